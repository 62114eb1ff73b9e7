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
    any_gain,
    any_weights,
    assert_close,
    attitudes,
    formations,
    quaternions,
    unit_vectors,
)
from tetra_ros2.formation import law, rotation, shapes, sphere
from tetra_ros2.formation import topology as topologies
from tetra_ros2.formation.controller import Controller
from tetra_ros2.formation.gain import Cosine, Exponential, Gaussian

ROUNDING = 1e-12
COMPLETE = topologies.complete(4).weights
MIRROR = np.diag([1.0, 1.0, -1.0])


def potential(gamma, gain):
    """Return the paper's V: the integral of f(x) sin(x) from theta_ij to pi, over all edges."""
    node, weight = np.polynomial.legendre.leggauss(40)
    i, j = np.nonzero(COMPLETE)
    theta = sphere.geodesic_distance(gamma[i], gamma[j])
    half = (math.pi - theta) / 2.0
    x = theta[:, None] + half[:, None] * (1.0 + node)
    return np.sum(half[:, None] * weight * gain.f(x) * np.sin(x))


@given(formations(4), any_weights(4), any_gain())
def test_the_closed_loop_is_the_papers(gamma, weights, gain):
    for i in range(4):
        expected = np.zeros(3)
        for j in range(4):
            theta = sphere.geodesic_distance(gamma[i], gamma[j])
            expected += weights[i, j] * gain.f(theta) * np.cross(gamma[i], gamma[j])
        assert_close(
            law.world_angular_velocity(gamma, weights, gain)[i], -expected, atol=ROUNDING)
        assert_close(
            law.velocity(gamma, weights, gain)[i], np.cross(gamma[i], expected), atol=ROUNDING)


@given(formations(5), any_weights(5), any_gain())
def test_the_velocity_is_that_of_turning_at_the_angular_velocity(gamma, weights, gain):
    assert_close(
        law.velocity(gamma, weights, gain),
        np.cross(law.world_angular_velocity(gamma, weights, gain), gamma), atol=ROUNDING)


@given(formations(5), any_weights(5), any_gain())
def test_the_velocity_is_tangent_so_that_the_norm_is_preserved(gamma, weights, gain):
    assert_close(np.sum(gamma * law.velocity(gamma, weights, gain), axis=-1), 0.0, atol=ROUNDING)


@given(formations(4), any_weights(4), any_gain())
def test_nobody_turns_about_the_own_axis(gamma, weights, gain):
    rates = law.world_angular_velocity(gamma, weights, gain)
    assert_close(np.sum(gamma * rates, axis=-1), 0.0, atol=ROUNDING)


@given(quaternions(), formations(4), any_weights(4), any_gain())
def test_the_closed_loop_is_invariant_under_rotations(q, gamma, weights, gain):
    assert_close(
        law.velocity(rotation.rotate(q, gamma), weights, gain),
        rotation.rotate(q, law.velocity(gamma, weights, gain)), atol=ROUNDING)


@given(formations(4), any_weights(4), any_gain())
def test_the_mirror_image_of_a_motion_is_a_motion(gamma, weights, gain):
    assert_close(
        law.velocity(gamma @ MIRROR, weights, gain),
        law.velocity(gamma, weights, gain) @ MIRROR, atol=ROUNDING)


@given(st.permutations(range(4)), formations(4), any_weights(4), any_gain())
def test_agents_may_be_renamed(order, gamma, weights, gain):
    order = np.array(order)
    assert_close(
        law.velocity(gamma[order], weights[np.ix_(order, order)], gain),
        law.velocity(gamma, weights, gain)[order], atol=ROUNDING)


@given(attitudes(4), formations(4), any_weights(4), any_gain())
def test_an_agent_needs_only_what_it_sees_from_its_own_body_frame(q, axes, weights, gain):
    gamma = rotation.rotate(q, axes)
    seen = rotation.rotate(rotation.inverse(q)[:, None], gamma[None, :])
    in_body_frames = law.angular_velocity(axes, seen, weights, gain)
    assert_close(
        rotation.rotate(q, in_body_frames),
        law.world_angular_velocity(gamma, weights, gain), atol=ROUNDING)


@given(unit_vectors(), formations(3), any_weights(3), any_gain())
def test_the_agents_plain_floats_are_the_law_on_arrays(axis, seen, weights, gain):
    controller = Controller(axis, weights[0], gain)
    for slot, direction in enumerate(seen):
        controller.receive(slot, 1, tuple(direction), 0.0)
    on_arrays = law.angular_velocity(axis[None], seen[None], weights[:1], gain)[0]
    assert_close(controller.angular_velocity(), on_arrays, atol=ROUNDING)


@given(formations(4), any_gain())
def test_under_the_complete_graph_the_potential_falls_by_twice_the_squared_rates(gamma, gain):
    velocity = law.velocity(gamma, COMPLETE, gain)
    rates = law.world_angular_velocity(gamma, COMPLETE, gain)
    h = 1e-4 / max(1.0, np.max(np.abs(rates)))
    # Two central differences, of which the error terms in h^2 cancel.
    near, far = (
        (potential(sphere.exp(gamma, s * velocity), gain)
         - potential(sphere.exp(gamma, -s * velocity), gain)) / (2.0 * s) for s in (h, 2.0 * h))
    slope = (4.0 * near - far) / 3.0
    scale = max(1.0, gain.a)
    assert slope == pytest.approx(-2.0 * np.sum(rates**2), abs=1e-7 * scale**2)


@given(unit_vectors(), unit_vectors(), any_gain())
def test_two_agents_flee_each_other_along_the_great_circle_between_them(x, y, gain):
    gamma = np.array([x, y])
    theta = sphere.geodesic_distance(x, y)
    velocity = law.velocity(gamma, topologies.complete(2).weights, gain)
    speed = gain.f(theta) * math.sin(theta)
    assert_close(np.linalg.norm(velocity, axis=-1), speed, atol=ROUNDING)
    assert velocity[0] @ y <= ROUNDING
    assert velocity[1] @ x <= ROUNDING


@given(formations(4), any_weights(4), any_gain(), st.integers(0, 3))
def test_an_agent_that_sees_nobody_stays(gamma, weights, gain, blind):
    weights[blind] = 0.0
    np.testing.assert_array_equal(law.velocity(gamma, weights, gain)[blind], 0.0)


@given(quaternions(), any_gain())
def test_the_tetrahedron_is_an_equilibrium_of_the_complete_graph(q, gain):
    gamma = rotation.rotate(q, shapes.TETRAHEDRON.points)
    assert_close(law.velocity(gamma, COMPLETE, gain), 0.0, atol=ROUNDING)


def tangent_basis(gamma):
    """Return an orthonormal basis of the tangent space at a formation, ``(2 n, n, 3)``."""
    basis = []
    for i, point in enumerate(gamma):
        for direction in np.linalg.svd(point[None])[2][1:]:
            vector = np.zeros_like(gamma)
            vector[i] = direction
            basis.append(vector)
    return np.array(basis)


def linearisation(velocity, gamma):
    """Return the Jacobian of a vector field at a formation, in an orthonormal basis."""
    basis, h = tangent_basis(gamma), 1e-4
    columns = (velocity(sphere.exp(gamma, h * basis))
               - velocity(sphere.exp(gamma, -h * basis))) / (2.0 * h)
    return np.einsum('aij,bij->ab', basis, columns)


@pytest.mark.parametrize('gain', [Cosine(), Exponential(), Gaussian(1.0, 0.7)])
def test_the_tetrahedron_at_rest_has_the_eigenvalues_of_the_paper(gain):
    jacobian = linearisation(
        lambda gamma: law.velocity(gamma, COMPLETE, gain), shapes.TETRAHEDRON.points)
    f, slope = gain.f(shapes.THETA_STAR), gain.derivative(shapes.THETA_STAR)
    expected = [2.0 * math.sqrt(2.0) * slope] * 2 + [
        4.0 * math.sqrt(2.0) / 3.0 * slope - 8.0 / 3.0 * f] * 3 + [0.0] * 3
    assert_close(np.sort(np.linalg.eigvals(jacobian).real), np.sort(expected), atol=1e-6)


@pytest.mark.parametrize('gain', [Cosine(), Exponential(), Gaussian(1.0, 0.7)])
@pytest.mark.parametrize('k, p', [(k, p) for k in (1, 2, 3, 4) for p in (0, 1)])
def test_the_spinning_tetrahedron_is_stable_but_for_its_three_rotations(gain, k, p):
    topology = topologies.rotating(k, p)
    gamma = shapes.TETRAHEDRON.points
    spin = shapes.predicted_angular_velocity(gamma, topology, gain)
    jacobian = linearisation(
        lambda gamma: law.velocity(gamma, topology.weights, gain) - np.cross(spin, gamma), gamma)
    real = np.sort(np.linalg.eigvals(jacobian).real)
    assert_close(real[5:], 0.0, atol=1e-6)
    assert np.all(real[:5] < -0.1 * gain.f(shapes.THETA_STAR))


@given(formations(8), any_weights(4), any_gain())
def test_one_call_for_many_formations_is_many_calls_for_one(gamma, weights, gain):
    gamma = gamma.reshape(2, 1, 4, 3)
    for function in (law.velocity, law.world_angular_velocity):
        together = function(gamma, weights, gain)
        assert together.shape == gamma.shape
        for index in np.ndindex(2, 1):
            assert_close(together[index], function(gamma[index], weights, gain), atol=ROUNDING)
