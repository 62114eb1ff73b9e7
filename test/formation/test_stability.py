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

"""Lyapunov function, equilibria and spectra, held against the paper's closed forms."""

import itertools

import numpy as np
import pytest
from tetra_ros2.formation import (
    coordinates,
    equilibria,
    law,
    measures,
    rotation,
    shapes,
    sphere,
    stability,
    topology,
)
from tetra_ros2.formation.gain import Cosine, Exponential, Gaussian, Linear, Rational
from tetra_ros2.paper.differences import differentiated_law
from tetra_ros2.paper.formations import proof_point

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
    found, nowhere = equilibria.find_equilibria(np.random.default_rng(0), COMPLETE, Cosine(), 300)
    counts = [entry.found for entry in found]
    assert counts == sorted(counts, reverse=True), 'the most often found first'
    assert sum(counts) + nowhere == 300
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
    assert equilibria.classify(cross) == 'cross'
    assert_same_spectrum(there.eigenvalues, 1.5 * np.array([2.0, -2.0, -2.0, -2.0, -4.0]))


@pytest.mark.parametrize('scale', [1e-12, 1e-3, 1.0, 1e6])
@pytest.mark.parametrize('rank', [0, 1, 3])
def test_the_complement_is_all_that_is_across_whatever_the_unit(scale, rank):
    rng = np.random.default_rng(rank)
    vectors = scale * rng.standard_normal((7, rank)) @ rng.standard_normal((rank, 4))
    across = stability.complement(vectors)
    assert across.shape == (7, 7 - rank)
    assert np.allclose(across.T @ across, np.eye(7 - rank), atol=1e-14)
    assert np.max(np.abs(across.T @ vectors)) <= 1e-13 * scale


S = np.sqrt(0.75)


@pytest.mark.parametrize(('gamma', 'kind'), [
    ([[1, 0, 0]] * 4, 'consensus'), ([[1, 0, 0]] * 3 + [[-1, 0, 0]], '3 against 1'),
    ([[-1, 0, 0]] * 3 + [[1, 0, 0]] * 4, '4 against 3'),
    ([[1, 0, 0], [1, 0, 0], [-0.5, S, 0], [-0.5, -S, 0]], 'triangle with a pair'),
    ([[1, 0, 0], [-0.5, S, 0], [-0.5, -S, 0]], 'other coplanar'),
    ([[1, 0, 0], [0, 1, 0], [-1, 0, 0], [0, -1, 0]], 'cross'),
    ([[1, 0, 0], [0, 1, 0], [-1, 0, 0], [0.6, -0.8, 0]], 'other coplanar'),
    ([[1, 0, 0], [0, 1, 0], [-1, 0, 0], [0, 0, 1]], 'other spatial'),
    (shapes.OCTAHEDRON.points, 'octahedron'), (TETRAHEDRON, 'tetrahedron'),
    (-TETRAHEDRON[[2, 0, 1, 3]], 'tetrahedron')], ids=str)
def test_a_formation_is_called_what_it_looks_like(gamma, kind):
    turn = rotation.random(np.random.default_rng(2), (1,))
    for off, called in ((0.0, kind), (1e-7, kind), (3e-2, 'other spatial')):
        noise = off * np.random.default_rng(3).standard_normal((len(gamma), 3))
        near = sphere.normalize(rotation.rotate(turn, np.array(gamma, float)) + noise)
        if len(gamma) > 3 or off < 1e-2:  # three agents are always close to a great circle
            assert equilibria.classify(near) == called


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
    reached = equilibria.settle(start, graph.weights, Exponential())
    assert np.allclose(np.sort(measures.pairwise_angles(reached)), angles, atol=1e-7)
    there = stability.transverse(reached, graph.weights, Exponential())
    assert there.residual < 1e-9
    assert there.inertia[0] == 0


def found_under(weights, gain, starts=400):
    return equilibria.find_equilibria(np.random.default_rng(0), weights, gain, starts)


@every_gain
def test_the_spinning_tetrahedron_is_among_the_equilibria(gain):
    found, _ = found_under(ROTATING, gain)
    spinning, = [entry for entry in found if entry.kind == 'tetrahedron']
    assert spinning.spin_rate == pytest.approx(
        np.sqrt(3.0) / 2.0 * gain.f(shapes.THETA_STAR), rel=1e-9)
    assert spinning.stability == 'stable'
    assert spinning.inertia == (0, 0, 5)
    assert_same_spectrum(spinning.eigenvalues, stability.rotating_spectrum(gain))


def test_a_slow_gain_has_the_same_equilibria_as_a_fast_one():
    kinds = [sorted(entry.kind for entry in found_under(ROTATING, Cosine(a), 200)[0])
             for a in (1e-6, 1.0, 1e6)]
    assert kinds[0] == kinds[1] == kinds[2]


def test_equilibria_that_no_automorphism_joins_are_told_apart():
    # Agents 3 and 4 may change places, and no others may: of the four ways to put one agent
    # against the rest, two are one.
    graph = topology.custom(4, [
        (1, 2, 1.0), (2, 1, 2.0), (1, 3, 0.5), (1, 4, 0.5), (2, 3, 1.5), (2, 4, 1.5),
        (3, 1), (4, 1), (3, 2, 0.7), (4, 2, 0.7), (3, 4), (4, 3)])
    found, _ = found_under(graph.weights, Cosine(), 1500)
    alone = [entry for entry in found if entry.kind == '3 against 1']
    assert len(alone) == 3
    seen = set()
    for entry in alone:
        against = np.sum(entry.gamma @ entry.gamma.T, axis=1) < 0.0
        seen.add(min(int(np.flatnonzero(against)[0]) + 1, 3))
        exact = np.where(against, -1.0, 1.0)[:, None] * [0.0, 0.0, 1.0]
        assert_same_spectrum(
            entry.eigenvalues, stability.transverse(exact, graph.weights, Cosine()).eigenvalues)
    assert seen == {1, 2, 3}
    for one, another in itertools.combinations(alone, 2):
        assert np.max(np.abs(stability.sorted_spectrum(one.eigenvalues)
                             - stability.sorted_spectrum(another.eigenvalues))) > 1e-2


@pytest.mark.parametrize('gain', [Cosine(), Exponential()], ids=['cosine', 'exponential'])
def test_agents_on_a_line_keep_all_their_transverse_eigenvalues(gain):
    found, _ = found_under(COMPLETE, gain)
    lines = [entry for entry in found
             if entry.kind in ('consensus', '3 against 1', '2 against 2')]
    assert len(lines) == 3
    for entry in lines:
        assert len(entry.eigenvalues) == 6
        assert entry.residual < 10.0 * np.finfo(float).eps
    # Closed form at the consensus: every difference grows at n f(0).
    consensus, = [entry for entry in lines if entry.kind == 'consensus']
    assert_same_spectrum(consensus.eigenvalues, [4.0 * gain.f(0.0)] * 6)


def test_a_formation_nearly_on_a_line_has_its_eigenvalues_too():
    near = sphere.normalize(
        np.array([[0.0, 0.0, 1.0]] * 3 + [[0.0, 0.0, -1.0]])
        + 1e-6 * np.random.default_rng(3).standard_normal((4, 3)))
    assert len(stability.transverse(near, COMPLETE, Cosine()).eigenvalues) == 6
    assert np.linalg.svd(equilibria.straighten(near), compute_uv=False)[1] < 1e-15


def test_stability_is_said_in_a_word():
    words = {entry.kind: entry.stability for entry in found_under(COMPLETE, Exponential())[0]}
    assert words['tetrahedron'] == 'stable'
    assert words['consensus'] == words['cross'] == 'unstable'
    pair = found_under(topology.complete(2).weights, Cosine(), 50)[0]
    assert {entry.kind: entry.stability for entry in pair} == {
        'consensus': 'unstable', '1 against 1': 'undecided'}


@pytest.mark.parametrize(('real', 'expected'), [
    (1e-6, (1, 0, 1)), (1e-8, (1, 0, 1)), (1e-10, (0, 1, 1)), (0.0, (0, 1, 1)),
    (-1e-6, (0, 0, 2)), (-1e-10, (0, 1, 1))])
def test_a_real_part_is_zero_only_to_rounding(real, expected):
    for scale in (1e-3, 1.0, 1e3):
        assert stability.inertia(scale * np.array([real, -1.0])) == expected


@pytest.mark.parametrize('saddle', [
    [[1, 0, 0], [0, 1, 0], [-1, 0, 0], [0, -1, 0]], [[1, 0, 0], [1, 0, 0], [-1, 0, 0], [-1, 0, 0]],
    [[1, 0, 0]] * 4], ids=['cross', '2 against 2', 'consensus'])
def test_settling_goes_on_from_a_saddle_to_what_attracts(saddle):
    nearly = sphere.normalize(
        np.array(saddle, float) + 1e-5 * np.random.default_rng(2).standard_normal((4, 3)))
    end = equilibria.settle(nearly, COMPLETE, Exponential())
    assert equilibria.classify(end) == 'tetrahedron'


@pytest.mark.parametrize('a', [1e-12, 1e-4, 1.0, 1e8])
@pytest.mark.parametrize(('weights', 'spins'), [(COMPLETE, False), (ROTATING, True)])
def test_what_is_said_of_an_equilibrium_does_not_depend_on_the_unit_of_time(a, weights, spins):
    there = stability.transverse(TETRAHEDRON, weights, Cosine(a))
    assert there.is_hyperbolic
    assert there.spins is spins
    assert there.inertia == (0, 0, 5)
    assert len(there.decaying) == 5
    octahedron = stability.transverse(
        shapes.OCTAHEDRON.points, topology.complete(6).weights, Cosine(a))
    assert not octahedron.is_hyperbolic, 'it is one of a continuum'
    assert 0 < len(octahedron.decaying) < 9
    assert octahedron.inertia[1] == 9 - len(octahedron.decaying)


def test_the_mirror_image_has_the_same_angles_and_the_other_chirality():
    gamma = sphere.random(np.random.default_rng(4), (20, 4))
    mirrored = stability.mirrored(gamma)
    assert np.allclose(measures.pairwise_cosines(mirrored), measures.pairwise_cosines(gamma))
    assert np.array_equal(measures.chirality(mirrored), -measures.chirality(gamma))
