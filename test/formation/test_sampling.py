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

"""Limits of sample time and delay: closed forms, the linearised loop, and runs on either side."""

import math

import numpy as np
import pytest
from tetra_ros2.formation import batch, measures, rotation, sampling, shapes, stability, topology
from tetra_ros2.formation.gain import Cosine, Exponential
from tetra_ros2.formation.simulation import SampledLoop

COMPLETE, ROTATING = topology.complete(4), topology.rotating()
TETRAHEDRON = shapes.TETRAHEDRON.points
AXES = np.tile(sampling.AXIS, (4, 1))


def deviation_after(gamma, topology_, gain, h, steps, limit):
    """Return how far the cosines are from a limit after so many steps from a small push."""
    push = 1e-3 * np.random.default_rng(0).standard_normal((4, 3))
    gamma = gamma + push
    gamma = gamma / np.linalg.norm(gamma, axis=1, keepdims=True)
    for _ in range(steps):
        gamma = batch.advance(gamma, topology_.weights, gain, h)
    return np.max(np.abs(measures.pairwise_cosines(gamma) - limit))


def test_limits_of_the_papers_complete_graph():
    eigenvalues = stability.transverse(TETRAHEDRON, COMPLETE.weights, Cosine()).eigenvalues
    assert sampling.max_sample_time_at_rest(eigenvalues) == pytest.approx(0.5625, rel=1e-12)
    assert sampling.max_delay_at_rest(eigenvalues) == pytest.approx(
        9.0 * math.pi / 64.0, rel=1e-12)
    assert sampling.max_delay_steps_at_rest(eigenvalues, 0.01) == 43


@pytest.mark.parametrize('h', [0.01, 0.1, 0.3, 0.5, 0.56, 0.57])
def test_delay_steps_are_where_the_roots_leave_the_circle(h):
    eigenvalues = np.array([-8.0 / 3.0, -32.0 / 9.0, -1.5 + 0.7j, -1.5 - 0.7j])
    steps = sampling.max_delay_steps_at_rest(eigenvalues, h)
    if steps >= 0:
        assert np.max(np.abs(sampling.floquet_multipliers_at_rest(eigenvalues, h, steps))) < 1.0
    assert np.max(np.abs(sampling.floquet_multipliers_at_rest(eigenvalues, h, steps + 1))) > 1.0


@pytest.mark.parametrize('delay', [0, 1, 5])
def test_the_linearised_loop_has_the_roots_of_the_closed_form_at_rest(delay):
    eigenvalues = stability.transverse(TETRAHEDRON, COMPLETE.weights, Cosine()).eigenvalues
    there = sampling.sampled_equilibrium(TETRAHEDRON, COMPLETE.weights, Cosine(), 0.05, delay)
    closed = np.max(np.abs(sampling.floquet_multipliers_at_rest(eigenvalues, 0.05, delay)))
    assert abs(there.floquet_multipliers()[0]) == pytest.approx(closed, rel=1e-8)


@pytest.mark.parametrize(('graph', 'gain', 'h'), [
    (COMPLETE, Cosine(), 0.01), (ROTATING, Cosine(), 0.01), (ROTATING, Exponential(), 0.04)],
    ids=['complete', 'rotating', 'rotating exponential'])
@pytest.mark.parametrize('delay', [0, 10, 43, 44, 70])
def test_the_argument_principle_counts_what_the_eigenvalues_show(graph, gain, h, delay):
    there = sampling.sampled_equilibrium(TETRAHEDRON, graph.weights, gain, h, delay)
    growing = int(np.sum(np.abs(there.floquet_multipliers()) > 1.0))
    assert there.unstable_modes() == growing


def test_sampling_takes_the_spinning_formation_off_the_tetrahedron_as_was_measured():
    there = sampling.sampled_equilibrium(TETRAHEDRON, ROTATING.weights, Cosine(), 0.01)
    off = np.max(np.abs(measures.pairwise_angles(there.gamma) - shapes.THETA_STAR))
    assert off == pytest.approx(2.9e-4, abs=1e-5)  # design.md, section 4
    after = batch.advance(there.gamma, ROTATING.weights, Cosine(), 0.01)
    turned = rotation.rotate(rotation.exp(0.01 * there.spin), there.gamma)
    assert np.max(np.abs(after - turned)) < 1e-12


def test_sample_time_limit_lies_between_0_55_and_0_57():
    limit = np.full(6, -1.0 / 3.0)
    assert deviation_after(TETRAHEDRON, COMPLETE, Cosine(), 0.55, 400, limit) < 1e-6
    assert deviation_after(TETRAHEDRON, COMPLETE, Cosine(), 0.57, 400, limit) > 1e-2


def test_sample_time_limit_of_the_spinning_formation_holds_on_either_side():
    gain, weights = Cosine(), ROTATING.weights
    limit = sampling.max_sample_time(TETRAHEDRON, weights, gain)
    assert limit == pytest.approx(0.9761, abs=1e-4)
    near = None
    for h in np.linspace(0.1, 0.98 * limit, 12):
        near = sampling.sampled_equilibrium(TETRAHEDRON, weights, gain, h, near=near)
    inside = measures.pairwise_cosines(near.gamma)
    outside = sampling.sampled_equilibrium(TETRAHEDRON, weights, gain, 1.02 * limit, near=near)
    assert deviation_after(near.gamma, ROTATING, gain, near.h, 1500, inside) < 1e-8
    assert deviation_after(outside.gamma, ROTATING, gain, outside.h, 1500,
                           measures.pairwise_cosines(outside.gamma)) > 1e-2


def growth(graph, gain, h, delay, steps=9000):
    """
    Return by what the deviation of a late loop from its limit is multiplied in steps / 3 steps.

    In the first third what the start did beside the slowest mode dies away.
    """
    there = sampling.sampled_equilibrium(TETRAHEDRON, graph.weights, gain, h, delay)
    limit = measures.pairwise_cosines(there.gamma)
    push = rotation.exp(1e-3 * np.random.default_rng(1).standard_normal((4, 3)))
    loop = SampledLoop(
        rotation.multiply(there.attitudes, push), AXES, graph, gain, delay=delay)
    sizes = []
    for _ in range(3):
        window = []
        for _ in range(steps // 30):
            loop.advance(h, 10)
            window.append(np.max(np.abs(
                measures.pairwise_cosines(np.array(loop.bodies.reduced)) - limit)))
        sizes.append(max(window))
    return sizes[2] / sizes[1]


def test_delay_limit_of_the_formation_at_rest_holds_on_either_side():
    assert growth(COMPLETE, Cosine(), 0.01, 43) < 0.8
    assert growth(COMPLETE, Cosine(), 0.01, 44) > 1.1


def test_delay_limit_of_the_spinning_formation_holds_on_either_side():
    steps = sampling.max_delay_steps(TETRAHEDRON, ROTATING.weights, Cosine(), 0.01)
    assert growth(ROTATING, Cosine(), 0.01, steps - 2) < 0.9
    assert growth(ROTATING, Cosine(), 0.01, steps + 3) > 1.1


def test_predicted_noise_is_what_the_loop_shows():
    h, sigma = 0.1, 1e-3
    for graph in (COMPLETE, ROTATING):
        there = sampling.sampled_equilibrium(TETRAHEDRON, graph.weights, Cosine(), h)
        deviation, mean_largest = there.steady_angles(sigma)
        loop = SampledLoop(there.attitudes, AXES, graph, Cosine(), noise=sigma, seed=3)
        loop.advance(h, 100)
        limit, off = measures.pairwise_angles(there.gamma), []
        for _ in range(6000):
            loop.advance(h)
            off.append(measures.pairwise_angles(np.array(loop.bodies.reduced)) - limit)
        assert np.std(off, axis=0) == pytest.approx(deviation, rel=0.1)
        assert np.mean(np.max(np.abs(off), axis=1)) == pytest.approx(mean_largest, rel=0.05)


@pytest.mark.parametrize('graph', [COMPLETE, ROTATING], ids=lambda graph: graph.kind)
def test_the_covariance_that_noise_leaves_solves_the_equation_it_is_the_limit_of(graph):
    there = sampling.sampled_equilibrium(TETRAHEDRON, graph.weights, Cosine(), 0.1, 2)
    matrix, across = there._history_matrix()
    m = len(there.at_once)
    noise = across.T[:, :m] @ there.noise @ across[:m]
    size = len(matrix)
    solved = np.linalg.solve(np.eye(size**2) - np.kron(matrix, matrix), noise.ravel())
    attitude = across[:m] @ solved.reshape(size, size) @ across[:m].T
    # To first order an angle moves as the two directions turn apart.
    gamma = there.gamma
    i, j = np.triu_indices(4, k=1)
    normal = np.cross(gamma[i], gamma[j])
    normal /= np.linalg.norm(normal, axis=1, keepdims=True)
    rows = np.zeros((6, 4, 3))
    for row, (a, b) in enumerate(zip(i, j)):
        rows[row, a] = -rotation.rotate(rotation.inverse(there.attitudes[a]), normal[row])
        rows[row, b] = rotation.rotate(rotation.inverse(there.attitudes[b]), normal[row])
    rows = rows.reshape(6, 12)
    expected = np.sqrt(np.diag(rows @ attitude @ rows.T))
    assert there.steady_angles(1.0)[0] == pytest.approx(expected, rel=1e-8)


def test_noise_turns_an_antipodal_pair_in_two_directions():
    graph, gain, h, sigma = topology.complete(2), Exponential(), 0.1, 1e-3
    gamma = np.array([[0.0, 0.0, 1.0], [0.0, 0.0, -1.0]])
    there = sampling.sampled_equilibrium(gamma, graph.weights, gain, h)
    deviation, mean_error = there.steady_angles(sigma)
    # Each of the two components is a Gaussian of the same size: the angle is Rayleigh's.
    assert mean_error == pytest.approx(deviation[0] * np.sqrt(np.pi) / 2.0, rel=0.02)
    loop = SampledLoop(there.attitudes, AXES[:2], graph, gain, noise=sigma, seed=3)
    loop.advance(h, 100)
    off = []
    for _ in range(4000):
        loop.advance(h)
        off.append(np.pi - measures.pairwise_angles(np.array(loop.bodies.reduced))[0])
    assert np.mean(off) == pytest.approx(mean_error, rel=0.1)


def test_the_delay_limit_of_the_spinning_formation_does_not_depend_on_how_finely_it_is_sought():
    limit = sampling.max_delay(TETRAHEDRON, ROTATING.weights, Cosine())
    for count in (331, 457, 613):
        h = limit / count
        steps = sampling.max_delay_steps(TETRAHEDRON, ROTATING.weights, Cosine(), h)
        # Each of the two is half a step of its own from the truth at most.
        assert (steps + 0.5) * h == pytest.approx(limit, rel=0.5 / count + 0.5 / 500 + 1e-4)


def test_at_the_sample_time_limit_itself_no_delay_is_stable():
    values = stability.transverse(TETRAHEDRON, COMPLETE.weights, Cosine()).eigenvalues
    limit = sampling.max_sample_time_at_rest(values)
    assert sampling.max_delay_steps_at_rest(values, limit) == -1
    assert sampling.max_delay_steps_at_rest(values, 0.999 * limit) == 0


def test_beyond_the_sample_time_limit_a_spinning_formation_bears_no_delay_at_all():
    weights, gain = ROTATING.weights, Cosine()
    limit = sampling.max_sample_time(TETRAHEDRON, weights, gain)
    assert sampling.max_delay_steps(TETRAHEDRON, weights, gain, 1.05 * limit) == -1


def test_what_is_not_stable_has_no_limits():
    together = np.tile([0.0, 0.0, 1.0], (4, 1))
    for limit in (sampling.max_sample_time, sampling.max_delay):
        with pytest.raises(ValueError, match='not stable even without sampling'):
            limit(together, COMPLETE.weights, Cosine())
