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

"""How fast a recorded run of the nodes comes to its shape, against the slowest eigenvalue."""

import math

import numpy as np
import pytest
from tetra_ros2.formation import law, measures, rotation, shapes
from tetra_ros2.launcher import Launcher
from tetra_ros2.paper.runs import NodeRun, slowest_rate
from tetra_ros2.recording import reader as recording


def predicted_rate(topology, gain):
    """Return the slowest decay of the cosines at the ideal tetrahedron, by differences [1/s]."""
    start, size = shapes.TETRAHEDRON.points, 1e-5
    slopes = []
    for axis in np.eye(12).reshape(12, 4, 3):
        ends = [rotation.rotate(rotation.exp(sign * size * axis), start) for sign in (1, -1)]
        rows = []
        for gamma in ends:
            v = law.velocity(gamma, topology.weights, gain)
            i, j = np.triu_indices(4, k=1)
            rows.append((measures.pairwise_cosines(gamma),
                         np.sum(v[i] * gamma[j] + gamma[i] * v[j], axis=-1)))
        slopes.append([(rows[0][k] - rows[1][k]) / (2.0 * size) for k in (0, 1)])
    moved, moving = (np.array([s[k] for s in slopes]) for k in (0, 1))
    u, s, vt = np.linalg.svd(moved, full_matrices=False)
    kept = s > 1e-6 * s[0]  # five: the sixth direction leaves the surface of the Gram identity
    matrix = (u[:, kept].T @ moving @ vt[kept].T) / s[kept][:, None]
    assert kept.sum() == 5
    return -np.max(np.linalg.eigvals(matrix).real)


@pytest.mark.parametrize(('config', 'gain', 'rate', 'duration'), [
    ('complete', 'cosine', 400.0, 10.0), ('complete', 'exponential', 100.0, 60.0),
    ('rotating', 'cosine', 400.0, 16.0), ('rotating', 'exponential', 100.0, 90.0)])
def test_a_recorded_run_converges_at_the_slowest_transverse_rate(
        tmp_path, config, gain, rate, duration):
    with Launcher(config, record=tmp_path / 'bag', seed=7, parameters={
            'gain.kind': gain, 'plant:rate': rate}) as launcher:
        launcher.run_for(duration)
        formation = launcher.formation
    bag = recording.load(tmp_path / 'bag')
    times = (bag.stamps - bag.stamps[0]) / 1e9
    assert np.ptp(np.diff(bag.stamps)) == 0, 'no gap'
    measured = slowest_rate(
        NodeRun(times, bag.gamma, 1.0 / rate), formation.topology, formation.gain)
    predicted = predicted_rate(formation.topology, formation.gain)
    print(config, gain, measured, predicted)
    assert math.isfinite(measured)
    assert measured == pytest.approx(predicted, rel=0.01)
