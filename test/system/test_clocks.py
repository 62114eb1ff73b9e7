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

"""System clocks that are set while a formation runs in real time."""

from itertools import pairwise
import time
from types import SimpleNamespace

from benchmarks import clocks
from geometry_msgs.msg import PoseArray
from harness import nanoseconds
import pytest
from rclpy.duration import Duration
from rclpy.task import Future
from tetra_ros2.launcher import Launcher
from tetra_ros2.ros.executor import spin_some

TOLERANCE = 5e-3
MEASUREMENT_TIMEOUT = 0.5


def set_clock(node, jump):
    """Let the clock of a node be off by so much [s]."""
    clock = node.get_clock()
    node.get_clock = lambda: SimpleNamespace(now=lambda: clock.now() + Duration(seconds=jump))


def spin_until(formation, condition, timeout):
    """Spin until a condition holds; the formation's own way to wait goes by its stamps."""
    never, deadline = Future(executor=formation.executor), time.monotonic() + timeout
    while not condition():
        assert time.monotonic() < deadline
        spin_some(formation.executor, never, timeout=0.01)


@pytest.fixture(scope='module')
def formation():
    with Launcher('rotating', mode='realtime', seed=3, parameters={
            'gain.a': 4.0, 'agent:measurement_timeout': MEASUREMENT_TIMEOUT}) as running:
        yield running


@pytest.mark.parametrize('jump', [-3600.0, -60.0, -30.0, 30.0, 3600.0])
@pytest.mark.parametrize('hosts', ['plant', 'agent_2', 'all'])
def test_a_clock_that_is_set_costs_less_than_the_timeout_and_a_second(formation, hosts, jump):
    """The agents answer, the bodies move and the formation is one again, on whatever host."""
    spin_until(formation, lambda: formation.error < TOLERANCE, 30.0)
    agents = list(formation.agents.values())
    nodes = [node for node in formation.nodes if hosts in (node.get_name(), 'all')]
    assert nodes
    for node in nodes:
        set_clock(node, jump)
    counts = [agent.answers for agent in agents]
    answered_at = [time.monotonic()] * len(agents)
    longest = 0.0

    def note():
        nonlocal longest
        now = time.monotonic()
        for k, agent in enumerate(agents):
            if agent.answers > counts[k]:
                longest = max(longest, now - answered_at[k])
                counts[k], answered_at[k] = agent.answers, now

    begun = time.monotonic()
    spin_until(formation, lambda: note() or time.monotonic() - begun > 1.0, 5.0)
    assert max(longest, time.monotonic() - min(answered_at)) < MEASUREMENT_TIMEOUT + 1.0
    spin_until(formation, lambda: formation.error < TOLERANCE, MEASUREMENT_TIMEOUT + 1.0)
    for node in nodes:
        del node.get_clock


@pytest.mark.parametrize('jump', [-30.0, 30.0])
def test_a_run_lasts_as_long_as_was_asked_for_though_the_clock_is_set(formation, jump):
    formation.run_for(0.2)
    begun = time.monotonic()

    def set_once():
        timer.cancel()
        set_clock(formation.plant, jump)

    timer = formation.plant.create_steady_timer(0.5, set_once)
    formation.run_for(1.5)
    lasted = time.monotonic() - begun
    formation.plant.destroy_timer(timer)
    del formation.plant.get_clock
    assert 1.4 < lasted < 10.0


@pytest.mark.skipif(not clocks.LIBRARY.exists(), reason='there is no libfaketime')
def test_the_plant_goes_on_stepping_when_the_clock_of_its_host_is_set(
        processes, probe, monkeypatch, tmp_path):
    clock = tmp_path / 'clock'
    clocks.set_clock(clock, 0.0)
    with monkeypatch.context() as patch:
        for name, value in clocks.environment(clock).items():
            patch.setenv(name, value)
        plant = processes.tetra(
            'plant', '--ros-args', '-p', 'mode:=realtime', '-p', 'command_timeout:=100.0')
    stamps = []  # [s]
    probe.node.create_subscription(
        PoseArray, 'formation/attitudes',
        lambda m: stamps.append(nanoseconds(m.header.stamp) / 1e9), 1000)
    probe.wait_for(lambda: len(stamps) > 10, 'states')
    for jump in (-30, 3600):
        before = stamps[-1]
        stamps[:] = stamps[-1:]
        clocks.set_clock(clock, jump)
        probe.wait_for(lambda e=before + jump: abs(stamps[-1] - e) < 10.0, f'{jump} s')
        clocks.set_clock(clock, 0.0)
        probe.wait_for(lambda b=before: abs(stamps[-1] - b) < 15.0, 'the true time')
        for one, next_one in pairwise(stamps):
            passed = min(abs(next_one - one - leap) for leap in (0.0, jump, -jump))
            assert passed < MEASUREMENT_TIMEOUT + 1.0
    plant.kill()
    plant.wait()
    clocks.remove_dead()
