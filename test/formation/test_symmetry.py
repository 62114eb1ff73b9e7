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

import itertools
import math

from hypothesis import given, settings
from hypothesis import strategies as st
import numpy as np
import pytest
from strategies import assert_close, formations
from tetra_ros2.formation import measures, polyhedra, rings, shapes, sphere, symmetry
from tetra_ros2.formation.symmetry import AdmissibleAngles


def uniform(n):
    return np.ones((n, n)) - np.eye(n)


def group(generators, n):
    """Return all permutations that the generators make."""
    found, waiting = {tuple(range(n))}, [tuple(range(n))]
    while waiting:
        p = waiting.pop()
        for g in generators:
            q = tuple(p[k] for k in g)
            if q not in found:
                found.add(q)
                waiting.append(q)
    return found


@given(st.integers(2, 5), st.data())
def test_the_generators_make_exactly_the_automorphisms(n, data):
    weights = np.array(data.draw(st.lists(
        st.sampled_from([0.0, 0.5, 1.0]), min_size=n * n, max_size=n * n))).reshape(n, n)
    np.fill_diagonal(weights, 0.0)
    brute = {p for p in itertools.permutations(range(n))
             if np.array_equal(weights[np.ix_(p, p)], weights)}
    assert group(symmetry.generators(weights), n) == brute


@pytest.mark.parametrize('scale', [1e-12, 1.0, 1e12])
def test_weights_are_the_same_if_they_differ_by_little_of_the_largest(scale):
    weights = scale * np.array([[0.0, 1.0, 1.0 + 1e-10], [1.0 + 1e-8, 0.0, 0.5], [0.5, 1.0, 0.0]])
    colors = symmetry.weight_colors(weights)
    assert colors.tolist() == [[0, 2, 2], [3, 0, 1], [1, 2, 0]]


@pytest.mark.parametrize('name, strengths, order', [
    ('tetrahedron', [1.0], 24), ('octahedron', [1.0, 6.0], 48), ('cube', [0.0, 1.0, 4.0], 48),
    ('icosahedron', [0.0, 1.0, 3.0], 120), ('dodecahedron', [0.0, 0.0, 0.6, 1.0, 2.0], 120)])
def test_at_rest_the_automorphisms_are_the_symmetries_of_the_solid(name, strengths, order):
    points = polyhedra.SOLIDS[name]
    weights = polyhedra.weights(points, strengths, points[0])
    assert len(group(symmetry.generators(weights), len(points))) == order
    assert len(AdmissibleAngles(points, weights).permutations) == 1


@pytest.mark.parametrize('axis, order', [('vertex', 3), ('edge', 2), ('face', 5)])
def test_spinning_only_turns_about_the_axis_and_the_inversion_are_left(axis, order):
    points = polyhedra.SOLIDS['dodecahedron']
    direction = polyhedra.axis_direction(points, axis)
    weights = polyhedra.weights(points, [0.0, 0.0, 0.6, 1.0, 2.0], direction, 0.5)
    assert len(group(symmetry.generators(weights), 20)) == 2 * order
    assert len(AdmissibleAngles(points, weights).permutations) == 1


def error_over_all(gamma, points, weights):
    """Return the error by its definition, over all automorphisms."""
    angles = measures.pairwise_angles(gamma)
    return min(np.max(np.abs(angles - measures.pairwise_angles(points[list(p)])))
               for p in itertools.permutations(range(len(points)))
               if np.allclose(weights[np.ix_(p, p)], weights))


@pytest.mark.parametrize('points, weights', [
    (shapes.OCTAHEDRON.points, uniform(6)),
    (polyhedra.SOLIDS['octahedron'], polyhedra.weights(
        polyhedra.SOLIDS['octahedron'], [1.0, 6.0], np.array([0.6, 0.0, 0.8]), 0.3)),
    (rings.points(6), rings.weights(6)),
    (rings.points(5), uniform(5)),
    (sphere.random(np.random.default_rng(1), (5,)), uniform(5)),  # all angles differ, by little
    (shapes.TETRAHEDRON.points, uniform(4))])
@settings(max_examples=15)
@given(st.data())
def test_the_error_is_the_least_over_all_automorphisms(points, weights, data):
    gamma = data.draw(formations(len(points)))
    admissible = AdmissibleAngles(points, weights)
    assert admissible.is_complete
    for size in (1.0, 0.5, 0.1, 1e-3):
        order = data.draw(st.permutations(range(len(points))))
        near = sphere.normalize(points[order] + 0.99 * size * gamma)
        expected = error_over_all(near, points, weights)
        assert admissible.error(measures.pairwise_angles(near).tolist()) == pytest.approx(
            expected, abs=1e-12)
        assert_close(admissible.errors(near), expected, atol=1e-12)


def test_six_that_see_all_have_fifteen_octahedra():
    admissible = AdmissibleAngles(shapes.OCTAHEDRON.points, uniform(6))
    assert len(admissible.permutations) == 15
    assert admissible.gap == pytest.approx(math.pi / 2.0)


@given(st.permutations(range(8)), formations(8), st.floats(-6.0, -1.0))
def test_too_many_matrices_to_keep_are_told_apart_close_by_and_bounded_far_off(
        order, direction, exponent):
    points = polyhedra.SOLIDS['cube']
    admissible = AdmissibleAngles(points, uniform(8))
    assert not admissible.is_complete
    near = sphere.normalize(points[order] + 10.0**exponent * direction)
    expected = np.max(np.abs(
        measures.pairwise_angles(near) - measures.pairwise_angles(points[order])))
    error = admissible.error(measures.pairwise_angles(near).tolist())
    assert error <= expected + 1e-12
    if expected < 0.5 * admissible.gap:
        assert error == pytest.approx(expected, abs=1e-12)
    bound = measures.shape_error(direction, np.sort(measures.pairwise_angles(points)))
    if bound >= 0.5 * admissible.gap:
        far = admissible.error(measures.pairwise_angles(direction).tolist())
        assert far == pytest.approx(bound, abs=1e-12)


def test_two_solids_of_the_same_distances_are_not_taken_for_each_other():
    # The dodecahedron's vertices under the other root of 5: the same angles in another order.
    points = polyhedra.SOLIDS['icosahedron']
    classes = polyhedra.distance_classes(points).of_pair
    weights = polyhedra.weights(points, [0.0, 1.0, 3.0], points[0])
    admissible = AdmissibleAngles(points, weights)
    # Agents 2 and its opposite change places: all angles occur as often as before.
    order = list(range(12))
    opposite = int(np.flatnonzero(classes[1] == 2)[0])
    order[1], order[opposite] = opposite, 1
    assert measures.shape_error(points[order], np.sort(measures.pairwise_angles(points))) < 1e-7
    assert admissible.errors(points[order]) == pytest.approx(admissible.gap)
