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

"""What an agent does with what it hears, and in silence, on a clock of the test's."""

from types import SimpleNamespace

from node_bench import Bench
import numpy as np
import pytest
from rclpy.parameter import Parameter
from tetra_ros2.config.parameters import ConfigurationError
from tetra_ros2.formation import law, topology
from tetra_ros2.formation.gain import Cosine
from tetra_ros2.nodes import agent
from tetra_ros2.nodes.agent import Agent
from tetra_ros2.ros import diagnostics
from tetra_ros2.wire import cdr

STILL = (0.0, 0.0, 0.0)
AXIS = np.array([1.0, 0.0, 0.0])
SEEN = np.array([[0.0, 1.0, 0.0], [0.0, 0.0, 1.0], [0.6, 0.0, -0.8]])
encode, decode = cdr.vector3_stamped('agent_1').encode, cdr.twist_stamped('agent_1').decode


class Alone:
    """Agent 1 of four, with a clock and ticks of the test's own, and what it commands."""

    def __init__(self, bench, clock):
        self.node, self.clock, self.commanded = bench.node, clock, []
        self.node._send = lambda message: self.commanded.append(self.read(message))
        self.listen()

    def listen(self):
        self.receivers = [self.node._receiver(slot, f'agent_{slot + 2}') for slot in range(3)]

    @staticmethod
    def read(message):
        stamp, (*linear, x, y, z) = decode(message)
        assert linear == [0.0, 0.0, 0.0]
        return stamp, (x, y, z)

    def see(self, stamp, slots=(0, 1, 2)):
        for slot in slots:
            self.receivers[slot](encode(stamp, *SEEN[slot]))

    def tick(self):
        """Let the agent look after itself; return the state that it is in then."""
        self.node._on_tick()
        return self.node._state


@pytest.fixture
def alone(probe, monkeypatch):
    clock = SimpleNamespace(now=50.0)
    clock.monotonic = lambda: clock.now
    monkeypatch.setattr(agent, 'time', clock)
    with Bench(probe, Agent, 1, rate=0.01, measurement_timeout=1.0) as bench:
        yield Alone(bench, clock)


def expected(gain=None):
    return law.angular_velocity(AXIS, SEEN, topology.complete(4).weights[0, 1:],
                                gain or Cosine())


def test_each_full_set_of_one_time_is_answered_with_the_law(alone):
    for stamp in (1000, 2000):
        alone.see(stamp)
    (first, rate), (second, again) = alone.commanded
    assert (first, second) == (1000, 2000)
    assert rate == again == pytest.approx(expected(), abs=1e-14)
    assert alone.tick() == (diagnostics.OK, 'answering')
    assert (alone.node.answers, alone.node.measurements) == (2, 6)


def test_sets_of_different_times_are_answered_at_a_tick_with_the_oldest_of_their_stamps(alone):
    alone.see(1000)
    assert alone.tick() == (diagnostics.OK, 'answering')
    alone.see(3000, [0])
    alone.see(2000, [1])
    level, message = alone.tick()
    assert (level, message) == (diagnostics.WARN, 'answering to measurements of different times')
    stamp, rate = alone.commanded[-1]
    assert stamp == 1000
    assert rate == pytest.approx(expected(), abs=1e-14)
    assert alone.node.partial_answers == 1
    alone.tick()
    assert alone.node.partial_answers == 1, 'nothing new was heard'


def test_it_waits_for_whom_it_has_never_heard_and_commands_nothing(alone):
    assert alone.tick() == (
        diagnostics.WARN, 'waiting for measurements of agent_2, agent_3, agent_4')
    alone.see(1000, [0, 2])
    assert alone.tick() == (diagnostics.WARN, 'waiting for measurements of agent_3')
    assert alone.commanded == []


def test_silence_of_one_neighbour_stops_it_one_nanosecond_after_the_newest_measurement(alone):
    alone.see(1000)
    alone.tick()
    alone.clock.now += 0.9
    alone.see(2000, [0, 1])
    alone.tick()
    alone.clock.now += 0.2  # agent 4 was last heard 1.1 s ago
    assert alone.tick() == (diagnostics.ERROR, 'stopped, nothing heard of agent_4')
    assert alone.commanded[-1] == (2001, STILL)
    assert alone.node.stops == 1
    figures = alone.node.assess()[2]
    assert figures['age of agent_2 [s]'] == pytest.approx(0.2)
    assert figures['age of agent_4 [s]'] > 1e9
    alone.clock.now += 10.0
    assert alone.tick()[1] == 'stopped, nothing heard of agent_2, agent_3, agent_4'
    assert alone.commanded[-1] == (2001, STILL), 'no later than what was measured'
    # Whatever comes then is welcome, even of a clock that was set back.
    alone.see(10)
    assert alone.commanded[-1][0] == 10
    assert alone.tick() == (diagnostics.OK, 'answering')


@pytest.mark.parametrize(('timeout', 'allowed'), [(0.5, 0.5), (3.0, 3.0)])
def test_a_stamp_may_be_ahead_by_the_time_out_and_a_margin(alone, timeout, allowed):
    result, = alone.node.set_parameters([Parameter('measurement_timeout', value=timeout)])
    assert result.successful
    assert alone.node._controller.ahead == round(1e9 * (allowed + 0.1))


def test_a_new_gain_counts_from_the_next_answer_on(alone):
    alone.see(1000)
    alone.node.set_parameters([Parameter('gain.a', value=2.5)])
    alone.see(2000)
    assert alone.commanded[0][1] == pytest.approx(expected(), abs=1e-14)
    assert alone.commanded[1][1] == pytest.approx(expected(Cosine(2.5)), abs=1e-13)


def test_with_two_publishers_it_holds_still_if_that_is_wished_for(alone, monkeypatch):
    alone.see(1000)
    monkeypatch.setattr(alone.node, 'publisher_conflicts', lambda: ['/x', '/y'])
    assert alone.tick() == (diagnostics.OK, 'answering'), 'it is not wished for'
    alone.node.set_parameters([Parameter('on_publisher_conflict', value='hold')])
    assert alone.tick() == (
        diagnostics.ERROR, 'holding still, more than one publisher on /x, /y')
    assert alone.commanded[-1] == (1001, STILL)
    answers = alone.node.answers
    alone.see(2000)
    assert alone.node.answers == answers
    assert alone.tick()[0] == diagnostics.ERROR
    assert alone.commanded[-1] == (2001, STILL)
    monkeypatch.setattr(alone.node, 'publisher_conflicts', lambda: [])
    alone.tick()
    alone.see(3000)
    assert alone.node.answers == answers + 1


def test_a_bad_measurement_is_counted_and_what_else_is_raised_survived(alone, monkeypatch):
    alone.receivers[1](encode(1000, 0.0, 0.0, 2.0))
    assert dict(alone.node.health.rejected) == {'not a unit vector (agent_3)': 1}
    monkeypatch.setattr(alone.node, '_encode', lambda *_: 1 / 0)
    alone.listen()
    alone.see(2000)
    assert alone.node.health.exceptions == 1
    assert 'ZeroDivisionError' in alone.node.health._last_exception


def test_with_simulated_time_silence_is_measured_in_that(probe, monkeypatch):
    with Bench(probe, Agent, 1, rate=0.01, use_sim_time=True) as bench:
        now = SimpleNamespace(now=lambda: SimpleNamespace(nanoseconds=1_250_000_000))
        monkeypatch.setattr(bench.node, 'get_clock', lambda: now)
        assert bench.node._now() == 1.25


def test_what_the_executor_hands_on_after_the_end_is_not_answered(alone):
    alone.see(10**9)
    alone.see(2 * 10**9, slots=(0, 1))
    alone.node.close()
    alone.see(2 * 10**9, slots=(2,))  # it completes the round
    alone.see(3 * 10**9)
    alone.tick()
    alone.see(4 * 10**9)
    assert [stamp for stamp, _ in alone.commanded] == [10**9, 10**9 + 1]


def test_its_last_command_is_zero_if_there_was_any(probe, alone):
    alone.see(1000)
    alone.node.close()
    assert alone.commanded[-1] == (1001, STILL)
    assert alone.node.inputs == []


def test_who_never_commanded_anything_commands_nothing_at_its_end(alone):
    alone.see(1000, [0])
    alone.node.close()
    assert alone.commanded == []


@pytest.mark.parametrize('i', [0, 5])
def test_an_agent_that_the_topology_does_not_have_is_refused(probe, i):
    with pytest.raises(ConfigurationError, match=f'--id: {i} is not valid, the topology has agen'):
        Bench(probe, Agent, i)


def test_an_agent_that_sees_nobody_says_so(probe):
    with Bench(probe, Agent, 1, topology__kind='custom', topology__edges=['2 1', '3 1', '4 1'],
               rate=0.01) as bench:
        bench.node._on_tick()
        assert bench.node._state == (diagnostics.WARN, 'sees nobody')
        assert bench.node.assess()[2]['answers'] == 0
