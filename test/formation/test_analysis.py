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

"""What an analysis says of the graph."""

import math

import numpy as np
import pytest
from tetra_ros2.formation import (
    analysis,
    complete,
    Cosine,
    custom,
    equilibria,
    Exponential,
    Formation,
    rotating,
    sphere,
    targets,
)

FOLLOWERS = [(i, j) for i, j, _ in complete(4).edges if i != 1]
"""Agent 1 sees nobody and everybody sees it: connected, but not strongly."""


@pytest.mark.parametrize(('edges', 'strongly'), [
    (FOLLOWERS, False), ([*FOLLOWERS, (1, 2)], True)])
def test_a_graph_is_strongly_connected_if_everybody_is_seen_by_everybody(edges, strongly):
    found = Formation(custom(4, edges), Exponential()).analyze()
    assert found.strongly_connected is strongly
    assert found.edges == len(edges)


@pytest.mark.parametrize(('graph', 'gain', 'what'), [
    (custom(4, [(1, 2), (2, 1), (3, 4), (4, 3)]), Exponential(),
     r'agents \{1, 2\} and \{3, 4\} do not see one another'),
    (complete(61), Exponential(), '61 agents are too many to analyse, expected 60 at most')])
def test_what_has_no_numbers_is_refused(graph, gain, what):
    with pytest.raises(ValueError, match=what):
        Formation(graph, gain).analyze()


def test_a_delay_longer_than_linear_algebra_bears_is_refused(monkeypatch):
    monkeypatch.setattr(analysis, 'MAX_HISTORY', 3 * 4 * 6)
    formation = Formation(complete(4), Exponential())
    assert formation.analyze(rate=100.0, delay=0.05).delay_steps == 5
    with pytest.raises(analysis.NotAnalyzable,
                       match=r'6 steps of delay .*, expected 5 at most for 4 ag') as refusal:
        formation.analyze(rate=100.0, delay=0.06)
    assert refusal.value.key == 'delay'


def test_a_shape_that_goes_on_changing_has_no_numbers(monkeypatch):
    graph = custom(4, FOLLOWERS[:-1])
    start = sphere.random(np.random.default_rng(0), (4,))
    assert equilibria.settle(start, graph.weights, Exponential(), longest=0.1) is None
    monkeypatch.setattr(equilibria, 'settle', lambda *_: None)
    with pytest.raises(ValueError, match='its shape goes on changing'):
        Formation(graph, Exponential()).analyze()


@pytest.mark.parametrize(('delay', 'steps'), [(0.0, 0), (0.05, 5)])
def test_the_numbers_of_the_papers_complete_graph(delay, steps):
    found = Formation(complete(4), Cosine()).analyze(
        rate=100.0, delay=delay, start=0.1, error=0.001)
    assert (found.agents, found.edges, found.delay_steps) == (4, 12, steps)
    assert found.strongly_connected and found.symmetric and found.hyperbolic
    assert (found.shape, found.spin_rate, found.period) == ('regular tetrahedron', 0.0, None)
    assert found.angles == pytest.approx([math.acos(-1.0 / 3.0)] * 6)
    # eq:SF:proofLinear6 with f = 2/3 and f' = -sin(theta).
    rates = [-v for v, _ in found.eigenvalues]
    assert len(rates) == 5
    assert rates == sorted(rates)
    assert all(min(abs(rate - 8 / 3), abs(rate - 32 / 9)) < 1e-9 for rate in rates)
    assert (found.slowest_rate, found.fastest_rate) == pytest.approx((8 / 3, 32 / 9))
    assert found.settling_time == pytest.approx(math.log(100.0) / (8 / 3))
    assert found.max_sample_time == pytest.approx(0.5625)
    assert found.max_delay == pytest.approx(9.0 * math.pi / 64.0)
    assert found.max_delay_steps == 43
    assert found.is_stable
    assert found.offset == 0.0
    if not delay:
        assert found.sampled_rate == pytest.approx(-math.log(1.0 - 0.01 * 8 / 3) / 0.01)
    rates = [rate for rate, _, _ in found.max_delay_by_rate]
    assert 1.0 / found.max_sample_time < rates[0] < 1.2 / found.max_sample_time
    assert rates == sorted(rates)
    assert 40.0 < rates[-1] * found.max_sample_time < 60.0
    for rate, most, late in found.max_delay_by_rate:
        assert late == pytest.approx(most / rate)
        assert late < found.max_delay
        assert (most + 2) / rate > found.max_delay
    assert found.mean_error > found.angle_deviation > 0.0


def test_the_numbers_of_the_papers_rotating_graph():
    found = Formation(rotating(), Cosine()).analyze(rate=100.0)
    assert found.spin_rate == pytest.approx(1.0 / math.sqrt(3.0))
    assert found.period == pytest.approx(2.0 * math.pi * math.sqrt(3.0))
    assert found.sampled_spin_rate == pytest.approx(found.spin_rate, rel=1e-2)
    assert found.sampled_spin_rate != found.spin_rate
    assert found.offset == pytest.approx(2.9e-4, abs=1e-5)
    assert not found.symmetric
    assert found.edges == 9


def test_beyond_its_limits_a_loop_is_not_stable_and_has_no_noise_to_speak_of():
    slow = Formation(complete(4), Cosine()).analyze(rate=1.7)
    assert not slow.is_stable
    assert slow.sampled_rate < 0.0
    assert slow.max_delay_steps == -1
    assert (slow.angle_deviation, slow.mean_error) == (None, None)


def test_a_shape_that_is_not_stable_attracts_nobody_and_a_neutral_one_might():
    unstable = Formation(targets.polyhedron('cube', [1.0, 0.0, 0.0]), Exponential())
    equilibrium, shape = analysis.attractor(unstable)
    assert shape is None
    assert equilibrium.inertia[0] == 0
    assert equilibrium.residual < 1e-8
    neutral = Formation(complete(6), Cosine())
    equilibrium, shape = analysis.attractor(neutral)
    assert shape is neutral.shape
    assert equilibrium.inertia[0] == 0
    assert equilibrium.inertia[1] > 0
    assert not neutral.analyze().hyperbolic


def test_two_agents_whose_gain_is_zero_where_they_end_have_no_rate():
    # f(pi) = 0 for the cosine gain: the last bit of the way takes ever longer.
    with pytest.raises(ValueError, match='decays exponentially'):
        Formation(complete(2), Cosine()).analyze()
    # Any gain with f(pi) > 0 has: to first order both move by f(pi) times the gap.
    gain = Exponential()
    assert Formation(complete(2), gain).analyze().slowest_rate == pytest.approx(
        2.0 * gain.f(np.pi), rel=1e-6)
