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

"""
Every solid about every kind of axis, by real nodes in lockstep.

A few of them run with the suite. All of them, with the exact spin of the sampled loop beside the
prediction: ``python -m pytest -m slow test/system/test_solids.py -s``.
"""

import itertools
import math

import numpy as np
import pytest
from tetra_ros2.cli import main
from tetra_ros2.commands.design import read_points
from tetra_ros2.formation import gain as gains
from tetra_ros2.formation import polyhedra, rings, rotation, sampling
from tetra_ros2.launcher import Launcher

AXES = {'vertex': 'vertex', 'edge': 'edge', 'face': 'face', 'generic': '0.3 -0.5 0.8'}
GAINS = {'tetrahedron': ('cosine', 2.0), 'octahedron': ('rational', 2.0),
         'cube': ('exponential', 4.0), 'icosahedron': ('rational', 2.0),
         'dodecahedron': ('rational', 2.0)}
AT_REST = [(solid, 'vertex', 0.0) for solid in GAINS]
SPINNING = list(itertools.product(GAINS, AXES, (0.3, -0.5)))
QUICK = [('tetrahedron', 'vertex', 1.0), ('octahedron', 'face', -0.3), ('cube', 'generic', 0.5),
         ('icosahedron', 'edge', -0.5), ('dodecahedron', 'vertex', 0.0)]


def expected_spin(solid, axis, spin, gain, gamma):
    """Return the spin of the claim, in the world: laid over the agents by hand."""
    points = polyhedra.SOLIDS[solid]
    e = points[0] if axis == 'vertex' else polyhedra.axis_direction(
        points, axis if axis in polyhedra.AXES else np.array([float(x) for x in axis.split()]))
    handed = np.sign(np.linalg.det(points.T @ gamma))
    turn = rotation.align(handed * points, gamma)
    rate = polyhedra.spin_rate(points, np.array(polyhedra.CLASS_WEIGHTS[solid]), e, spin, gain)
    return rate * rotation.rotate(turn, e), handed


def run(solid, axis, spin, seed=7):
    kind, a = GAINS[solid]
    parameters = {'topology.kind': 'polyhedron', 'topology.polyhedron': solid, 'topology.n': 0,
                  'topology.axis': AXES[axis], 'topology.spin': spin, 'gain.kind': kind,
                  'gain.a': a, 'monitor:tolerance': 4e-3}
    with Launcher('complete', parameters=parameters, seed=seed) as formation:
        formation.run_for(20.0)
        summary, observer = formation.summary(), formation.monitor.observer
        topology, gain = formation.formation.topology, formation.formation.gain
    gamma = observer.reduced_attitudes
    assert summary.formed, summary
    expected, handed = expected_spin(solid, AXES[axis], spin, gain, gamma)
    assert summary.shape.endswith(solid)
    assert summary.chirality == handed
    rate = float(np.linalg.norm(expected))
    measured = observer.angular_velocity
    if spin == 0.0:
        assert summary.measured.rate < 1e-5
        return summary, topology, gain
    assert summary.predicted.rate == pytest.approx(rate, rel=1e-9)
    assert np.linalg.norm(measured - expected) < 2e-3 * rate, 'rate, axis and sense'
    assert summary.predicted.sense == summary.measured.sense == np.sign(spin) * handed
    return summary, topology, gain


@pytest.mark.parametrize(('solid', 'axis', 'spin'), QUICK)
def test_a_solid_forms_and_turns_as_claimed(solid, axis, spin):
    run(solid, axis, spin)


@pytest.mark.slow
@pytest.mark.timeout(600)
@pytest.mark.parametrize(('solid', 'axis', 'spin'), AT_REST + SPINNING)
def test_every_solid_forms_and_turns_as_claimed(solid, axis, spin):
    summary, topology, gain = run(solid, axis, spin)
    line = f'| {solid} | {axis} | {spin:g} | {summary.time_to_form:.2f} | {summary.error:.2e} '
    if spin:
        sampled = sampling.sampled_equilibrium(
            topology.shape.points, topology.weights, gain, 0.01)
        there = float(np.linalg.norm(sampled.spin))
        line += (f'| {summary.predicted.rate:.6f} | {summary.measured.rate:.6f} '
                 f'| {abs(summary.measured.rate / there - 1.0):.1e} |')
        assert summary.measured.rate == pytest.approx(there, rel=1e-6)
    print(f'\n{line}')


@pytest.mark.parametrize(('n', 'spin'), [(5, 0.6), (6, 0.0)])
def test_a_ring_forms_what_is_predicted(n, spin):
    parameters = {'topology.kind': 'ring', 'topology.n': n, 'topology.spin': spin,
                  'gain.kind': 'exponential', 'gain.a': 20.0}
    with Launcher('complete', parameters=parameters, seed=3) as formation:
        formation.run_for(25.0)
        summary = formation.summary()
    assert summary.formed, summary
    assert summary.shape == rings.name(n)
    rate = abs(rings.spin_rate(n, spin, gains.Exponential(20.0)))
    assert summary.measured.rate == pytest.approx(rate, rel=2e-3, abs=1e-3)
    assert summary.predicted.sense == summary.measured.sense == (1 if rate else 0)


def test_a_designed_formation_forms_by_nodes_and_is_known_to_the_monitor(tmp_path, capfd):
    pytest.importorskip('scipy')
    points, config = tmp_path / 'points.csv', tmp_path / 'formation.yaml'
    points.write_text('# no tetrahedron\n1, 1, 1.2\n-1, 1, -0.8\n1, -1, -1\n-1, -1.3, 1\n')
    assert main(['design', '--points', str(points), '--spin', '0.1', '0.05', '0.2', '--gain',
                 'cosine', '--starts', '50', '--out', str(config)]) == 0
    assert '50 of 50' in capfd.readouterr().out
    with Launcher(str(config), seed=1) as formation:
        formation.run_for(60.0)
        summary, observer = formation.summary(), formation.monitor.observer
    assert summary.formed, summary
    assert summary.shape == 'formation of 4 given directions'
    rate = math.sqrt(0.1**2 + 0.05**2 + 0.2**2)
    assert summary.measured.rate == pytest.approx(rate, rel=2e-3)
    given = read_points(str(points))
    gamma = observer.reduced_attitudes
    handed = np.sign(np.linalg.det(given.T @ gamma))
    turned = rotation.rotate(rotation.align(handed * given, gamma), np.array([0.1, 0.05, 0.2]))
    assert np.linalg.norm(observer.angular_velocity - turned) < 2e-3 * rate
