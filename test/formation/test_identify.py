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

"""The law is read off the commands; what theory predicts of it agrees with the paper."""

import bags
import numpy as np
import pytest
from tetra_ros2.formation import gain as gains
from tetra_ros2.formation import identify, rotation, shapes, topology
from tetra_ros2.formation import law as laws

GRAPHS = {
    'complete': topology.complete(4),
    'rotating': topology.rotating(2, 0),
    'custom': topology.custom(5, [(1, 2, 0.25), (2, 3), (3, 1, 0.5), (4, 1), (5, 4, 0.7), (1, 5)]),
}


def seen(graph, gain, noise=0.0):
    attitudes, body = bags.states(200, graph, gain)
    gamma = rotation.rotate(attitudes, [1.0, 0.0, 0.0])
    rates = rotation.rotate(attitudes, body)
    rates = rates + noise * np.random.default_rng(1).standard_normal(rates.shape)
    return gamma, rates, tuple((i, j) for i, j, _ in graph.edges)


@pytest.mark.parametrize('graph', GRAPHS.values(), ids=GRAPHS)
@pytest.mark.parametrize('gain', [
    gains.Cosine(0.7), gains.Exponential(3.0), gains.Exponential(2.0, 0.6), gains.Gaussian(1.5),
    gains.Linear(1.0, 0.8), gains.Rational(2.0, 1.7)], ids=str)
def test_graph_and_gain_are_read_off_the_commands(graph, gain):
    law = identify.identify(*seen(graph, gain))
    np.testing.assert_allclose(law.topology.weights, graph.weights, atol=1e-5)
    theta = np.linspace(0.3, 3.0, 20)
    np.testing.assert_allclose(law.gain.f(theta), gain.f(theta), rtol=1e-4)


@pytest.mark.parametrize('gain', [
    gains.Exponential(1.0, 7.2), gains.Exponential(1.0, 0.083), gains.Rational(1.0, 7.2)], ids=str)
def test_a_gain_is_read_off_to_the_ends_of_what_is_looked_at(gain):
    law = identify.identify(*seen(GRAPHS['complete'], gain))
    assert type(law.gain) is type(gain)
    assert law.gain.b == pytest.approx(gain.b, rel=1e-3)


def test_commands_that_follow_no_known_gain_are_not_explained():
    gamma, rates, edges = seen(GRAPHS['complete'], gains.Cosine(), noise=0.1)
    assert identify.identify(gamma, rates, edges) is None
    assert identify.identify(gamma, np.full_like(rates, np.nan), edges) is None
    assert identify.identify(gamma, rates, ()) is None


def test_motion_that_does_not_tell_the_neighbours_apart_is_not_explained():
    gamma = np.broadcast_to(shapes.TETRAHEDRON.points, (50, 4, 3))
    rates = np.zeros_like(gamma)
    assert identify.identify(gamma, rates, seen(GRAPHS['complete'], gains.Cosine())[2]) is None


@pytest.mark.parametrize(('noise', 'explained'), [(3e-4, True), (5e-3, False)])
def test_commands_are_explained_if_a_gain_fits_to_a_thousandth(noise, explained):
    gamma, rates, edges = seen(GRAPHS['complete'], gains.Exponential())
    size = np.sqrt(np.mean(rates**2))
    noisy = rates + noise * size * np.random.default_rng(1).standard_normal(rates.shape)
    law = identify.identify(gamma, noisy, edges)
    assert (law is not None) is explained


def test_two_neighbours_in_one_direction_are_not_told_apart():
    gamma, rates, edges = seen(GRAPHS['complete'], gains.Exponential())
    gamma = gamma.copy()
    gamma[:, 3] = gamma[:, 2]
    graph = GRAPHS['complete']
    rates = np.array([laws.world_angular_velocity(points, graph.weights, gains.Exponential())
                      for points in gamma])
    assert identify.identify(gamma, rates, edges) is None


def test_agents_that_see_nobody_or_never_move_are_left_as_they_are():
    graph = topology.custom(4, [(1, 2), (1, 3), (2, 3, 0.5), (3, 2)])  # agent 4 is blind
    gamma, rates, edges = seen(graph, gains.Exponential())
    law = identify.identify(gamma, rates, edges)
    np.testing.assert_allclose(law.topology.weights, graph.weights, atol=1e-6)
    assert law.residual < 1e-7
    np.testing.assert_array_equal(law.rounded.weights, graph.weights)
    assert law.rounded.kind == 'custom'
    assert identify.identify(gamma, np.zeros_like(rates), edges) is None


def test_a_blind_agent_that_moves_is_not_explained():
    graph = topology.custom(4, [(1, 2), (1, 3), (2, 3, 0.5), (3, 2)])
    gamma, rates, edges = seen(graph, gains.Exponential())
    rates = rates.copy()
    rates[:, 3] += 0.1
    assert identify.identify(gamma, rates, edges) is None
    rates[:, :3] = 0.0
    assert identify.identify(gamma, rates, edges) is None


def test_states_without_commands_are_left_out():
    graph = GRAPHS['rotating']
    gamma, rates, edges = seen(graph, gains.Cosine())
    rates = rates.copy()
    rates[::3, 1] = np.nan
    law = identify.identify(gamma, rates, edges)
    np.testing.assert_allclose(law.topology.weights, graph.weights, atol=1e-6)
