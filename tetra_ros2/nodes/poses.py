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

"""Attitudes that come from elsewhere: motion capture, the drivers of bodies, TF."""

from collections.abc import Callable, Collection, Mapping, Sequence
import math
import time
from typing import Any

from geometry_msgs.msg import PoseArray, PoseStamped
from rclpy.expand_topic_name import expand_topic_name
from rclpy.serialization import deserialize_message
from tetra_ros2.config.parameters import ConfigurationError
from tetra_ros2.formation._types import Quaternion, Vector
from tetra_ros2.formation.checks import Rejected
from tetra_ros2.formation.tracking import FROZEN, TRACKED, Tracker, WAITING
from tetra_ros2.ros import executor, ports, qos
from tetra_ros2.ros.node import FormationNode
from tetra_ros2.wire import names

LOOKS, PAUSE = 160, 0.05
"""
How often to look for who publishes poses, and of which type, before listening; and the time
between two looks [s]. Not for how long: a machine that is busy finds others later. All of them
take more than two periods of Fast DDS, which announces a node every 3 s if the first announcement
was not heard.
"""

LOOKS_BEFORE_SAID = 20
"""After how many looks in vain to say what is looked for."""

REPORT_AGAIN = 0.2
"""How long after a report of lost bodies the next one may wait for its turn [s]."""


class Poses:
    """
    Listens to the poses of some bodies, and says what is known of their attitudes.

    Motion capture publishes with best effort, drivers reliably: a best-effort subscription takes
    both.

    :param node: the node that listens; what it counts as rejected is told in its diagnostics
    :param values: its parameters, with those of POSES
    :param bodies: the agents, from 1, whose bodies these are
    :param n: the number of agents
    :raises ConfigurationError: if somebody publishes something else there
    """

    def __init__(self, node: FormationNode, values: Mapping[str, Any], bodies: Collection[int],
                 n: int) -> None:
        self._node = node
        self._names = list(values['poses.names']) or [names.agent(i) for i in range(1, n + 1)]
        self._frame = values['poses.frame'] or None
        self._now: Callable[[], float] = time.monotonic
        self.trackers = {i - 1: Tracker(values['poses.timeout'], values['poses.max_rate'],
                                        values['poses.frozen_angle']) for i in sorted(bodies)}
        self._lost: frozenset[int] = frozenset(self.trackers)
        self._reported_at = -math.inf
        self._topics: dict[int, str] = {}  # of the bodies that have one each
        self._wanted: dict[str, str] = {}  # what type each topic should have
        source, topic = values['poses.source'], values['poses.topic']
        if source == 'tf':
            self._listen_to_transforms()
            return
        if source == 'array':
            topics: dict[str, Callable[[bytes], None]] = {topic: self._on_array}
            kind: type = PoseArray
        else:
            every = names.pose_topics(values, n)
            self._topics = {i: every[i + 1] for i in self.trackers}
            topics = {name: self._receiver(i) for i, name in self._topics.items()}
            kind = PoseStamped
        self._wanted = {
            expand_topic_name(name, node.get_name(), node.get_namespace()):
            f'geometry_msgs/msg/{kind.__name__}' for name in topics}
        self._refuse_other_types()
        for name, callback in topics.items():
            node.listen(kind, name, callback, qos.SENSORS)

    def _refuse_other_types(self) -> None:
        for look in range(LOOKS):
            if others := self._other_types():
                raise ConfigurationError(others[0], key='poses.topic')
            if executor.signalled() \
                    or self._wanted.keys() <= dict(self._node.get_topic_names_and_types()).keys():
                return
            if look == LOOKS_BEFORE_SAID:
                self._node.get_logger().info(f'looking for poses on {", ".join(self._wanted)}')
            time.sleep(PAUSE)  # the middleware learns of others in a thread of its own
            ports.reopen_lost()  # as the timer that does so is not running yet

    def _other_types(self) -> list[str]:
        """Return what is published on a topic of poses and is none, in words."""
        found = dict(self._node.get_topic_names_and_types())
        return [f'{name} is of type {other}, expected {wanted}'
                for name, wanted in self._wanted.items()
                for other in found.get(name, ()) if other != wanted]

    def _listen_to_transforms(self) -> None:
        try:
            from tf2_msgs.msg import TFMessage  # not among the wheels: only a whole ROS 2 has it
        except ImportError:
            raise ConfigurationError(
                "'tf' needs tf2_msgs, which a whole ROS 2 has: apt install ros-jazzy-tf2-msgs",
                key='poses.source') from None

        def on_message(data: bytes) -> None:
            self.on_transforms(deserialize_message(data, TFMessage))

        self._frame = self._frame or names.WORLD
        self._node.listen(TFMessage, names.TF, on_message, qos.SENSORS)

    def _receiver(self, i: int) -> Callable[[bytes], None]:
        def on_pose(data: bytes) -> None:
            try:
                message = deserialize_message(data, PoseStamped)
            except Exception:  # rclpy has no class of its own for bytes that are no such message
                self._node.health.reject(Rejected(Rejected.MALFORMED), self._names[i])
                return
            self._take(i, message.header, message.pose.orientation)
        return on_pose

    def _on_array(self, data: bytes) -> None:
        try:
            message = deserialize_message(data, PoseArray)
            if len(message.poses) < len(self._names):
                raise ValueError
        except Exception:  # as above
            self._node.health.reject(Rejected(Rejected.MALFORMED), 'poses')
            return
        for i in self.trackers:
            self._take(i, message.header, message.poses[i].orientation)

    def on_transforms(self, message: Any) -> None:
        """Take what a tf2_msgs/TFMessage says of the bodies."""
        for transform in message.transforms:
            name = transform.child_frame_id
            if name in self._names and (i := self._names.index(name)) in self.trackers:
                self._take(i, transform.header, transform.transform.rotation)

    def _take(self, i: int, header: Any, q: Any) -> None:
        try:
            if self._frame is None:
                self._frame = header.frame_id
            if header.frame_id != self._frame:
                raise Rejected(Rejected.WRONG_FRAME)
            stamp = header.stamp.sec * 1_000_000_000 + header.stamp.nanosec
            self.trackers[i].receive(stamp, (q.x, q.y, q.z, q.w), self._now())
        except Rejected as rejection:
            self._node.health.reject(rejection, f'pose of {self._names[i]}')

    def told(self, rates: Sequence[Vector], elapsed: float) -> None:
        """Take note of what all bodies are told to do, for a time [s]."""
        for i, tracker in self.trackers.items():
            tracker.told(rates[i], elapsed)

    def attitudes(self) -> dict[int, Quaternion]:
        """Return the attitudes that may be used, by index; report at once if they become less."""
        now = self._now()
        known = {}
        for i, tracker in self.trackers.items():
            state = tracker.state(now)
            if state == FROZEN and i not in self._lost and self._is_told_by_its_driver(i):
                tracker.repeats = True
                state = tracker.state(now)
            if state == TRACKED and tracker.attitude is not None:
                known[i] = tracker.attitude
        lost = frozenset(self.trackers.keys() - known.keys())
        if lost != self._lost:
            worse, self._lost = lost - self._lost, lost
            if worse and now - self._reported_at > REPORT_AGAIN:
                self._reported_at = now
                self._node.health.report()
        return known

    def _is_told_by_its_driver(self, i: int) -> bool:
        """
        Return whether it is the driver of body i that tells its pose, and nobody else.

        A driver reads encoders, which have no noise: a body at a limit repeats itself. Whether
        the body can be reached is known to the driver.
        """
        if i not in self._topics:
            return False
        publishers = self._node.get_publishers_info_by_topic(
            self._node.resolve_topic_name(self._topics[i]))
        return {p.node_name for p in publishers} == {names.body(i + 1)}

    def assess(self) -> tuple[str, dict[str, Any]]:
        """Return what is wrong, or nothing, and figures for the diagnostics."""
        now = self._now()
        problems, values = [], {}
        for i, tracker in self.trackers.items():
            state = tracker.state(now)
            values[f'poses of {names.agent(i + 1)}'] = tracker.received
            values[f'jumps of {names.agent(i + 1)}'] = tracker.jumps
            if state != TRACKED:
                problems.append(f'{names.agent(i + 1)}: {state}')
        if self.waiting:  # perhaps for somebody who has come since, with something else
            problems += self._other_types()
        return ', '.join(problems), values

    @property
    def waiting(self) -> bool:
        """Return whether a body has not been seen at all yet."""
        return any(t.state(self._now()) == WAITING for t in self.trackers.values())
