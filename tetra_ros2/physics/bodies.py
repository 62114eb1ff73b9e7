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

"""
Bodies that turn by torques, in the place of those that turn as they are told.

They have the interface of :class:`~tetra_ros2.formation.bodies.RigidBodies`: a command is a body
rate, held for a time. Inside of that, physics and rate loop take steps of their own. A run is a
pure function of start, commands and seed, to the last bit.
"""

from abc import ABC, abstractmethod
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
import math

import mujoco
import numpy as np
from numpy.typing import ArrayLike, NDArray
from tetra_ros2.formation import gimbal, rotation
from tetra_ros2.formation._types import JointLimits, Quaternion, Vector
from tetra_ros2.formation.bodies import RigidBodies
from tetra_ros2.physics import models
from tetra_ros2.physics.settings import BodyError, Physics

Array = NDArray[np.float64]

ARC_RADIUS, ARC_POINTS = 0.16, 33
"""Of the arcs that show how far a gimbal's joints can go [m]."""

NEAR_LIMIT = 1e-3
"""A joint nearer to its limit than this is at it [rad]."""


@dataclass(frozen=True)
class Part:
    """
    A part of a body, as it looks, or an arc that shows what a joint of it can do.

    :param body: whose it is, counted from 0
    :param kind: ``box``, ``cylinder``, ``sphere`` or ``arc``
    :param size: its lengths along its own axes [m]; of an arc, its radius
    :param position: of its middle, from the origin of the vehicle, in the world [m]
    :param attitude: a unit quaternion x y z w, part to world
    :param points: of an arc, in its own frame [m]
    :param at_limit: of an arc, whether the joint is at an end of it
    """

    body: int
    kind: str
    size: Vector
    position: Vector
    attitude: Quaternion
    points: tuple[Vector, ...] = ()
    at_limit: bool = False


_KINDS = {mujoco.mjtGeom.mjGEOM_BOX: 'box', mujoco.mjtGeom.mjGEOM_CYLINDER: 'cylinder',
          mujoco.mjtGeom.mjGEOM_CAPSULE: 'cylinder', mujoco.mjtGeom.mjGEOM_SPHERE: 'sphere',
          mujoco.mjtGeom.mjGEOM_ELLIPSOID: 'sphere'}
"""What a geometry of MuJoCo's is shown as; meshes and planes are not shown."""


@dataclass(frozen=True)
class Joints:
    """
    The joints of a body at one time.

    :param names: of the joints
    :param positions: [rad]
    :param velocities: [rad/s]
    :param efforts: of their motors [N m]
    """

    names: tuple[str, ...]
    positions: tuple[float, ...]
    velocities: tuple[float, ...]
    efforts: tuple[float, ...]


class PhysicalBodies(RigidBodies, ABC):
    """
    What floating bodies and gimbals have in common.

    :ivar saturated: for each body, in words, what was at its limit in the last step
    :ivar saturated_steps: for each body, in how many steps anything was
    :ivar diverged_steps: in how many steps the numbers of the physics got out of hand; all bodies
        were then put back, at rest, to where the step had begun

    :param attitudes: unit quaternions x y z w, body to world, n of them
    :param axes: pointing axes in the body frames, unit vectors (x, y, z), n of them
    :param physics: what they are made of
    :param vehicle: the same as a model
    """

    def __init__(self, attitudes: ArrayLike, axes: ArrayLike, physics: Physics,
                 vehicle: models.Vehicle) -> None:
        self.physics = physics
        self._vehicle = vehicle
        self._axes = np.array(axes, dtype=float)
        n = len(self._axes)
        self._mounting = np.broadcast_to(
            models.LEVEL if vehicle.floats else np.array(physics.gimbal.mounting), (n, 4))
        self._model = models.assemble(vehicle, self._mounting)
        self._data = mujoco.MjData(self._model)
        self._origins = models.origins(n)
        self._random = np.random.default_rng([physics.seed, 0x6779726f])
        self._bias = physics.loop.bias * self._random.standard_normal((n, 3))
        self.saturated: list[tuple[str, ...]] = [()] * n
        self.saturated_steps = [0] * n
        self.diverged_steps = 0
        self._velocities = self._data.qvel.reshape(n, -1)
        self._controls = self._data.ctrl.reshape(n, -1)
        super().__init__(self._place(np.array(attitudes, dtype=float)), self._axes)

    @abstractmethod
    def _place(self, attitudes: Array) -> Array:
        """Put the bodies where they start, at rest; return the attitudes that they then have."""

    @abstractmethod
    def _substep(self, commands: Array, dt: float) -> None:
        """Set the motors, and let physics take one step."""

    @abstractmethod
    def _attitudes(self) -> Array:
        """Return the attitudes as of now."""

    @abstractmethod
    def _saturation(self) -> list[tuple[str, ...]]:
        """Return for each body what was at its limit since :meth:`_forget`."""

    @abstractmethod
    def _forget(self) -> None:
        """Begin to note anew what is at its limit."""

    def step(self, h: float, rates: Iterable[Sequence[float]]) -> None:
        """
        Command every body a constant rate for a time ``h`` [s].

        :param h: the time [s]
        :param rates: angular velocities w_i (x, y, z) in the body frames [rad/s]
        """
        commands = np.array(list(rates), dtype=float)
        count = max(1, round(h * self.physics.rate))
        dt = self._model.opt.timestep = h / count
        self._forget()
        before = self._data.qpos.copy()
        for _ in range(count):
            self._substep(commands, dt)
        if any(self._data.warning.number):
            self._put_back(before)
        for i, attitude in enumerate(self._attitudes().tolist()):
            self.attitudes[i] = tuple(attitude)
            self._refresh(i, *attitude)
        self.saturated = self._saturation()
        for i, what in enumerate(self.saturated):
            self.saturated_steps[i] += bool(what)

    def _put_back(self, positions: Array) -> None:
        """Let all bodies rest where they were: MuJoCo has put them where their file has them."""
        outside = self._data.xfrc_applied.copy()
        mujoco.mj_resetData(self._model, self._data)
        self._data.qpos[:] = positions
        self._data.xfrc_applied[:] = outside
        mujoco.mj_forward(self._model, self._data)
        self.diverged_steps += 1

    def _measured(self, rates: Array) -> Array:
        """Return what the gyros say of body rates, ``(n, 3)``."""
        noise = self.physics.loop.noise
        if noise:
            rates = rates + noise * self._random.standard_normal(rates.shape)
        return rates + self._bias

    @abstractmethod
    def joints(self, i: int) -> Joints:
        """Return the joints of body i, counted from 0."""

    @abstractmethod
    def limits(self) -> dict[str, JointLimits]:
        """Return what each joint can do, by its name: the same for all bodies."""

    def parts(self) -> list[Part]:
        """Return what the bodies look like, as of now."""
        model = self._model
        shown = mujoco.MjData(model)  # of its own, so that looking changes nothing
        shown.qpos[:] = self._data.qpos
        mujoco.mj_kinematics(model, shown)
        quaternion = np.zeros(4)
        made = []
        for g in range(model.ngeom):
            kind = _KINDS.get(mujoco.mjtGeom(model.geom_type[g]))
            if kind is None:
                continue
            i = int(model.geom(g).name.partition('/')[0].removeprefix('agent_')) - 1
            x, y, z = model.geom_size[g].tolist()
            size = {'box': (2.0 * x, 2.0 * y, 2.0 * z), 'cylinder': (2.0 * x, 2.0 * x, 2.0 * y),
                    'sphere': (2.0 * x, 2.0 * (y or x), 2.0 * (z or x))}[kind]
            mujoco.mju_mat2Quat(quaternion, shown.geom_xmat[g])
            w, qx, qy, qz = quaternion.tolist()
            px, py, pz = (shown.geom_xpos[g] - self._origins[i]).tolist()
            made.append(Part(i, kind, size, (px, py, pz), (qx, qy, qz, w)))
        return made


class FloatingBodies(PhysicalBodies):
    """Bodies that float, turned by wheels or by whatever motors their file gives them."""

    def _place(self, attitudes: Array) -> Array:
        n = len(attitudes)
        self._positions = self._data.qpos.reshape(n, -1)
        self._positions[:, 3:7] = attitudes[:, [3, 0, 1, 2]]
        vehicle, wheels = self._vehicle, self.physics.wheels
        speed = np.where(vehicle.wheel >= 0, wheels.speed_limit, np.inf)
        self._speed_limits = speed
        self._has_wheels = bool(np.any(vehicle.wheel >= 0))
        self._wheel_columns = 6 + np.maximum(vehicle.wheel, 0)
        # What the reaction wheels answer is the wheel's own acceleration, relative to the box.
        self._response = np.where(vehicle.wheel_response > 0.0, vehicle.wheel_response, 1.0)
        if any(wheels.disturbance):
            for i in range(1, n + 1):
                body = self._model.body(f'agent_{i}/{models.BODY}').id
                self._data.xfrc_applied[body, 3:] = wheels.disturbance
        self._torque_seen = np.zeros(n, dtype=bool)
        self._speed_seen = np.zeros(n, dtype=bool)
        return attitudes

    def _substep(self, commands: Array, dt: float) -> None:
        loop, vehicle, velocities = self.physics.loop, self._vehicle, self._velocities
        rates = self._measured(velocities[:, 3:6])
        wanted = loop.bandwidth * (commands - rates)
        if loop.feedforward:
            momentum = velocities @ vehicle.momentum.T
            x, y, z = rates.T
            hx, hy, hz = momentum.T
            gyroscopic = np.stack([y * hz - z * hy, z * hx - x * hz, x * hy - y * hx], axis=1)
            wanted += gyroscopic @ vehicle.compliance
        torques = wanted @ vehicle.allocation.T
        # All by the same factor: the direction of the torque is worth more than its size.
        excess = np.max(np.abs(torques) / vehicle.torque_limits, axis=1)
        self._torque_seen |= excess > 1.0
        torques /= np.maximum(excess, 1.0)[:, None]
        if self._has_wheels:
            torques = self._within_speeds(torques, dt)
        self._controls[:] = torques
        mujoco.mj_step(self._model, self._data)

    def _within_speeds(self, torques: Array, dt: float) -> Array:
        """Return torques that take no wheel beyond its speed limit within a step."""
        speeds = self._velocities[:, self._wheel_columns]
        room = 1.0 / (dt * self._response)
        within = np.clip(torques, (-self._speed_limits - speeds) * room,
                         (self._speed_limits - speeds) * room)
        clipped = within != torques
        if not clipped.any():
            return torques
        self._speed_seen |= clipped.any(axis=1)
        # A wheel beyond its limit is not braked harder than its motor can.
        return np.clip(within, -self._vehicle.torque_limits, self._vehicle.torque_limits)

    def _attitudes(self) -> Array:
        attitudes = self._positions[:, [4, 5, 6, 3]]
        unit: Array = attitudes / np.linalg.norm(attitudes, axis=1, keepdims=True)
        return unit

    def _forget(self) -> None:
        self._torque_seen[:] = self._speed_seen[:] = False

    def _saturation(self) -> list[tuple[str, ...]]:
        return [('torque',) * bool(t) + ('wheel speed',) * bool(s)
                for t, s in zip(self._torque_seen, self._speed_seen)]

    def angular_momentum(self) -> Array:
        """Return the momentum of each body with its wheels, in the world [N m s], ``(n, 3)``."""
        momentum = self._velocities @ self._vehicle.momentum.T
        world: Array = rotation.rotate(self._attitudes(), momentum)
        return world

    def joints(self, i: int) -> Joints:
        """Return the joints of body i, counted from 0."""
        wheel = self._vehicle.wheel
        efforts = [0.0] * len(self._vehicle.joints)
        for motor, w in enumerate(wheel):
            if w >= 0:
                efforts[w] = float(self._controls[i, motor])
        return Joints(self._vehicle.joints, tuple(self._positions[i, 7:].tolist()),
                      tuple(self._velocities[i, 6:].tolist()), tuple(efforts))

    def limits(self) -> dict[str, JointLimits]:
        """Return what each joint can do, by its name: the same for all bodies."""
        vehicle = self._vehicle
        torque = {int(w): float(limit) for w, limit in zip(vehicle.wheel, vehicle.torque_limits)}
        speed = self.physics.wheels.speed_limit
        return {
            name: JointLimits(low, high, speed if k in torque else math.inf,
                              torque.get(k, math.inf))
            for k, (name, (low, high)) in enumerate(zip(vehicle.joints, vehicle.limits.tolist()))}


class Gimbals(PhysicalBodies):
    """
    Pan-tilt gimbals: what they are told about their pointing axes comes to nothing.

    :raises BodyError: if the limits exclude where one is to start
    """

    def _place(self, attitudes: Array) -> Array:
        n = len(attitudes)
        settings, vehicle = self.physics.gimbal, self._vehicle
        given = np.array([settings.pan_limits, settings.tilt_limits])
        self._limits = np.where(np.isfinite(vehicle.limits), vehicle.limits, given)
        self._crooked = rotation.between(np.array([1.0, 0.0, 0.0]), self._axes)
        self._positions = self._data.qpos.reshape(n, 2)
        for i, direction in enumerate(self._directions(attitudes)):
            angles = gimbal.angles(direction.tolist(), tuple(self._limits[0].tolist()),
                                   tuple(self._limits[1].tolist()))
            if angles is None:
                raise BodyError(
                    f'agent {i + 1} starts along {np.round(direction, 4).tolist()} of its base, '
                    'which the limits of the gimbal exclude', 'gimbal.tilt_limits')
            self._positions[i] = angles
        self._inertia = np.zeros((2 * n, 2 * n))
        self._torque_seen = np.zeros((n, 2), dtype=bool)
        self._rate_seen = np.zeros((n, 2), dtype=bool)
        self._limit_seen = np.zeros((n, 2), dtype=bool)
        mujoco.mj_forward(self._model, self._data)
        return self._attitudes()

    def _directions(self, attitudes: Array) -> Array:
        """Return where the bodies point, in the frames of their bases, ``(n, 3)``."""
        gamma = rotation.rotate(attitudes, self._axes)
        directions: Array = rotation.rotate(rotation.inverse(self._mounting), gamma)
        return directions

    def _substep(self, commands: Array, dt: float) -> None:
        loop, settings, model, data = self.physics.loop, self.physics.gimbal, self._model, \
            self._data
        mujoco.mj_step1(model, data)
        tilt = self._positions[:, 1]
        cosine, sine = np.cos(tilt), np.sin(tilt)
        safe = cosine / np.maximum(cosine * cosine, gimbal.DAMPING**2)
        told = rotation.rotate(rotation.inverse(self._crooked), commands)
        if loop.feedforward:
            # The joints roll the body about its pointing axis; what was commanded does not roll.
            c, s = np.cos(self._roll), np.sin(self._roll)
            told = np.stack([told[:, 0], c * told[:, 1] + s * told[:, 2],
                             c * told[:, 2] - s * told[:, 1]], axis=1)
        wanted = np.stack([told[:, 2] * safe, told[:, 1]], axis=1)
        limited = np.clip(wanted, -settings.rate_limit, settings.rate_limit)
        self._rate_seen |= limited != wanted
        # Near a limit, no faster towards it than the servo can brake without overshooting.
        braking = 0.25 * loop.bandwidth
        low, high = self._limits[:, 0], self._limits[:, 1]
        held = np.clip(limited, braking * (low - self._positions),
                       braking * (high - self._positions))
        self._limit_seen |= (held != limited) & (np.minimum(
            high - self._positions, self._positions - low) < NEAR_LIMIT)
        pan_rate, tilt_rate = self._velocities.T
        measured = self._velocities
        if loop.noise or loop.bias:
            # The gyro is in what points; the joints' rates are told from it.
            gyro = self._measured(np.stack(
                [-sine * pan_rate, tilt_rate, cosine * pan_rate], axis=1))
            measured = np.stack([gyro[:, 2] * safe, gyro[:, 1]], axis=1)
        acceleration = loop.bandwidth * (held - measured)
        torques = np.zeros_like(acceleration)
        if loop.feedforward:
            # What keeps the pointing axis on a great circle, and what the joints do to each other.
            acceleration[:, 0] += 2.0 * sine * safe * pan_rate * tilt_rate
            acceleration[:, 1] -= sine * cosine * pan_rate * pan_rate
            torques += data.qfrc_bias.reshape(-1, 2)
        mujoco.mj_fullM(model, data, self._inertia)
        torques += (self._inertia @ acceleration.ravel()).reshape(-1, 2)
        possible = np.clip(torques, -self._vehicle.torque_limits, self._vehicle.torque_limits)
        self._torque_seen |= possible != torques
        self._controls[:] = possible
        self._roll -= dt * sine * pan_rate
        mujoco.mj_step2(model, data)

    def _attitudes(self) -> Array:
        pan, tilt = 0.5 * self._positions.T
        turned = np.stack([-np.sin(pan) * np.sin(tilt), np.cos(pan) * np.sin(tilt),
                           np.sin(pan) * np.cos(tilt), np.cos(pan) * np.cos(tilt)], axis=1)
        attitudes = rotation.multiply(self._mounting, rotation.multiply(
            turned, rotation.inverse(self._crooked)))
        unit: Array = attitudes / np.linalg.norm(attitudes, axis=1, keepdims=True)
        return unit

    def parts(self) -> list[Part]:
        """Return what the bodies look like as of now, and how far their joints can go."""
        shown = super().parts()
        for i, (pan, _) in enumerate(self._positions.tolist()):
            turned = rotation.multiply(
                self._mounting[i], [0.0, 0.0, math.sin(0.5 * pan), math.cos(0.5 * pan)])
            for joint, base in ((0, self._mounting[i]), (1, turned)):
                low, high = self._limits[joint].tolist()
                if not -math.inf < low < high < math.inf:
                    continue
                angles = np.linspace(low, min(high, low + 2.0 * math.pi), ARC_POINTS)
                c, s, o = np.cos(angles), np.sin(angles), np.zeros(ARC_POINTS)
                points = ARC_RADIUS * np.stack([c, o, -s] if joint else [c, s, o], axis=1)
                x, y, z, w = base.tolist()
                shown.append(Part(
                    i, 'arc', (ARC_RADIUS, ARC_RADIUS, ARC_RADIUS), (0.0, 0.0, 0.0),
                    (x, y, z, w), tuple(map(tuple, points.tolist())),
                    bool(self._limit_seen[i, joint])))
        return shown

    def _forget(self) -> None:
        self._roll = np.zeros(len(self.axes))  # since the command began to count
        for seen in (self._torque_seen, self._rate_seen, self._limit_seen):
            seen[:] = False

    def _saturation(self) -> list[tuple[str, ...]]:
        return [tuple(f'{joint} {what}' for what, seen in
                      (('limit', self._limit_seen), ('rate', self._rate_seen),
                       ('torque', self._torque_seen))
                      for joint, yes in zip((models.PAN, models.TILT), seen[i]) if yes)
                for i in range(len(self.saturated))]

    def joints(self, i: int) -> Joints:
        """Return the joints of body i, counted from 0."""
        return Joints(self._vehicle.joints, tuple(self._positions[i].tolist()),
                      tuple(self._velocities[i].tolist()), tuple(self._controls[i].tolist()))

    def limits(self) -> dict[str, JointLimits]:
        """Return what each joint can do, by its name: the same for all bodies."""
        rate = self.physics.gimbal.rate_limit
        return {name: JointLimits(low, high, rate, torque) for name, (low, high), torque in zip(
            self._vehicle.joints, self._limits.tolist(), self._vehicle.torque_limits.tolist())}


def make_bodies(attitudes: ArrayLike, axes: ArrayLike, physics: Physics,
                vehicle: models.Vehicle | None = None) -> PhysicalBodies:
    """
    Return bodies at rest.

    :param attitudes: unit quaternions x y z w, body to world, n of them
    :param axes: pointing axes in the body frames, unit vectors (x, y, z), n of them
    :param physics: what they are made of
    :param vehicle: the same as a model, where it was loaded already
    :raises BodyError: if there are none such, or they cannot start there
    """
    if vehicle is None:
        vehicle = models.load(physics)
    kind = FloatingBodies if vehicle.floats else Gimbals
    return kind(attitudes, axes, physics, vehicle)
