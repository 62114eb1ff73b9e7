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
from tetra_ros2.formation import rotation, shapes, topology
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


@pytest.mark.parametrize('spin', [0.5, 1e-2, 1e-4, 1e-6, -1e-4])
def test_a_slow_spin_is_reported_as_one(spin):
    measured = watched(spin).measured
    assert measured.rate == pytest.approx(abs(spin), rel=1e-3)
    assert measured.period == pytest.approx(2.0 * math.pi / abs(spin), rel=1e-3)
    assert measured.sense == np.sign(spin)


def test_no_spin_has_no_period_and_no_sense():
    measured = watched(0.0).measured
    assert measured.rate == pytest.approx(0.0, abs=1e-12)
    assert (measured.period, measured.sense) == (math.inf, 0)
