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

"""The batch of the sampled loop: numpy and numba, and against the loop of one formation."""

from dataclasses import dataclass
import sys

import numba
import numpy as np
import pytest
from tetra_ros2.formation import batch, gain, law, rotation, shapes, topology
from tetra_ros2.formation.observer import Observer
from tetra_ros2.formation.simulation import SampledLoop

GRAPHS = (topology.complete(4), topology.rotating(), topology.complete(3), topology.complete(6))
AXIS = (1.0, 0.0, 0.0)


def starts(n, count=40, seed=0):
    return rotation.random(np.random.default_rng(seed), (count, n))


@pytest.mark.parametrize(('graph', 'family'), [
    *((topology.complete(4), family) for family in gain.KINDS.values()),
    *((graph, gain.Exponential) for graph in GRAPHS[1:])],
    ids=lambda value: getattr(value, 'kind', None) or value.__name__)
def test_compiled_and_plain_agree_to_rounding(graph, family):
    chosen = family(1.2, 0.8)
    gamma = rotation.rotate(starts(graph.n), AXIS)
    given = (gamma, graph.weights, chosen, shapes.known_shape(graph).angles, 1e-3, 0.02, 300, 40)
    formed, last = batch.compiled(chosen)(*given)
    expected_formed, expected_last = batch.run(*given)
    assert np.array_equal(formed, expected_formed)
    assert np.max(np.abs(last - expected_last)) < 1e-12


def test_it_tells_the_time_to_form_as_the_observer_does():
    graph, chosen, h = topology.rotating(), gain.Cosine(), 0.01
    attitudes = starts(4, 5)
    formed, _ = batch.run(rotation.rotate(attitudes, AXIS), graph.weights, chosen,
                          shapes.TETRAHEDRON.angles, 1e-3, h, 3000, 100)
    for start, step in zip(attitudes, formed):
        loop = SampledLoop(start, [AXIS] * 4, graph, chosen)
        observer = Observer(graph, 1e-3)
        for k in range(step + 101):
            observer.observe(k + 1, sum(
                (p + q for p, q in zip(loop.bodies.reduced, loop.bodies.attitudes)), ()))
            loop.advance(h)
        assert observer.formed_at - observer.started_at == step


def test_the_last_step_counts_and_none_is_taken_after_it():
    graph, chosen = GRAPHS[0], gain.Cosine()
    gamma = rotation.rotate(starts(4, 3), AXIS)
    given = (graph.weights, chosen, shapes.TETRAHEDRON.angles, 0.1, 0.05)
    for follow in (batch.run, batch.compiled(chosen)):
        formed = follow(gamma[:1], *given, 400, 0)[0]
        assert formed[0] > 3
        for longest, came in ((formed[0], formed[0]), (formed[0] - 1, batch.NEVER)):
            assert follow(gamma[:1], *given, longest, 0)[0] == came
        assert follow(gamma[:1], *given, formed[0] + 2, 2)[0] == formed
        assert follow(gamma[:1], *given, formed[0] + 1, 2)[0] == formed
        for longest in (0, 1, 2):
            expected = gamma
            for _ in range(longest):
                expected = batch.advance(expected, *given[:2], given[-1])
            np.testing.assert_allclose(follow(gamma, *given, longest, 5)[1], expected, atol=1e-14)


@pytest.mark.parametrize('size', [0.05, 0.09, 0.0999, 0.1001, 0.3, 2.0])
def test_a_compiled_step_is_exact_to_rounding_however_long(size):
    chosen, still = gain.Exponential(), np.ones((2, 2)) - np.eye(2)
    gamma = rotation.rotate(starts(2, 200), AXIS)
    rate = np.linalg.norm(law.velocity(gamma, still, chosen), axis=-1)
    for one, speed in zip(gamma, rate[:, 0]):
        h = size / speed
        _, last = batch.compiled(chosen)(one[None], still, chosen, [9.0], 1e-3, h, 1, 1)
        expected = batch.advance(one[None], still, chosen, h)
        assert np.max(np.abs(last - expected)) < 8e-16 * max(1.0, size / 0.1)


def test_a_start_that_does_not_form_is_told():
    graph = topology.complete(4)
    together = np.tile(AXIS, (3, 4, 1))
    formed, last = batch.compiled(gain.Cosine())(
        together, graph.weights, gain.Cosine(), shapes.TETRAHEDRON.angles, 1e-3, 0.01, 50, 5)
    assert np.all(formed == batch.NEVER)
    assert np.array_equal(last, together)


def test_without_numba_there_is_numpy(monkeypatch):
    monkeypatch.setitem(sys.modules, 'numba', None)
    assert batch.fastest(gain.Cosine(), 4) is batch.run


class Quartic(gain.Gain):

    def f(self, theta, xp=np):
        return self.a / (1.0 + self.b * theta**4)


@dataclass(frozen=True)
class Shifted(gain.Gain):
    shift: float = 0.5

    def f(self, theta, xp=np):
        return self.a / (self.shift + theta)


class Interpreted(Quartic):

    def f(self, theta, xp=np):
        return super().f(theta, xp)  # which numba cannot compile


@pytest.mark.parametrize('family', [Quartic, Shifted, Interpreted])
def test_a_gain_of_ones_own_is_compiled_where_numba_can(family):
    chosen = family()
    follow = batch.fastest(chosen, 4)
    assert (follow is batch.run) == (family is Interpreted)
    given = (rotation.rotate(starts(4, 5), AXIS), GRAPHS[0].weights, chosen,
             shapes.TETRAHEDRON.angles, 1e-3, 0.05, 3000, 20)
    formed, last = follow(*given)
    assert np.all(formed > 0)
    assert np.array_equal(formed, batch.run(*given)[0])
    assert np.max(np.abs(last - batch.run(*given)[1])) < 1e-10


@pytest.mark.parametrize('angles', [[0.0], [np.pi], [1e-3], [np.pi - 1e-3]], ids=str)
def test_a_target_at_the_end_of_its_range_is_reached(angles):
    gamma = np.array([[[1.0, 0.0, 0.0], [np.cos(angles[0]), np.sin(angles[0]), 0.0]]])
    still = np.zeros((2, 2))
    for follow in (batch.run, batch.compiled(gain.Cosine())):
        formed, _ = follow(gamma, still, gain.Cosine(), angles, 0.02, 0.01, 50, 10)
        assert formed.tolist() == [0], follow


@pytest.mark.parametrize('sign', [1.0, -1.0])
def test_a_tolerance_that_reaches_to_the_end_of_the_range_takes_all_up_to_there(sign):
    # Rounding takes the cosine of these two beyond 1.
    one = next(v for v in rotation.rotate(starts(1, 100)[:, 0], AXIS) if v @ v > 1.0)
    gamma, still, tolerance = np.stack([one, sign * one])[None], np.zeros((2, 2)), 2.0**-6
    target = tolerance if sign > 0.0 else np.pi - tolerance
    for follow in (batch.run, batch.compiled(gain.Cosine())):
        formed, _ = follow(gamma, still, gain.Cosine(), [target], tolerance, 0.01, 50, 10)
        assert formed.tolist() == [0], follow


@pytest.mark.parametrize('labelled', [False, True])
@pytest.mark.parametrize('family', [gain.Cosine, gain.Exponential])
def test_what_is_compiled_does_what_its_source_says(family, labelled, monkeypatch):
    graph, chosen = topology.rotating(), family(1.3)
    gamma = rotation.rotate(starts(4, 4), AXIS)
    given = (gamma, graph.weights, chosen, shapes.known_shape(graph).angles, 0.1, 0.4, 60, 3,
             labelled)
    formed, last = batch.compiled(chosen)(*given)
    batch._kernel.cache_clear()
    monkeypatch.setattr(numba.config, 'DISABLE_JIT', True)
    formed_plain, last_plain = batch.compiled(chosen)(*given)
    batch._kernel.cache_clear()
    assert np.array_equal(formed, formed_plain)
    assert np.any(formed != batch.NEVER)
    np.testing.assert_allclose(last, last_plain, atol=1e-12)
