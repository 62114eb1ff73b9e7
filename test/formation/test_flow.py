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

"""The compiled flow is that of the closed loop, as exact as wanted, whoever shares the work."""

import numba
import numpy as np
import pytest
from tetra_ros2.formation import _dop853, flow, law
from tetra_ros2.formation.gain import Cosine, Exponential
from tetra_ros2.formation.topology import complete, rotating

CASES = [(complete(4), Cosine(1.3)), (rotating(), Exponential())]


def starts(count):
    gamma = np.random.default_rng(2).normal(size=(count, 4, 3))
    return gamma / np.linalg.norm(gamma, axis=-1, keepdims=True)


def runge_kutta(gamma, weights, gain, h, steps):
    for _ in range(steps):
        k1 = law.velocity(gamma, weights, gain)
        k2 = law.velocity(gamma + 0.5 * h * k1, weights, gain)
        k3 = law.velocity(gamma + 0.5 * h * k2, weights, gain)
        k4 = law.velocity(gamma + h * k3, weights, gain)
        gamma = gamma + h / 6.0 * (k1 + 2.0 * (k2 + k3) + k4)
        gamma /= np.linalg.norm(gamma, axis=-1, keepdims=True)
    return gamma


@pytest.mark.parametrize(('topology', 'gain'), CASES)
def test_it_follows_the_law(topology, gain):
    gamma = starts(flow.LANES + 3)
    end = flow.run(gamma, topology.weights, gain, 1.0, 1e-12)
    expected = runge_kutta(gamma, topology.weights, gain, 1e-3, 1000)
    np.testing.assert_allclose(end, expected, atol=1e-10)
    np.testing.assert_allclose(np.linalg.norm(end, axis=-1), 1.0, atol=1e-14)


@pytest.mark.parametrize('tolerance', [1e-3, 1e-6])
@pytest.mark.parametrize(('topology', 'gain'), CASES)
def test_it_takes_the_steps_of_the_integrator_on_arrays(topology, gain, tolerance):
    duration, weights = 3.0, topology.weights

    def rate(x):
        # The stages of a step leave the sphere a little: there this is what is followed.
        cosine = x @ x.T
        rate = weights * gain.of_cosine(cosine)
        return np.sum(rate * cosine, axis=1)[:, None] * x - rate @ x

    for start in starts(5):
        first = 0.1 / np.max(np.abs(rate(start)))
        *_, last = _dop853.steps(rate, start, tolerance, flow._unit, first, duration)
        end, = flow.run(start[None], weights, gain, duration, tolerance)
        np.testing.assert_allclose(end, last.after, atol=1e-12)


@pytest.mark.parametrize(('topology', 'gain'), CASES)
def test_the_worst_of_a_block_decides_about_its_steps(topology, gain):
    # The others could take longer steps, and are no less exact for it.
    gamma = starts(flow.LANES)
    gamma[3] = gamma[3, :1] + 1e-3 * gamma[3]
    gamma[3] /= np.linalg.norm(gamma[3], axis=-1, keepdims=True)
    alone = np.concatenate([
        flow.run(one[None], topology.weights, gain, 1.0, 1e-5) for one in gamma])
    exact = flow.run(gamma, topology.weights, gain, 1.0, 1e-13)
    together = flow.run(gamma, topology.weights, gain, 1.0, 1e-5)
    error = [np.max(np.abs(end - exact), axis=(1, 2)) for end in (together, alone)]
    assert np.all(error[0] < np.maximum(2.0 * error[1], 1e-6))


@pytest.mark.parametrize('tolerance', [1e-4, 1e-6, 1e-8])
def test_it_is_as_exact_as_wanted(tolerance):
    topology, gain = CASES[0]
    gamma = starts(20 * flow.LANES)
    exact = flow.run(gamma, topology.weights, gain, 2.0, 1e-13)
    error = np.abs(flow.run(gamma, topology.weights, gain, 2.0, tolerance) - exact).max()
    assert 1e-6 * tolerance < error < 10.0 * tolerance


def test_what_is_not_a_number_ends():
    topology, gain = CASES[0]
    end = flow.run(np.full((1, 4, 3), np.nan), topology.weights, gain, 1.0, 1e-6)
    assert np.isnan(end).all()


def test_threads_change_nothing():
    topology, gain = CASES[0]
    gamma = starts(3 * flow.TASK + 1)
    alone = flow.run(gamma, topology.weights, gain, 1.0, 1e-6)
    assert np.array_equal(alone, flow.run(gamma, topology.weights, gain, 1.0, 1e-6, threads=2))


@pytest.mark.parametrize(('topology', 'gain'), CASES)
def test_what_is_compiled_does_what_its_source_says(topology, gain, monkeypatch):
    gamma, given = starts(3), (topology.weights, gain, 0.7, 1e-5)
    compiled = flow.run(gamma, *given)
    flow._kernel.cache_clear()
    monkeypatch.setattr(numba.config, 'DISABLE_JIT', True)
    np.testing.assert_allclose(flow.run(gamma, *given), compiled, atol=1e-12)
    flow._kernel.cache_clear()
