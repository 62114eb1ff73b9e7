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
Sensors apart from the plant: what everybody sees, from poses that come from elsewhere.

With motion capture and the bodies' own drivers there is no plant. This node takes the poses of
all bodies, and publishes the state and the relative attitudes of the graph as the plant would.
"""

from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
import time
from typing import Any

from geometry_msgs.msg import TwistStamped
from tetra_ros2.config.bodies import check_poses
from tetra_ros2.config.configuration import formation_from_parameters
from tetra_ros2.formation import rotation
from tetra_ros2.formation._types import Vector
from tetra_ros2.formation.bodies import RigidBodies
from tetra_ros2.formation.checks import Rejected
from tetra_ros2.nodes.measurements import Measurements
from tetra_ros2.nodes.poses import Poses
from tetra_ros2.ros import diagnostics, executor, parameters, qos
from tetra_ros2.ros.node import FormationNode
from tetra_ros2.wire import cdr, names

STILL: Vector = (0.0, 0.0, 0.0)


class Sensors(FormationNode):
    """
    The node ``sensors``.

    :param kwargs: what rclpy's Node takes beside its name
    :raises ConfigurationError: if a parameter is not valid, or the poses are of another type
    """

    def __init__(self, **kwargs: Any) -> None:
        super().__init__(names.SENSORS, **kwargs)
        values = parameters.declare(self, 'sensors', self._accept, lambda _: None)
        formation = formation_from_parameters(values)
        n = formation.topology.n
        everybody = range(1, n + 1)
        self.poses = Poses(self, values, everybody, n)
        self.bodies = RigidBodies([rotation.IDENTITY] * n, formation.pointing_axes)
        self._measurements = Measurements(self, formation.topology)
        self._rates = [STILL] * n  # the last commands: a body told nothing may well rest
        self.published = 0
        for i in everybody:
            self.listen(TwistStamped, names.cmd_vel(i), self._receiver(i), qos.COMMANDS)
        self.report_health(self.assess)
        self._told_at = time.monotonic()
        self._timer = self.create_timer(1.0 / values['rate'], self._on_timer)

    @staticmethod
    def _accept(values: Mapping[str, Any]) -> None:
        check_poses(values, formation_from_parameters(values).topology.n)

    def close(self) -> None:
        """Measure no more."""
        self._timer.cancel()

    def _receiver(self, i: int) -> Callable[[bytes], None]:
        decode = cdr.twist_stamped(names.body_frame(i)).decoder()

        def on_command(message: bytes) -> None:
            try:
                _, (_, _, _, x, y, z) = decode(message)
                self._rates[i - 1] = (x, y, z)
            except Rejected as rejection:
                self.health.reject(rejection, names.agent(i))
        return on_command

    def _on_timer(self) -> None:
        now = time.monotonic()
        self.poses.told(self._rates, now - self._told_at)
        self._told_at = now
        known = self.poses.attitudes()
        for i, attitude in known.items():
            self.bodies.place(i, attitude)
        if not known:
            return
        lost = frozenset(self.poses.trackers.keys() - known.keys())
        stamp = self.get_clock().now().nanoseconds
        self._measurements.publish(stamp, self.bodies, self.bodies.seen_by, lost)
        self.published += 1

    def assess(self) -> diagnostics.Assessment:
        """Return level, message and figures for the diagnostics."""
        lost, values = self.poses.assess()
        values.update(self.health.rates({'measurement rate [Hz]': self.published}))
        if not lost:
            return diagnostics.OK, 'measuring', values
        if self.poses.waiting:
            return diagnostics.WARN, f'waiting for poses: {lost}', values
        return diagnostics.ERROR, f'not measured: {lost}', values


def main(config: str | Path | None = None, arguments: Sequence[str] = ()) -> int:
    """Run the sensors until they are signalled; see :func:`tetra_ros2.ros.executor.run`."""
    return executor.run(Sensors, config, arguments)
