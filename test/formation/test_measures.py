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

from hypothesis import assume, given
from hypothesis import strategies as st
import numpy as np
import pytest
from strategies import assert_close, formations, quaternions, unit_vectors, vectors
from tetra_ros2.formation import measures, rotation, sphere
from tetra_ros2.formation.shapes import ANTIPODAL, OCTAHEDRON, TETRAHEDRON, TRIANGLE

ROUNDING = 4e-15
MIRROR = np.diag([1.0, 1.0, -1.0])
SQUARE = np.array([[1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [-1.0, 0.0, 0.0], [0.0, -1.0, 0.0]])


def sign(permutation):
    """Return the sign of a permutation."""
    return np.linalg.det(np.eye(len(permutation))[list(permutation)])


def well_spread(gamma):
    return abs(np.linalg.det(gamma[1:] - gamma[0])) > 1e-3


def test_pairs_of_four_agents_are_in_the_order_of_the_papers_coordinates():
    assert measures.pairs(4) == ((1, 2), (1, 3), (1, 4), (2, 3), (2, 4), (3, 4))


@given(st.integers(2, 7).flatmap(formations))
def test_cosines_and_angles_are_those_of_the_pairs_in_order(gamma):
    pairs = measures.pairs(len(gamma))
    assert_close(
        measures.pairwise_cosines(gamma), [gamma[i - 1] @ gamma[j - 1] for i, j in pairs],
        atol=ROUNDING)
    assert_close(
        measures.pairwise_angles(gamma),
        [sphere.geodesic_distance(gamma[i - 1], gamma[j - 1]) for i, j in pairs], atol=0.0)


@given(quaternions(), st.integers(2, 6).flatmap(formations))
def test_cosines_and_angles_do_not_depend_on_the_world_frame(q, gamma):
    turned = rotation.rotate(q, gamma)
    for measure in (measures.pairwise_cosines, measures.pairwise_angles):
        assert_close(measure(turned), measure(gamma), atol=ROUNDING)


SHAPES = [ANTIPODAL, TRIANGLE, TETRAHEDRON, OCTAHEDRON]


@pytest.mark.parametrize('shape', SHAPES)
@given(quaternions(), st.randoms(use_true_random=False))
def test_a_shape_has_no_error_however_it_is_turned_and_numbered(shape, q, random):
    order = list(range(len(shape.points)))
    random.shuffle(order)
    gamma = rotation.rotate(q, shape.points[order])
    # Near pi the arc of an angle is as accurate as its square, but no better.
    assert measures.shape_error(gamma, shape.angles) == pytest.approx(0.0, abs=1e-14)


@given(st.floats(0.0, math.pi))
def test_the_error_of_a_pair_is_what_it_lacks_to_being_antipodal(theta):
    gamma = [[1.0, 0.0, 0.0], [math.cos(theta), math.sin(theta), 0.0]]
    assert measures.shape_error(gamma, ANTIPODAL.angles) == pytest.approx(
        math.pi - theta, abs=ROUNDING)


@given(formations(4))
def test_the_error_of_a_tetrahedron_is_that_of_its_worst_pair(gamma):
    worst = max(
        abs(math.acos(np.clip(gamma[i] @ gamma[j], -1.0, 1.0)) - math.acos(-1.0 / 3.0))
        for i, j in itertools.combinations(range(4), 2))
    assert measures.shape_error(gamma, TETRAHEDRON.angles) == pytest.approx(worst, abs=1e-7)


@given(formations(4).filter(well_spread), quaternions())
def test_rotations_keep_the_chirality_and_mirrors_change_it(gamma, q):
    handedness = measures.chirality(gamma)
    assert handedness in (1.0, -1.0)
    assert measures.chirality(rotation.rotate(q, gamma)) == handedness
    assert measures.chirality(rotation.rotate(q, gamma) @ MIRROR) == -handedness
    assert measures.chirality(-gamma) == -handedness


@given(formations(4).filter(well_spread), st.permutations(range(4)))
def test_a_permutation_changes_the_chirality_by_its_sign(gamma, order):
    assert measures.chirality(gamma[order]) == sign(order) * measures.chirality(gamma)


def test_the_chirality_of_three_axes_seen_from_outside_is_that_of_the_right_hand():
    # From the far corner the three ends run counter-clockwise: a positive volume.
    corner = np.array([-1.0, -1.0, -1.0]) / math.sqrt(3.0)
    assert measures.chirality([corner, *np.eye(3)]) == 1.0


def test_coplanar_agents_have_no_chirality():
    assert measures.chirality(SQUARE) == 0.0


@given(formations(4), vectors(3.0))
def test_the_angular_velocity_of_a_rigid_motion_is_the_one_it_turns_at(gamma, spin):
    assume(np.linalg.svd(gamma)[1][1] > 0.1)
    assert_close(measures.angular_velocity(gamma, np.cross(spin, gamma)), spin, atol=1e-11)


@given(formations(4), formations(4), vectors(1.0))
def test_no_other_angular_velocity_explains_a_motion_better(gamma, velocity, other):
    assume(np.linalg.svd(gamma)[1][1] > 0.1)

    def unexplained(spin):
        return np.sum((velocity - np.cross(spin, gamma))**2)

    best = measures.angular_velocity(gamma, velocity)
    assert unexplained(best) <= unexplained(best + other) + 1e-11


@given(unit_vectors(), vectors(3.0))
def test_the_angular_velocity_of_a_line_is_the_shortest_that_turns_it(axis, spin):
    gamma = np.array([axis, -axis])
    assert_close(
        measures.angular_velocity(gamma, np.cross(spin, gamma)), sphere.project(axis, spin),
        atol=1e-12)


@given(formations(4), unit_vectors(), st.floats(0.0, 3.0), st.floats(0.01, 10.0))
def test_the_mean_angular_velocity_takes_one_sample_to_the_next(gamma, axis, angle, elapsed):
    assume(np.linalg.svd(gamma)[1][1] > 0.1)
    after = rotation.rotate(rotation.exp(angle * axis), gamma)
    found = measures.mean_angular_velocity(gamma, after, elapsed)
    assert_close(elapsed * found, angle * axis, atol=1e-10)


@given(unit_vectors(), unit_vectors(), st.floats(0.0, 1.5))
def test_the_mean_angular_velocity_of_a_line_does_not_turn_it_about_itself(axis, other, angle):
    normal = np.cross(axis, other)
    assume(np.linalg.norm(normal) > 0.1)
    turn = angle * sphere.normalize(normal)
    before = np.array([axis, -axis])
    after = rotation.rotate(rotation.exp(turn), before)
    assert_close(measures.mean_angular_velocity(before, after, 1.0), turn, atol=1e-7)


@given(formations(8))
def test_one_call_for_many_formations_is_many_calls_for_one(gamma):
    gamma = gamma.reshape(2, 1, 4, 3)
    for measure in (
            measures.pairwise_cosines, measures.pairwise_angles, measures.chirality,
            lambda x: measures.shape_error(x, TETRAHEDRON.angles),
            lambda x: measures.angular_velocity(x, np.cross([1.0, 2.0, 3.0], x)),
    ):
        together = measure(gamma)
        for index in np.ndindex(2, 1):
            assert_close(together[index], measure(gamma[index]), atol=1e-9)


def test_the_mean_angular_velocity_of_many_formations_is_that_of_each():
    rng = np.random.default_rng(5)
    gamma = sphere.random(rng, (3, 2, 4))
    turns = rng.uniform(-1.0, 1.0, (3, 2, 3))
    after = rotation.rotate(rotation.exp(turns)[..., None, :], gamma)
    assert_close(measures.mean_angular_velocity(gamma, after, 0.5), turns / 0.5, atol=1e-12)


@pytest.mark.parametrize('off', [1e-2, 1e-4, 1e-6])
def test_agents_a_little_off_a_line_tell_how_they_turn_about_it(off):
    before = np.array([[0.0, 0.0, 1.0], [off, 0.0, -1.0], [0.0, off, 1.0]])
    before /= np.linalg.norm(before, axis=1, keepdims=True)
    turn = np.array([0.0, 0.0, 0.3])
    after = rotation.rotate(rotation.exp(turn), before)
    found = measures.mean_angular_velocity(before, after, 1.0)
    np.testing.assert_allclose(found, turn, atol=1e-3)
