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

from fractions import Fraction
import math

from hypothesis import given
from hypothesis import strategies as st
import numpy as np
import pytest
from strategies import assert_close, formations, quaternions, tangents, unit_vectors, vectors
from tetra_ros2.formation import rotation, sphere

ROUNDING = 2e-15


def exact_angle(x, y):
    """Return the angle between two vectors as they are stored, rounded only at the end."""
    x, y = [Fraction(c) for c in x.tolist()], [Fraction(c) for c in y.tolist()]
    cross = [x[1] * y[2] - x[2] * y[1], x[2] * y[0] - x[0] * y[2], x[0] * y[1] - x[1] * y[0]]
    return math.atan2(
        math.sqrt(sum(c * c for c in cross)), sum(a * b for a, b in zip(x, y)))


@given(vectors(10.0), vectors(10.0))
def test_hat_is_the_matrix_of_the_cross_product(x, y):
    assert_close(sphere.hat(x) @ y, np.cross(x, y), atol=1e-13)


@given(vectors(10.0))
def test_hat_is_skew_symmetric(x):
    np.testing.assert_array_equal(sphere.hat(x), -sphere.hat(x).T)


@given(unit_vectors(), unit_vectors(), unit_vectors())
def test_geodesic_distance_is_a_metric(x, y, z):
    assert sphere.geodesic_distance(x, x) <= ROUNDING
    assert sphere.geodesic_distance(x, y) == sphere.geodesic_distance(y, x)
    assert 0.0 <= sphere.geodesic_distance(x, y) <= math.pi
    assert (sphere.geodesic_distance(x, z)
            <= sphere.geodesic_distance(x, y) + sphere.geodesic_distance(y, z) + ROUNDING)


@given(unit_vectors(), unit_vectors())
def test_geodesic_distance_is_the_arc_cosine_of_the_paper(x, y):
    assert math.cos(sphere.geodesic_distance(x, y)) == pytest.approx(x @ y, abs=ROUNDING)


@given(quaternions(), unit_vectors(), unit_vectors())
def test_geodesic_distance_is_invariant_under_rotations(q, x, y):
    turned = sphere.geodesic_distance(rotation.rotate(q, x), rotation.rotate(q, y))
    assert turned == pytest.approx(sphere.geodesic_distance(x, y), abs=ROUNDING)


@given(unit_vectors(), unit_vectors())
def test_geodesic_distance_to_the_antipode_is_what_is_left_of_pi(x, y):
    assert sphere.geodesic_distance(x, -y) == pytest.approx(
        math.pi - sphere.geodesic_distance(x, y), abs=ROUNDING)


@given(unit_vectors(), unit_vectors(), st.floats(-16.0, -1.0))
def test_geodesic_distance_is_accurate_near_pi(x, y, exponent):
    y = -x + 10.0**exponent * y
    y /= np.linalg.norm(y)
    assert sphere.geodesic_distance(x, y) == pytest.approx(exact_angle(x, y), abs=ROUNDING)


@given(unit_vectors(), unit_vectors(), st.floats(-16.0, -1.0))
def test_geodesic_distance_is_accurate_near_zero(x, y, exponent):
    y = x + 10.0**exponent * y
    y /= np.linalg.norm(y)
    assert sphere.geodesic_distance(x, y) == pytest.approx(exact_angle(x, y), abs=ROUNDING)


@given(tangents(longest=1.0), st.floats(-8.0, -3.0))
def test_geodesic_distance_keeps_full_relative_accuracy_near_zero(start, exponent):
    x, v = start
    y = x + 10.0**exponent * v
    y /= np.linalg.norm(y)
    angle = exact_angle(x, y)
    if angle > 1e-9:
        assert sphere.geodesic_distance(x, y) == pytest.approx(angle, rel=1e-12, abs=0.0)


@given(tangents(longest=math.pi))
def test_exp_goes_as_far_as_the_tangent_is_long_and_stays_on_the_sphere(start):
    x, v = start
    y = sphere.exp(x, v)
    assert np.linalg.norm(y) == pytest.approx(1.0, abs=ROUNDING)
    assert sphere.geodesic_distance(x, y) == pytest.approx(np.linalg.norm(v), abs=ROUNDING)


@given(tangents(longest=3.0))
def test_exp_starts_with_the_velocity_given(start):
    x, v = start
    h = 1e-5
    velocity = (sphere.exp(x, h * v) - sphere.exp(x, -h * v)) / (2.0 * h)
    assert_close(velocity, v, atol=1e-8)


@given(tangents(longest=3.0))
def test_exp_follows_the_great_circle_through_its_start(start):
    x, v = start
    assert_close(
        sphere.exp(x, v), rotation.rotate(rotation.exp(np.cross(x, v)), x), atol=ROUNDING)


@given(unit_vectors())
def test_exp_of_no_velocity_stays_where_it_is(x):
    np.testing.assert_array_equal(sphere.exp(x, np.zeros(3)), x)


@given(unit_vectors(), vectors(5.0))
def test_project_leaves_the_tangent_part(x, v):
    tangent = sphere.project(x, v)
    assert x @ tangent == pytest.approx(0.0, abs=1e-14)
    assert_close(np.cross(x, v - tangent), 0.0, atol=1e-14)
    assert_close(sphere.project(x, tangent), tangent, atol=1e-14)


@given(unit_vectors(), st.floats(-307.0, 307.0))
def test_normalize_keeps_the_direction_of_the_longest_and_the_shortest_vectors(x, exponent):
    assert_close(sphere.normalize(10.0**exponent * x), x, atol=ROUNDING)


@pytest.mark.parametrize('nowhere', [
    [0.0, 0.0, 0.0], [math.nan, 0.0, 1.0], [math.inf, 0.0, 1.0], [0.0, -math.inf, 0.0]])
def test_normalize_refuses_what_has_no_direction(nowhere):
    with pytest.raises(ValueError, match='finite and not zero'):
        sphere.normalize([[1.0, 0.0, 0.0], nowhere])


def test_random_points_are_uniform_on_the_sphere():
    points = sphere.random(np.random.default_rng(1), 20000)
    assert_close(np.linalg.norm(points, axis=-1), 1.0, atol=ROUNDING)
    # Archimedes: every coordinate is uniform on [-1, 1]; Kolmogorov-Smirnov at the 0.1 % level.
    expected = np.linspace(-1.0, 1.0, len(points))
    distance = np.max(np.abs(np.sort(points, axis=0) - expected[:, None])) / 2.0
    assert distance < 1.95 / math.sqrt(len(points))
    assert_close(points.T @ points / len(points), np.eye(3) / 3.0, atol=0.01)


@pytest.mark.parametrize('shape, expected', [((), (3,)), (5, (5, 3)), ((2, 4), (2, 4, 3))])
def test_random_points_come_in_the_shape_asked_for(shape, expected):
    assert sphere.random(np.random.default_rng(1), shape).shape == expected


@given(formations(6), formations(6))
def test_one_call_for_many_points_is_many_calls_for_one(x, y):
    x, y = x.reshape(2, 3, 3), y.reshape(2, 3, 3)
    for function in (sphere.geodesic_distance, sphere.project, sphere.exp):
        together = function(x, y)
        for index in np.ndindex(2, 3):
            assert_close(
                together[index], function(x[index], y[index]), atol=ROUNDING)
    for function in (sphere.hat, sphere.normalize):
        together = function(x)
        for index in np.ndindex(2, 3):
            assert_close(together[index], function(x[index]), atol=ROUNDING)


def test_geodesic_distance_broadcasts_one_point_against_many():
    x = np.eye(3)
    distances = sphere.geodesic_distance(x[:, None], x[None, :])
    assert_close(distances, math.pi / 2.0 * (1.0 - np.eye(3)), atol=ROUNDING)
