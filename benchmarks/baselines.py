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
The lockstep round without mathematics, checks or state: what there is to compare with.

Plant and agents use the topics, types and quality of service of the formation. In one style they
are written as one writes rclpy: message objects, the default executor. In the other they go to
the limit of what rclpy and DDS can do: constant bytes, past the checks of ``Publisher.publish``,
raw subscriptions, the events executor. The plants have the interface that ``worker.py`` measures
by: ``steps``, ``pause``, ``resume``.
"""

import struct

from geometry_msgs.msg import Pose, PoseArray, TwistStamped, Vector3Stamped
from rclpy.executors import SingleThreadedExecutor
from rclpy.experimental.events_executor import EventsExecutor
from rclpy.node import Node
from rclpy.qos import HistoryPolicy, QoSProfile, ReliabilityPolicy
from rclpy.serialization import serialize_message
from rosgraph_msgs.msg import Clock
from std_msgs.msg import Float64, Float64MultiArray, MultiArrayDimension

NEWEST = QoSProfile(history=HistoryPolicy.KEEP_LAST, depth=1,
                    reliability=ReliabilityPolicy.RELIABLE)
COMMANDS = QoSProfile(history=HistoryPolicy.KEEP_LAST, depth=1,
                      reliability=ReliabilityPolicy.BEST_EFFORT)
STATE = QoSProfile(history=HistoryPolicy.KEEP_LAST, depth=1000,
                   reliability=ReliabilityPolicy.RELIABLE)
PERIOD_NS = 10_000_000


class PlantOfSteps(Node):
    """What both styles have in common: steps are begun one after the other until a pause."""

    def __init__(self, **kwargs):
        super().__init__('plant', **kwargs)
        self.steps = 0
        self.stamp = 0
        self._paused = True

    def pause(self):
        """Begin no step any more."""
        self._paused = True

    def resume(self):
        """Begin the next step."""
        self._paused = False
        self._begin()


class ObjectPlant(PlantOfSteps):
    """The plant's half of a round, with message objects."""

    def __init__(self, n, **kwargs):
        super().__init__(**kwargs)
        self._missing = set()
        self._everybody = {*range(1, n + 1)}
        self._state = self.create_publisher(PoseArray, 'formation/attitudes', STATE)
        self._time_publisher = self.create_publisher(Clock, '/clock', NEWEST)
        self._sensors = [
            (f'agent_{i}', self.create_publisher(
                Vector3Stamped, f'agent_{i}/relative_attitude/agent_{j}', NEWEST))
            for i in range(1, n + 1) for j in range(1, n + 1) if i != j]
        for i in range(1, n + 1):
            self.create_subscription(TwistStamped, f'agent_{i}/cmd_vel',
                                     lambda message, i=i: self._on_command(i, message), COMMANDS)
        state = PoseArray()
        state.header.frame_id = 'world'
        state.poses = [Pose() for _ in range(n)]
        self._state_message = state

    def _begin(self):
        if self._paused:
            return
        self._missing = set(self._everybody)
        self.stamp += PERIOD_NS
        clock = Clock()
        clock.clock.sec, clock.clock.nanosec = divmod(self.stamp, 1_000_000_000)
        self._time_publisher.publish(clock)
        self._publish(clock.clock)

    def _publish(self, stamp):
        self._state_message.header.stamp = stamp
        self._state.publish(self._state_message)
        for frame, publisher in self._sensors:
            message = Vector3Stamped()
            message.header.stamp = stamp
            message.header.frame_id = frame
            message.vector.x = 1.0
            publisher.publish(message)

    def _on_command(self, i, message):
        stamp = message.header.stamp
        if stamp.sec * 1_000_000_000 + stamp.nanosec != self.stamp:
            return
        self._missing.discard(i)
        if not self._missing:
            self.steps += 1
            self._begin()


class ObjectAgent(Node):
    """An agent's half of a round, with message objects."""

    def __init__(self, i, n, **kwargs):
        super().__init__(f'agent_{i}', **kwargs)
        self._frame = f'agent_{i}'
        self._count = n - 1
        self._stamp = None
        self._seen = set()
        self._publisher = self.create_publisher(TwistStamped, f'agent_{i}/cmd_vel', NEWEST)
        for j in range(1, n + 1):
            if j != i:
                self.create_subscription(
                    Vector3Stamped, f'agent_{i}/relative_attitude/agent_{j}',
                    lambda message, j=j: self._on_measurement(j, message), NEWEST)

    def _on_measurement(self, j, message):
        if message.header.stamp != self._stamp:
            self._stamp = message.header.stamp
            self._seen = set()
        self._seen.add(j)
        if len(self._seen) == self._count:
            command = TwistStamped()
            command.header.stamp = message.header.stamp
            command.header.frame_id = self._frame
            self._publisher.publish(command)


class ObjectRealTimePlant(ObjectPlant):
    """
    A plant that steps on a timer and takes the newest commands, with message objects.

    :param note: called at each step with its time and the oldest stamp among the commands [ns]
    """

    def __init__(self, n, note, **kwargs):
        super().__init__(n, **kwargs)
        self._stamps = [0] * n
        self._note = note
        self._timer = None

    def set_rate(self, rate):
        """Step so often from now on [Hz]."""
        if self._timer is not None:
            self.destroy_timer(self._timer)
        self._timer = self.create_timer(1.0 / rate, self._on_timer)

    def _on_timer(self):
        now = self.get_clock().now()
        self._note(now.nanoseconds, self._stamps)
        self.steps += 1
        self._publish(now.to_msg())

    def _on_command(self, i, message):
        stamp = message.header.stamp
        self._stamps[i - 1] = stamp.sec * 1_000_000_000 + stamp.nanosec


def raw_publish(node, message_type, topic, profile):
    """Return a function that publishes bytes, without what rclpy looks at before."""
    return node.create_publisher(message_type, topic, profile).handle.publish_raw


class BytePlant(PlantOfSteps):
    """The plant's half of a round, with bytes that only differ in their stamp."""

    def __init__(self, n, **kwargs):
        super().__init__(**kwargs)
        self._waiting = 0
        self._n = n
        measurement, state = Vector3Stamped(), PoseArray()
        measurement.header.frame_id, state.header.frame_id = 'agent_1', 'world'
        state.poses = [Pose() for _ in range(n)]
        self._measurement = serialize_message(measurement)[12:]
        self._state_tail = serialize_message(state)[12:]
        self._state = raw_publish(self, PoseArray, 'formation/attitudes', STATE)
        self._time_publisher = raw_publish(self, Clock, '/clock', NEWEST)
        self._sensors = [raw_publish(
            self, Vector3Stamped, f'agent_{i}/relative_attitude/agent_{j}', NEWEST)
            for i in range(1, n + 1) for j in range(1, n + 1) if i != j]
        for i in range(1, n + 1):
            self.create_subscription(
                TwistStamped, f'agent_{i}/cmd_vel', self._on_command, COMMANDS, raw=True)

    def _begin(self):
        if self._paused:
            return
        self._waiting = self._n
        self.stamp += PERIOD_NS
        head = struct.pack('<4siI', b'\0\1\0\0', *divmod(self.stamp, 1_000_000_000))
        self._time_publisher(head)
        self._publish(head)

    def _publish(self, head):
        self._state(head + self._state_tail)
        measurement = head + self._measurement
        for publish in self._sensors:
            publish(measurement)

    def _on_command(self, message):
        self._waiting -= 1
        if not self._waiting:
            self.steps += 1
            self._begin()


class ByteRealTimePlant(BytePlant):
    """
    A plant that steps on a timer and takes the newest commands, with bytes.

    :param note: called at each step with its time and the oldest stamp among the commands [ns]
    """

    def __init__(self, n, note, **kwargs):
        super().__init__(n, **kwargs)
        self._stamps = dict.fromkeys(range(1, n + 1), 0)
        self._note = note
        self._timer = None

    set_rate = ObjectRealTimePlant.set_rate

    def _on_timer(self):
        now = self.get_clock().now().nanoseconds
        self._note(now, self._stamps.values())
        self.steps += 1
        self._publish(struct.pack('<4siI', b'\0\1\0\0', *divmod(now, 1_000_000_000)))

    def _on_command(self, message):
        sec, nanosec, i = struct.unpack_from('<iI4x6xc', message, 4)
        self._stamps[int(i)] = sec * 1_000_000_000 + nanosec


class ByteAgent(Node):
    """An agent's half of a round, with bytes that only differ in their stamp."""

    def __init__(self, i, n, **kwargs):
        super().__init__(f'agent_{i}', **kwargs)
        command = TwistStamped()
        command.header.frame_id = f'agent_{i}'
        self._command = serialize_message(command)[12:]
        self._count, self._missing = n - 1, n - 1
        self._publish = raw_publish(self, TwistStamped, f'agent_{i}/cmd_vel', NEWEST)
        for j in range(1, n + 1):
            if j != i:
                self.create_subscription(
                    Vector3Stamped, f'agent_{i}/relative_attitude/agent_{j}',
                    self._on_measurement, NEWEST, raw=True)

    def _on_measurement(self, message):
        self._missing -= 1
        if not self._missing:
            self._missing = self._count
            self._publish(message[:12] + self._command)


class ByteMonitor(Node):
    """The monitor's part, with constant bytes."""

    def __init__(self, n, **kwargs):
        super().__init__('monitor', **kwargs)
        pairs = n * (n - 1) // 2
        cosines = Float64MultiArray(data=[0.0] * pairs)
        cosines.layout.dim = [MultiArrayDimension(label='1 2', size=1, stride=1)] * (pairs + 1)
        self._cosines = serialize_message(cosines)
        self._error = serialize_message(Float64())
        self._publish_cosines = raw_publish(
            self, Float64MultiArray, 'formation/cosines', STATE)
        self._publish_error = raw_publish(self, Float64, 'formation/error', STATE)
        self.create_subscription(PoseArray, 'formation/attitudes', self._on_attitudes, STATE,
                                 raw=True)

    def _on_attitudes(self, message):
        self._publish_cosines(self._cosines)
        self._publish_error(self._error)


OBJECTS = ObjectPlant, ObjectAgent, SingleThreadedExecutor
BYTES = BytePlant, ByteAgent, EventsExecutor
REAL_TIME_PLANTS = {'objects': ObjectRealTimePlant, 'bytes': ByteRealTimePlant}
