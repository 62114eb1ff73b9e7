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
from strategies import (
    assert_close,
    attitudes,
    formations,
    quaternions,
    tangents,
    unit_vectors,
    vectors,
)
from tetra_ros2.formation import rotation, sphere

ROUNDING = 4e-15


def distance(p, q):
    """Return the angle [rad] between two attitudes, from the matrices alone."""
    difference = rotation.to_matrix(p) - rotation.to_matrix(q)
    return 2.0 * math.asin(min(1.0, np.linalg.norm(difference) / math.sqrt(8.0)))


def matrix_exponential(matrix):
    """Return the exponential of a matrix by its power series, after halving it into reach."""
    halvings = 12
    scaled, term, total = matrix / 2.0**halvings, np.eye(len(matrix)), np.eye(len(matrix))
    for k in range(1, 12):
        term = term @ scaled / k
        total = total + term
    for _ in range(halvings):
        total = total @ total
    return total


@given(quaternions(), quaternions())
def test_closure(p, q):
    assert np.linalg.norm(rotation.multiply(p, q)) == pytest.approx(1.0, abs=ROUNDING)


@given(quaternions())
def test_identity(q):
    np.testing.assert_array_equal(rotation.multiply(rotation.IDENTITY, q), q)
    np.testing.assert_array_equal(rotation.multiply(q, rotation.IDENTITY), q)


@given(quaternions())
def test_inverse(q):
    for product in (rotation.multiply(q, rotation.inverse(q)),
                    rotation.multiply(rotation.inverse(q), q)):
        assert_close(product, rotation.IDENTITY, atol=ROUNDING)


@given(quaternions(), quaternions(), quaternions())
def test_associativity(p, q, r):
    assert_close(
        rotation.multiply(rotation.multiply(p, q), r),
        rotation.multiply(p, rotation.multiply(q, r)), atol=ROUNDING)


@given(quaternions(), quaternions(), vectors(3.0))
def test_rotate_is_an_action_of_the_group(p, q, v):
    assert_close(
        rotation.rotate(rotation.multiply(p, q), v),
        rotation.rotate(p, rotation.rotate(q, v)), atol=5.0 * ROUNDING)


@given(quaternions(), vectors(3.0), vectors(3.0))
def test_rotate_keeps_lengths_angles_and_handedness(q, x, y):
    turned_x, turned_y = rotation.rotate(q, x), rotation.rotate(q, y)
    assert turned_x @ turned_y == pytest.approx(x @ y, abs=1e-13)
    assert_close(
        rotation.rotate(q, np.cross(x, y)), np.cross(turned_x, turned_y), atol=1e-13)


@given(quaternions(), vectors(3.0))
def test_opposite_quaternions_are_one_rotation(q, v):
    np.testing.assert_array_equal(rotation.rotate(q, v), rotation.rotate(-q, v))


@given(quaternions(), vectors(3.0))
def test_to_matrix_is_the_matrix_of_rotate(q, v):
    matrix = rotation.to_matrix(q)
    assert_close(matrix @ v, rotation.rotate(q, v), atol=5.0 * ROUNDING)
    assert_close(matrix.T @ matrix, np.eye(3), atol=ROUNDING)
    assert np.linalg.det(matrix) == pytest.approx(1.0, abs=ROUNDING)


@given(quaternions(), quaternions())
def test_to_matrix_takes_products_to_products(p, q):
    assert_close(
        rotation.to_matrix(rotation.multiply(p, q)),
        rotation.to_matrix(p) @ rotation.to_matrix(q), atol=ROUNDING)


def test_a_quarter_turn_about_z_takes_x_to_y_and_y_to_minus_x():
    quarter = [0.0, 0.0, math.sqrt(0.5), math.sqrt(0.5)]
    x, y, _ = np.eye(3)
    assert_close(rotation.rotate(quarter, x), y, atol=ROUNDING)
    assert_close(rotation.rotate(quarter, y), -x, atol=ROUNDING)


@given(quaternions())
def test_from_matrix_is_the_inverse_of_to_matrix(q):
    back = rotation.from_matrix(rotation.to_matrix(q))
    assert back[3] >= 0.0
    assert abs(back @ q) == pytest.approx(1.0, abs=ROUNDING)
    assert_close(rotation.to_matrix(back), rotation.to_matrix(q), atol=ROUNDING)


@given(unit_vectors(), st.floats(-1e-7, 1e-7))
def test_from_matrix_is_accurate_near_half_turns(axis, offset):
    q = rotation.exp((math.pi + offset) * axis)
    back = rotation.from_matrix(rotation.to_matrix(q))
    assert_close(np.sign(back @ q) * back, q, atol=ROUNDING)


@given(vectors(4.0))
def test_exp_is_the_matrix_exponential(w):
    assert_close(
        rotation.to_matrix(rotation.exp(w)), matrix_exponential(sphere.hat(w)), atol=1e-11)


@given(vectors(2.0), st.floats(-3.0, 3.0), st.floats(-3.0, 3.0))
def test_exp_of_one_axis_is_a_one_parameter_group(w, s, t):
    assert_close(
        rotation.multiply(rotation.exp(s * w), rotation.exp(t * w)),
        rotation.exp((s + t) * w), atol=ROUNDING)


@given(unit_vectors(), st.floats(-300.0, -5.0))
def test_exp_of_small_vectors_loses_nothing(axis, exponent):
    w = 10.0**exponent * axis
    np.testing.assert_allclose(rotation.exp(w)[:3], 0.5 * w, rtol=1e-10, atol=0.0)


@given(unit_vectors(), st.floats(0.0, math.pi))
def test_log_is_the_inverse_of_exp_below_pi(axis, angle):
    w = angle * axis
    if angle < math.pi - 1e-6:
        assert_close(rotation.log(rotation.exp(w)), w, atol=ROUNDING)


@given(unit_vectors(), st.floats(-150.0, -1.0))
def test_log_of_small_rotations_keeps_relative_accuracy(axis, exponent):
    w = 10.0**exponent * axis
    # A component may be subnormal, and has fewer digits then.
    np.testing.assert_allclose(rotation.log(rotation.exp(w)), w, rtol=1e-14, atol=1e-321)


@given(quaternions())
def test_log_is_the_shortest_vector_that_gives_the_rotation(q):
    w = rotation.log(q)
    assert np.linalg.norm(w) <= math.pi + ROUNDING
    assert distance(rotation.exp(w), q) <= 1e-14
    assert np.linalg.norm(w) == pytest.approx(distance(q, rotation.IDENTITY), abs=1e-7)


@given(quaternions().filter(lambda q: q[3] != 0.0))
def test_log_does_not_see_the_sign_of_a_quaternion(q):
    np.testing.assert_array_equal(rotation.log(q), rotation.log(-q))


def test_log_of_half_turns_is_pi_long():
    assert_close(
        rotation.log(np.eye(4)[:3]), math.pi * np.eye(3), atol=ROUNDING)


@given(quaternions(), st.floats(-1e-9, 1e-9))
def test_renormalize_brings_a_length_back_to_one_and_keeps_the_direction(q, excess):
    back = rotation.renormalize((1.0 + excess) * q)
    assert_close(back, q, atol=ROUNDING)


def test_renormalize_leaves_alone_what_is_within_the_tolerance():
    q = (1.0 + 1e-6) * np.array([0.5, -0.5, 0.5, 0.5])
    np.testing.assert_array_equal(rotation.renormalize(q, tolerance=1e-5), q)


@given(attitudes(2))
def test_a_million_products_stay_of_unit_length(pair):
    # 2^20 factors by squaring: each square doubles the error that renormalize must take back.
    q, step = pair
    for _ in range(20):
        step = rotation.renormalize(rotation.multiply(step, step))
        q = rotation.renormalize(rotation.multiply(q, step))
    assert np.linalg.norm(q) == pytest.approx(1.0, abs=1e-14)
    assert np.linalg.norm(step) == pytest.approx(1.0, abs=1e-14)


@given(unit_vectors(), unit_vectors())
def test_between_takes_one_vector_to_the_other_the_shortest_way(x, y):
    q = rotation.between(x, y)
    assert_close(rotation.rotate(q, x), y, atol=1e-12)
    assert np.linalg.norm(rotation.log(q)) == pytest.approx(
        sphere.geodesic_distance(x, y), abs=1e-12)


@given(unit_vectors())
def test_between_of_a_vector_and_itself_is_the_identity(x):
    assert_close(rotation.between(x, x), rotation.IDENTITY, atol=ROUNDING)


@given(unit_vectors())
def test_between_opposite_vectors_is_a_half_turn(x):
    q = rotation.between(x, -x)
    assert_close(rotation.rotate(q, x), -x, atol=ROUNDING)
    assert np.linalg.norm(rotation.log(q)) == pytest.approx(math.pi, abs=ROUNDING)


@given(tangents(), st.floats(-16.0, -6.0))
def test_between_vectors_that_are_all_but_opposite_takes_one_to_the_other(start, exponent):
    x, v = start
    y = -x + 10.0**exponent * v
    y /= np.linalg.norm(y)
    assert_close(rotation.rotate(rotation.between(x, y), x), y, atol=1e-12)


@given(quaternions(), formations(5).filter(lambda x: np.linalg.svd(x)[1][1] > 0.1))
def test_align_finds_the_rotation_that_was_applied(q, points):
    found = rotation.align(points, rotation.rotate(q, points))
    assert distance(found, q) <= 1e-11


@given(formations(5), formations(5), vectors(1.0))
def test_align_is_better_than_any_rotation_beside_it(x, y, turn):
    q = rotation.align(x, y)
    assert np.linalg.norm(q) == pytest.approx(1.0, abs=ROUNDING)

    def cost(q):
        return np.sum((y - rotation.rotate(q, x))**2)

    assert cost(q) <= cost(rotation.multiply(rotation.exp(turn), q)) + 1e-12


def test_align_of_mirror_images_is_a_rotation_all_the_same():
    x = np.eye(3)
    matrix = rotation.to_matrix(rotation.align(x, -x))
    assert np.linalg.det(matrix) == pytest.approx(1.0, abs=ROUNDING)
    assert_close(matrix.T @ matrix, np.eye(3), atol=ROUNDING)


def test_random_attitudes_are_uniform():
    q = rotation.random(np.random.default_rng(3), 20000)
    assert_close(np.linalg.norm(q, axis=-1), 1.0, atol=ROUNDING)
    # The angle of a uniform rotation has the distribution (t - sin t) / pi.
    angle = np.sort(np.linalg.norm(rotation.log(q), axis=-1))
    cumulative = (angle - np.sin(angle)) / math.pi
    uniform = np.linspace(0.0, 1.0, len(angle))
    assert np.max(np.abs(cumulative - uniform)) < 1.95 / math.sqrt(len(angle))
    # Any axis is uniform on the sphere.
    gamma = rotation.rotate(q, np.array([0.6, 0.0, 0.8]))
    assert_close(np.mean(gamma, axis=0), 0.0, atol=0.02)
    assert_close(gamma.T @ gamma / len(gamma), np.eye(3) / 3.0, atol=0.01)


@given(attitudes(6), attitudes(6), formations(6))
def test_one_call_for_many_attitudes_is_many_calls_for_one(p, q, v):
    p, q, v = p.reshape(2, 3, 4), q.reshape(2, 3, 4), v.reshape(2, 3, 3)
    calls = (
        (rotation.multiply, (p, q)), (rotation.inverse, (p,)), (rotation.rotate, (p, v)),
        (rotation.exp, (v,)), (rotation.log, (p,)), (rotation.renormalize, (p,)),
        (rotation.to_matrix, (p,)), (rotation.from_matrix, (rotation.to_matrix(p),)),
        (rotation.between, (v, v[::-1])),
    )
    for function, arguments in calls:
        together = function(*arguments)
        for index in np.ndindex(2, 3):
            assert_close(
                together[index], function(*(argument[index] for argument in arguments)),
                atol=ROUNDING)


@given(attitudes(2), formations(4).filter(lambda x: np.linalg.svd(x)[1][1] > 0.1))
def test_align_works_on_many_sets_of_points_at_once(q, points):
    turned = rotation.rotate(q[:, None], points)
    together = rotation.align(points, turned)
    assert together.shape == (2, 4)
    for found, applied in zip(together, q):
        assert distance(found, applied) <= 1e-11
