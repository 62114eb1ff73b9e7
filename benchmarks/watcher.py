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
from collections.abc import Callable, Iterator
from contextlib import suppress
from functools import partial
import math
import re
import struct
import threading
import time
from typing import Any

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
from tetra_ros2.ros.executor import leave, make_executor, spin_some
from tetra_ros2.wire import cdr, names

THETA_STAR = math.acos(-1.0 / 3.0)
LISTEN = QoSProfile(history=HistoryPolicy.KEEP_LAST, depth=1000,
                    reliability=ReliabilityPolicy.BEST_EFFORT)
SPEAK = QoSProfile(history=HistoryPolicy.KEEP_LAST, depth=100,
                   reliability=ReliabilityPolicy.RELIABLE)
AFTERMATH = 1.0
"""How long after an attack what is heard on its topic is not the formation's fault [s]."""

FRESH = 0.25
"""How long a topic may be silent and count as alive [s]; each has fifty messages a second."""

ABSENT = 1.5
"""After which time [s] a node that reports twice a second is missed, as an aggregator does."""

SILENT = 'says nothing'

FAR = 0.8
"""The way back begins where the error was last this share of its largest."""

_WELL = re.compile('running|answering|recording$|forming|formed|paused|watching')
CONFLICT = 'more than one publisher on'
_CONFLICT = re.compile(rf'{CONFLICT} (/[^:]+): two')


READING_PERIOD = 0.01
"""How often to read what has come [s]."""


class _Reader(Node):
    """A node whose subscriptions no executor looks after: to be called costs more than to read."""

    @property
    def subscriptions(self) -> Iterator[Any]:
        """Give none."""
        return iter(())


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
        self.node = _Reader('watcher', context=self._context)
        self._queues: list[tuple[Callable[[], Any], Callable[[bytes], None]]] = []
        self._executor.add_node(self.node)
        self.error = math.inf
        self.stamp = 0
        self.changed_at = 0.0  # when the stamp last changed, on the monotonic clock
        self.worst = 0.0  # the largest error since it was set to zero
        self.way_back: tuple[float, list[tuple[float, ...]]] = 0.0, []  # its begin: when and where
        self.largest = 0.0  # the largest error since the way back was asked for
        self.not_finite: list[str] = []
        self.heard_from: dict[str, float] = {}  # when each node last said how it is
        self.reports: list[tuple[float, str]] = []  # when, and who said what is wrong
        self._conflicts: dict[str, set[str]] = defaultdict(set)  # topics, by who says so
        self._known_conflicts: dict[str, set[str]] = {}  # before the fault
        self._recorded_since: float | None = None
        self.spoke_at = 0.0  # when it last began to speak
        self._heard: dict[str, float] = {}  # when something last came on each topic
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
        self._needed = [names.ATTITUDES, *(names.cmd_vel(i) for i, _ in edges),
                        *(names.relative_attitude(i, j) for i, j in edges)]
        self._stopping = False
        self._thread = threading.Thread(target=self._spin, daemon=True)
        self._thread.start()

    def close(self) -> None:
        """Leave."""
        self._stopping = True
        self._thread.join()
        leave(self._executor)

    def _spin(self) -> None:
        never = Future(executor=self._executor)
        while not self._stopping:
            spin_some(self._executor, never, timeout=READING_PERIOD)
            for take, callback in self._queues:
                while (taken := take()) is not None:
                    # What an intruder says need not be a message.
                    with suppress(Rejected, struct.error, Exception):
                        callback(taken[0])

    def _listen(self, kind: type, topic: str, callback: Callable[[bytes], None]) -> None:
        subscription = self.node.create_subscription(kind, topic, callback, LISTEN, raw=True)
        self._queues.append((partial(subscription.handle.take_message, kind, True), callback))

    def _listen_finite(self, kind: type, topic: str,
                       decode: Callable[[bytes], tuple[Any, Any]]) -> None:
        def on_message(message: bytes) -> None:
            _, numbers = decode(message)
            self._heard[topic] = time.monotonic()
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
        self._heard[names.ATTITUDES] = now
        self.largest = max(self.largest, error)
        if error >= FAR * self.largest:
            self.way_back = now, gamma

    def _on_diagnostics(self, message: bytes) -> None:
        now = time.monotonic()
        for status in deserialize_message(message, DiagnosticArray).status:
            name = status.name.rpartition('/')[2]
            level = status.level[0] if isinstance(status.level, bytes) else int(status.level)
            silent_since, self.heard_from[name] = self.heard_from.get(name, now), now
            if now - silent_since > ABSENT:
                self.reports.append((silent_since + ABSENT, f'{name}: {SILENT}'))
            conflicts: set[str] = set()
            for clause in status.message.split('; '):
                if named := _CONFLICT.match(clause):
                    conflicts = set(named[1].split(', '))
                    known = self._known_conflicts.get(name, set())
                    # DDS takes a while to forget who was killed.
                    for word, topics in ((CONFLICT, conflicts - known),
                                         (f'still {CONFLICT}', conflicts & known)):
                        if topics:
                            self.reports.append((now, f'{name}: {word} {", ".join(topics)}'))
                elif level > 0 and not _WELL.match(clause):
                    self.reports.append((now, f'{name}: {clause}'))
            self._conflicts[name] = conflicts
            if name == names.RECORDER:
                counts = {item.key: item.value for item in status.values}
                if counts.get(f'messages on /{names.ATTITUDES}', '0') != '0' \
                        and self._recorded_since is None:
                    self._recorded_since = now

    @property
    def recorded_for(self) -> float:
        """Return how long ago the recorder said that it has recorded states [s], or 0."""
        return 0.0 if self._recorded_since is None else time.monotonic() - self._recorded_since

    def forget_recording(self) -> None:
        """Take note that the recording has ended."""
        self._recorded_since = None

    def begin(self) -> None:
        """Forget what was seen before: only what is new from now on comes of a fault."""
        self.not_finite.clear()
        self.worst = self.error
        self.begin_to_listen()

    def begin_to_listen(self) -> None:
        """Forget what was reported before."""
        self.reports.clear()
        self._known_conflicts = {name: set(topics) for name, topics in self._conflicts.items()}

    def begin_way_back(self) -> None:
        """Look for the moment at which the error begins to fall for good."""
        self.largest = 0.0

    def reported_at(self, *words: str) -> float | None:
        """
        Return when somebody first reported something, or None.

        :param words: regular expressions; one of them finds the report, which has the name of
            the node before it
        """
        now = time.monotonic()
        silent = [(at + ABSENT, f'{name}: {SILENT}')
                  for name, at in list(self.heard_from.items()) if now - at > ABSENT]
        return min((at for at, text in self.reports + silent
                    if any(re.search(word, text) for word in words)), default=None)

    @property
    def alive(self) -> bool:
        """Return whether all agents are told what they see, and all of them answer."""
        now = time.monotonic()
        return self.fresh and all(
            now - self._heard.get(topic, 0.0) < FRESH for topic in self._needed)

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
        return time.monotonic() - self.changed_at < FRESH

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
        k = 0
        try:
            self.wait(lambda: publisher.get_subscription_count() > 1, 2.0)
            begun = self.spoke_at = time.monotonic()
            while (now := time.monotonic()) - begun < duration:
                self._attacked[topic.lstrip('/') if topic != names.CLOCK else topic] = now
                with suppress(RuntimeError):  # the middleware knows how large a message can be
                    publisher.publish(messages(k))
                k += 1
                if rate:
                    time.sleep(max(0.0, begun + k / rate - time.monotonic()))
        finally:
            self.node.destroy_publisher(publisher)
        return k


TYPES = {'measurement': Vector3Stamped, 'command': TwistStamped, 'attitudes': PoseArray,
         'diagnostics': DiagnosticArray, 'clock': Clock, 'error': Float64,
         'cosines': Float64MultiArray}
"""The kinds of topic that an intruder can speak on."""
