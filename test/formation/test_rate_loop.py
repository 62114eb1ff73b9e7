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

"""Rate loops: the closed form at rest, the shifted spin, and the limit against simulation."""

from hypothesis import given
from hypothesis import strategies as st
import numpy as np
import pytest
from tetra_ros2.formation import (
    gain,
    law,
    rate_loop,
    rotation,
    sampling,
    shapes,
    sphere,
    stability,
)
from tetra_ros2.formation import topology as topologies

TETRAHEDRON = shapes.TETRAHEDRON.points
COSINE = gain.Cosine()
ROTATING = topologies.rotating().weights
COMPLETE = topologies.complete().weights


def simulate(equilibrium, weights, bandwidth, h, seconds, delay_steps=0, seed=0):
    """Return by how much a small disturbance of the shape has grown over a time, as a factor."""
    rng = np.random.default_rng(seed)
    n = len(equilibrium.gamma)
    attitudes = rotation.multiply(
        equilibrium.attitudes, rotation.exp(1e-5 * rng.standard_normal((n, 3))))
    rates = equilibrium.rates
    angles = np.sort(_angles(equilibrium.gamma))
    commands = [rate_loop._commands(attitudes, weights, COSINE)] * (delay_steps + 1)
    errors = []
    for _ in range(round(seconds / h)):
        commands = [*commands[1:], rate_loop._commands(attitudes, weights, COSINE)]
        attitudes, rates = rate_loop.turn(attitudes, rates, commands[0], bandwidth, h)
        gamma = rotation.rotate(attitudes, rate_loop.AXIS)
        errors.append(np.max(np.abs(np.sort(_angles(gamma)) - angles)))
    # Half of the time for the modes that decay quickly, then two windows that hold a whole beat.
    quarter = len(errors) // 4
    return max(errors[3 * quarter:]) / max(errors[2 * quarter:3 * quarter])


def _angles(gamma):
    i, j = np.triu_indices(len(gamma), 1)
    return np.arccos(np.clip(np.sum(gamma[i] * gamma[j], axis=-1), -1.0, 1.0))


@pytest.mark.parametrize('bandwidth', [0.1, 1.0, 10.0, 100.0])
def test_at_rest_each_eigenvalue_becomes_two_of_a_quadratic(bandwidth):
    law_alone = stability.transverse(TETRAHEDRON, COMPLETE, COSINE).eigenvalues
    found = rate_loop.rate_loop_equilibrium(TETRAHEDRON, COMPLETE, COSINE, bandwidth)
    expected = rate_loop.eigenvalues_at_rest(law_alone, bandwidth)
    # Beside these, each body loses a rate about no shape at all at the rate of the loop.
    for value in expected:
        assert np.min(np.abs(found.eigenvalues - value)) < 1e-6 * bandwidth + 1e-6
    assert found.slowest_rate == pytest.approx(min(-expected.real), rel=1e-6)


def test_a_formation_of_symmetric_weights_at_rest_has_no_threshold():
    assert rate_loop.min_bandwidth(TETRAHEDRON, COMPLETE, COSINE) == 0.0


@given(st.integers(0, 2**32 - 1), st.sampled_from([COMPLETE, ROTATING, -0.7 * COMPLETE]),
       st.sampled_from([COSINE, gain.Exponential(a=2.0, b=0.5)]))
def test_the_law_never_asks_for_more_acceleration_than_its_bound(seed, weights, family):
    rng = np.random.default_rng(seed)
    gamma = sphere.normalize(rng.standard_normal((4, 3)) + rng.choice([0.0, 3.0]))
    theta = np.linspace(0.0, np.pi, 1001)
    fastest = np.sum(np.abs(weights), axis=1) * np.max(family.f(theta) * np.sin(theta))
    rates = sphere.project(gamma, rng.standard_normal((4, 3)))
    rates *= (fastest / np.linalg.norm(rates, axis=1))[:, None]
    step = 1e-6
    ahead, behind = (law.velocity(sphere.normalize(gamma + h * rates), weights, family)
                     for h in (step, -step))
    change = sphere.project(gamma, (ahead - behind) / (2.0 * step))
    bound = rate_loop.acceleration_bound(weights, family)
    assert np.max(np.linalg.norm(change, axis=1)) <= bound * (1.0 + 1e-4)


def test_the_bound_on_acceleration_is_that_of_the_formula():
    # f and d(f sin)/dtheta are largest where two agents meet, 2 a; f sin at 60 degrees.
    fastest = 3.0 * 0.75 * np.sqrt(3.0)
    assert rate_loop.acceleration_bound(COMPLETE, COSINE) == pytest.approx(
        3 * 2.0 * 2.0 * fastest, rel=1e-6)
    assert rate_loop.acceleration_bound(COMPLETE, gain.Cosine(0.5)) == pytest.approx(
        0.25 * 12.0 * fastest, rel=1e-6)


class Steep(gain.Gain):

    def f(self, theta, xp=np):
        return self.a / (1.0 + xp.exp(8.0 * (theta - 2.0)))


def test_a_gain_that_falls_steeply_makes_the_law_change_as_fast():
    theta = np.linspace(0.0, np.pi, 100001)
    product = Steep().f(theta) * np.sin(theta)
    steepest = np.max(np.abs(np.diff(product))) / theta[1]
    assert steepest > 1.5
    assert rate_loop.acceleration_bound(COMPLETE, Steep()) == pytest.approx(
        3 * steepest * 2.0 * 3.0 * np.max(product), rel=1e-4)


def test_a_fast_rate_loop_leaves_the_law_as_it_is():
    fast = rate_loop.rate_loop_equilibrium(TETRAHEDRON, ROTATING, COSINE, 1e4)
    alone = stability.transverse(TETRAHEDRON, ROTATING, COSINE)
    assert fast.slowest_rate == pytest.approx(-alone.eigenvalues[0].real, rel=1e-3)
    assert np.linalg.norm(fast.spin) == pytest.approx(np.linalg.norm(alone.spin), rel=1e-3)


@pytest.mark.parametrize('delay_steps', [0, 1, 3])
def test_the_sampled_loop_with_a_fast_rate_loop_is_that_of_kinematic_bodies(delay_steps):
    h = 0.05
    fast = rate_loop.rate_loop_equilibrium(
        TETRAHEDRON, ROTATING, COSINE, 1e6, h=h, delay_steps=delay_steps)
    kinematic = sampling.sampled_equilibrium(TETRAHEDRON, ROTATING, COSINE, h, delay_steps)
    slowest = -np.log(abs(kinematic.floquet_multipliers()[0])) / h
    assert fast.slowest_rate == pytest.approx(slowest, rel=1e-4)
    assert np.linalg.norm(fast.spin) == pytest.approx(np.linalg.norm(kinematic.spin), rel=1e-4)


@pytest.mark.parametrize(('bandwidth', 'h', 'delay_steps'), [
    (0.5, 0.0, 0), (5.0, 0.0, 0), (0.5, 0.1, 0), (5.0, 0.1, 0), (2.0, 0.1, 2)])
def test_the_equilibrium_is_one_that_simulation_keeps(bandwidth, h, delay_steps):
    there = rate_loop.rate_loop_equilibrium(
        TETRAHEDRON, ROTATING, COSINE, bandwidth, h=h, delay_steps=delay_steps)
    assert 0.0 <= there.residual < 1e-11
    step = h or 1e-3
    attitudes, rates = there.attitudes, there.rates
    if delay_steps:
        return  # what simulation makes of a delay is tested at the limit
    for _ in range(20):
        commands = rate_loop._commands(attitudes, ROTATING, COSINE)
        attitudes, rates = rate_loop.turn(attitudes, rates, commands, bandwidth, step)
    gamma = rotation.rotate(attitudes, rate_loop.AXIS)
    expected = rotation.rotate(rotation.exp(20 * step * there.spin), there.gamma)
    assert np.max(np.abs(gamma - expected)) < (1e-10 if h else 1e-5)


def test_the_shape_shifts_by_the_square_of_the_spin_over_the_bandwidth():
    shifts = []
    for k in (100.0, 200.0):
        there = rate_loop.rate_loop_equilibrium(TETRAHEDRON, ROTATING, COSINE, k)
        shifts.append(k * np.max(np.abs(_angles(there.gamma) - np.arccos(-1.0 / 3.0))))
    assert shifts[0] == pytest.approx(shifts[1], rel=0.01)


@pytest.mark.parametrize(('h', 'delay_steps'), [(0.1, 0), (0.1, 1)])
def test_the_limit_is_within_five_percent_of_where_simulation_turns(h, delay_steps):
    limit = rate_loop.min_bandwidth(
        TETRAHEDRON, ROTATING, COSINE, h=h, delay_steps=delay_steps)
    for factor, grows in ((0.95, True), (1.05, False)):
        there = rate_loop.rate_loop_equilibrium(
            TETRAHEDRON, ROTATING, COSINE, factor * limit, h=h, delay_steps=delay_steps)
        assert there.is_stable() is not grows
        growth = simulate(there, ROTATING, factor * limit, h, 300.0, delay_steps)
        assert (growth > 1.0) == grows


def test_the_naive_bound_of_the_laws_own_eigenvalues_is_no_prediction():
    values = stability.transverse(TETRAHEDRON, ROTATING, COSINE).eigenvalues
    # s^2 + k s - k lambda has a root on the axis at k = Im^2 / -Re.
    naive = max(value.imag**2 / -value.real for value in values)
    assert rate_loop.min_bandwidth(TETRAHEDRON, ROTATING, COSINE) < 0.6 * naive


@pytest.mark.parametrize('a', [1e-3, 100.0])
@pytest.mark.parametrize('h', [0.0, 0.1])
def test_the_limit_is_in_the_unit_of_the_gain(a, h):
    one, other = (rate_loop.min_bandwidth(TETRAHEDRON, ROTATING, gain.Cosine(unit), h=h / unit,
                                          accuracy=1e-2) for unit in (1.0, a))
    assert other == pytest.approx(a * one, rel=0.02)


def test_no_bandwidth_helps_where_sampling_alone_is_too_slow():
    limit = sampling.max_sample_time(TETRAHEDRON, COMPLETE, COSINE)
    assert rate_loop.min_bandwidth(TETRAHEDRON, COMPLETE, COSINE, h=1.2 * limit) == np.inf


def test_turning_in_many_short_steps_is_turning_in_one():
    rng = np.random.default_rng(1)
    attitudes, rates = rotation.random(rng, (5,)), rng.standard_normal((5, 2))
    commands = rng.standard_normal((5, 2))
    whole = rate_loop.turn(attitudes, rates, commands, 3.0, 0.2)
    for _ in range(50):
        attitudes, rates = rate_loop.turn(attitudes, rates, commands, 3.0, 0.2 / 50)
    assert np.max(np.abs(whole[0] - attitudes)) < 1e-5
    assert np.max(np.abs(whole[1] - rates)) < 1e-13


@pytest.mark.parametrize('bandwidth', [0.3, 1.0])
def test_a_step_half_as_long_is_two_to_the_fifth_as_exact(bandwidth):
    rng = np.random.default_rng(3)
    attitudes, rates = rotation.random(rng, (5,)), 3.0 * rng.standard_normal((5, 2))
    commands = 3.0 * rng.standard_normal((5, 2))
    errors = []
    for h in (0.2, 0.1):
        assert 4.0 * h * bandwidth <= 1.0, 'one step'
        one = rate_loop.turn(attitudes, rates, commands, bandwidth, h)[0]
        exact = attitudes, rates
        for _ in range(64):
            exact = rate_loop.turn(*exact, commands, bandwidth, h / 64)
        errors.append(np.max(np.abs(one - exact[0])))
    assert 2.0**4.5 < errors[0] / errors[1] < 2.0**5.5
    assert errors[1] < 1e-5


def test_the_commands_are_those_of_the_law():
    rng = np.random.default_rng(2)
    attitudes = rotation.random(rng, (4,))
    gamma = rotation.rotate(attitudes, rate_loop.AXIS)
    world = law.world_angular_velocity(gamma, ROTATING, COSINE)
    body = rotation.rotate(rotation.inverse(attitudes), world)
    assert np.allclose(rate_loop._commands(attitudes, ROTATING, COSINE), body[:, 1:])


def test_the_spin_asks_most_of_the_bodies_away_from_the_axis():
    found = rate_loop.rate_loop_equilibrium(TETRAHEDRON, ROTATING, COSINE, 1e4)
    # A body rate is the part of W across the pointing axis, and turns about it at the rest of W:
    # |W|^2 sin(theta) cos(theta), 0 on the axis, and the others are at cos(theta) = -1/3.
    spin = 1.0 / np.sqrt(3.0)
    assert found.angular_acceleration == pytest.approx(
        spin**2 * np.sqrt(8.0) / 9.0, rel=1e-3)
