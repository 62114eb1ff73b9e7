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

"""What a summary says of the spin."""

import math

import numpy as np
import pytest
from tetra_ros2.formation import measures, rotation, shapes, topology
from tetra_ros2.formation.gain import Cosine
from tetra_ros2.formation.observer import Observer
from tetra_ros2.formation.summary import summarize


def watched(spin):
    """Return an observer that has seen a tetrahedron turn about the first agent for 0.01 s."""
    graph = topology.rotating()
    observer = Observer(graph, 1e-3)
    for k in range(2):
        turn = rotation.exp(np.array([0.0, 0.0, 0.01 * k * spin]))
        gamma = rotation.rotate(turn, shapes.TETRAHEDRON.points)
        poses = np.concatenate([gamma, np.tile(turn, (4, 1))], axis=1).ravel().tolist()
        observer.observe(10_000_000 * (k + 1), poses)
    return summarize(observer, graph, Cosine())


@pytest.mark.parametrize('spin', [0.5, 1e-2, 1e-4, 1e-8, -1e-4])
def test_a_slow_spin_is_reported_as_one(spin):
    measured = watched(spin).measured
    assert measured.rate == pytest.approx(abs(spin), rel=1e-3)
    assert measured.period == pytest.approx(2.0 * math.pi / abs(spin), rel=1e-3)
    assert measured.sense == np.sign(spin)


def test_no_spin_has_no_period_and_no_sense():
    measured = watched(0.0).measured
    assert measured.rate == pytest.approx(0.0, abs=1e-12)
    assert (measured.period, measured.sense) == (math.inf, 0)


def test_without_a_known_shape_or_a_second_sample_less_is_told():
    with pytest.raises(ValueError, match='nothing has been observed'):
        summarize(Observer(topology.complete(4), 1e-3), topology.complete(4), Cosine())
    graph = topology.complete(5)
    observer = Observer(graph, 1e-3)
    gamma = np.concatenate([shapes.TETRAHEDRON.points, [[1.0, 0.0, 0.0]]])
    poses = np.concatenate([gamma, np.tile([0.0, 0.0, 0.0, 1.0], (5, 1))], axis=1).ravel().tolist()
    observer.observe(10_000_000, poses)
    first = summarize(observer, graph, Cosine())
    assert (first.shape, first.measured, first.predicted, first.axis_drift) == (None,) * 4
    assert not first.formed
    observer.observe(20_000_000, poses)
    second = summarize(observer, graph, Cosine())
    assert second.formed
    assert second.predicted is None
    assert second.measured.period == math.inf
    assert second.duration == pytest.approx(0.01)


def test_the_prediction_is_that_of_theory_and_the_axis_stays_where_it_is():
    seen = watched(-1.0 / math.sqrt(3.0))
    assert (seen.shape, seen.formed, seen.tolerance) == ('regular tetrahedron', True, 1e-3)
    assert seen.predicted.rate == pytest.approx(1.0 / math.sqrt(3.0))
    assert seen.predicted.axis == 1
    assert seen.predicted.sense == shapes.predicted_sense(topology.rotating(), seen.chirality)
    assert seen.measured.sense == -1
    assert seen.predicted.about == 'the direction of agent_1'
    assert seen.axis_drift == pytest.approx(0.0, abs=1e-12)
    assert seen.angles == pytest.approx([math.acos(-1.0 / 3.0)] * 6)
    assert seen.time_to_form == 0.0
    assert seen.chirality == measures.chirality(shapes.TETRAHEDRON.points)
