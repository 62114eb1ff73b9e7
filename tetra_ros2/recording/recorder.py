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
The recorder: serialised messages, as they come, into a rosbag2 directory.

It needs no rosbag2: the files are written by rosbags, in a process of its own, see
:mod:`tetra_ros2.recording.writer`; ``ros2 bag``, Foxglove and PlotJuggler read them.
"""

from collections import Counter
from collections.abc import Callable, Mapping, Sequence
from datetime import datetime
from importlib import import_module
from operator import itemgetter
from pathlib import Path
import re
import shutil
import time
from typing import Any, TypeVar

from rcl_interfaces.msg import SetParametersResult
from rclpy.parameter import Parameter
from rclpy.qos import DurabilityPolicy, HistoryPolicy, QoSProfile, ReliabilityPolicy
from rclpy.topic_endpoint_info import TopicEndpointInfo
import rosbags  # noqa: F401, to miss it here and not in the process that writes
from tetra_ros2.config.configuration import check_new
from tetra_ros2.config.parameters import ConfigurationError
from tetra_ros2.formation.checks import Rejected
from tetra_ros2.recording.simulated_time import SimulatedTime
from tetra_ros2.recording.writer import BagError, BagWriter
from tetra_ros2.ros import diagnostics, executor, parameters
from tetra_ros2.ros.node import FormationNode
from tetra_ros2.wire import cdr, names

DISCOVERY_PERIOD = 0.1
"""How often to look for topics that have appeared [s]."""

READING_PERIOD = 0.01
"""How often to read what has come [s]."""

DEPTH = 10000
"""How many messages of a topic may wait to be read."""

_TYPE = re.compile(r'(\w+)/msg/(\w+)')

Policy = TypeVar('Policy', ReliabilityPolicy, DurabilityPolicy)

Taken = tuple[bytes, Mapping[str, int]]
"""A message and what is known about it."""

Come = list[tuple[int, int | None, bytes]]
"""Of each message when it came [ns], the number of its topic, and its bytes."""


class Recorder(FormationNode):
    """
    The node ``recorder``; it records from its making to its :meth:`close`.

    Messages are filed under the time of their arrival; with ``use_sim_time`` that is the time of
    /clock, and recording begins with the first of it.

    It does not have the executor call it for each message, which would cost as much again as the
    message: DDS notes when it came, and now and then all that have come are read.

    :param sim_time: whether to go by /clock even without the parameter, which makes rclpy take
        every message of it apart
    :param kwargs: what rclpy's Node takes beside its name
    :raises ConfigurationError: if a parameter is not valid, or the output cannot be made; an
        existing path is never written to
    """

    def __init__(self, *, sim_time: bool = False, **kwargs: Any) -> None:
        super().__init__(names.RECORDER, **kwargs)
        values = parameters.declare(self, 'recorder', self._accept, lambda _: None)
        self._wanted = re.compile('|'.join(f'(?:{p})' for p in self._patterns(values)))
        self.path = Path(values['output'] or f'tetra_{datetime.now():%Y_%m_%d-%H_%M_%S}')
        self.exclusive_inputs = False
        sim_time = sim_time or self.get_parameter('use_sim_time').value
        self._sim_time = SimulatedTime() if sim_time else None
        self._latest = 0  # time of the last message that was written [ns]
        self._number_of_clock: int | None = None  # of that topic, if it is to be recorded
        self._recorded: list[str] = []  # topics, by the number that the writer gave them
        self._heard: set[str] = set()  # topics
        self._refused: dict[str, str] = {}  # why others are not recorded: texts, by topic
        self.failure: str | None = None  # why the recording ended before it was to end, a text
        # For each topic: its number, and what gives its next message.
        self._queues: list[tuple[int | None, Callable[[], Taken | None]]] = []
        self._ahead: Come = []  # what came while the last reading went on
        self._written: Counter[int] = Counter()  # how many messages, by the topic's number
        self._writer: BagWriter | None = self._open(values['storage'])
        self.add_on_set_parameters_callback(self._keep_to_one_time)
        self.report_health(self.assess)
        self.create_steady_timer(DISCOVERY_PERIOD, self.discover)
        self.create_steady_timer(READING_PERIOD, self._read)
        self.discover()

    def _accept(self, values: Mapping[str, Any]) -> None:
        try:
            re.compile(values['regex'])
        except re.error as error:
            raise ConfigurationError(
                f'{values["regex"]!r} is not a regular expression: {error}', key='regex') from None

    def _keep_to_one_time(self, given: list[Parameter]) -> SetParametersResult:
        """Refuse another source of time: half of the bag would be of one, half of the other."""
        for parameter in given:
            if parameter.name == 'use_sim_time' \
                    and parameter.value != (self._sim_time is not None):
                return SetParametersResult(
                    successful=False, reason='a recording keeps to the time that it began with')
        return SetParametersResult(successful=True)

    def _patterns(self, values: Mapping[str, Any]) -> list[str]:
        """Return regular expressions of the full names of the topics to record."""
        namespace = self.get_namespace().rstrip('/')
        patterns = [re.escape(topic if topic.startswith('/') else f'{namespace}/{topic}')
                    for topic in values['topics']]
        if not patterns:
            patterns = [f'{re.escape(namespace)}/(?:{p})' for p in names.FORMATION_TOPICS]
            patterns += [re.escape(names.DIAGNOSTICS), re.escape(names.CLOCK)]
        if values['regex']:
            patterns.append(values['regex'])
        return patterns

    def _open(self, storage: str) -> BagWriter:
        check_new(self.path)
        try:
            writer = BagWriter(self.path, storage)
        except BagError as error:
            raise ConfigurationError(
                f'cannot be recorded into: {error}', source=self.path) from None
        self.get_logger().info(f'recording into {self.path}')
        return writer

    def close(self) -> None:
        """End the recording; what has come so far is all there, and the bag is complete."""
        self._read()
        self._write(self._ahead)
        if self._writer is None:
            return
        try:
            self._writer.close()
        except BagError as error:
            self._fail(error)
            return
        self._end()
        self.get_logger().info(
            f'{sum(self.counts.values())} messages of {len(self.counts)} topics are in '
            f'{self.path}')

    def discard(self) -> None:
        """Record nothing after all: the directory goes, which was made for this recording."""
        if self._writer is not None:
            self._writer.abort()
            self._end()
            shutil.rmtree(self.path)

    def _fail(self, error: BagError) -> None:
        """Give up recording: what is on the disk stays there, and may have to be recovered."""
        writer = self._writer
        self._end()
        self.exit_status = 1
        self.failure = str(error)
        if self.health is not None:
            self.health.report()  # before it waits
        if writer is not None:
            self.failure = writer.give_up(error)
        self.get_logger().error(f'{self.path} cannot be written any more: {self.failure}')

    def _end(self) -> None:
        """Listen no more: what nobody reads would pile up."""
        self._writer = None
        self._queues.clear()
        self._ahead.clear()
        while self.inputs:
            self.destroy_subscription(self.inputs.pop())

    @property
    def counts(self) -> dict[str, int]:
        """Return how many messages of each topic were recorded."""
        self._read()
        return {topic: self._written[k] for k, topic in enumerate(self._recorded)}

    def _follow(self, clock: SimulatedTime, message: bytes, at: int) -> None:
        try:
            clock.hear(cdr.time(message), at)
        except Rejected as rejection:
            self.health.reject(rejection, names.CLOCK)

    def _take(self, take: Callable[[], Taken | None]) -> Taken | None:
        """Return a queue's next message, or None if there is none, or it cannot be read."""
        try:
            return take()
        except Exception as error:  # whatever the middleware says of what somebody sent
            self.health.reject(type(error).__name__, 'the middleware')
            return None

    def _read(self) -> None:
        """Have all that has come written, in the order in which it came."""
        come, self._ahead = self._ahead, []
        begun = time.time_ns()
        for number, take in self._queues:
            latest = 0
            while (taken := self._take(take)) is not None:
                message, info = taken
                # Not every middleware tells when a message came.
                at = info['received_timestamp'] or info['source_timestamp']
                if at > latest:  # else it was sent again, and was not to be read before this one
                    latest = at
                # What came since this began may have followed something on a topic that was read
                # before, so it waits for that.
                (come if latest <= begun else self._ahead).append((latest, number, message))
        self._write(come)

    def _write(self, come: Come) -> None:
        """Have messages written."""
        come.sort(key=itemgetter(0))
        messages: list[tuple[int, int, bytes]] = []
        for at, number, message in come:
            if self._sim_time is not None:
                if number == self._number_of_clock:
                    self._follow(self._sim_time, message, at)
                at = self._sim_time.now
            elif at < self._latest:  # the system's clock was set back; a bag's may not be
                at = self._latest
            else:
                self._latest = at
            if at and number is not None:
                messages.append((number, at, message))
        if not messages or self._writer is None:
            return
        try:
            self._writer.write(messages)
        except BagError as error:
            self._fail(error)
            return
        self._written.update([number for number, _, _ in messages])

    def discover(self) -> None:
        """Begin to record those of the wanted topics that have appeared."""
        for topic, types in self.get_topic_names_and_types():
            if self._writer is None:  # even the last topic may have been one too many
                return
            wanted = self._wanted.fullmatch(topic) is not None
            if topic in self._heard or not (wanted or self._goes_by(topic)):
                continue
            try:
                refusal = self._consider(topic, types, wanted)
            except BagError as error:
                self._fail(error)
                return
            # Whatever somebody puts onto the network must not end a recording.
            except Exception as error:
                refusal = f'{type(error).__name__}: {error}'.splitlines()[0]
            if refusal is None:
                self._refused.pop(topic, None)
            elif self._refused.get(topic) != refusal:
                self._refused[topic] = refusal
                self.get_logger().warning(f'{topic} is not recorded, {refusal}')

    def _goes_by(self, topic: str) -> bool:
        return topic == names.CLOCK and self._sim_time is not None

    def _consider(self, topic: str, types: Sequence[str], wanted: bool) -> str | None:
        """Record a topic if it can be; return why not, or None."""
        expected = names.message_type(topic, self.get_namespace())
        if expected is not None and expected not in types:
            return f'its type is {", ".join(types)}, expected {expected}'
        publishers = self.get_publishers_info_by_topic(topic)
        refusal = None
        for type_name in [expected] if expected is not None else types:
            of_type = [p for p in publishers if p.topic_type == type_name]
            if of_type:
                refusal = self._listen(topic, type_name, of_type, wanted)
                if refusal is None and len(types) > 1:
                    self.get_logger().warning(
                        f'{topic} is of the types {", ".join(types)}; {type_name} is recorded')
                if refusal is None:
                    return None
        return refusal

    def _listen(self, topic: str, type_name: str, publishers: Sequence[TopicEndpointInfo],
                wanted: bool) -> str | None:
        """Subscribe to a topic, and announce it to the process that writes if it is wanted."""
        message_type, number = _import(type_name), None
        unknown = f'its type {type_name} is unknown'
        if message_type is None:
            return unknown
        profile = QoSProfile(
            history=HistoryPolicy.KEEP_LAST, depth=DEPTH,
            reliability=_common(publishers, 'reliability', ReliabilityPolicy.RELIABLE,
                                ReliabilityPolicy.BEST_EFFORT),
            durability=_common(publishers, 'durability', DurabilityPolicy.TRANSIENT_LOCAL,
                               DurabilityPolicy.VOLATILE))
        subscription = self.create_subscription(
            message_type, topic, _never_called, profile, raw=True)
        try:
            if wanted and self._writer is not None:
                number = self._writer.add_topic(
                    topic, type_name, str(publishers[0].topic_type_hash),
                    [_offered(publisher.qos_profile) for publisher in publishers])
        finally:
            if wanted and number is None:
                self.destroy_subscription(subscription)
        if wanted and number is None:
            return unknown
        self.inputs.append(subscription)
        self._heard.add(topic)
        if wanted:
            self._recorded.append(topic)
        if self._goes_by(topic):
            self._number_of_clock = number
        self._queues.append((number, self.queue(subscription)))
        return None

    def assess(self) -> diagnostics.Assessment:
        """Return level, message and figures for the diagnostics."""
        counts = self.counts
        total = sum(counts.values())
        values = {'path': self.path, 'topics': len(counts), 'messages': total,
                  **self.health.rates({'message rate [Hz]': total}),
                  **{f'messages on {topic}': n for topic, n in counts.items()},
                  **{f'not recorded: {topic}': why for topic, why in self._refused.items()}}
        if self._writer is None:
            return diagnostics.ERROR, f'not recording any more: {self.failure}', values
        if self._sim_time is not None and self.count_publishers(names.CLOCK) > 1:
            return (diagnostics.WARN, f'recording; more than one publisher on {names.CLOCK}, by '
                    'which the messages are filed', values)
        if self._refused:
            return (diagnostics.WARN, f'recording, but not {", ".join(sorted(self._refused))}',
                    values)
        if not counts:
            return diagnostics.WARN, 'no topic to record yet', values
        return diagnostics.OK, 'recording', values


def _import(type_name: str) -> type | None:
    """Return the class of a message type, or None if there is none here."""
    if not (parts := _TYPE.fullmatch(type_name)):
        return None
    try:
        return getattr(import_module(f'{parts[1]}.msg'), parts[2], None)
    except ImportError:
        return None


def _never_called(_message: bytes) -> None:
    """Stand for the callback that rclpy wants: messages are read instead."""


def _common(publishers: Sequence[TopicEndpointInfo], policy: str, strong: Policy,
            weak: Policy) -> Policy:
    """Return the stronger policy if all publishers offer it, so that all can be heard."""
    offered = {getattr(publisher.qos_profile, policy) for publisher in publishers}
    return strong if offered == {strong} else weak


def _offered(profile: QoSProfile) -> tuple[Any, ...]:
    """Return a quality of service profile as :class:`BagWriter` takes it."""
    return (profile.history.value, profile.depth, profile.reliability.value,
            profile.durability.value, profile.deadline.nanoseconds, profile.lifespan.nanoseconds,
            profile.liveliness.value, profile.liveliness_lease_duration.nanoseconds,
            profile.avoid_ros_namespace_conventions)


def main(config: str | Path | None = None, arguments: Sequence[str] = ()) -> int:
    """Record until signalled; see :func:`tetra_ros2.ros.executor.run`."""
    executor.look_around()
    return executor.run(Recorder, config, arguments)
