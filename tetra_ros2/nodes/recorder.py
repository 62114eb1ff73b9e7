# Copyright 2026 The tetra_ros2 authors
# SPDX-License-Identifier: Apache-2.0

"""
The recorder: serialised messages, as they come, into a rosbag2 directory.

It needs no rosbag2: the files are written by rosbags, and ``ros2 bag``, Foxglove and PlotJuggler
read them.
"""

from contextlib import suppress
from datetime import datetime
from functools import partial
from importlib import import_module
from pathlib import Path
import re

import apsw
from rclpy.clock import Clock
from rclpy.clock_type import ClockType
from rclpy.qos import DurabilityPolicy, HistoryPolicy, QoSProfile, ReliabilityPolicy
from rosbags.interfaces import (
    Qos,
    QosDurability,
    QosHistory,
    QosLiveliness,
    QosReliability,
    QosTime,
)
from rosbags.rosbag2 import StoragePlugin, Writer, WriterError
from rosbags.typesys import get_typestore, Stores
from rosbags.typesys.base import TypesysError

from tetra_ros2.configuration import check_new
from tetra_ros2.parameters import ConfigurationError
from tetra_ros2.ros import diagnostics, executor, names, parameters
from tetra_ros2.ros.node import FormationNode

DISCOVERY_PERIOD = 0.1
"""How often to look for topics that have appeared [s]."""

DEPTH = 10000
"""How many messages of a topic may wait to be written."""

WRITING_ERRORS = OSError, apsw.Error, WriterError

_STORAGE = {'mcap': StoragePlugin.MCAP, 'sqlite3': StoragePlugin.SQLITE3}


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
        self._typestore = get_typestore(Stores.ROS2_JAZZY)
        self.exclusive_inputs = False
        self._now = now or (lambda: self.get_clock().now().nanoseconds)
        self._recorded = set()
        self._refused = set()
        self._last = 0
        self.counts = {}
        self._writer = self._open(_STORAGE[values['storage']])
        self.report_health()
        self.create_timer(
            DISCOVERY_PERIOD, self.discover, clock=Clock(clock_type=ClockType.STEADY_TIME))
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
        writer = Writer(self.path, version=9, storage_plugin=storage)
        try:
            writer.open()
        except OSError as error:
            raise ConfigurationError(
                f'cannot be recorded into: {error.strerror}', source=self.path) from None
        self.get_logger().info(f'recording into {self.path}')
        return writer

    def close(self):
        """End the recording; what has come so far is all there, and the bag is complete."""
        writer, self._writer = self._writer, None
        if writer is None:
            return
        try:
            writer.close()
        except WRITING_ERRORS as error:
            self._fail(error)
            return
        self.get_logger().info(
            f'{sum(self.counts.values())} messages of {len(self.counts)} topics are in '
            f'{self.path}')

    def _fail(self, error):
        """Give up recording: what is on the disk stays there, and may have to be recovered."""
        writer, self._writer = self._writer, None
        if writer is not None:
            with suppress(*WRITING_ERRORS):
                writer.abort()
        self.exit_status = 1
        self.get_logger().error(f'{self.path} cannot be written any more: {error}')

    def discover(self):
        """Begin to record those of the wanted topics that have appeared."""
        if self._writer is None:
            return
        for topic, types in self.get_topic_names_and_types():
            if topic in self._recorded or not self._wanted.fullmatch(topic):
                continue
            publishers = self.get_publishers_info_by_topic(topic)
            if publishers and (topic, types[0]) not in self._refused:
                self._record(topic, types[0], publishers)

    def _record(self, topic, type_name, publishers):
        package, _, name = type_name.split('/')
        try:
            message_type = getattr(import_module(f'{package}.msg'), name)
            connection = self._writer.add_connection(
                topic, type_name,
                msgdef=self._typestore.generate_msgdef(type_name, ros_version=2)[0],
                rihs01=str(publishers[0].topic_type_hash),
                offered_qos_profiles=[_offered(p.qos_profile) for p in publishers])
        except (ImportError, AttributeError, KeyError, TypesysError):
            self._refused.add((topic, type_name))
            self.get_logger().warning(f'{topic} is not recorded, its type {type_name} is unknown')
            return
        self.counts[topic] = 0
        profile = QoSProfile(
            history=HistoryPolicy.KEEP_LAST, depth=DEPTH,
            reliability=_common(publishers, 'reliability', ReliabilityPolicy.RELIABLE,
                                ReliabilityPolicy.BEST_EFFORT),
            durability=_common(publishers, 'durability', DurabilityPolicy.TRANSIENT_LOCAL,
                               DurabilityPolicy.VOLATILE))
        subscription = self.create_subscription(
            message_type, topic, partial(self._on_message, topic, connection), profile, raw=True)
        self._recorded.add(topic)
        self.inputs.append(subscription)

    def _on_message(self, topic, connection, message):
        now = self._now()
        if self._writer is None or not now:
            return
        self._last = max(now, self._last)  # the system's clock may be set back; a bag's may not
        try:
            self._writer.write(connection, self._last, message)
        except WRITING_ERRORS as error:
            self._fail(error)
            return
        self.counts[topic] += 1

    def assess(self):
        """Return level, message and figures for the diagnostics."""
        total = sum(self.counts.values())
        values = {'path': self.path, 'topics': len(self.counts), 'messages': total,
                  **self.health.rates({'message rate [Hz]': total}),
                  **{f'messages on {topic}': n for topic, n in self.counts.items()}}
        if self._writer is None:
            return diagnostics.ERROR, 'not recording any more', values
        if not self.counts:
            return diagnostics.WARN, 'no topic to record yet', values
        return diagnostics.OK, 'recording', values


def _common(publishers, policy, strong, weak):
    """Return the stronger policy if all publishers offer it, so that all can be heard."""
    offered = {getattr(publisher.qos_profile, policy) for publisher in publishers}
    return strong if offered == {strong} else weak


def _offered(profile):
    """Return a quality of service profile as rosbags writes it into a bag."""
    def duration(value):
        return QosTime(*divmod(value.nanoseconds, 1_000_000_000))

    return Qos(
        history=QosHistory(profile.history.value),
        depth=profile.depth,
        reliability=QosReliability(profile.reliability.value),
        durability=QosDurability(profile.durability.value),
        deadline=duration(profile.deadline),
        lifespan=duration(profile.lifespan),
        liveliness=QosLiveliness(profile.liveliness.value),
        liveliness_lease_duration=duration(profile.liveliness_lease_duration),
        avoid_ros_namespace_conventions=profile.avoid_ros_namespace_conventions,
    )


def main(config=None, arguments=()):
    """Record until signalled; see :func:`tetra_ros2.ros.executor.run`."""
    return executor.run(Recorder, config, arguments)
