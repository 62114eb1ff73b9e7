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
Somebody who looks at a formation from a host of their own, and who can play the intruder.

The watcher hears every topic as bytes. It works out the formation error from the attitudes by
itself, looks whether every number is finite, and keeps what the nodes report of themselves.
"""

from collections import defaultdict
from collections.abc import Callable
from contextlib import suppress
import math
import struct
import threading
import time

from diagnostic_msgs.msg import DiagnosticArray
from geometry_msgs.msg import PoseArray, TwistStamped, Vector3Stamped
from rclpy.context import Context
from rclpy.node import Node
from rclpy.qos import HistoryPolicy, QoSProfile, ReliabilityPolicy
from rclpy.serialization import deserialize_message
from rclpy.task import Future
from rosgraph_msgs.msg import Clock
from std_msgs.msg import Float64, Float64MultiArray
from std_srvs.srv import Trigger
from tetra_ros2.formation.checks import Rejected
from tetra_ros2.ros.executor import make_executor, spin_some
from tetra_ros2.wire import cdr, names

THETA_STAR = math.acos(-1.0 / 3.0)
LISTEN = QoSProfile(history=HistoryPolicy.KEEP_LAST, depth=100,
                    reliability=ReliabilityPolicy.BEST_EFFORT)
SPEAK = QoSProfile(history=HistoryPolicy.KEEP_LAST, depth=100,
                   reliability=ReliabilityPolicy.RELIABLE)
AFTERMATH = 1.0
"""How long after an attack what is heard on its topic is not the formation's fault [s]."""


class Watcher:
    """
    Hears all, and speaks if told to.

    :param edges: (i, j) for each agent j that agent i sees
    :param n: number of agents
    """

    def __init__(self, edges: list[tuple[int, int]], n: int = 4) -> None:
        self._context = Context()
        self._context.init()
        self._executor = make_executor(self._context)
        self.node = Node('watcher', context=self._context)
        self._executor.add_node(self.node)
        self.error = math.inf
        self.stamp = 0
        self.changed_at = 0.0  # when the stamp last changed, on the monotonic clock
        self.worst = 0.0  # the largest error since it was set to zero
        self.not_finite: list[str] = []
        self.levels: dict[str, int] = {}
        self.messages: dict[str, str] = {}
        self._counts: dict[str, int] = {}
        self.reports: list[tuple[float, str, str]] = []  # when, who, what: warnings, and counts
        self._saying: dict[str, str] = {}  # what each node says now, in words
        self._said: set[str] = set()  # what any of them said before the fault
        self._attacked: dict[str, float] = defaultdict(lambda: -math.inf)
        self._n = n
        poses = cdr.pose_array(names.WORLD, n).decode
        self._listen(PoseArray, names.ATTITUDES, lambda m: self._on_attitudes(*poses(m)))
        for i in range(1, n + 1):
            self._listen_finite(TwistStamped, names.cmd_vel(i),
                                cdr.twist_stamped(names.body_frame(i)).decode)
        for i, j in edges:
            self._listen_finite(Vector3Stamped, names.relative_attitude(i, j),
                                cdr.vector3_stamped(names.body_frame(i)).decode)
        self._listen_finite(Float64, names.ERROR, lambda m: (0, struct.unpack_from('<d', m, 4)))
        pairs = n * (n - 1) // 2
        self._listen_finite(Float64MultiArray, names.COSINES,
                            lambda m: (0, struct.unpack(f'<{pairs}d', m[-8 * pairs:])))
        self._listen(DiagnosticArray, '/diagnostics', self._on_diagnostics)
        self._random = self.node.create_client(Trigger, 'plant/randomize')
        self._reset = self.node.create_client(Trigger, names.RESET)
        self._stopping = False
        self._thread = threading.Thread(target=self._spin, daemon=True)
        self._thread.start()

    def close(self) -> None:
        """Leave."""
        self._stopping = True
        self._thread.join()
        self.node.destroy_node()
        self._executor.shutdown()
        self._context.try_shutdown()

    def _spin(self) -> None:
        never = Future(executor=self._executor)
        while not self._stopping:
            spin_some(self._executor, never, timeout=0.2)

    def _listen(self, kind: type, topic: str, callback: Callable[[bytes], None]) -> None:
        def guarded(message: bytes) -> None:
            # What an intruder says need not be a message.
            with suppress(Rejected, struct.error, Exception):
                callback(message)
        self.node.create_subscription(kind, topic, guarded, LISTEN, raw=True)

    def _listen_finite(self, kind: type, topic: str, decode: Callable[[bytes], tuple]) -> None:
        def on_message(message: bytes) -> None:
            _, numbers = decode(message)
            self._require_finite(topic, numbers)
        self._listen(kind, topic, on_message)

    def _require_finite(self, topic: str, numbers: tuple) -> None:
        if not all(map(math.isfinite, numbers)) \
                and time.monotonic() - self._attacked[topic] > AFTERMATH:
            self.not_finite.append(topic)

    def _on_attitudes(self, stamp: int, numbers: tuple) -> None:
        now = time.monotonic()
        if now - self._attacked[names.ATTITUDES] <= AFTERMATH:
            return
        self._require_finite(names.ATTITUDES, numbers)
        gamma = [numbers[7 * i:7 * i + 3] for i in range(self._n)]
        error = 0.0
        for i in range(self._n):
            for j in range(i):
                cosine = sum(a * b for a, b in zip(gamma[i], gamma[j]))
                error = max(error, abs(math.acos(min(max(cosine, -1.0), 1.0)) - THETA_STAR))
        if stamp != self.stamp:
            self.stamp, self.changed_at = stamp, now
        self.error = error
        self.worst = max(self.worst, error)

    def _on_diagnostics(self, message: bytes) -> None:
        now = time.monotonic()
        for status in deserialize_message(message, DiagnosticArray).status:
            name = status.name.rpartition('/')[2]
            level = status.level[0] if isinstance(status.level, bytes) else int(status.level)
            self.levels[name], self.messages[name] = level, status.message
            count = sum(int(item.value) for item in status.values
                        if item.key in ('rejected', 'exceptions') and item.value.isdigit())
            said = _words(status.message)
            if (level > 0 and said not in self._said) or count > self._counts.get(name, count):
                self.reports.append((now, name, status.message))
            self._counts[name], self._saying[name] = count, said

    def begin(self) -> None:
        """Forget what was seen before: only what is new from now on is a report of a fault."""
        self.not_finite.clear()
        self.reports.clear()
        self._said = set(self._saying.values())
        self.worst = self.error

    def restart(self, at_random: bool = False) -> bool:
        """Let the plant start anew; return whether it was there to be asked."""
        client = self._random if at_random else self._reset
        ready = client.service_is_ready()
        if ready:
            client.call_async(Trigger.Request())
        return ready

    @property
    def fresh(self) -> bool:
        """Return whether formation time passes."""
        return time.monotonic() - self.changed_at < 0.5

    def wait(self, condition: Callable[[], bool], timeout: float, hold: float = 0.0) -> bool:
        """
        Wait until a condition has held for some time.

        :param condition: called twenty times a second
        :param timeout: when to give up [s]
        :param hold: for how long it has to hold [s]
        :returns: whether it did
        """
        begun = time.monotonic()
        since = None
        while (now := time.monotonic()) - begun < timeout:
            if not condition():
                since = None
            else:
                since = now if since is None else since
                if now - since >= hold:
                    return True
            time.sleep(0.05)
        return False

    def speak(self, kind: type, topic: str, messages: Callable[[int], bytes], rate: float,
              duration: float) -> int:
        """
        Publish bytes on a topic, as an intruder would.

        :param messages: gives the k-th message, from 0
        :param rate: how many a second; 0 for as many as go
        :param duration: for how long [s]
        :returns: how many there were
        """
        publisher = self.node.create_publisher(kind, topic, SPEAK)
        begun = time.monotonic()
        k = 0
        try:
            self.wait(lambda: publisher.get_subscription_count() > 1, 2.0)
            begun = time.monotonic()
            while (now := time.monotonic()) - begun < duration:
                self._attacked[topic.lstrip('/') if topic != names.CLOCK else topic] = now
                publisher.publish(messages(k))
                k += 1
                if rate:
                    time.sleep(max(0.0, begun + k / rate - time.monotonic()))
        finally:
            self.node.destroy_publisher(publisher)
        return k


def _words(text: str) -> str:
    """Return a message without its numbers, which change from one report to the next."""
    return ''.join(c for c in text if not c.isdigit())


TYPES = {'measurement': Vector3Stamped, 'command': TwistStamped, 'attitudes': PoseArray,
         'diagnostics': DiagnosticArray, 'clock': Clock, 'error': Float64,
         'cosines': Float64MultiArray}
"""The kinds of topic that an intruder can speak on."""
