# Copyright 2026 The tetra_ros2 authors
#
# Licensed under the Apache License, Version 2.0 (the "License");
# you may not use this file except in compliance with the License.
# You may obtain a copy of the License at
#
#     http://www.apache.org/licenses/LICENSE-2.0
#
# Unless required by applicable law or agreed to in writing, software
# distributed under the License is distributed on an "AS IS" BASIS,
# WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied.
# See the License for the specific language governing permissions and
# limitations under the License.

"""What bodies with mass are made of; MuJoCo is not needed to say it."""

from dataclasses import dataclass, field
import math

import numpy as np
from numpy.typing import ArrayLike, NDArray
from tetra_ros2.formation import gimbal, rotation
from tetra_ros2.formation.gimbal import ENDLESS, Limits

Vector = tuple[float, float, float]


class BodyError(ValueError):
    """Bodies that cannot be; ``key`` names the parameter at fault, or is None for the file."""

    def __init__(self, problem: str, key: str | None = None) -> None:
        super().__init__(problem)
        self.key = key


@dataclass(frozen=True)
class RateLoop:
    """
    What turns a commanded rate into torques.

    :param bandwidth: k of ``dw/dt = k (u - w)`` [1/s]
    :param feedforward: whether it makes up for the gyroscopic torque; for a gimbal, for what the
        motion of one joint does to the other
    :param noise: standard deviation of a sample of the gyro, per axis [rad/s]
    :param bias: standard deviation of the gyro's constant error, per axis [rad/s]
    """

    bandwidth: float = 100.0
    feedforward: bool = True
    noise: float = 0.0
    bias: float = 0.0


@dataclass(frozen=True)
class Wheels:
    """
    A free-floating box with three reaction wheels along its axes.

    :param mass: of the box [kg]
    :param body_inertia: of the box without its wheels, about its axes [kg m^2]
    :param inertia: of a wheel about its axis [kg m^2]
    :param torque_limit: of a wheel's motor [N m]
    :param speed_limit: of a wheel [rad/s]
    :param disturbance: a torque on each body, constant in the world [N m]
    :raises BodyError: if no solid has such moments of inertia
    """

    mass: float = 2.0
    body_inertia: Vector = (0.010, 0.012, 0.014)
    inertia: float = 2e-4
    torque_limit: float = 0.1
    speed_limit: float = 600.0
    disturbance: Vector = (0.0, 0.0, 0.0)

    def __post_init__(self) -> None:
        """Check what no range of a single number can."""
        smallest, middle, largest = sorted(self.body_inertia)
        if not (smallest > 0.0 and largest <= smallest + middle):
            raise BodyError(
                f'{list(self.body_inertia)} is not valid, expected three numbers above 0, none '
                'above the sum of the other two', 'wheels.body_inertia')

    @property
    def total_inertia(self) -> Vector:
        """Return the moments of inertia of box and wheels, the wheels at rest in it [kg m^2]."""
        x, y, z = self.body_inertia
        # A wheel is a thin disc: half as much across its axis, and there are two of those.
        return x + 2.0 * self.inertia, y + 2.0 * self.inertia, z + 2.0 * self.inertia

    @property
    def rate_limit(self) -> float:
        """Return the angular velocity [rad/s] that the wheels can give the box about any axis."""
        return self.inertia * self.speed_limit / max(self.total_inertia)

    @property
    def acceleration_limit(self) -> float:
        """Return the angular acceleration [rad/s^2] that they can give it about any axis."""
        return self.torque_limit / max(self.total_inertia)

    def lifetime(self, rate: float) -> float:
        """
        Return how long [s] the wheels last, from rest, at a body rate [rad/s].

        Box and wheels keep their momentum together, so that a spin uses up nothing: what fills
        the wheels is the disturbance, at a constant rate.
        """
        left = self.inertia * self.speed_limit - max(self.total_inertia) * rate
        torque = math.sqrt(sum(t * t for t in self.disturbance))
        return 0.0 if left <= 0.0 else left / torque if torque else math.inf


@dataclass(frozen=True)
class Gimbal:
    """
    A pan-tilt gimbal on a fixed base; see :mod:`tetra_ros2.formation.gimbal`.

    :param pan_limits: of the pan joint [rad]
    :param tilt_limits: of the tilt joint [rad]
    :param rate_limit: of either joint [rad/s]
    :param torque_limit: of either motor [N m]
    :param mounting: attitudes of the bases, unit quaternions x y z w, one for all or one each
    :raises BodyError: if limits are not in order
    """

    pan_limits: Limits = ENDLESS
    tilt_limits: Limits = (-1.8, 1.8)
    rate_limit: float = 10.0
    torque_limit: float = 1.0
    mounting: tuple[tuple[float, float, float, float], ...] = field(
        default=((0.0, 0.0, 0.0, 1.0),))

    def __post_init__(self) -> None:
        """Check the order of the limits."""
        for name in ('pan_limits', 'tilt_limits'):
            low, high = getattr(self, name)
            if not low < high:
                raise BodyError(f'{[low, high]} is not valid, expected a lower and an upper '
                                'limit in rad, or nothing for none', f'gimbal.{name}')


@dataclass(frozen=True)
class Physics:
    """
    All that there is to say of the bodies.

    :param body: ``wheels``, ``gimbal``, or the path of an MJCF file
    :param rate: steps of the physics and of the rate loop per second [Hz]
    :param loop: the rate loop
    :param wheels: of ``wheels``; the speed limit and the disturbance of a file's too
    :param gimbal: of ``gimbal``; the limits of a file's too, where it gives none itself
    :param seed: of the gyro
    """

    body: str
    rate: float = 1000.0
    loop: RateLoop = field(default_factory=RateLoop)
    wheels: Wheels = field(default_factory=Wheels)
    gimbal: Gimbal = field(default_factory=Gimbal)
    seed: int = 0

    def __post_init__(self) -> None:
        """Check that the rate loop can follow itself from step to step."""
        if not self.loop.bandwidth < 2.0 * self.rate:
            raise BodyError(
                f'{self.loop.bandwidth:g} is not valid, expected less than twice physics_rate, '
                f'{2.0 * self.rate:g}: the rate loop would not be stable', 'rate_loop.bandwidth')

    def can_point(self, attitudes: ArrayLike, axes: ArrayLike) -> NDArray[np.bool_]:
        """
        Return which bodies can point as they would at given attitudes, ``(n,)``.

        :param attitudes: unit quaternions x y z w, body to world, ``(n, 4)``
        :param axes: pointing axes in the body frames, ``(n, 3)``
        """
        attitudes = np.asarray(attitudes, dtype=float)
        if self.body != 'gimbal':
            return np.ones(len(attitudes), dtype=bool)
        gamma = rotation.rotate(attitudes, np.asarray(axes, dtype=float))
        directions = rotation.rotate(rotation.inverse(np.array(self.gimbal.mounting)), gamma)
        return np.array([
            gimbal.angles(d.tolist(), self.gimbal.pan_limits, self.gimbal.tilt_limits) is not None
            for d in directions])
