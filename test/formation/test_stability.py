# Copyright 2026 The tetra_ros2 authors
# SPDX-License-Identifier: Apache-2.0

"""Lyapunov function, equilibria and spectra, held against the paper's closed forms."""

import numpy as np
import pytest

from tetra_ros2.formation import (
    coordinates,
    law,
    measures,
    rotation,
    shapes,
    sphere,
    stability,
    topology,
)
from tetra_ros2.formation.gain import Cosine, Exponential, Gaussian, Linear, Rational
from tetra_ros2.paper.claims import differentiated_law, proof_point

GAINS = (Cosine(), Exponential(), Gaussian(1.5, 0.8), Linear(2.0, 0.9), Rational(0.7, 1.3))
COMPLETE, ROTATING = topology.complete(4).weights, topology.rotating().weights
TETRAHEDRON = shapes.TETRAHEDRON.points
RELATIVE = 1e-9

every_gain = pytest.mark.parametrize('gain', GAINS, ids=lambda gain: type(gain).__name__)


def assert_same_spectrum(found, expected):
    found, expected = map(stability.sorted_spectrum, (found, expected))
    assert np.max(np.abs(found - expected)) <= RELATIVE * np.max(np.abs(expected))


@every_gain
def test_spectrum_in_roll_pitch_yaw_angles_is_the_papers(gain):
    matrix = stability.angle_linearization(proof_point(), COMPLETE, gain)
    assert_same_spectrum(np.linalg.eigvals(matrix), stability.complete_spectrum(gain))


@every_gain
def test_spectrum_of_the_cosines_is_the_papers(gain):
    matrix = coordinates.cosine_jacobian(np.full(6, -1.0 / 3.0), COMPLETE, gain)
    assert_same_spectrum(np.linalg.eigvals(matrix), stability.complete_cosine_spectrum(gain))


@every_gain
def test_transverse_spectrum_is_the_papers_less_the_rotations(gain):
    found = stability.transverse(TETRAHEDRON, COMPLETE, gain).eigenvalues
    assert_same_spectrum(found, stability.complete_spectrum(gain)[:5])


@every_gain
@pytest.mark.parametrize('points', [TETRAHEDRON, -TETRAHEDRON], ids=['right', 'left'])
def test_rotating_spectrum_has_its_closed_form_for_both_chiralities(gain, points):
    there = stability.transverse(points, ROTATING, gain)
    assert_same_spectrum(there.eigenvalues, stability.rotating_spectrum(gain))
    assert np.linalg.norm(there.spin) == pytest.approx(
        np.sqrt(3.0) / 2.0 * gain.f(shapes.THETA_STAR), rel=1e-12)
    assert there.residual < 1e-14
    assert there.inertia == (0, 0, 5)


def test_rotating_spectrum_is_the_cosines_less_the_one_off_the_gram_surface():
    gain = Exponential(1.2, 0.9)
    found = np.linalg.eigvals(
        coordinates.cosine_jacobian(np.full(6, -1.0 / 3.0), ROTATING, gain))
    assert_same_spectrum(
        found, [*stability.rotating_spectrum(gain), -4.0 * gain.of_cosine(-1.0 / 3.0)])


@pytest.mark.parametrize('weights', [COMPLETE, ROTATING], ids=['complete', 'rotating'])
def test_linearization_is_the_derivative_of_the_law(weights):
    spin = stability.transverse(TETRAHEDRON, weights, Exponential()).spin
    numeric, bases = differentiated_law(TETRAHEDRON, weights, Exponential(), spin)
    exact = stability.linearization(TETRAHEDRON, weights, Exponential(), bases, spin)
    assert np.allclose(exact, numeric, atol=1e-11)


def test_lyapunov_function_falls_at_twice_the_squared_rates():
    gamma = sphere.random(np.random.default_rng(0), (100, 4))
    for gain in GAINS:
        velocity = law.velocity(gamma, COMPLETE, gain)
        squared = np.sum(law.world_angular_velocity(gamma, COMPLETE, gain) ** 2, axis=(-2, -1))
        rate = stability.lyapunov_rate(gamma, velocity, COMPLETE, gain)
        assert np.allclose(rate, -2.0 * squared, atol=1e-12)
        ahead, behind = (stability.lyapunov(sphere.exp(gamma, t * velocity), COMPLETE, gain)
                         for t in (1e-5, -1e-5))
        assert np.allclose((ahead - behind) / 2e-5, rate, atol=1e-5)


def test_lyapunov_function_has_its_closed_form_for_the_cosine_gain():
    gamma = sphere.random(np.random.default_rng(1), (20, 4))
    c = measures.pairwise_cosines(gamma)
    closed = 2.0 * np.sum(0.5 * (1.0 + c) ** 2, axis=-1)
    assert np.allclose(stability.lyapunov(gamma, COMPLETE, Cosine()), closed, atol=1e-13)


def test_newtons_method_finds_all_the_papers_equilibria_and_no_other():
    found, _ = stability.find_equilibria(np.random.default_rng(0), COMPLETE, Cosine(), 300)
    kinds = {entry.kind for entry in found}
    assert kinds == {'tetrahedron', 'cross', 'consensus', '3 against 1', '2 against 2',
                     'other coplanar'}
    for entry in found:
        positive = stability.inertia(entry.eigenvalues)[0]
        assert (positive == 0) == (entry.kind == 'tetrahedron')


def test_the_cross_has_one_way_out():
    psi = np.arange(4) * np.pi / 2.0
    cross = coordinates.from_angles(np.zeros(4), psi)
    there = stability.transverse(cross, COMPLETE, Cosine(1.5))
    assert stability.classify(cross) == 'cross'
    assert_same_spectrum(there.eigenvalues, 1.5 * np.array([2.0, -2.0, -2.0, -2.0, -4.0]))


def test_linearization_does_not_depend_on_how_the_formation_lies():
    turn = rotation.random(np.random.default_rng(2), (1,))
    turned = rotation.rotate(turn, TETRAHEDRON)
    assert_same_spectrum(stability.transverse(turned, ROTATING, Cosine()).eigenvalues,
                         stability.transverse(TETRAHEDRON, ROTATING, Cosine()).eigenvalues)


@pytest.mark.parametrize(('graph', 'angles'), [
    (topology.complete(4), shapes.TETRAHEDRON.angles),
    (topology.rotating(2, 0), shapes.TETRAHEDRON.angles),
    (topology.complete(6), shapes.OCTAHEDRON.angles),
    (topology.custom(3, [(1, 2), (2, 3), (3, 1)]), shapes.TRIANGLE.angles),
])
def test_settling_leads_where_the_loop_goes(graph, angles):
    start = sphere.random(np.random.default_rng(4), graph.n)
    reached = stability.settle(start, graph.weights, Exponential())
    assert np.allclose(np.sort(measures.pairwise_angles(reached)), angles, atol=1e-7)
    there = stability.transverse(reached, graph.weights, Exponential())
    assert there.residual < 1e-9
    assert there.inertia[0] == 0
