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

"""Spinning: which executor, how long at a time, and how a process ends."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
import gc
import os
from pathlib import Path
import signal
from types import FrameType
from typing import Any, TYPE_CHECKING, TypeVar

from rclpy.context import Context
from rclpy.exceptions import ParameterException
from rclpy.executors import Executor, ExternalShutdownException
from rclpy.task import Future
from tetra_ros2 import signals
from tetra_ros2.config.parameters import ConfigurationError
from tetra_ros2.ros import fastdds, ports, shared_memory

if TYPE_CHECKING:
    from tetra_ros2.ros.node import FormationNode

try:
    from rclpy.experimental.events_executor import EventsExecutor
except ImportError:  # an rclpy older than 7.1.3
    from rclpy.executors import SingleThreadedExecutor as EventsExecutor

N = TypeVar('N', bound='FormationNode')

SPIN_PERIOD = 10.0
"""
How long to spin at a time [s].

Never without end: the events executor of rclpy 7.1 then busies a whole core and starves its own
callbacks. But seldom: each time, it loses 32 bytes. Under load it does not look at the time before
its queue is empty: what must happen meanwhile belongs in a timer, and what must end the spinning
in a future.
"""

WATCH_PERIOD = 0.1
"""How long a signal may wait in an idle process [s]."""

LARGEST_DOMAIN = 232
"""The largest ROS domain: those above it would need ports that there are not."""


def make_executor(context: Context) -> Executor:
    """Return the executor that all of this package's nodes spin in."""
    return EventsExecutor(context=context)


def spin_some(executor: Executor, future: Future, timeout: float = SPIN_PERIOD) -> None:
    """
    Spin until the future is done, or the time is over and nothing is left to do.

    :param timeout: [s], finite
    :raises ExternalShutdownException: if the context was shut down from elsewhere
    """
    try:
        executor.spin_until_future_complete(future, timeout_sec=timeout)
    except ExternalShutdownException:
        raise
    except Exception as error:
        # Callbacks survive what they raise. What is left is raised before one is called: a
        # request to a service that is none, for example. It costs that message, and no node.
        if not executor.context.ok():
            raise ExternalShutdownException from error
        for node in executor.get_nodes():
            if health := getattr(node, 'health', None):
                health.survive(error)
    if not executor.context.ok():
        raise ExternalShutdownException


class Signalled:
    """
    A future that the first SIGINT or SIGTERM completes, once :meth:`look` is called in a callback.

    The handler of a signal only takes note. To complete a future takes locks of rclpy, which the
    thread that was interrupted may hold just then, and it would wait for itself.

    :param executor: in which the future is waited for
    """

    def __init__(self, executor: Executor) -> None:
        self.future = Future(executor=executor)
        self._came: list[int] = []

    def note(self, number: int, _frame: FrameType | None = None) -> None:
        """Take note of a signal: a handler."""
        self._came.append(number)

    @property
    def came(self) -> bool:
        """Return whether a signal has come."""
        return bool(self._came)

    def look(self) -> None:
        """Complete it with the first signal that has come, if there is one."""
        if self._came and not self.future.done():
            self.future.set_result(self._came[0])


def keep_watch(node: FormationNode, signalled: Signalled | None = None) -> None:
    """
    Have a timer of a node look for signals, and for ports that others cannot find any more.

    Python sees signals only while it runs.

    :param signalled: what a signal completes, if it does not raise anything
    """
    def look() -> None:
        if signalled is not None:
            signalled.look()
        if lost := ports.reopen_lost():
            node.get_logger().warning(
                f'new nodes could not find {" and ".join(lost)} in shared memory, and would not '
                'have been heard; opened again')

    node.create_steady_timer(WATCH_PERIOD, look)


def spare_collections() -> None:
    """
    Keep the garbage collector from looking again at all that a process has made so far.

    What stays for good makes each full collection take some 10 ms, twenty steps at 2 kHz.
    """
    gc.collect()
    gc.freeze()


_signalled: Signalled | None = None


def signalled() -> bool:
    """Return whether a signal has come since :func:`until_signalled`: whoever waits should not."""
    return _signalled is not None and _signalled.came


@contextmanager
def until_signalled(executor: Executor) -> Iterator[Signalled]:
    """
    Give a future that the first SIGINT or SIGTERM completes; those that follow do nothing.

    A node has to look for them, see :func:`keep_watch`.

    rclpy's own handlers shut the context down at once, after which a node can no longer say what
    it has to: a last command of zero, the end of a recording. When this is left, the process is
    taken to be ending, and signals stay without effect: inside rclpy they would abort it.
    """
    global _signalled
    _signalled = Signalled(executor)
    for number in signals.SIGNALS:
        signal.signal(number, _signalled.note)
    if signals.interrupted():  # and a library that was loading swallowed what that raised
        _signalled.note(signal.SIGINT)
    try:
        yield _signalled
    finally:
        signals.ignore()


def local_by_default() -> None:
    """Keep the traffic on this machine, unless the environment says otherwise."""
    os.environ.setdefault('ROS_AUTOMATIC_DISCOVERY_RANGE', 'LOCALHOST')


def look_around() -> None:
    """
    Learn of all nodes and topics from a discovery server too, if there is one.

    It tells a plain client only of what that publishes or subscribes itself, and a recorder would
    never hear of the topics that it is to record.
    """
    if os.environ.get('ROS_DISCOVERY_SERVER'):
        os.environ.setdefault('ROS_SUPER_CLIENT', 'TRUE')


def ros_arguments(config: str | Path | None = None,
                  arguments: Sequence[str] = ()) -> tuple[list[str], dict[str, Any]]:
    """
    Return how a context and how its nodes are to be initialised.

    To rcl, a parameter on the command line does not come before one that a file gives to the very
    node. People expect that it does, so here the file is global and the rest the node's own.

    :param config: path of a parameter file, or None
    :param arguments: arguments as after ``--ros-args`` on a command line
    :returns: arguments for the context, and keyword arguments for each node
    """
    file = ['--params-file', str(config)] if config is not None else []
    return ['--ros-args', *file, *arguments], {'cli_args': ['--ros-args', *arguments]}


def initialize(context: Context, arguments: list[str]) -> None:
    """
    Initialise a context, without rclpy's signal handlers; see to the shared memory first.

    :param arguments: a command line's, with ``--ros-args``
    :raises ConfigurationError: if rcl does not take them, or there is no such ROS domain
    """
    domain = os.environ.get('ROS_DOMAIN_ID', '')
    if domain and not (domain.isdecimal() and int(domain) <= LARGEST_DOMAIN):
        raise ConfigurationError(
            f'{domain!r} is not valid, expected an integer from 0 to {LARGEST_DOMAIN}',
            key='ROS_DOMAIN_ID')
    shared_memory.prepare()
    fastdds.load_profiles()
    try:
        context.init(arguments)
    except Exception as error:  # rclpy has no public class for what rcl refuses
        raise ConfigurationError(str(error).splitlines()[0], source='--ros-args') from None


def leave(executor: Executor) -> None:
    """
    Destroy the nodes of an executor, the executor, and its context.

    :param executor: which has all nodes of its context
    """
    nodes = executor.get_nodes()
    any(map(fastdds.stop_listening, nodes))  # once for all, as they share a participant
    ports.settle()
    for node in nodes:
        executor.remove_node(node)
        node.destroy_node()
    executor.shutdown()  # the events executor holds on to the nodes until then
    executor.context.try_shutdown()


def _make(make_node: Callable[..., N], **kwargs: Any) -> N:
    try:
        return make_node(**kwargs)
    except ConfigurationError:
        raise
    except (ParameterException, RuntimeError, ValueError) as error:
        # What rclpy and rcl say of a name, a parameter of theirs or a quality of service.
        raise ConfigurationError(str(error).splitlines()[0], source='--ros-args') from error


def run(make_node: Callable[..., FormationNode], config: str | Path | None = None,
        arguments: Sequence[str] = ()) -> int:
    """
    Run one node until it is signalled or shut down; the body of every node's ``main``.

    :param make_node: called with keyword arguments for rclpy's Node, returns the node; its
        ``close`` is called at the end, while it can still publish
    :param config: path of a checked parameter file, or None
    :param arguments: arguments as after ``--ros-args`` on a command line
    :returns: the exit status: the node's, 0 if nothing went wrong
    :raises ConfigurationError: if the node cannot be configured
    """
    for_context, for_node = ros_arguments(config, arguments)
    context = Context()
    initialize(context, for_context)
    executor = make_executor(context)
    try:
        with until_signalled(executor) as signalled:
            node = _make(make_node, context=context, **for_node)
            executor.add_node(node)
            keep_watch(node, signalled)
            spare_collections()
            try:
                while not signalled.future.done():
                    spin_some(executor, signalled.future)
            except ExternalShutdownException:
                pass
            finally:
                node.close()
        return node.exit_status
    finally:
        leave(executor)
