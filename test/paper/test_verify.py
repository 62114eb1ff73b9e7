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

"""The checks of the paper's claims hold, and each of them can fail."""

import itertools
import json
import math
import os
from pathlib import Path
import subprocess
import sys

import numpy as np
import pytest
from tetra_ros2.cli import main
from tetra_ros2.formation import (
    controller,
    coordinates,
    equilibria,
    gain,
    law,
    polyhedra,
    rate_loop,
    rings,
    rotation,
    shapes,
    sphere,
    stability,
    topology,
)
from tetra_ros2.paper import errata, registry, verify
from tetra_ros2.paper.claims import almost_global, preliminaries, xi
from tetra_ros2.paper.errata import ERRATA, erratum
from tetra_ros2.paper.registry import CLAIMS as ALL
from tetra_ros2.paper.runs import NodeRun
from tetra_ros2.paper.system import SystemUnderTest
from tetra_ros2.study import confidence

ERRATA_PAGE = Path(__file__).parents[2] / 'docs' / 'errata.md'
CLAIMS = {key: claim for key, claim in ALL.items() if key not in ERRATA}


class Rising(gain.Gain):
    """A gain that violates As:SF:f: it rises with the distance."""

    def __post_init__(self):
        """Do not look."""

    def f(self, theta, xp=np):
        return self.a * (1.2 - xp.cos(theta))

    def derivative(self, theta, xp=np):
        return self.a * xp.sin(theta)


def changed(graph, i, j, weight):
    """Return a graph with one weight changed."""
    weights = graph.weights.copy()
    weights[i - 1, j - 1] = weight
    return topology.Topology('custom', weights)


FEW = 0.05
"""Starts that do not form take as long as can be: some of them are enough to see it."""

WRONG_SIGN = SystemUnderTest(complete=topology.Topology('custom', -topology.complete().weights),
                             rotating=topology.Topology('custom', -topology.rotating().weights),
                             effort=FEW)
WRONG_WEIGHT = SystemUnderTest(complete=changed(topology.complete(), 1, 2, 0.4),
                               rotating=changed(topology.rotating(), 2, 3, 0.6), effort=FEW)
WRONG_GAIN = SystemUnderTest(gains=(Rising(), Rising(0.5)), effort=FEW)

BY_WRONG_SIGN = [
    'closed-loop', 'angles', 'lyapunov', 'omega-attracts', 'proof-spectrum',
    'commuting-split', 'centre-manifold', 'triangular', 'triangular-weighted', 'xi-split',
    'xi-spectrum', 'locally-exponential', 'coplanar-decouples', 'coplanar-form',
    'coplanar-unstable', 'almost-global', 'almost-global-f2', 'weighted-graph',
    'hurwitz-f1', 'hurwitz-f2', 'hurwitz-any', 'three-equations', 'rotating-forms']
BY_WRONG_WEIGHT = [
    'closed-loop', 'angles', 'lyapunov', 'omega-t-in-omega', 'proof-spectrum', 'commuting-split',
    'centre-is-omega-t', 'triangular', 'triangular-weighted',
    'omega-t-is-a-point', 'xi-split', 'xi-spectrum', 'coplanar-decouples', 'coplanar-form',
    'cross', 'almost-global', 'weighted-graph', 'omega-t-invariant', 'hurwitz-f1', 'hurwitz-f2',
    'three-equations', 'decomposition']
BY_WRONG_GAIN = [
    'assumption', 'assumption-any-a', 'locally-exponential', 'centre-manifold', 'hurwitz-f1',
    'hurwitz-f2', 'almost-global', 'almost-global-f2', 'rotating-forms', 'coplanar-form', 'cross']


def broken(system):
    """Return a system whose runs of the nodes are of a formation that does not form."""
    rng = np.random.default_rng(0)
    times = np.arange(2000) * 0.01
    wandering = sphere.normalize(np.cumsum(0.01 * rng.standard_normal((2000, 4, 3)), axis=0)
                                 + sphere.random(rng, (4,)))
    for graph in ('complete', 'rotating'):
        for chosen in system.gains:
            for seed in range(8):
                system._runs[graph, chosen, seed] = NodeRun(times, wandering, 0.01)
    return system


def scaled_points(rng, shape=()):
    return 1.1 * sphere.normalize(rng.standard_normal((*np.atleast_1d(shape).astype(int), 3)))


def off_cosine(x, true=np.cos):
    return true(x) - 0.1


# What breaks each check that does not look at the law: (object, attribute, replacement).
SABOTAGE = {
    'geodesic': (rotation, 'exp', lambda w, true=rotation.exp: true(-np.asarray(w))),
    'geodesic-ends': (rotation, 'exp', lambda w, true=rotation.exp: true(1.1 * np.asarray(w))),
    'ones-determinant': (np.linalg, 'det', lambda a, true=np.linalg.det: 1.01 * true(a)),
    'exchange-spectrum': (np, 'fliplr', lambda a: np.roll(a, 1, axis=0)),
    'kinematics': (sphere, 'hat', lambda x, true=sphere.hat: -true(x)),
    'cosine-formula': (sphere, 'random', scaled_points),
    'simultaneous': (np.linalg, 'eig', lambda a, true=np.linalg.eig: (
        true(a)[0], true(a)[1] + 0.01 * np.eye(len(a)))),
    'exchange-commutes': (np, 'fliplr', lambda a: np.roll(a, 1, axis=1)),
    'lambda-even': (preliminaries, 'lambda_matrix', lambda n: np.ones((n, n)) - np.eye(n)),
    'lambda-odd': (preliminaries, 'lambda_matrix', lambda n: np.ones((n, n)) - np.eye(n)),
    'theta-star': (coordinates, 'cosine_matrix', lambda c, true=coordinates.cosine_matrix: true(
        np.asarray(c)[..., :3])),
    'double-hat': (sphere, 'random', scaled_points),
    'intrinsic': (controller.Controller, 'receive', lambda *_: (0.0, 0.0, 0.0)),
    'rotational-invariance': (law, 'velocity', lambda gamma, weights, gain,
                              true=law.velocity: true(gamma, weights, gain)
                              + np.array([0.0, 0.0, 0.1])),
    'xi-round-trip': (coordinates, 'inverse', lambda xi, chirality: sphere.random(
        np.random.default_rng(0), (len(xi), 4))),
    'normalising': (coordinates, 'tilt', lambda phi, true=coordinates.tilt: true(-phi)),
    'local-diffeomorphism': (coordinates, 'absolute', lambda gamma: 0.0 * gamma[..., 0, :]),
    'gram-identity': (coordinates, 'gram_identity', lambda c: np.sum(np.square(c), axis=-1)),
    'eight-degrees': (stability, 'rotations', lambda gamma, bases: np.zeros((8, 3))),
    'inequality': (np, 'cos', off_cosine),
    'kkt-points': (np, 'cos', off_cosine),
    'polynomial-system': (coordinates, 'cosine_matrix', lambda c, true=coordinates.cosine_matrix:
                          true(0.5 * np.asarray(c))),
    'disjoint-equilibria': (equilibria, 'find_equilibria', lambda *_: ([], 300)),
    'rate-loop-at-rest': (rate_loop, 'eigenvalues_at_rest', lambda values, k: 1.1 * values),
    'rate-loop-spin': (rate_loop, 'rate_loop_equilibrium', lambda gamma, weights, gain, k,
                       true=rate_loop.rate_loop_equilibrium: true(gamma, weights, gain, 1.1 * k)),
    'rate-loop-limit': (rate_loop, 'min_bandwidth', lambda gamma, weights, gain,
                        true=rate_loop.min_bandwidth: 1.1 * true(gamma, weights, gain)),
    'decomposition': (equilibria, 'find_equilibria', lambda *_: ([], 300)),
    'solid-classes': (polyhedra, 'SOLIDS', {'cube': sphere.normalize(
        polyhedra.SOLIDS['cube'] * [1.0, 1.0, 1.1])}),
    'solid-others': (polyhedra, 'anisotropy', lambda points: np.zeros(3)),
    'solid-spin': (law, 'velocity', lambda gamma, weights, gain, true=law.velocity: 1.001 * true(
        gamma, weights, gain)),
    'solid-weights': (polyhedra, 'weights', lambda *a, true=polyhedra.weights: true(
        *a[:3], 1.001 * a[3])),
    'solid-paper': (polyhedra, 'spin_rate', lambda *a, true=polyhedra.spin_rate: 1.001 * true(*a)),
    'solid-mirror': (stability, 'mirrored', lambda gamma: gamma),
    'solid-stable': (polyhedra, 'CLASS_WEIGHTS', {
        name: -np.ones(len(polyhedra.CLASS_WEIGHTS[name])) for name in polyhedra.SOLIDS}),
    'solid-starts': (polyhedra, 'CLASS_WEIGHTS', {
        **polyhedra.CLASS_WEIGHTS, 'cube': (1.0, 0.0, 0.0)}),
    'ring-spin': (law, 'velocity', lambda gamma, weights, gain, true=law.velocity: 1.001 * true(
        gamma, weights, gain)),
    'ring-rate': (rings, 'slowest_rate', lambda n, gain, true=rings.slowest_rate: 1.001 * true(
        n, gain)),
}


def failures(keys, system):
    chosen = [CLAIMS[key] for key in keys]
    return [entry.key for entry, result, _ in verify.check(chosen, system)
            if not result.passed]


@pytest.mark.timeout(300)
def test_every_mathematical_claim_holds():
    rows = verify.check(verify.select(without_nodes=True), SystemUnderTest())
    assert [entry.key for entry, result, _ in rows if not result.passed] == []
    assert len(rows) > 60


@pytest.mark.timeout(300)
def test_every_claim_about_the_nodes_holds(capfd):
    nodes = [key for key, entry in CLAIMS.items() if entry.nodes]
    assert len(nodes) >= 11
    assert main(['verify', '--json', *nodes]) == 0
    rows = json.loads(capfd.readouterr().out)
    assert [row['claim'] for row in rows] == nodes
    assert all(row['passed'] for row in rows)


@pytest.mark.parametrize('system, keys', [
    (WRONG_SIGN, BY_WRONG_SIGN),
    (WRONG_WEIGHT, BY_WRONG_WEIGHT),
    (WRONG_GAIN, BY_WRONG_GAIN)], ids=['wrong sign', 'wrong weight', 'wrong gain'])
def test_a_wrong_law_fails_the_rows_that_it_should(system, keys):
    assert failures(keys, system) == keys


@pytest.mark.parametrize('system', [WRONG_SIGN, WRONG_WEIGHT, WRONG_GAIN],
                         ids=['wrong sign', 'wrong weight', 'wrong gain'])
def test_a_wrong_law_leaves_the_geometry_alone(system):
    keys = ['geodesic', 'cosine-formula', 'lambda-even', 'gram-identity', 'xi-round-trip',
            'rotational-invariance', 'normalising', 'inequality']
    assert failures(keys, system) == []


def test_a_wrong_sign_leaves_the_equilibria_where_they_are():
    assert failures(['omega-t-in-omega', 'omega-t-invariant', 'omega-t-is-a-point'],
                    WRONG_SIGN) == []


@pytest.mark.parametrize('key', SABOTAGE)
def test_a_check_without_the_law_can_fail_too(key, monkeypatch):
    place, name, replacement = SABOTAGE[key]
    monkeypatch.setattr(place, name, replacement)
    result = CLAIMS[key].check(SystemUnderTest())
    monkeypatch.undo()
    assert not result.passed


def test_a_change_of_any_printed_entry_of_h_is_seen(monkeypatch):
    rows = [row.split() for row in xi.PRINTED_H.strip().splitlines()]
    assert np.shape(rows) == (6, 6)
    for i, j in itertools.product(range(6), repeat=2):
        entry = rows[i][j]
        wrong = [list(row) for row in rows]
        wrong[i][j] = 'x1x2-x3' if entry != 'x1x2-x3' else 'x1x2-x4'
        text = '\n'.join(['', *map(' '.join, wrong), ''])
        monkeypatch.setattr(xi, 'PRINTED_H', text)
        assert not CLAIMS['triangular'].check(SystemUnderTest()).passed, (i, j)


@pytest.mark.parametrize('point', almost_global.KKT_POINTS)
def test_a_solution_that_the_paper_does_not_print_is_found(point, monkeypatch):
    others = {p: value for p, value in almost_global.KKT_POINTS.items() if p != point}
    monkeypatch.setattr(almost_global, 'KKT_POINTS', others)
    assert not CLAIMS['kkt-points'].check(SystemUnderTest(effort=FEW)).passed


def test_a_stable_coplanar_formation_would_be_found(monkeypatch):
    monkeypatch.setattr(almost_global, 'out_of_plane', lambda *_: -np.eye(4))
    assert not CLAIMS['coplanar-unstable'].check(SystemUnderTest()).passed


def test_checks_of_the_nodes_fail_for_a_run_that_does_not_form():
    nodes = [key for key, entry in CLAIMS.items() if entry.nodes]
    assert failures(nodes, broken(SystemUnderTest())) == nodes


def test_nodes_with_the_wrong_law_fail_in_real_runs():
    repelled = SystemUnderTest(complete=WRONG_SIGN.complete, gains=(gain.Cosine(),) * 2)
    keys = ['rate-complete-f1', 'figure-stationary']
    assert failures(keys, repelled) == keys


def test_every_claim_was_seen_to_fail():
    seen = {*BY_WRONG_SIGN, *BY_WRONG_WEIGHT, *BY_WRONG_GAIN, *SABOTAGE,
            *(key for key, entry in CLAIMS.items() if entry.nodes)}
    assert set(CLAIMS) - seen == set()


@pytest.mark.parametrize('key', ERRATA)
def test_a_printed_form_fails_where_the_corrected_one_holds(key):
    result = ERRATA[key].check(SystemUnderTest())
    assert result.passed, result


@pytest.mark.parametrize(('printed', 'corrected', 'passes'), [
    (1.0, 0.0, True), (0.0, 0.0, False), (2e-5, 0.0, False), (1.0, 2e-6, False),
    (math.nan, 0.0, False), (1.0, math.nan, False)])
def test_an_erratum_needs_a_wrong_form_and_a_right_one(printed, corrected, passes, monkeypatch):
    monkeypatch.setattr(registry, 'CLAIMS', {})
    monkeypatch.setattr(errata, 'CLAIMS', registry.CLAIMS)
    monkeypatch.setattr(errata, 'ERRATA', {})
    erratum('x', '', '', '')(lambda system: (printed, corrected))
    assert errata.ERRATA['x'].check(SystemUnderTest()).passed is passes


def test_every_erratum_is_in_the_document():
    page = ERRATA_PAGE.read_text(encoding='utf-8')
    for key, entry in ERRATA.items():
        printed = entry.how.removeprefix('printed: ')
        assert f'`{key}` | {entry.label} | `{printed}` | {entry.says} |' in page


def test_a_claim_that_does_not_exist_is_refused(capsys):
    assert main(['verify', 'perido']) == 2
    assert capsys.readouterr().err == (
        "tetra: error: there is no claim 'perido' (did you mean 'period'?); "
        'see tetra verify --list\n')


def test_a_failing_row_makes_exit_status_1(monkeypatch, capsys):
    monkeypatch.setattr(preliminaries, 'lambda_matrix', lambda n: np.zeros((n, n)))
    assert main(['verify', 'lambda-even']) == 1
    assert 'FAILS' in capsys.readouterr().out


@pytest.mark.parametrize(('formed', 'starts'), [(5, 10), (97, 100), (999, 1000), (0, 10)])
def test_the_confidence_bound_is_where_so_many_would_be_this_rare(formed, starts):
    bound = confidence.lower_bound(formed, starts)
    drawn = np.random.default_rng(0).binomial(starts, bound, 200000) if bound else np.zeros(1)
    if formed:
        assert np.mean(drawn >= formed) == pytest.approx(0.05, abs=0.002)
    assert bound <= formed / starts


def test_the_bound_for_all_is_the_root_of_the_doubt():
    assert confidence.lower_bound(1000000, 1000000) == pytest.approx(1.0 - 2.9957e-6, rel=1e-9)


def test_theta_star_is_the_tetrahedrons():
    assert np.cos(shapes.THETA_STAR) == pytest.approx(-1.0 / 3.0)


@pytest.mark.parametrize('arguments', [['--list'], ['geodesic', '--json'], ['geodesic']])
def test_whoever_stops_reading_gets_no_traceback(arguments):
    reader, writer = os.pipe()
    os.close(reader)
    with os.fdopen(writer, 'w') as nobody:
        ended = subprocess.run([sys.executable, '-m', 'tetra_ros2', 'verify', *arguments],
                               stdout=nobody, stderr=subprocess.PIPE, text=True, timeout=60)
    assert ended.stderr == ''
    assert ended.returncode != 0


def test_a_pipe_gets_paragraphs_of_eighty_columns(capsys):
    assert main(['verify', 'geodesic', 'erratum-period']) == 0
    lines = capsys.readouterr().out.splitlines()
    assert lines[0] == 'holds geodesic  (Section 2.1)'
    assert max(map(len, lines)) <= 80
    assert lines[-1].startswith('2 of 2 claims hold')


def test_a_wide_terminal_gets_a_table(monkeypatch, capsys):
    monkeypatch.setenv('FORCE_COLOR', '1')
    monkeypatch.setenv('COLUMNS', '160')
    assert main(['verify', 'geodesic']) == 0
    out = capsys.readouterr().out
    assert 'verdict' in out
    assert '┃' in out
