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

"""What a formation asks of its bodies, and what they make of it; MuJoCo is not needed."""

from dataclasses import dataclass
import math

import numpy as np
from tetra_ros2.formation import Formation, measures, sensing
from tetra_ros2.formation.analysis import attractor
from tetra_ros2.formation.rate_loop import acceleration_bound, min_bandwidth, rate_loop_equilibrium
from tetra_ros2.physics.settings import Physics


@dataclass(frozen=True)
class Demands:
    """
    What theory says of bodies with a rate loop.

    :param body: what turns
    :param bandwidth: of the rate loop [1/s]
    :param slowest_rate: of the formation with it, where commands change all the time [1/s]
    :param sampled_rate: the same at the rate and delay of the plant [1/s]; negative if it grows
    :param spin_rate: at which the formation then spins [rad/s]
    :param offset: how far rate loop, sampling and delay take the angles from the shape [rad]
    :param min_bandwidth: above which the formation is stable, where commands change all the time
        [1/s]; 0 if any will do
    :param sampled_min_bandwidth: the same at the rate and delay of the plant [1/s]; None if none
        will do
    :param body_rate: the largest angular velocity of a body, once it spins [rad/s]
    :param angular_acceleration: the largest that the spin asks of a body [rad/s^2]
    :param saturation_rate: from which difference between command and rate on a motor is at its
        limit [rad/s]; None where that is not known beforehand
    :param torque: that the spin asks of a motor [N m]; None as above
    :param torque_limit: what it has [N m]
    :param enough_torque: with a limit above this a motor is saturated once at most, after a start
        from rest: :func:`~tetra_ros2.formation.rate_loop.acceleration_bound` [N m]
    :param wheel_speed: that the spin asks of a wheel, at most [rad/s]
    :param wheel_speed_limit: what it has [rad/s]
    :param rate_limit: how fast the wheels can turn a body [rad/s]
    :param momentum: that the spin asks of the wheels [N m s]
    :param lifetime: how long they last under the disturbance [s]; None for ever
    """

    body: str
    bandwidth: float
    slowest_rate: float
    sampled_rate: float
    spin_rate: float
    offset: float
    min_bandwidth: float
    sampled_min_bandwidth: float | None
    body_rate: float
    angular_acceleration: float
    saturation_rate: float | None = None
    torque: float | None = None
    torque_limit: float | None = None
    enough_torque: float | None = None
    wheel_speed: float | None = None
    wheel_speed_limit: float | None = None
    rate_limit: float | None = None
    momentum: float | None = None
    lifetime: float | None = None

    @property
    def is_stable(self) -> bool:
        """Return whether the formation is stable with this rate loop, rate and delay."""
        return self.sampled_rate > 0.0


def demands(formation: Formation, physics: Physics, *, rate: float, delay: float) -> Demands:
    """
    Return what a formation asks of its bodies.

    :param formation: the formation
    :param physics: what its bodies are made of
    :param rate: of the loop [Hz]
    :param delay: how old the measurements are [s]
    :raises tetra_ros2.formation.analysis.NotAnalyzable: if there is no formation to analyse
    """
    weights, gain, k = formation.topology.weights, formation.gain, physics.loop.bandwidth
    equilibrium, _ = attractor(formation)
    gamma = equilibrium.gamma
    h = round(1e9 / rate) / 1e9
    steps = sensing.delay_in_steps(delay, h)
    now = rate_loop_equilibrium(gamma, weights, gain, k)
    held = rate_loop_equilibrium(gamma, weights, gain, k, h=h, delay_steps=steps)
    least = min_bandwidth(gamma, weights, gain, h=h, delay_steps=steps)
    angles, shifted = (np.sort(measures.pairwise_angles(g)) for g in (gamma, held.gamma))
    body_rate = float(np.max(np.linalg.norm(held.rates, axis=-1)))
    acceleration = held.angular_acceleration
    if equilibrium.spins:
        spin = float(np.linalg.norm(held.spin))
    else:
        spin = body_rate = acceleration = 0.0
    more = {}
    if physics.body == 'wheels':
        wheels = physics.wheels
        inertia = max(wheels.total_inertia)
        lifetime = wheels.lifetime(body_rate)
        more = {
            'saturation_rate': wheels.acceleration_limit / k,
            'torque': inertia * acceleration,
            'torque_limit': wheels.torque_limit,
            'enough_torque': inertia * acceleration_bound(weights, gain),
            'wheel_speed': inertia * body_rate / wheels.inertia,
            'wheel_speed_limit': wheels.speed_limit,
            'rate_limit': wheels.rate_limit,
            'momentum': inertia * body_rate,
            'lifetime': None if math.isinf(lifetime) else lifetime,
        }
    return Demands(
        body=physics.body, bandwidth=k, slowest_rate=now.slowest_rate,
        sampled_rate=held.slowest_rate if held.is_stable() else min(held.slowest_rate, 0.0),
        spin_rate=spin, offset=float(np.max(np.abs(shifted - angles))),
        min_bandwidth=min_bandwidth(gamma, weights, gain),
        sampled_min_bandwidth=None if math.isinf(least) else least,
        body_rate=body_rate, angular_acceleration=acceleration, **more)
