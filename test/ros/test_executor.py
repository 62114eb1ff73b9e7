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

"""What ends the spinning of a node."""

from contextlib import suppress
import signal

import pytest
from rclpy.context import Context
from rclpy.executors import SingleThreadedExecutor
from tetra_ros2 import signals
from tetra_ros2.config.share import shipped
from tetra_ros2.launcher import Launcher
from tetra_ros2.ros import fastdds
from tetra_ros2.ros.executor import leave, run, until_signalled
from tetra_ros2.ros.node import FormationNode


@pytest.fixture
def handlers():
    """Give the test's process its handlers back."""
    before = {number: signal.getsignal(number) for number in signals.SIGNALS}
    yield
    for number, handler in before.items():
        signal.signal(number, handler)


@pytest.fixture
def executor():
    context = Context()
    context.init()
    made = SingleThreadedExecutor(context=context)
    yield made
    leave(made)


@pytest.mark.timeout(30)
def test_a_signal_in_the_middle_of_rclpy_does_not_wait_for_itself(handlers, executor):
    with until_signalled(executor) as signalled:
        signalled.future.add_done_callback(lambda _: None)  # as spinning does
        with executor._tasks_lock:  # as rclpy does while it looks for what is ready
            signal.raise_signal(signal.SIGINT)
            signal.raise_signal(signal.SIGTERM)
        signalled.look()
        assert signalled.future.result() == signal.SIGINT


def test_a_signal_that_came_while_libraries_were_loading_counts_though_one_swallowed_it(
        handlers, executor, monkeypatch):
    monkeypatch.setattr(signals, '_interrupted', False)
    signals.interrupt_once()
    with suppress(KeyboardInterrupt):
        signal.raise_signal(signal.SIGINT)
    with until_signalled(executor) as signalled:
        signalled.look()
        assert signalled.future.done()


class Brief(FormationNode):
    """A node that wants to leave as soon as it is there."""

    def __init__(self, **kwargs):
        super().__init__('brief', **kwargs)
        self.create_timer(0.01, lambda: signal.raise_signal(signal.SIGINT))

    def close(self):
        pass


@pytest.fixture
def asked(monkeypatch):
    """Return the names of the nodes for which Fast DDS was asked to stop, and whether it did."""
    found = {}
    stop = fastdds.stop_listening

    def note(node):
        found[node.get_name()] = stop(node)
        return found[node.get_name()]

    monkeypatch.setattr(fastdds, 'stop_listening', note)
    return found


def test_a_node_that_leaves_waits_with_a_limit_for_what_it_is_being_told(handlers, asked):
    assert run(Brief) == 0
    assert asked == {'brief': True}


def test_a_launcher_that_leaves_waits_with_a_limit_for_what_it_is_being_told(asked):
    with Launcher(shipped()['complete']) as formation:
        formation.run_for(0.01)
        assert not asked
    assert list(asked.values()) == [True], 'one is enough: they share a participant'
