# Copyright 2026 The tetra_ros2 authors
# SPDX-License-Identifier: Apache-2.0

"""The law is read off the commands; what theory predicts of it agrees with the paper."""

import bags
import numpy as np
import pytest

from tetra_ros2.formation import gain as gains
from tetra_ros2.formation import identify, rotation, shapes, topology
from tetra_ros2.formation.convergence import slowest_rate, transverse_eigenvalues

GRAPHS = {
    'complete': topology.complete(4),
    'rotating': topology.rotating(2, 0),
    'custom': topology.custom(5, [(1, 2, 0.25), (2, 3), (3, 1, 0.5), (4, 1), (5, 4, 0.7), (1, 5)]),
}


def seen(graph, gain, noise=0.0):
    attitudes, body = bags.states(200, graph, gain)
    gamma = rotation.rotate(attitudes, [1.0, 0.0, 0.0])
    rates = rotation.rotate(attitudes, body)
    rates = rates + noise * np.random.default_rng(1).standard_normal(rates.shape)
    return gamma, rates, tuple((i, j) for i, j, _ in graph.edges)


@pytest.mark.parametrize('graph', GRAPHS.values(), ids=GRAPHS)
@pytest.mark.parametrize('gain', [
    gains.Cosine(0.7), gains.Exponential(3.0), gains.Exponential(2.0, 0.6), gains.Gaussian(1.5),
    gains.Linear(1.0, 0.8), gains.Rational(2.0, 1.7)], ids=str)
def test_graph_and_gain_are_read_off_the_commands(graph, gain):
    law = identify.identify(*seen(graph, gain))
    np.testing.assert_allclose(law.topology.weights, graph.weights, atol=1e-5)
    theta = np.linspace(0.3, 3.0, 20)
    np.testing.assert_allclose(law.gain.f(theta), gain.f(theta), rtol=1e-4)


def test_commands_that_follow_no_known_gain_are_not_explained():
    gamma, rates, edges = seen(GRAPHS['complete'], gains.Cosine(), noise=0.1)
    assert identify.identify(gamma, rates, edges) is None
    assert identify.identify(gamma, np.full_like(rates, np.nan), edges) is None
    assert identify.identify(gamma, rates, ()) is None


def test_motion_that_does_not_tell_the_neighbours_apart_is_not_explained():
    gamma = np.broadcast_to(shapes.TETRAHEDRON.points, (50, 4, 3))
    rates = np.zeros_like(gamma)
    assert identify.identify(gamma, rates, seen(GRAPHS['complete'], gains.Cosine())[2]) is None


@pytest.mark.parametrize('gain', [gains.Cosine(), gains.Exponential(2.0)], ids=str)
def test_eigenvalues_of_the_complete_graph_are_the_papers(gain):
    f, slope = (float(g(shapes.THETA_STAR)) for g in (gain.f, gain.derivative))
    paper = np.sort([2.0 * 2**0.5 * slope] * 2 + [4.0 * 2**0.5 / 3.0 * slope - 8.0 / 3.0 * f] * 3)
    found = transverse_eigenvalues(
        shapes.TETRAHEDRON.points, topology.complete(4).weights, gain)
    np.testing.assert_allclose(np.sort(found.real), paper, rtol=1e-6)
    np.testing.assert_allclose(found.imag, 0.0, atol=1e-6)


def test_the_error_decays_at_the_predicted_rate():
    graph, gain = GRAPHS['complete'], gains.Cosine()
    attitudes, _ = bags.states(8000, graph, gain, h=0.001)
    gamma = rotation.rotate(attitudes, [1.0, 0.0, 0.0])
    from tetra_ros2.formation import measures
    error = measures.shape_error(gamma, shapes.TETRAHEDRON.angles)
    measured = np.log(error[5000] / error[7900]) / 2.9
    assert measured == pytest.approx(
        slowest_rate(shapes.TETRAHEDRON.points, graph.weights, gain), rel=0.01)


def test_where_nothing_decays_there_is_no_rate():
    attracting = topology.custom(4, [(i, j, -1.0) for i, j, _ in GRAPHS['complete'].edges])
    assert slowest_rate(shapes.TETRAHEDRON.points, attracting.weights, gains.Cosine()) is None
