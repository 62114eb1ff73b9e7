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

"""What theory says beside a measurement, and what is measured, of runs whose rates are known."""

import math

import bags
import numpy as np
import pytest
from tetra_ros2.drawing.theory import recognize, spin_rate, table, Theory
from tetra_ros2.formation import (
    decay,
    measures,
    polyhedra,
    rotation,
    sampling,
    shapes,
    sphere,
    targets,
    topology,
)
from tetra_ros2.formation import gain as gains

GRAPHS = {'complete': topology.complete(4), 'rotating': topology.rotating()}


def run(graph, gain, h, count, seed=3):
    """Return times and reduced attitudes of the sampled loop."""
    attitudes, _ = bags.states(count, GRAPHS[graph], gain, h=h, seed=seed)
    return h * np.arange(count), rotation.rotate(attitudes, [1.0, 0.0, 0.0])


@pytest.mark.parametrize('gain', [gains.Cosine(), gains.Exponential(2.0)], ids=str)
def test_the_predicted_rate_of_the_complete_graph_is_the_papers(gain):
    f, slope = (float(g(shapes.THETA_STAR)) for g in (gain.f, gain.derivative))
    paper = min(-2.0 * 2**0.5 * slope, -4.0 * 2**0.5 / 3.0 * slope + 8.0 / 3.0 * f)
    spin, rate = Theory(4, GRAPHS['complete'], gain).rates
    assert rate == pytest.approx(paper, rel=1e-9)
    assert spin == pytest.approx(0.0, abs=1e-12)


@pytest.mark.parametrize('graph', GRAPHS)
@pytest.mark.parametrize(('h', 'a'), [(0.01, 1.0), (0.05, 1.0), (0.01, 3.0)])
@pytest.mark.parametrize('seed', [3, 8])
def test_the_measured_decay_is_that_of_the_sampled_loop(graph, h, a, seed):
    theory = Theory(4, GRAPHS[graph], gains.Cosine(a), h)
    times, gamma = run(graph, gains.Cosine(a), h, int(20.0 / a / h), seed)
    measured = theory.decay_rate(times, gamma)
    assert measured == pytest.approx(theory.sampled_rates[1], rel=0.01)
    # As the viewer has it: thinned, and not evenly.
    kept = np.flatnonzero(np.diff(np.floor(times * 20.0), prepend=-1))
    rng = np.random.default_rng(seed)
    kept = kept[np.sort(rng.permutation(len(kept))[:-len(kept) // 20])]
    assert theory.decay_rate(times[kept], gamma[kept]) == pytest.approx(
        theory.sampled_rates[1], rel=0.03)


def test_a_hole_in_the_samples_does_not_spoil_the_measurement():
    theory = Theory(4, GRAPHS['rotating'], gains.Cosine(), 0.01)
    times, gamma = run('rotating', gains.Cosine(), 0.01, 2000)
    kept = np.arange(0, 2000, 5)
    whole = theory.decay_rate(times[kept], gamma[kept])
    for begin, end in ((5.5, 6.5), (6.0, 7.5), (12.0, 14.0)):
        seen = kept[(times[kept] < begin) | (times[kept] > end)]
        measured = theory.decay_rate(times[seen], gamma[seen])
        assert measured is None or measured == pytest.approx(whole, rel=0.02)


def test_the_sampled_prediction_is_that_of_the_mathematics_in_either_chirality():
    theory = Theory(4, GRAPHS['rotating'], gains.Cosine(), 0.01)
    for sign in (1.0, -1.0):
        there = sampling.sampled_equilibrium(
            sign * shapes.TETRAHEDRON.points, GRAPHS['rotating'].weights, gains.Cosine(), 0.01)
        spin, slowest = theory.sampled_rates
        assert spin == pytest.approx(np.linalg.norm(there.spin), rel=1e-9)
        multiplier = np.abs(there.floquet_multipliers()[0])
        assert slowest == pytest.approx(-np.log(multiplier) / 0.01, rel=1e-6)
        np.testing.assert_allclose(
            measures.pairwise_cosines(theory.limit(sign * shapes.TETRAHEDRON.points)),
            measures.pairwise_cosines(there.gamma), atol=1e-9)
    assert theory.rates == pytest.approx((3**0.5 / 2.0 * 2.0 / 3.0, 1.522), abs=1e-3)


@pytest.mark.parametrize('part', [slice(0, 100), slice(-400, None), slice(400, 403)], ids=str)
def test_where_no_decay_is_seen_none_is_told(part):
    theory = Theory(4, GRAPHS['rotating'], gains.Cosine(), 0.01)
    times, gamma = run('rotating', gains.Cosine(), 0.01, 3000)
    assert theory.decay_rate(times[part], gamma[part]) is None


def about(offsets):
    """Return formations that are so far from the tetrahedron, ``(k, 4, 3)``."""
    return sphere.normalize(shapes.TETRAHEDRON.points + offsets)


def test_noise_is_no_decay():
    noise = 3e-4 * np.random.default_rng(4).standard_normal((400, 4, 3))
    times = 0.05 * np.arange(400)
    fading = np.exp(-times)[:, None, None] * noise
    growing = np.exp(0.2 * times)[:, None, None] * 1e-3 * noise[0]
    for gamma in (about(0.1 * noise), about(fading), about(growing)):
        assert math.isnan(decay.decay_rate(gamma, 0.05, shapes.TETRAHEDRON.points))
        assert math.isnan(decay.decay_rate(gamma, times, shapes.TETRAHEDRON.points))


def test_a_decay_is_found_among_faster_ones_that_turn():
    times = 0.05 * np.arange(500)
    modes = np.stack([np.exp(-0.7 * times) * np.cos(3.0 * times), np.exp(-0.7 * times)
                      * np.sin(3.0 * times), np.exp(-1.9 * times)], axis=1)
    gamma = about(2e-5 * np.tensordot(
        modes, np.random.default_rng(1).standard_normal((3, 4, 3)), axes=1))
    rate = decay.decay_rate(gamma, 0.05, shapes.TETRAHEDRON.points)
    assert rate == pytest.approx(0.7, rel=1e-2)
    assert decay.decay_rate(gamma, times, shapes.TETRAHEDRON.points) == rate


def test_the_table_has_a_dash_where_there_is_nothing_to_tell():
    theory = Theory(4, GRAPHS['rotating'], gains.Cosine(), 0.01)
    times, gamma = run('rotating', gains.Cosine(), 0.01, 2000)
    kept = slice(None, None, 5)
    rows = {line.split('|')[1].strip(): [cell.strip() for cell in line.split('|')[2:-1]]
            for line in table(theory, times[kept], gamma[kept]).splitlines()}
    assert rows[''] == ['theory', 'at 100 Hz', 'measured']
    assert rows['spin [rad/s]'] == ['0.5774', '0.5771', '0.5771']
    predicted, sampled, measured = map(float, rows['decay [1/s]'])
    assert predicted == pytest.approx(1.522, abs=1e-3)
    assert measured == pytest.approx(sampled, rel=0.01)
    assert float(rows['error [rad]'][1]) == pytest.approx(float(rows['error [rad]'][2]), rel=0.02)
    late = table(theory, times[kept], gamma[kept], since=times[-100])
    assert late.splitlines()[-1].endswith('| — |'), 'a new gain has not been seen to act yet'
    unknown = table(Theory(4), times[kept], gamma[kept]).splitlines()
    assert unknown[0] == '|  | theory | measured |'
    assert unknown[-1] == '| decay [1/s] | — | — |'
    assert 'error' not in table(Theory(5), times[:2], np.ones((2, 5, 3)))


def test_what_is_not_known_is_not_predicted():
    attracting = topology.custom(4, [(i, j, -1.0) for i, j, _ in GRAPHS['complete'].edges])
    assert Theory(4, attracting, gains.Cosine()).rates == (None, None)
    assert Theory(4).rates == Theory(4).sampled_rates == (None, None)
    assert Theory(4).fastest is None
    assert Theory(4).shape is shapes.TETRAHEDRON
    assert Theory(5).shape is None
    assert Theory(2, topology.complete(2), gains.Cosine(), 0.01).rates == (None, None)
    assert spin_rate(np.zeros(1), np.zeros((1, 4, 3))) is None


def test_two_theories_agree_when_they_say_the_same():
    theory = Theory(4, GRAPHS['rotating'], gains.Cosine(), 0.01)
    assert theory.agrees_with(Theory(4, topology.rotating(), gains.Cosine(), 0.01))
    for other in (Theory(4), Theory(4, GRAPHS['complete'], gains.Cosine(), 0.01),
                  Theory(4, GRAPHS['rotating'], gains.Cosine(2.0), 0.01),
                  Theory(4, GRAPHS['rotating'], gains.Exponential(), 0.01),
                  Theory(4, GRAPHS['rotating'], gains.Cosine(), 0.02)):
        assert not theory.agrees_with(other)
        assert not other.agrees_with(theory)


def test_no_agent_is_faster_than_the_law_lets_it():
    for graph in GRAPHS.values():
        theory = Theory(4, graph, gains.Exponential(2.0))
        _, rates = bags.states(300, graph, gains.Exponential(2.0))
        assert np.max(np.linalg.norm(rates, axis=-1)) < theory.fastest


@pytest.mark.parametrize('name', polyhedra.SOLIDS)
def test_a_recording_of_a_solid_is_recognized_whoever_is_where(name):
    points = polyhedra.SOLIDS[name]
    rng = np.random.default_rng(2)
    turn = np.linalg.qr(rng.standard_normal((3, 3)))[0]
    gain = gains.Exponential()
    seen = topology.Topology('custom', targets.polyhedron(name, spin=0.5).weights)
    found = recognize(seen, gain, sphere.normalize(
        points @ turn + 0.01 * rng.standard_normal(points.shape)))
    shape = shapes.known_shape(found)
    assert name in shape.name
    np.testing.assert_allclose(np.sort(shape.points @ shape.points.T), np.sort(points @ points.T),
                               atol=1e-9)
    assert Theory(len(points), found, gain).rates[1] > 0.0
    other = sphere.normalize(rng.standard_normal(points.shape))
    assert (shapes.known_shape(recognize(seen, gain, other)) is None) == (len(points) > 4)


@pytest.mark.parametrize('order', [range(6), [0, 3, 1, 4, 2, 5], [4, 1, 0, 5, 3, 2]])
def test_the_limit_of_a_formation_has_each_agent_as_far_from_each_other_as_it_is(order):
    theory = Theory(6, topology.complete(6), gains.Exponential(), 0.01)
    points = shapes.OCTAHEDRON.points[list(order)]
    for gamma in (points, -points):
        np.testing.assert_allclose(measures.pairwise_cosines(theory.limit(gamma)),
                                   measures.pairwise_cosines(gamma), atol=1e-6)
