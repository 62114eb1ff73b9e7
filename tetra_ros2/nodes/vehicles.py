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

"""The plant's bodies: kinematic or with mass, here or elsewhere, and their emergency stop."""

from collections.abc import Callable, Collection, Mapping, Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray
from sensor_msgs.msg import JointState
from tetra_ros2.config.bodies import physics_from_parameters
from tetra_ros2.config.parameters import ConfigurationError
from tetra_ros2.formation import Formation, rotation
from tetra_ros2.formation._types import Quaternion, Vector
from tetra_ros2.formation.bodies import RigidBodies
from tetra_ros2.nodes.measurements import NOBODY
from tetra_ros2.nodes.poses import Poses
from tetra_ros2.ros import qos
from tetra_ros2.ros.body_markers import BodyMarkers
from tetra_ros2.ros.node import FormationNode, raw_publish
from tetra_ros2.wire import names
from tetra_ros2.wire.joints import joint_state, limits_to_diagnostics

STILL: Vector = (0.0, 0.0, 0.0)

MOST_DRAWS = 10_000
"""After how many random starts that a gimbal cannot point at there is taken to be none."""


class Vehicles:
    """
    Makes the plant's bodies, and tells of them what only these have to tell.

    :param plant: the node
    :param values: its parameters
    :param formation: what they say of the formation
    :raises ConfigurationError: if there are no such bodies
    """

    def __init__(self, plant: FormationNode, values: Mapping[str, Any],
                 formation: Formation) -> None:
        self._axes = np.asarray(formation.pointing_axes)
        n = len(self._axes)
        self.physics = physics_from_parameters(values, n)
        self._vehicle: Any = None
        if self.physics is not None:
            from tetra_ros2.physics import models  # MuJoCo is an extra
            self._vehicle = models.load(self.physics)
        external = values['external_bodies']
        self.poses = Poses(plant, values, external, n) if external else None
        self._encoders: list[Callable[..., bytes]] = []
        self._senders: list[Callable[[bytes], None]] = []
        if self._vehicle is not None and self._vehicle.joints:
            for i in range(1, n + 1):
                self._senders.append(raw_publish(
                    plant.offer(JointState, names.joint_states(i), qos.NEWEST)))
                self._encoders.append(joint_state(names.body_frame(i), self._vehicle.joints))
        self._bodies: Any = None  # those that are simulated
        self._stamp = 0
        if self._vehicle is not None:
            self._markers = BodyMarkers(plant, lambda: (
                self._stamp, self._bodies.reduced, self._bodies.parts()))
        self._saturated_before: list[int] = [0] * n

    def draw(self, rng: np.random.Generator) -> NDArray[np.float64]:
        """
        Return random attitudes at which the bodies can start, ``(n, 4)``.

        :raises ConfigurationError: if there are none
        """
        attitudes: NDArray[np.float64] = rotation.random(rng, (len(self._axes),))
        if self.physics is None:
            return attitudes
        for _ in range(MOST_DRAWS):
            bad = np.flatnonzero(~self.physics.can_point(attitudes, self._axes))
            if not len(bad):
                return attitudes
            attitudes[bad] = rotation.random(rng, (len(bad),))
        raise ConfigurationError(
            'no random start is within the limits of the gimbals', key='gimbal.tilt_limits')

    def make(self, attitudes: NDArray[np.float64]) -> 'RigidBodies | PartlyElsewhere':
        """
        Return bodies at rest.

        :param attitudes: where they start, unit quaternions x y z w, ``(n, 4)``
        :raises ConfigurationError: if they cannot start there
        """
        self._saturated_before = [0] * len(self._axes)  # new bodies count anew
        if self.physics is None:
            self._bodies = RigidBodies(attitudes, self._axes)
        else:
            from tetra_ros2.physics.bodies import make_bodies  # as above
            from tetra_ros2.physics.settings import BodyError
            try:
                self._bodies = make_bodies(
                    attitudes, self._axes, self.physics, self._vehicle)
            except BodyError as error:
                raise ConfigurationError(str(error), key=error.key) from None
        if self.poses is None:
            return self._bodies  # type: ignore[no-any-return]
        return PartlyElsewhere(self._bodies, self.poses)

    def tell(self, stamp: int) -> None:
        """Publish the joints as of a time [ns]."""
        self._stamp = stamp
        for i, (send, encode) in enumerate(zip(self._senders, self._encoders)):
            joints = self._bodies.joints(i)
            send(encode(stamp, *joints.positions, *joints.velocities, *joints.efforts))

    def assess(self) -> tuple[str, dict[str, Any]]:
        """Return what is wrong with the bodies, or nothing, and figures for the diagnostics."""
        problems: list[str] = []
        values: dict[str, Any] = {}
        if self.physics is not None:
            values['body'] = self.physics.body
            values.update(limits_to_diagnostics(self._bodies.limits()))
            for i, (what, steps) in enumerate(
                    zip(self._bodies.saturated, self._bodies.saturated_steps)):
                name = names.agent(i + 1)
                values[f'saturated steps of {name}'] = steps
                # What was so in any step since the last report, not in the last step alone.
                if steps > self._saturated_before[i] or what:
                    problems.append(f'{name}: {", ".join(what) or "saturated for a while"}')
                self._saturated_before[i] = steps
        text = f'at a limit: {"; ".join(problems)}' if problems else ''
        if self.physics is not None and (diverged := self._bodies.diverged_steps):
            values['diverged steps'] = diverged
            text = '; '.join(filter(None, (text, 'the physics has diverged, and put the bodies '
                                           'to rest: they need a higher physics_rate')))
        if self.poses is not None:
            lost, figures = self.poses.assess()
            values.update(figures)
            if lost:
                text = '; '.join(filter(None, (text, f'poses: {lost}')))
        return text, values


class PartlyElsewhere:
    """
    Bodies some of which are simulated, and some are where their poses say.

    :param bodies: all of them, as simulated
    :param poses: of those that are elsewhere
    """

    def __init__(self, bodies: RigidBodies, poses: Poses) -> None:
        self._bodies, self._poses = bodies, poses
        self.axes = bodies.axes
        self.lost: Collection[int] = NOBODY
        self.seen_by = bodies.seen_by
        self.look()

    @property
    def attitudes(self) -> list[Quaternion]:
        """Return the attitudes."""
        return self._bodies.attitudes

    @property
    def reduced(self) -> list[Vector]:
        """Return the reduced attitudes."""
        return self._bodies.reduced

    def step(self, h: float, rates: Sequence[Vector]) -> None:
        """Let the simulated bodies move; the others do so by themselves."""
        self._poses.told(rates, h)
        mine = list(rates)
        for i in self._poses.trackers:
            mine[i] = STILL
        self._bodies.step(h, mine)

    def look(self) -> None:
        """Take the poses as they are now."""
        known = self._poses.attitudes()
        for i, attitude in known.items():
            self._bodies.place(i, attitude)
        self.lost = frozenset(self._poses.trackers.keys() - known.keys())
