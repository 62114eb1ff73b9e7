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
from strategies import assert_close, attitudes, formations, quaternions, unit_vectors, vectors
from tetra_ros2.formation import rotation, sphere
from tetra_ros2.formation.bodies import RigidBodies

X = (1.0, 0.0, 0.0)


def rates_of(array):
    return [tuple(row) for row in np.atleast_2d(array).tolist()]


@given(attitudes(3), formations(3))
def test_the_reduced_attitude_is_the_pointing_axis_in_the_world(q, axes):
    assert_close(RigidBodies(q, axes).reduced, rotation.rotate(q, axes), atol=2e-15)


@given(attitudes(3), formations(3), st.permutations(range(3)))
def test_a_body_sees_the_others_axes_from_its_own_frame(q, axes, others):
    bodies = RigidBodies(q, axes)
    gamma = rotation.rotate(q, axes)
    for i in range(3):
        expected = [rotation.to_matrix(q[i]).T @ gamma[j] for j in others]
        assert_close(bodies.seen_by(i, others), expected, atol=4e-15)
    assert bodies.seen_by(0, []) == []


@given(attitudes(3), formations(3), quaternions())
def test_what_a_body_sees_does_not_depend_on_the_world_frame(q, axes, turn):
    here, there = RigidBodies(q, axes), RigidBodies(rotation.multiply(turn, q), axes)
    for i in range(3):
        assert_close(here.seen_by(i, range(3)), there.seen_by(i, range(3)), atol=1e-14)


@given(attitudes(2), st.floats(1e-4, 3.0), st.lists(vectors(5.0), min_size=2, max_size=2))
def test_a_step_multiplies_by_the_exponential_of_the_body_rate(q, h, rates):
    bodies = RigidBodies(q, [X, X])
    bodies.step(h, rates_of(rates))
    expected = rotation.multiply(q, rotation.exp(h * np.array(rates)))
    assert_close(bodies.attitudes, expected, atol=1e-14)
    assert_close(bodies.reduced, rotation.rotate(expected, X), atol=2e-14)


@given(quaternions(), st.floats(0.01, 2.0), vectors(5.0), st.integers(2, 200))
def test_many_small_steps_at_a_constant_rate_are_one_large_one(q, time, rate, steps):
    many, one = RigidBodies([q], [X]), RigidBodies([q], [X])
    for _ in range(steps):
        many.step(time / steps, rates_of(rate))
    one.step(time, rates_of(rate))
    assert_close(many.attitudes, one.attitudes, atol=1e-13)


@given(quaternions(), unit_vectors(), vectors(2.0))
def test_a_step_starts_with_the_velocity_of_the_kinematics(q, axis, rate):
    # dR/dt = R w^, so that dGamma/dt = (R w) x Gamma
    h = 1e-5
    ends = []
    for sign in (1.0, -1.0):
        bodies = RigidBodies([q], [axis])
        bodies.step(sign * h, rates_of(rate))
        ends.append(np.array(bodies.reduced[0]))
    expected = np.cross(rotation.rotate(q, rate), rotation.rotate(q, axis))
    assert_close((ends[0] - ends[1]) / (2.0 * h), expected, atol=1e-8)


@given(quaternions(), vectors(5.0), st.floats(0.0, 2.0))
def test_a_step_back_undoes_a_step(q, rate, h):
    bodies = RigidBodies([q], [X])
    bodies.step(h, rates_of(rate))
    bodies.step(-h, rates_of(rate))
    assert_close(bodies.attitudes[0], q, atol=1e-14)


@given(attitudes(2), formations(2))
def test_a_body_that_is_told_to_hold_still_does_so_to_the_last_bit(q, axes):
    bodies = RigidBodies(q, axes)
    before = list(bodies.attitudes), list(bodies.reduced)
    bodies.step(0.1, [(0.0, 0.0, 0.0)] * 2)
    assert (bodies.attitudes, bodies.reduced) == before


@given(quaternions(), unit_vectors(), st.floats(-5.0, 5.0), st.floats(0.0, 3.0))
def test_turning_about_the_pointing_axis_does_not_move_it(q, axis, speed, h):
    bodies = RigidBodies([q], [axis])
    before = bodies.reduced[0]
    bodies.step(h, rates_of(speed * axis))
    assert_close(bodies.reduced[0], before, atol=4e-15)


@given(unit_vectors(), st.floats(-300.0, -8.0))
def test_the_slowest_rates_are_not_lost(axis, exponent):
    rate = 10.0**exponent * axis
    bodies = RigidBodies([rotation.IDENTITY], [X])
    bodies.step(1.0, rates_of(rate))
    if exponent > -150.0:  # below that the square of the speed is out of range, and the rate zero
        np.testing.assert_allclose(bodies.attitudes[0][:3], 0.5 * rate, rtol=1e-12, atol=0.0)
    assert bodies.attitudes[0][3] == pytest.approx(1.0)


def test_each_body_turns_at_its_own_rate():
    bodies = RigidBodies([rotation.IDENTITY] * 3, [X] * 3)
    bodies.step(math.pi / 2.0, [(0.0, 0.0, 1.0), (0.0, 0.0, 0.0), (0.0, 1.0, 0.0)])
    assert_close(bodies.reduced, [[0.0, 1.0, 0.0], X, [0.0, 0.0, -1.0]], atol=1e-15)


@pytest.mark.parametrize('excess', [-1e-9, -1e-13, 1e-13, 1e-9])
def test_a_quaternion_that_is_too_long_or_too_short_is_brought_back_at_the_next_step(excess):
    start = np.array([0.5, -0.5, 0.5, 0.5]) * math.sqrt(1.0 + excess)
    bodies = RigidBodies([start], [(1.0, 0.0, 0.0)])
    bodies.step(0.01, [(0.1, 0.2, 0.3)])
    assert abs(sum(x * x for x in bodies.attitudes[0]) - 1.0) < 2e-15


def test_the_quaternion_stays_of_unit_length_over_a_million_steps():
    bodies = RigidBodies([[0.1, 0.5, -0.7, 0.5]], [X])  # 0.01 + 0.25 + 0.49 + 0.25 = 1
    rates = [[(math.sin(3.0 * k), math.cos(5.0 * k), math.sin(7.0 * k + 1.0))] for k in range(9)]
    worst = 0.0
    for k in range(1000):
        for _ in range(1000):
            bodies.step(0.01, rates[k % 9])
        worst = max(worst, abs(math.hypot(*bodies.attitudes[0]) - 1.0))
    assert worst < 1e-12


def test_a_hundred_thousand_steps_end_where_one_does():
    rate, h, steps = np.array([0.3, -0.5, 0.8]), 0.01, 100000
    bodies = RigidBodies([rotation.IDENTITY], [X])
    for _ in range(steps):
        bodies.step(h, rates_of(rate))
    axis, speed = sphere.normalize(rate), np.linalg.norm(rate)
    turned = math.remainder(h * steps * speed, 4.0 * math.pi)
    assert_close(bodies.attitudes[0], rotation.exp(turned * axis), atol=1e-10)
