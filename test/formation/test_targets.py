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

"""Graphs that are made for a shape: which shape, which axis, and what is refused."""

import numpy as np
import pytest
from tetra_ros2.formation import polyhedra, rings, rotation, targets, topology


@pytest.mark.parametrize('name', polyhedra.SOLIDS)
def test_a_graph_made_for_a_solid_has_it_as_its_shape_and_turns_only_if_asked_to(name):
    graph = targets.polyhedron(name)
    assert graph.n == targets.number_of_vertices(name) == len(polyhedra.SOLIDS[name])
    assert graph.shape.name == ('cube' if name == 'cube' else f'regular {name}')
    assert np.array_equal(graph.shape.points, polyhedra.SOLIDS[name])
    assert (graph.kind, graph.axis, graph.axis_agent, graph.axis_name) == (
        'polyhedron', None, None, None)
    assert np.array_equal(graph.weights, graph.weights.T)
    turning = targets.polyhedron(name, spin=-1.0)
    assert turning.axis_agent == 1
    assert turning.axis_name == 'the direction of agent_1'
    assert turning.axis == pytest.approx(turning.shape.points[0])
    assert not np.array_equal(turning.weights, turning.weights.T)


def test_an_axis_has_a_name_and_an_agent_only_where_one_lies_on_it():
    def axis(given):
        graph = targets.polyhedron('octahedron', axis=given, spin=0.5)
        return graph.axis_agent, graph.axis_name

    i, j = polyhedra.axis_agents(polyhedra.SOLIDS['octahedron'], 'edge')
    assert axis('edge') == (None, f'the middle of agents {i} and {j}')
    i, j, k = polyhedra.axis_agents(polyhedra.SOLIDS['octahedron'], 'face')
    assert axis('face') == (None, f'the middle of agents {i}, {j} and {k}')
    points = polyhedra.SOLIDS['octahedron']
    assert axis(3.0 * points[4]) == (5, 'the direction of agent_5')
    assert axis(np.array([3.0, 0.0, 4.0])) == (None, 'the axis [0.6, 0, 0.8] of the octahedron')


@pytest.mark.parametrize(('arguments', 'what'), [
    ({'name': 'cube', 'class_weights': [1.0, 2.0]},
     '2 weights are not valid, the cube has 3 classes of distance'),
    ({'name': 'cube', 'class_weights': [0.0, 0.0, 0.0]}, 'at least one class must have a weight'),
    ({'name': 'cube', 'spin': 1.0 + 1e-9}, 'spin must be from -1 to 1'),
    ({'name': 'cube', 'spin': -1.0 - 1e-9}, 'spin must be from -1 to 1'),
    ({'name': 'cube', 'spin': float('nan')}, 'spin must be from -1 to 1'),
    ({'name': 'cube', 'axis': np.zeros(3)}, 'finite and not zero')])
def test_a_solid_that_cannot_be_is_refused(arguments, what):
    with pytest.raises(ValueError, match=what):
        targets.polyhedron(**arguments)


@pytest.mark.parametrize('n', range(2, 9))
@pytest.mark.parametrize('spin', [0.0, 1.0, -1.0, 0.3])
def test_only_an_odd_ring_turns_about_the_normal_of_its_plane(n, spin):
    graph = targets.ring(n, spin)
    assert (graph.kind, graph.n) == ('ring', n)
    assert np.array_equal(graph.weights, rings.weights(n, spin))
    assert np.array_equal(graph.shape.points, rings.points(n))
    assert graph.shape.name == rings.name(n)
    turns = n % 2 == 1 and spin != 0.0
    assert (graph.axis is not None) == turns
    assert graph.axis_name == (
        'the normal of its plane, in the order of the agents' if turns else None)
    if turns:
        assert graph.axis.tolist() == [0.0, 0.0, 1.0]


@pytest.mark.parametrize(('n', 'spin', 'what'), [
    (1, 0.0, 'at least 2 agents, not 1'), (3, -1.0 - 1e-9, 'spin must be'),
    (3, 1.0 + 1e-9, 'spin must be')])
def test_a_ring_that_cannot_be_is_refused(n, spin, what):
    with pytest.raises(ValueError, match=what):
        targets.ring(n, spin)


def test_directions_are_made_unit_vectors():
    assert targets.directions([3.0, 0.0, 4.0, 0.0, -2.0, 0.0]) == pytest.approx(
        np.array([[0.6, 0.0, 0.8], [0.0, -1.0, 0.0]]))
    assert targets.directions([]).shape == (0, 3)
    with pytest.raises(ValueError, match='4 numbers are not valid, expected 3 for each agent'):
        targets.directions([1.0, 0.0, 0.0, 1.0])
    with pytest.raises(ValueError, match=r'\[0.0, 0.0, 0.0\] of agent 2 is not valid: .*not zero'):
        targets.directions([1.0, 0.0, 0.0, 0.0, 0.0, 0.0])


def test_a_graph_can_be_made_for_given_points_one_for_each_agent():
    points = targets.directions([1, 0, 0, 0, 1, 0, 0, 0, 1])
    graph = targets.given(topology.complete(3), points)
    assert np.array_equal(graph.shape.points, points)
    assert graph.shape.name == 'formation of 3 given directions'
    with pytest.raises(ValueError, match='9 numbers are not valid, expected 12 for 4 agents'):
        targets.given(topology.complete(4), points)


@pytest.mark.parametrize('name', polyhedra.SOLIDS)
def test_points_are_named_after_the_solid_that_they_are_however_it_lies(name):
    points = polyhedra.SOLIDS[name]
    rng = np.random.default_rng(1)
    turned = rotation.rotate(rotation.random(rng, (1,)), points)[rng.permutation(len(points))]
    expected = 'cube' if name == 'cube' else f'regular {name}'
    assert targets.name(-turned) == expected
    turned[0] = turned[1]
    assert targets.name(turned) == f'formation of {len(points)} given directions'
