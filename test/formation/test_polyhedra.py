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

from hypothesis import assume, given
from hypothesis import strategies as st
import numpy as np
import pytest
from strategies import any_gain, assert_close
from tetra_ros2.formation import law, measures, polyhedra, sphere, stability, topology
from tetra_ros2.formation.gain import Cosine, Exponential

ROUNDING = 1e-13
PHI = (1.0 + math.sqrt(5.0)) / 2.0
SOLIDS = {  # how many vertices, k_c, cos(theta_c), edges at a vertex, vertices of a face
    'tetrahedron': (4, [3], [-1 / 3], 3, 3),
    'octahedron': (6, [4, 1], [0, -1], 4, 3),
    'cube': (8, [3, 3, 1], [1 / 3, -1 / 3, -1], 3, 4),
    'icosahedron': (12, [5, 5, 1], [1 / math.sqrt(5), -1 / math.sqrt(5), -1], 5, 3),
    'dodecahedron': (20, [3, 6, 6, 3, 1],
                     [math.sqrt(5) / 3, 1 / 3, -1 / 3, -math.sqrt(5) / 3, -1], 3, 5),
}
EVERY_SOLID = pytest.mark.parametrize('name', SOLIDS)
UNIT = st.tuples(*[st.floats(-1.0, 1.0)] * 3).filter(
    lambda v: np.linalg.norm(v) > 0.1).map(sphere.normalize)
CLASS_WEIGHTS = st.lists(st.floats(0.01, 3.0), min_size=5, max_size=5)
SPIN = st.floats(-1.0, 1.0)


def triangular_prism():
    azimuth = 2.0 * math.pi / 3.0 * np.arange(3)
    ring = np.stack([np.cos(azimuth), np.sin(azimuth), np.full(3, 0.6)], axis=-1)
    return sphere.normalize(np.concatenate([ring, ring * [1.0, 1.0, -1.0]]))


def test_these_are_the_five():
    assert set(polyhedra.SOLIDS) == set(SOLIDS)


@EVERY_SOLID
def test_a_solid_has_its_vertices_distances_and_axes(name):
    n, sizes, cosines, degree, corners = SOLIDS[name]
    points = polyhedra.SOLIDS[name]
    classes = polyhedra.distance_classes(points)
    assert len(points) == n
    assert_close(np.linalg.norm(points, axis=1), 1.0, atol=ROUNDING)
    assert classes.sizes.tolist() == sizes
    assert np.all(classes.multiples == sizes)
    assert_close(np.cos(classes.angles), cosines, atol=ROUNDING)
    assert sizes[0] == degree
    assert len(polyhedra.axis_agents(points, 'face')) == corners
    assert polyhedra.axis_agents(points, 'vertex') == (1,)
    i, j = polyhedra.axis_agents(points, 'edge')
    assert classes.of_pair[i - 1, j - 1] == 0
    for axis in polyhedra.AXES:
        assert_close(polyhedra.axis_direction(points, axis), sphere.normalize(
            np.sum([points[i - 1] for i in polyhedra.axis_agents(points, axis)], axis=0)),
            atol=ROUNDING)


@EVERY_SOLID
def test_a_face_is_flat_with_all_other_vertices_below(name):
    points = polyhedra.SOLIDS[name]
    heights = points @ polyhedra.axis_direction(points, 'face')
    face = np.array(polyhedra.axis_agents(points, 'face')) - 1
    assert np.ptp(heights[face]) < ROUNDING
    assert np.max(np.delete(heights, face)) < np.min(heights) + np.ptp(heights) - 0.1


@pytest.mark.parametrize('order', [(0, 1, 2, 3, 4, 5), (0, 2, 1, 3, 4, 5), (1, 0, 2, 5, 4, 3)])
def test_a_face_is_found_whichever_way_round_its_points_are_counted(order):
    angles = 2.0 * np.pi / 3.0 * np.arange(3)
    triangle = np.stack([0.6 * np.cos(angles), 0.6 * np.sin(angles), np.full(3, 0.8)], axis=1)
    prism = np.concatenate([triangle, triangle * [1.0, 1.0, -1.0]])[list(order)]
    assert polyhedra.axis_agents(prism, 'face') == (1, 2, 3), 'the only face of nearest ones'
    assert_close(polyhedra.axis_direction(prism, 'face'), [0.0, 0.0, 1.0], atol=ROUNDING)


@EVERY_SOLID
def test_every_class_of_distance_is_balanced_and_isotropic(name):
    points = polyhedra.SOLIDS[name]
    assert np.max(polyhedra.imbalance(points)) < ROUNDING
    assert np.max(polyhedra.anisotropy(points)) < ROUNDING


def test_a_prism_is_neither():
    points = triangular_prism()
    assert np.max(polyhedra.imbalance(points)) > 0.1
    assert np.max(polyhedra.anisotropy(points)) > 0.1


@EVERY_SOLID
def test_under_the_recommended_weights_no_mode_is_much_slower_than_the_others(name):
    points, gain = polyhedra.SOLIDS[name], Exponential()
    weights = polyhedra.weights(points, np.array(polyhedra.CLASS_WEIGHTS[name]), points[0])
    rates = -stability.transverse(points, weights, gain).eigenvalues.real
    assert np.min(rates) > 0.32 * np.max(rates)


def test_imbalance_and_anisotropy_are_what_they_are_said_to_be():
    for points in (triangular_prism(), *polyhedra.SOLIDS.values()):
        points = sphere.normalize(points + 1e-8 * np.arange(points.size).reshape(points.shape))
        classes = polyhedra.distance_classes(points)
        tangent = [[pj - (pi @ pj) * pi for pj in points] for pi in points]
        imbalance, anisotropy = np.zeros(len(classes.angles)), np.zeros(len(classes.angles))
        for c, angle in enumerate(classes.angles):
            near = [[j for j in range(len(points)) if classes.of_pair[i, j] == c]
                    for i in range(len(points))]
            size = np.mean([len(js) for js in near])
            for i, js in enumerate(near):
                u = np.array([tangent[i][j] for j in js]).reshape(-1, 3)
                plane = np.eye(3) - np.outer(points[i], points[i])
                imbalance[c] = max(imbalance[c], np.linalg.norm(np.sum(u, axis=0)))
                anisotropy[c] = max(anisotropy[c], np.max(np.abs(
                    u.T @ u - 0.5 * size * np.sin(angle)**2 * plane)))
        assert_close(polyhedra.imbalance(points), imbalance, atol=1e-14)
        assert_close(polyhedra.anisotropy(points), anisotropy, atol=1e-14)


@EVERY_SOLID
@given(CLASS_WEIGHTS, UNIT, SPIN, any_gain(), st.booleans())
def test_a_solid_turns_about_any_axis_at_the_rate_of_the_closed_form(
        name, strengths, axis, spin, gain, mirrored):
    points = polyhedra.SOLIDS[name]
    strengths = strengths[:len(SOLIDS[name][1])]
    weights = polyhedra.weights(points, strengths, axis, spin)
    rate = polyhedra.spin_rate(points, strengths, axis, spin, gain)
    here = -points if mirrored else points  # -P is the mirror image of P, and e that of -e
    scale = gain.f(0.0) * np.max(weights) * len(points)
    assert_close(law.velocity(here, weights, gain), np.cross(rate * axis, here),
                 atol=ROUNDING * scale)


@EVERY_SOLID
@given(CLASS_WEIGHTS, UNIT, SPIN)
def test_no_weight_is_negative_and_the_largest_spin_makes_one_zero(name, strengths, axis, spin):
    points = polyhedra.SOLIDS[name]
    strengths = strengths[:len(SOLIDS[name][1])]
    assert np.min(polyhedra.weights(points, strengths, axis, spin)) >= 0.0
    assert topology.Topology('custom', polyhedra.weights(points, strengths, axis, spin))
    classes = polyhedra.distance_classes(points)
    full = polyhedra.weights(points, strengths, axis, 1.0)
    for c in range(len(classes.angles)):
        inside = classes.of_pair == c
        if classes.angles[c] < 3.1:
            assert np.min(full[inside]) == 0.0
        else:
            assert np.all(full[inside] == strengths[c])


@EVERY_SOLID
@given(CLASS_WEIGHTS, UNIT, SPIN, any_gain())
def test_the_sense_is_that_of_the_sign(name, strengths, axis, spin, gain):
    assume(abs(spin) > 1e-3)
    strengths = strengths[:len(SOLIDS[name][1])]
    rate = polyhedra.spin_rate(polyhedra.SOLIDS[name], strengths, axis, spin, gain)
    assert np.sign(rate) == np.sign(spin)


@pytest.mark.parametrize('spin, p', [(1.0, 1), (-1.0, 0)])
def test_the_papers_rotating_graph_is_the_tetrahedron_about_a_vertex(spin, p):
    points = polyhedra.SOLIDS['tetrahedron']
    assert measures.chirality(points) == 1
    weights = polyhedra.weights(points, [0.5], points[0], spin)
    assert np.array_equal(weights, topology.rotating(1, p).weights)
    gain = Cosine(1.7)
    assert polyhedra.spin_rate(points, [0.5], points[0], spin, gain) == pytest.approx(
        spin * math.sqrt(3.0) / 2.0 * gain.f(math.acos(-1.0 / 3.0)), rel=1e-14)


@pytest.mark.parametrize('axis', [[0.0, 0.0, 0.0], [math.nan, 0.0, 1.0]])
def test_an_axis_without_a_direction_is_refused(axis):
    with pytest.raises(ValueError, match='finite and not zero'):
        polyhedra.axis_direction(polyhedra.SOLIDS['cube'], np.array(axis))


def test_a_point_without_a_face_is_told():
    # Everything is above the only plane through the first point and its two nearest.
    points = np.array([[0.0, 0.0, 1.0], [0.6, 0.0, 0.8], [-0.6, 0.0, 0.8]])
    points = np.vstack([points, [[0.0, 1.0, 0.0], [0.0, -1.0, 0.0]]])
    with pytest.raises(ValueError, match='no face at the first of these 5 points'):
        polyhedra.axis_agents(points, 'face')
