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

from hypothesis import given, settings
from hypothesis import strategies as st
import numpy as np
import pytest
from strategies import (
    any_gain,
    any_topology,
    assert_close,
    attitudes,
    formations,
    quaternions,
    vectors,
)
from tetra_ros2.formation import law, measures, rotation, shapes, sphere
from tetra_ros2.formation import topology as topologies
from tetra_ros2.formation.gain import Cosine, Exponential, KINDS
from tetra_ros2.formation.simulation import SampledLoop, simulate, step

X = np.array([1.0, 0.0, 0.0])
ROTATING = [(k, p) for k in (1, 2, 3, 4) for p in (0, 1)]
FEW = settings(max_examples=15)


def axes_for(n):
    """Return a pointing axis for each of n bodies, no two alike."""
    return sphere.random(np.random.default_rng(n), n)


def near(shape, rng, count, offset=0.2):
    """Return attitudes near a shape and near its mirror image, turned at random."""
    gamma = np.concatenate([np.repeat(shape.points[None], count, axis=0)] * 2)
    gamma[count:] *= -1.0
    gamma = sphere.normalize(gamma + offset * rng.standard_normal(gamma.shape))
    gamma = rotation.rotate(rotation.random(rng, 2 * count)[:, None], gamma)
    return rotation.between(X, gamma)


@FEW
@given(attitudes(4), formations(4), any_topology(4), any_gain(), st.floats(1e-3, 0.1))
def test_the_loop_of_agents_is_the_simulation_on_arrays(q, axes, topology, gain, h):
    loop = SampledLoop(q, axes, topology, gain)
    loop.advance(h, steps=10)
    assert loop.steps == 10
    on_arrays = simulate(q, axes, topology.weights, gain, h, 10)
    assert_close(loop.bodies.attitudes, on_arrays, atol=1e-11)
    assert_close(loop.bodies.reduced, rotation.rotate(on_arrays, axes), atol=1e-11)


@pytest.mark.parametrize('topology', [topologies.complete(4), topologies.rotating(2, 0)])
def test_the_two_simulations_agree_to_rounding_over_two_thousand_steps(topology):
    q, axes, gain = rotation.random(np.random.default_rng(7), 4), axes_for(4), Cosine()
    loop = SampledLoop(q, axes, topology, gain)
    loop.advance(0.01, steps=2000)
    assert_close(
        loop.bodies.attitudes, simulate(q, axes, topology.weights, gain, 0.01, 2000), atol=1e-12)


def test_an_agent_that_sees_nobody_does_not_hold_up_the_loop():
    topology = topologies.custom(3, [(1, 2), (2, 3)])
    q, axes = rotation.random(np.random.default_rng(8), 3), axes_for(3)
    loop = SampledLoop(q, axes, topology, Cosine())
    loop.advance(0.01, steps=50)
    assert_close(
        loop.bodies.attitudes, simulate(q, axes, topology.weights, Cosine(), 0.01, 50), 1e-12)
    np.testing.assert_array_equal(loop.bodies.attitudes[2], q[2])
    assert not np.allclose(loop.bodies.attitudes[0], q[0])


def test_advancing_in_pieces_is_advancing_at_once_to_the_last_bit():
    q = rotation.random(np.random.default_rng(9), 4)
    loops = [SampledLoop(q, [X] * 4, topologies.rotating(), Cosine()) for _ in range(2)]
    loops[0].advance(0.01, steps=30)
    for _ in range(30):
        loops[1].advance(0.01)
    assert loops[0].bodies.attitudes == loops[1].bodies.attitudes


@given(attitudes(4), formations(4), any_topology(4), any_gain(), st.floats(1e-3, 1.0))
def test_a_step_holds_the_law_of_its_beginning(q, axes, topology, gain, h):
    gamma = rotation.rotate(q, axes)
    rates = law.world_angular_velocity(gamma, topology.weights, gain)
    # A rate held in the body is the same rate held in the world: exp(h w^) R = R exp(h (R'w)^).
    expected = rotation.multiply(rotation.exp(h * rates), q)
    assert_close(step(q, axes, topology.weights, gain, h), expected, atol=1e-11)


@FEW
@given(quaternions(), attitudes(4), any_topology(4), any_gain())
def test_the_motion_does_not_depend_on_the_world_frame(turn, q, topology, gain):
    assert_close(
        simulate(rotation.multiply(turn, q), X, topology.weights, gain, 0.01, 20),
        rotation.multiply(turn, simulate(q, X, topology.weights, gain, 0.01, 20)), atol=1e-12)


@FEW
@given(attitudes(4), attitudes(4), formations(4), any_topology(4), any_gain())
def test_the_motion_does_not_depend_on_how_the_body_frames_are_mounted(
        q, mounting, axes, topology, gain):
    remounted = rotation.multiply(q, rotation.inverse(mounting))
    same_axes = rotation.rotate(mounting, axes)
    assert_close(
        rotation.rotate(simulate(q, axes, topology.weights, gain, 0.01, 20), axes),
        rotation.rotate(simulate(remounted, same_axes, topology.weights, gain, 0.01, 20),
                        same_axes), atol=1e-12)


def test_one_call_for_many_formations_is_many_calls_for_one():
    q, axes = rotation.random(np.random.default_rng(10), (2, 3, 4)), axes_for(4)
    weights = topologies.rotating().weights
    together = simulate(q, axes, weights, Cosine(), 0.02, 30)
    for index in np.ndindex(2, 3):
        assert_close(together[index], simulate(q[index], axes, weights, Cosine(), 0.02, 30), 1e-13)


def test_what_is_kept_are_the_states_on_the_way():
    q, weights = rotation.random(np.random.default_rng(11), 4), topologies.complete().weights
    kept = simulate(q, X, weights, Cosine(), 0.02, 7, every=3)
    assert kept.shape == (3, 4, 4)
    for state, steps in zip(kept, (0, 3, 6)):
        np.testing.assert_array_equal(state, simulate(q, X, weights, Cosine(), 0.02, steps))


def test_the_initial_attitudes_are_left_alone():
    q = rotation.random(np.random.default_rng(12), 4)
    before = q.copy()
    simulate(q, X, topologies.complete().weights, Cosine(), 0.1, 3)
    SampledLoop(q, [X] * 4, topologies.complete(), Cosine()).advance(0.1, 3)
    np.testing.assert_array_equal(q, before)


def test_attitudes_stay_of_unit_length():
    q = rotation.random(np.random.default_rng(13), (5, 4))
    end = simulate(q, X, topologies.rotating().weights, Cosine(a=3.0), 0.05, 1000)
    assert_close(np.linalg.norm(end, axis=-1), 1.0, atol=1e-14)


def runge_kutta(gamma, weights, gain, h, steps):
    """Integrate the closed loop in continuous time."""
    def f(x):
        return law.velocity(sphere.normalize(x), weights, gain)

    for _ in range(steps):
        a = f(gamma)
        b = f(gamma + h / 2.0 * a)
        c = f(gamma + h / 2.0 * b)
        gamma = sphere.normalize(gamma + h / 6.0 * (a + 2.0 * b + 2.0 * c + f(gamma + h * c)))
    return gamma


@pytest.mark.parametrize('topology', [topologies.complete(), topologies.rotating()])
def test_the_sampled_loop_tends_to_the_closed_loop_in_proportion_to_the_step(topology):
    q = rotation.random(np.random.default_rng(14), 4)
    exact = runge_kutta(rotation.rotate(q, X), topology.weights, Cosine(), 0.01, 100)
    coarse, fine = (
        np.max(np.abs(exact - rotation.rotate(
            simulate(q, X, topology.weights, Cosine(), 1.0 / steps, steps), X)))
        for steps in (100, 200))
    assert coarse < 0.02
    assert coarse / fine == pytest.approx(2.0, abs=0.1)


def test_under_the_complete_graph_the_potential_never_rises():
    q = rotation.random(np.random.default_rng(15), (10, 4))
    kept = simulate(q, X, topologies.complete().weights, Cosine(), 0.02, 600, every=1)
    cosines = measures.pairwise_cosines(rotation.rotate(kept, X))
    potential = np.sum((1.0 + cosines)**2, axis=-1)  # the integral of (1 + cos x) sin x, times 2
    assert np.all(np.diff(potential, axis=0) < 1e-14)
    assert_close(potential[-1], 6.0 * (2.0 / 3.0)**2, atol=1e-6)
    assert np.all(potential[0] > potential[-1] + 0.1)


@pytest.mark.parametrize('n, gain', [
    *((4, family()) for family in KINDS.values()),
    (2, Exponential(b=0.5)), (3, Cosine()), (3, Exponential()), (6, Exponential(a=3.0))])
def test_uniform_starts_reach_the_shape_that_is_known_for_the_complete_graph(n, gain):
    topology = topologies.complete(n)
    q = rotation.random(np.random.default_rng(16), (20, n))
    end = simulate(q, X, topology.weights, gain, 0.1, 700)
    errors = measures.shape_error(
        rotation.rotate(end, X), shapes.known_shape(topology).angles)
    assert np.max(errors) < 1e-3


def test_a_pair_under_the_cosine_gain_opens_as_slowly_as_its_gain_vanishes():
    # What is left of pi, e, obeys de/dt = -2 a (1 - cos e) sin e = -a e^3 near 0.
    q = rotation.random(np.random.default_rng(20), (20, 2))
    time = 200.0
    end = simulate(q, X, topologies.complete(2).weights, Cosine(a=2.0), 0.1, round(time / 0.1))
    left = measures.shape_error(rotation.rotate(end, X), shapes.ANTIPODAL.angles)
    np.testing.assert_allclose(left, 1.0 / np.sqrt(2.0 * 2.0 * time), rtol=0.02)


@pytest.mark.parametrize('k, p', ROTATING)
def test_the_rotating_formation_spins_at_the_predicted_rate_and_sense(k, p):
    topology, gain, h = topologies.rotating(k, p), Cosine(), 0.005
    q = near(shapes.TETRAHEDRON, np.random.default_rng(17), count=2)
    settled = simulate(q, X, topology.weights, gain, 0.02, 500)
    kept = simulate(settled, X, topology.weights, gain, h, 200, every=100)
    gamma = rotation.rotate(kept, X)
    assert np.max(measures.shape_error(gamma[-1], shapes.TETRAHEDRON.angles)) < 1e-3
    assert sorted(measures.chirality(gamma[-1])) == [-1.0, -1.0, 1.0, 1.0]
    measured = measures.mean_angular_velocity(gamma[-2], gamma[-1], 100 * h)
    for formation, before, spin in zip(gamma[-1], gamma[-2], measured):
        predicted = shapes.predicted_angular_velocity(formation, topology, gain)
        assert_close(spin, predicted, atol=1e-3)
        sense = shapes.predicted_sense(topology, measures.chirality(formation))
        assert np.sign(spin @ formation[k - 1]) == sense
        # The agent on the axis stays, the others go round.
        travelled = sphere.geodesic_distance(before, formation)
        assert travelled[k - 1] < 1e-3
        assert np.min(np.delete(travelled, k - 1)) > 0.1


def test_holding_commands_takes_the_spinning_formation_off_the_tetrahedron_with_the_step():
    q = near(shapes.TETRAHEDRON, np.random.default_rng(18), count=1)
    offsets = []
    for h in (0.04, 0.02):
        end = simulate(q, X, topologies.rotating().weights, Cosine(), h, round(30.0 / h))
        offsets.append(
            measures.shape_error(rotation.rotate(end, X), shapes.TETRAHEDRON.angles))
    assert np.all(offsets[1] > 1e-5)
    np.testing.assert_allclose(offsets[0] / offsets[1], 2.0, atol=0.1)


def test_holding_commands_leaves_the_formation_at_rest_on_the_tetrahedron():
    q = near(shapes.TETRAHEDRON, np.random.default_rng(19), count=2)
    end = simulate(q, X, topologies.complete().weights, Cosine(), 0.05, 400)
    gamma = rotation.rotate(end, X)
    assert np.max(measures.shape_error(gamma, shapes.TETRAHEDRON.angles)) < 1e-13


@given(attitudes(3), vectors(1.0))
def test_without_any_edge_nothing_moves(q, axis):
    axes = sphere.normalize(axis + 2.0 * X)
    np.testing.assert_array_equal(simulate(q, axes, np.zeros((3, 3)), Cosine(), 0.1, 5), q)


def test_a_pair_opens_by_the_law_of_its_angle():
    # Both flee along the great circle: d theta / dt = 2 f(theta) sin(theta). With the constant
    # speed of a step that is exact: theta + 2 h f(theta) sin(theta).
    theta, h, gain = 0.7, 0.05, Exponential()
    q = rotation.exp([[0.0, 0.0, 0.0], [0.0, 0.0, theta]])
    weights = topologies.complete(2).weights
    for _ in range(20):
        q = step(q, X, weights, gain, h)
        theta += 2.0 * h * math.exp(-theta) * math.sin(theta)
        gamma = rotation.rotate(q, X)
        assert sphere.geodesic_distance(gamma[0], gamma[1]) == pytest.approx(theta, abs=1e-13)
