# Copyright 2026 The tetra_ros2 authors
# SPDX-License-Identifier: Apache-2.0

"""The compiled flow is the flow of the closed loop, of order 8, whoever shares the work."""

import numpy as np
import pytest

from tetra_ros2.formation import law
from tetra_ros2.formation.gain import Cosine, Exponential
from tetra_ros2.formation.topology import complete, rotating

pytest.importorskip('numba')
from tetra_ros2.formation import flow

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
    end = flow.run(gamma, topology.weights, gain, 1.0, 40)
    expected = runge_kutta(gamma, topology.weights, gain, 1e-3, 1000)
    np.testing.assert_allclose(end, expected, atol=1e-10)
    np.testing.assert_allclose(np.linalg.norm(end, axis=-1), 1.0, atol=1e-14)


def test_half_the_step_has_an_error_hundreds_of_times_smaller():
    topology, gain = CASES[0]
    gamma = starts(flow.LANES)
    exact = flow.run(gamma, topology.weights, gain, 2.0, 400)
    coarse, fine = (np.abs(flow.run(gamma, topology.weights, gain, 2.0, steps) - exact).max()
                    for steps in (10, 20))
    assert coarse / fine > 2.0**7


def test_threads_change_nothing():
    topology, gain = CASES[0]
    gamma = starts(3 * flow.LANES * flow.BLOCKS + 1)
    alone = flow.run(gamma, topology.weights, gain, 1.0, 10)
    assert np.array_equal(alone, flow.run(gamma, topology.weights, gain, 1.0, 10, threads=2))
