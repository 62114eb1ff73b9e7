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

import math

from hypothesis import given
from hypothesis import strategies as st
import numpy as np
import pytest
from strategies import any_topology
from tetra_ros2.formation import topology as topologies
from tetra_ros2.formation.topology import Topology

ROTATING = [(k, p) for k in (1, 2, 3, 4) for p in (0, 1)]


def successor(i, k):
    """Return Suc^k(i) as the paper writes it, where agent 4 counts as 0 modulo 4."""
    following = i % 4 + 1
    return following if following != k else following % 4 + 1


def test_rotating_about_agent_1_has_the_nine_edges_of_the_paper():
    assert topologies.rotating(k=1, p=1).edges == (
        (1, 2, 0.5), (1, 3, 0.5), (1, 4, 0.5),
        (2, 1, 0.5), (2, 3, 1.0),
        (3, 1, 0.5), (3, 4, 1.0),
        (4, 1, 0.5), (4, 2, 1.0))


@pytest.mark.parametrize('k, p', ROTATING)
def test_rotating_has_the_weights_of_the_papers_graph(k, p):
    weights = topologies.rotating(k, p).weights
    for i in range(1, 5):
        for j in range(1, 5):
            if i == j:
                expected = 0.0
            elif k in (i, j):
                expected = 0.5
            elif j == successor(i, k):
                expected = p
            else:
                assert i == successor(j, k)
                expected = 1 - p
            assert weights[i - 1, j - 1] == expected


@pytest.mark.parametrize('k', [1, 2, 3, 4])
def test_the_other_direction_is_the_transposed_graph(k):
    np.testing.assert_array_equal(
        topologies.rotating(k, 0).weights, topologies.rotating(k, 1).weights.T)


@pytest.mark.parametrize('k', [1, 2, 3, 4])
def test_each_of_the_others_is_followed_by_its_successor_skipping_k(k):
    others = topologies.others_in_order(k)
    assert sorted((*others, k)) == [1, 2, 3, 4]
    assert [successor(i, k) for i in others] == [*others[1:], others[0]]


@pytest.mark.parametrize('k', [0, 5, -1, 1.5])
def test_rotating_refuses_an_agent_that_does_not_exist(k):
    with pytest.raises(ValueError, match=f'k must be .* not {k}'):
        topologies.rotating(k=k)


@pytest.mark.parametrize('p', [2, -1, 0.5])
def test_rotating_refuses_a_third_direction(p):
    with pytest.raises(ValueError, match=f'p must be 0 or 1, not {p}'):
        topologies.rotating(p=p)


@pytest.mark.parametrize('n', [2, 3, 4, 7])
def test_in_the_complete_graph_everybody_sees_everybody_else(n):
    topology = topologies.complete(n)
    assert topology.n == n
    assert topology.edges == tuple(
        (i, j, 1.0) for i in range(1, n + 1) for j in range(1, n + 1) if i != j)
    assert topology.agents_without_neighbors == ()


@given(st.integers(2, 6).flatmap(any_topology))
def test_a_topology_is_what_its_edges_say(topology):
    assert list(topology.edges) == sorted(topology.edges)
    rebuilt = np.zeros((topology.n, topology.n))
    for i, j, weight in topology.edges:
        assert weight != 0.0
        rebuilt[i - 1, j - 1] = weight
    np.testing.assert_array_equal(rebuilt, topology.weights)
    np.testing.assert_array_equal(
        topologies.custom(topology.n, topology.edges).weights, topology.weights)


@given(st.integers(2, 6).flatmap(any_topology))
def test_neighbors_are_those_who_are_seen(topology):
    for i in range(1, topology.n + 1):
        assert topology.neighbors(i) == tuple(
            (j, weight) for by, j, weight in topology.edges if by == i)
        assert (i in topology.agents_without_neighbors) == (not topology.neighbors(i))


def test_an_edge_says_who_sees_whom():
    topology = topologies.custom(3, [(1, 2, 0.5), (2, 1)])
    assert topology.neighbors(1) == ((2, 0.5),)
    assert topology.neighbors(2) == ((1, 1.0),)
    assert topology.agents_without_neighbors == (3,)


@pytest.mark.parametrize('edge, problem', [
    ((1, 5), 'no agent 5 among 4'),
    ((0, 1), 'no agent 0 among 4'),
    ((-1, 1), 'no agent -1 among 4'),
    ((3, 3), 'agent 3 cannot see itself'),
    ((1, 2), 'agent 1 sees agent 2 more than once'),
    ((1, 2, 0.25), 'agent 1 sees agent 2 more than once'),
    ((1, 3, 0.0), 'not 0, not 0.0'),
    ((1, 3, math.nan), 'finite'),
    ((1, 3, -math.inf), 'finite'),
])
def test_an_edge_that_cannot_be_is_refused(edge, problem):
    with pytest.raises(ValueError, match=problem):
        topologies.custom(4, [(1, 2), edge])


@pytest.mark.parametrize('weights, problem', [
    (np.zeros((1, 1)), r'\(1, 1\)'),
    (np.zeros((2, 3)), r'\(2, 3\)'),
    (np.zeros(4), r'\(4,\)'),
    ([[0.0, math.nan], [0.0, 0.0]], 'finite'),
    ([[0.0, 1.0], [0.0, 2.0]], 'no edge to itself'),
])
def test_weights_that_are_no_graph_are_refused(weights, problem):
    with pytest.raises(ValueError, match=problem):
        Topology('custom', weights)


@pytest.mark.parametrize('n', [-1, 0, 1])
def test_fewer_than_two_agents_are_refused(n):
    for make in (topologies.complete, lambda n: topologies.custom(n, [])):
        with pytest.raises(ValueError):
            make(n)


def test_the_weights_cannot_be_changed_behind_the_topology():
    matrix = np.ones((2, 2)) - np.eye(2)
    topology = Topology('custom', matrix)
    matrix[0, 1] = 7.0
    assert topology.weights[0, 1] == 1.0
    with pytest.raises(ValueError, match='read-only'):
        topology.weights[0, 1] = 7.0
