# Copyright 2026 The tetra_ros2 authors
# SPDX-License-Identifier: Apache-2.0

"""
The recorder: serialised messages, as they come, into a rosbag2 directory.

It needs no rosbag2: the files are written by rosbags, in a process of its own, see
:mod:`tetra_ros2.nodes.bag_writer`; ``ros2 bag``, Foxglove and PlotJuggler read them.
"""

from collections import Counter
from contextlib import suppress
from datetime import datetime
from importlib import import_module
from pathlib import Path
import re
import shutil

from rclpy.qos import DurabilityPolicy, HistoryPolicy, QoSProfile, ReliabilityPolicy
import rosbags  # noqa: F401, to miss it here and not in the process that writes

from tetra_ros2.configuration import check_new
from tetra_ros2.nodes.bag_writer import BagError, BagWriter
from tetra_ros2.parameters import ConfigurationError
from tetra_ros2.ros import diagnostics, executor, names, parameters
from tetra_ros2.ros.node import FormationNode

DISCOVERY_PERIOD = 0.1
"""How often to look for topics that have appeared, and to pass on what has come [s]."""

BATCH = 512
"""How many messages are passed on together."""

DEPTH = 10000
"""How many messages of a topic may wait to be received."""


class Recorder(FormationNode):
    """
    The node ``recorder``; it records from its making to its :meth:`close`.

    Messages are filed under the time of their arrival; with ``use_sim_time`` that is the time of
    /clock, and recording begins with the first of it.

    :param now: where else to take the time from: returns it in nanoseconds, 0 for not yet
    :param kwargs: what rclpy's Node takes beside its name
    :raises ConfigurationError: if a parameter is not valid, or the output cannot be made; an
        existing path is never written to
    """

    def __init__(self, *, now=None, **kwargs):
        super().__init__(names.RECORDER, **kwargs)
        values = parameters.declare(self, 'recorder', self._accept, lambda _: None)
        self._wanted = re.compile('|'.join(f'(?:{p})' for p in self._patterns(values)))
        self.path = Path(values['output'] or f'tetra_{datetime.now():%Y_%m_%d-%H_%M_%S}')
        self.exclusive_inputs = False
        self._now = now or (lambda: self.get_clock().now().nanoseconds)
        self._recorded = []  # topics, by the number that the writer gave them
        self._refused = set()
        self._batch = []  # what has come and was not passed on yet
        self._passed_on = Counter()  # how many messages, by the topic's number
        self._writer = self._open(values['storage'])
        self.report_health()
        self.create_steady_timer(DISCOVERY_PERIOD, self._on_timer)
        self.discover()

    def _accept(self, values):
        try:
            re.compile(values['regex'])
        except re.error as error:
            raise ConfigurationError(
                f'{values["regex"]!r} is not a regular expression: {error}', key='regex') from None

    def _patterns(self, values):
        """Return regular expressions of the full names of the topics to record."""
        namespace = self.get_namespace().rstrip('/')
        patterns = [re.escape(topic if topic.startswith('/') else f'{namespace}/{topic}')
                    for topic in values['topics']]
        if values['regex']:
            patterns.append(values['regex'])
        if not patterns:
            patterns = [f'{re.escape(namespace)}/(?:{p})' for p in names.FORMATION_TOPICS]
            patterns.append(re.escape(names.CLOCK))
        return patterns

    def _open(self, storage):
        check_new(self.path)
        try:
            writer = BagWriter(self.path, storage)
        except BagError as error:
            raise ConfigurationError(
                f'cannot be recorded into: {error}', source=self.path) from None
        self.get_logger().info(f'recording into {self.path}')
        return writer

    def close(self):
        """End the recording; what has come so far is all there, and the bag is complete."""
        self._pass_on()
        if self._writer is None:
            return
        try:
            self._writer.close()
        except BagError as error:
            self._fail(error)
            return
        self._writer = None
        self.get_logger().info(
            f'{sum(self.counts.values())} messages of {len(self.counts)} topics are in '
            f'{self.path}')

    def discard(self):
        """Record nothing after all: the directory goes, which was made for this recording."""
        if self._writer is not None:
            self._writer.abort()
            self._writer = None
            shutil.rmtree(self.path)

    def _fail(self, error):
        """Give up recording: what is on the disk stays there, and may have to be recovered."""
        self._writer.abort()
        self._writer = None
        self._batch.clear()
        self.exit_status = 1
        self.get_logger().error(f'{self.path} cannot be written any more: {error}')

    @property
    def counts(self):
        """Return how many messages of each topic were recorded."""
        self._pass_on()
        return {topic: self._passed_on[k] for k, topic in enumerate(self._recorded)}

    def _pass_on(self):
        """Hand what has come to the process that writes."""
        batch = self._batch
        if self._writer is None:
            batch.clear()
        if not batch:
            return
        try:
            self._writer.write(batch)
        except BagError as error:
            self._fail(error)
            return
        self._passed_on.update([number for number, _, _ in batch])
        batch.clear()

    def _on_timer(self):
        self._pass_on()
        self.discover()

    def discover(self):
        """Begin to record those of the wanted topics that have appeared."""
        for topic, types in self.get_topic_names_and_types():
            if self._writer is None:  # even the last topic may have been one too many
                return
            if topic in self._recorded or not self._wanted.fullmatch(topic):
                continue
            publishers = self.get_publishers_info_by_topic(topic)
            if publishers and (topic, types[0]) not in self._refused:
                self._record(topic, types[0], publishers)

    def _record(self, topic, type_name, publishers):
        package, _, name = type_name.split('/')
        message_type = number = None
        with suppress(ImportError):
            message_type = getattr(import_module(f'{package}.msg'), name, None)
        if message_type is not None:
            try:
                number = self._writer.add_topic(
                    topic, type_name, str(publishers[0].topic_type_hash),
                    [_offered(publisher.qos_profile) for publisher in publishers])
            except BagError as error:
                self._fail(error)
                return
        if number is None:
            self._refused.add((topic, type_name))
            self.get_logger().warning(f'{topic} is not recorded, its type {type_name} is unknown')
            return
        profile = QoSProfile(
            history=HistoryPolicy.KEEP_LAST, depth=DEPTH,
            reliability=_common(publishers, 'reliability', ReliabilityPolicy.RELIABLE,
                                ReliabilityPolicy.BEST_EFFORT),
            durability=_common(publishers, 'durability', DurabilityPolicy.TRANSIENT_LOCAL,
                               DurabilityPolicy.VOLATILE))
        subscription = self.create_subscription(
            message_type, topic, self._receiver(number), profile, raw=True)
        self._recorded.append(topic)
        self.inputs.append(subscription)

    def _receiver(self, number):
        """Return what takes the messages of a topic."""
        batch, now = self._batch, self._now

        def on_message(message):
            if time := now():
                batch.append((number, time, message))
                if len(batch) >= BATCH:
                    self._pass_on()

        return on_message

    def assess(self):
        """Return level, message and figures for the diagnostics."""
        counts = self.counts
        total = sum(counts.values())
        values = {'path': self.path, 'topics': len(counts), 'messages': total,
                  **self.health.rates({'message rate [Hz]': total}),
                  **{f'messages on {topic}': n for topic, n in counts.items()}}
        if self._writer is None:
            return diagnostics.ERROR, 'not recording any more', values
        if not counts:
            return diagnostics.WARN, 'no topic to record yet', values
        return diagnostics.OK, 'recording', values


def _common(publishers, policy, strong, weak):
    """Return the stronger policy if all publishers offer it, so that all can be heard."""
    offered = {getattr(publisher.qos_profile, policy) for publisher in publishers}
    return strong if offered == {strong} else weak


def _offered(profile):
    """Return a quality of service profile as :class:`BagWriter` takes it."""
    return (profile.history.value, profile.depth, profile.reliability.value,
            profile.durability.value, profile.deadline.nanoseconds, profile.lifespan.nanoseconds,
            profile.liveliness.value, profile.liveliness_lease_duration.nanoseconds,
            profile.avoid_ros_namespace_conventions)


def main(config=None, arguments=()):
    """Record until signalled; see :func:`tetra_ros2.ros.executor.run`."""
    return executor.run(Recorder, config, arguments)
