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
A whole formation in one process: plant, agents, monitor and, if wanted, recorder.

They are the nodes that also run in processes of their own, they talk over DDS as these do, and
one executor spins them all::

    with Launcher('rotating', seed=3) as formation:
        formation.run_until(lambda: formation.error < 1e-3, timeout=60.0)
        print(formation.summary().measured.rate)
"""

from __future__ import annotations  # rclpy may be a stand-in, where the documentation is built

from collections import Counter
from collections.abc import Callable, Iterable, Mapping, Sequence
from pathlib import Path
import time
from typing import Any, TYPE_CHECKING, TypeVar

from rclpy.context import Context
from rclpy.executors import ExternalShutdownException
from rclpy.parameter import Parameter
from rclpy.task import Future
from tetra_ros2 import signals
from tetra_ros2.config import configuration
from tetra_ros2.config.bodies import check_bodies
from tetra_ros2.config.parameters import check_parameters, ConfigurationError, PARAMETERS
from tetra_ros2.formation import Formation
from tetra_ros2.formation._types import Array
from tetra_ros2.formation.simulation import period_of
from tetra_ros2.formation.summary import summarize, Summary
from tetra_ros2.nodes.agent import Agent
from tetra_ros2.nodes.monitor import Monitor
from tetra_ros2.nodes.plant import Plant
from tetra_ros2.ros.executor import (
    initialize,
    keep_watch,
    leave,
    local_by_default,
    look_around,
    make_executor,
    spin_some,
)
from tetra_ros2.ros.executor import ros_arguments as arguments_of
from tetra_ros2.ros.node import FormationNode
from tetra_ros2.wire import names

if TYPE_CHECKING:
    from tetra_ros2.recording.recorder import Recorder
    from tetra_ros2.viewer.node import Viewer

N = TypeVar('N', bound=FormationNode)

DISCOVERY_TIMEOUT = 20.0
"""How long the nodes may take to find each other [s]."""

AWAITED_PERIOD = 5.0
"""How often to say that somebody else's node is awaited [s]."""

FAREWELL_TIMEOUT = 2.0
"""How long nodes that were here before may take to be gone [s]."""

LOOK_PERIOD = 0.25
"""How often to look whether time stands still or the clock was set [s]."""

STALL_TIMEOUT = 60.0
"""How long formation time may stand still [s], where nobody gave another limit."""


class Launcher:
    """
    A formation in this process; a context manager that starts and stops it.

    :param config: a path, or the name of a configuration that ships
    :param seed: of the random initial attitudes, instead of the configuration's
    :param mode: ``lockstep`` or ``realtime``, instead of the configuration's
    :param body: ``kinematic``, ``wheels``, ``gimbal`` or an MJCF file, instead of the
        configuration's
    :param namespace: namespace of all nodes
    :param record: directory to record into, which must not exist; None for no recording
    :param storage: storage format of the recording, ``mcap`` or ``sqlite3``
    :param parameters: more parameters, ``{'gain.a': 2.0}`` for all nodes that have it or
        ``{'plant:rate': 50.0}`` for one kind of node; they come before the configuration's
    :param without: names of nodes to leave out, for somebody else's in their place
    :param view: address and port on which to show it to browsers, and whether they may do
        nothing but look; None for no viewer
    :param ros_arguments: arguments as after ``--ros-args`` on a command line
    :raises ConfigurationError: if anything of this is not valid; nothing was started then
    """

    def __init__(self, config: str | Path = 'complete', *, seed: int | None = None,
                 mode: str | None = None, body: str | None = None, namespace: str = '',
                 record: str | Path | None = None, storage: str = 'mcap',
                 parameters: Mapping[str, Any] | None = None,
                 without: Iterable[str] = (),
                 view: tuple[str, int] | tuple[str, int, bool] | None = None,
                 ros_arguments: Sequence[str] = ()) -> None:
        self._file = configuration.load(config)
        self._given = dict(parameters or {})
        if seed is not None:
            self._given['plant:seed'] = seed
        if mode is not None:
            self._given['plant:mode'] = mode
        if body is not None:
            self._given['plant:body'] = body
        if record is not None:
            configuration.check_new(record)
            self._given['recorder:output'] = str(record)
            self._given['recorder:storage'] = storage
        self._for_context, self._for_nodes = arguments_of(self._file.path, ros_arguments)
        self._namespace = configuration.check_namespace(namespace)
        configuration.check_ros_arguments(ros_arguments, PARAMETERS)
        for kind in PARAMETERS:
            check_parameters(kind, self._overrides(kind))
        if names.PLANT not in without:
            given = self._overrides('plant')
            try:
                check_bodies({**self._file.values('plant'), **given})
            except ConfigurationError as error:
                raise error if error.key in given else error.at(self._file.path) from None
        self._without = set(without)
        self._recording = record is not None
        self._view = view
        # These are there while it is entered.
        self.monitor: Monitor = None  # type: ignore[assignment]
        self.plant: Plant | None = None
        self.recorder: Recorder | None = None
        self.viewer: Viewer | None = None
        self.agents: dict[int, Agent] = {}
        self.nodes: list[FormationNode] = []
        self._context: Context | None = None
        self.executor: Any = None
        self._target = 0

    def _overrides(self, kind: str) -> dict[str, Any]:
        """Return the given parameters that are for a kind of node."""
        known = {spec.name for spec in PARAMETERS[kind]}
        overrides = {}
        for key, value in self._given.items():
            node, _, name = key.rpartition(':')
            if node not in ('', *PARAMETERS):
                raise ConfigurationError(
                    f'there is no node {node!r}, expected one of {", ".join(PARAMETERS)}', key=key)
            if node == kind or (not node and name in known):
                overrides[name] = value
            elif not node and not any(
                    name == spec.name for specs in PARAMETERS.values() for spec in specs):
                raise ConfigurationError('there is no such parameter', key=key)
        return overrides

    def __enter__(self) -> Launcher:
        """Start all nodes, and begin when they have found each other."""
        try:
            self._start()
        except BaseException:
            if self.recorder is not None:
                self.recorder.discard()
            self.close()
            raise
        return self

    def __exit__(self, *_: object) -> None:
        """Stop all nodes, and end the recording."""
        self.close()

    def _start(self) -> None:
        local_by_default()
        look_around()
        self._context = Context()
        initialize(self._context, self._for_context)
        self.executor = make_executor(self._context)
        self.monitor = self._add(Monitor, 'monitor')
        keep_watch(self.monitor)
        agents = {names.agent(i): i for i in range(1, self.formation.topology.n + 1)}
        for name in sorted(self._without - {names.PLANT, *agents}):
            raise ConfigurationError(
                f'{name!r} is not valid, expected one of {", ".join((names.PLANT, *agents))}',
                key='--without')
        for name, i in agents.items():
            if name not in self._without:
                self.agents[i] = self._add(Agent, 'agent', i)
        if names.PLANT not in self._without:
            self.plant = self._add(Plant, 'plant', start=False)
        if self._view is not None:
            from tetra_ros2.viewer.node import Viewer  # viser is optional, and slow to load
            host, port, read_only = (*self._view, False)[:3]
            # It gets the states from the monitor: one subscription more would slow the steps.
            self.viewer = self._add(
                Viewer, None, watch=self.monitor.watch, host=host, port=port, read_only=read_only)
        self._discover()
        if self._recording:
            from tetra_ros2.recording.recorder import Recorder  # rosbags is optional
            # In lockstep the recording is as reproducible as the run if it goes by its time.
            lockstep = self.plant is not None and self.plant.mode == 'lockstep'
            self.recorder = self._add(Recorder, 'recorder', sim_time=lockstep)
            self._discover()
        if self.plant is not None:
            self.plant.stepper.start()

    def _add(self, node_type: Callable[..., N], kind: str | None, *args: Any, **kwargs: Any) -> N:
        overrides = self._overrides(kind) if kind is not None else {}
        node = node_type(
            *args, context=self._context, namespace=self._namespace, **self._for_nodes, **kwargs,
            parameter_overrides=[Parameter(k, value=v) for k, v in overrides.items()])
        self.nodes.append(node)
        self.executor.add_node(node)
        return node

    def _discover(self) -> None:
        """
        Spin until every topic between the nodes has its two ends, and the recorder too.

        Who comes in the place of a node that was left out may take its time.
        """
        with signals.held_back() as release:
            self._wait_for_links(release)

    def _wait_for_links(self, release: Callable[[], None]) -> None:
        begun = told_at = time.monotonic()
        never = Future(executor=self.executor)
        while True:
            release()
            missing, awaited, conflicts = self._links()
            now = time.monotonic()
            if conflicts and now - begun > FAREWELL_TIMEOUT:
                raise ConfigurationError(
                    f'somebody else is on {conflicts[0]} already; choose another --namespace or '
                    'another ROS_DOMAIN_ID')
            if not missing and not awaited and not conflicts:
                return
            if missing and not awaited and now - begun > DISCOVERY_TIMEOUT:
                break
            if awaited and now - told_at > AWAITED_PERIOD:
                told_at = now
                self.monitor.get_logger().info(
                    f'waiting for {", ".join(sorted(self._without))}: nobody publishes on '
                    f'{awaited[0]}' + (f' and {len(awaited) - 1} more' if awaited[1:] else ''))
            spin_some(self.executor, never, timeout=0.01)
        raise ConfigurationError(
            f'nobody found on {missing[0]} within {DISCOVERY_TIMEOUT:g} s; is there a network '
            'interface, if only loopback, and does ROS_AUTOMATIC_DISCOVERY_RANGE allow it?')

    def _links(self) -> tuple[list[str], list[str], list[str]]:
        """
        Look at both ends of every topic here, as each end learns of the other by itself.

        :returns: topics on which one of these nodes is still missing, those on which somebody
            else's node is, and those on which there is one publisher too many
        """
        missing: list[str] = []
        awaited: list[str] = []
        conflicts: list[str] = []
        watching = (self.recorder, self.viewer)  # many may publish what these listen to
        listeners = Counter(s.topic_name for node in self.nodes for s in node.inputs)
        speakers = Counter(p.topic_name for node in self.nodes for p in node.outputs)
        if self.recorder is not None:
            missing += speakers.keys() - {s.topic_name for s in self.recorder.inputs}
        for node in self.nodes:
            for publisher in node.outputs:
                if publisher.get_subscription_count() < listeners[publisher.topic_name]:
                    missing.append(publisher.topic_name)
            for subscription in node.inputs:
                topic = subscription.topic_name
                count = subscription.get_publisher_count()
                if count < speakers[topic]:
                    missing.append(topic)
                elif not count:
                    (awaited if self._without else missing).append(topic)
                elif count > 1 and node not in watching:
                    conflicts.append(topic)
        return missing, awaited, conflicts

    @property
    def formation(self) -> Formation:
        """Return topology, gain and axes, as the nodes got them."""
        return self.monitor.formation

    @property
    def time(self) -> float:
        """Return the formation time since the start, as of the last sample [s]."""
        observer = self.monitor.observer
        if observer.stamp is None or observer.first_stamp is None:
            return 0.0
        return (observer.stamp - observer.first_stamp) / 1e9

    @property
    def error(self) -> float:
        """Return the last formation error; see :class:`~tetra_ros2.formation.summary.Summary`."""
        return self.monitor.observer.error

    @property
    def reduced_attitudes(self) -> Array:
        """Return the last Gamma, unit vectors in the world frame, ``(n, 3)``."""
        return self.monitor.observer.reduced_attitudes

    @property
    def attitudes(self) -> Array:
        """Return the last attitudes, unit quaternions x y z w, body to world, ``(n, 4)``."""
        return self.monitor.observer.attitudes

    def run_for(self, seconds: float, interrupt: Future | None = None,
                stall_timeout: float = STALL_TIMEOUT) -> bool:
        """
        Spin until so much more formation time has passed.

        In lockstep the plant then pauses at that very step; in real time it goes on.

        :param seconds: formation time [s]
        :param interrupt: a future that ends it earlier
        :param stall_timeout: how long to wait for formation time to pass at all [s]
        :returns: whether all that time has passed
        :raises TimeoutError: if formation time stands still
        """
        if not self.monitor.observer.count:
            # Formation time is counted from the first sample; until it is there, time waits too.
            self._run_to(0, interrupt, stall_timeout)
            if interrupt is not None and interrupt.done():
                return False
        # Count on from where the last run was to end, which may be less than a step ago.
        stamp = self.monitor.observer.stamp or 0
        period = period_of(self.plant.rate) if self.plant is not None else 0
        begin = self._target if 0 <= stamp - self._target < period else stamp
        self._target = self._run_to(begin + round(seconds * 1e9), interrupt, stall_timeout)
        return interrupt is None or not interrupt.done()

    def _run_to(self, stamp: int, interrupt: Future | None, stall_timeout: float) -> int:
        """
        Spin until the first sample at or after a stamp [ns].

        :returns: that stamp on the clock as it is then: it may have been set meanwhile
        """
        while True:
            shift = self._clock_shift
            reached = Future(executor=self.executor)
            self.monitor.notify(stamp, reached)
            if interrupt is not None:
                interrupt.add_done_callback(
                    lambda _, reached=reached: reached.done() or reached.set_result(None))
            if self.plant is not None:
                self.plant.stepper.run_until(stamp)
            self._spin(reached, stall_timeout)
            moved = self._clock_shift - shift
            if not moved or (interrupt is not None and interrupt.done()):
                return stamp
            stamp += moved

    @property
    def _clock_shift(self) -> int:
        """How far the clock of the plant's stamps was set since the start, in sum [ns]."""
        return 0 if self.plant is None else self.plant.stepper.clock_shift

    def _spin(self, future: Future, stall_timeout: float) -> None:
        """Spin until a future is done, or the plant's clock is set."""
        shift = self._clock_shift
        seen, since = None, time.monotonic()
        while not future.done() and self._clock_shift == shift:
            spin_some(self.executor, future, min(stall_timeout, LOOK_PERIOD))
            count = self.monitor.observer.count
            if count != seen:
                seen, since = count, time.monotonic()
            elif time.monotonic() - since > stall_timeout:
                raise TimeoutError(f'formation time has stood still for {stall_timeout:g} s')

    def run_until(self, condition: Callable[[], bool], timeout: float, every: float = 0.1) -> bool:
        """
        Run until a condition holds.

        :param condition: called without arguments, returns whether it holds
        :param timeout: formation time to give up after [s]
        :param every: formation time between two looks at the condition [s]
        :returns: whether it holds
        """
        end = self.time + timeout
        while not condition():
            if self.time >= end - 1e-9:
                return False
            self.run_for(min(every, end - self.time))
        return True

    def summary(self) -> Summary:
        """Return the :class:`~tetra_ros2.formation.summary.Summary` of the run so far."""
        return summarize(
            self.monitor.observer, self.formation.topology, self.formation.gain)

    def close(self) -> None:
        """Stop all nodes; what can be told is told, what is recorded is kept."""
        if self.executor is None:
            return
        if self.viewer is not None:
            self.viewer.close()
        if self.plant is not None:
            self.plant.close()
        for agent in self.agents.values():
            agent.close()
        if self.recorder is not None:
            self._drain()
            self.recorder.close()
        leave(self.executor)
        self.executor = self._context = None

    def _drain(self) -> None:
        """Let the recorder have what is still on its way."""
        try:
            for _ in range(3):
                spin_some(self.executor, Future(executor=self.executor), timeout=0.05)
        except ExternalShutdownException:
            pass
