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

import itertools
import math

import numpy as np
import pytest
from tetra_ros2.formation import law, polyhedra, sphere, stability, targets, topology
from tetra_ros2.formation.gain import Cosine, Exponential, Rational

pytest.importorskip('scipy')
design = pytest.importorskip('tetra_ros2.formation.design')

SPIN = np.array([0.1, 0.05, 0.2])


def layers(n, height, turned):
    azimuth = 2.0 * math.pi * np.arange(n) / n
    lower = azimuth + (math.pi / n if turned else 0.0)
    return sphere.normalize(np.concatenate([
        np.stack([np.cos(azimuth), np.sin(azimuth), np.full(n, height)], axis=-1),
        np.stack([np.cos(lower), np.sin(lower), np.full(n, -height)], axis=-1)]))


POINTS = {
    'triangular prism': layers(3, 0.6, False),
    'square antiprism': layers(4, 0.6, True),
    'four of my own': sphere.normalize(np.array(
        [[1.0, 1.0, 1.2], [-1.0, 1.0, -0.8], [1.0, -1.0, -1.0], [-1.0, -1.3, 1.0]])),
    'bipyramid': np.array([[0.0, 0.0, 1.0], [0.0, 0.0, -1.0], [1.0, 0.0, 0.0],
                           [-0.5, math.sqrt(0.75), 0.0], [-0.5, -math.sqrt(0.75), 0.0]]),
}


@pytest.mark.parametrize('name', POINTS)
@pytest.mark.parametrize('spin', [None, SPIN], ids=['at rest', 'spinning'])
def test_a_design_keeps_its_points_turning_as_asked_and_attracts(name, spin):
    points, gain = POINTS[name], Exponential()
    made = design.design(points, gain, spin=spin)
    assert np.min(made.weights) >= 0.0
    asked = np.zeros(3) if spin is None else spin
    np.testing.assert_allclose(
        law.velocity(points, made.weights, gain), np.cross(asked, points), atol=1e-9)
    assert made.slowest > 0.2 * made.fastest
    outcome = design.try_starts(made, 30)
    assert outcome.formed == 30, outcome
    assert (outcome.starts, outcome.others, outcome.unsettled) == (30, (), 0)


def test_the_papers_rotating_tetrahedron_is_found():
    points = polyhedra.SOLIDS['tetrahedron']
    spin = points[0] / math.sqrt(3.0)
    made = design.design(points, Cosine(), spin=spin)
    np.testing.assert_allclose(made.equilibrium.spin, spin, atol=1e-9)
    assert made.slowest > 0.5 * made.fastest
    # Those of the paper satisfy the equations too.
    a, b = design.constraints(points, Cosine(), spin)
    np.testing.assert_allclose(
        np.einsum('ipj,ij->ip', a, topology.rotating(1, 1).weights), b, atol=1e-12)


def test_few_neighbours_are_enough_where_few_are_asked_for():
    points = polyhedra.SOLIDS['octahedron']
    most = design.design(points, Exponential())
    made = design.design(points, Exponential(), max_degree=3)
    assert made.degree <= 3 < most.degree
    assert made.slowest > 0.0


def test_agents_that_are_too_far_are_not_looked_at():
    points = POINTS['square antiprism']
    made = design.design(points, Exponential(), visible=2.5)
    angles = sphere.geodesic_distance(points[:, None], points[None])
    assert np.all(made.weights[angles > 2.5] == 0.0)
    assert np.any(made.weights[angles > 2.0] > 0.0)


def has_solution(a, b, spins):
    """
    Return whether ``a w = b``, ``w >= 0`` has a solution that is not zero, by its vertices.

    If there is one, there is one with two weights (or three, of sum one, where b = 0) that are not
    zero: those are all tried.
    """
    rows = a if spins else np.vstack([a, np.ones(a.shape[1])])
    right = b if spins else np.array([0.0, 0.0, 1.0])
    for columns in itertools.combinations(range(a.shape[1]), len(rows)):
        basis = rows[:, columns]
        w = np.linalg.lstsq(basis, right, rcond=1e-12)[0]
        if np.min(w) > -1e-12 and np.max(np.abs(basis @ w - right)) < 1e-10:
            return True
    return False


@pytest.mark.parametrize('seed', range(12))
@pytest.mark.parametrize('spin', [None, 0.3 * SPIN], ids=['at rest', 'spinning'])
def test_a_refusal_is_right_as_all_vertices_of_the_program_say(seed, spin):
    points = sphere.random(np.random.default_rng(seed), (5,))
    gain, asked = Exponential(), np.zeros(3) if spin is None else spin
    seen = design.check_points(points)
    a, b = design.constraints(points, gain, asked)
    for i in range(5):
        blocked = design.blocking_direction(points, gain, asked, seen, i)
        exists = has_solution(a[i][:, seen[i]], b[i], spin is not None)
        assert (blocked is None) == exists
        if blocked is not None:
            assert abs(blocked @ points[i]) < 1e-9
            assert np.min((points @ blocked)[seen[i]]) > -1e-9


def test_points_on_one_side_are_refused_with_the_agent_and_the_direction():
    points = sphere.normalize(np.array(
        [[1.0, 0.0, 1.0], [0.0, 1.0, 1.0], [-1.0, -1.0, 1.0], [0.1, 0.1, 1.0]]))
    with pytest.raises(design.DesignError, match='no weights hold agent 1: all that it sees'):
        design.design(points, Exponential())


def test_a_gain_that_cannot_is_refused_with_what_was_tried():
    with pytest.raises(design.DesignError, match='no stable choice of weights was found'):
        design.design(polyhedra.SOLIDS['octahedron'], Cosine())


@pytest.mark.parametrize(('points', 'reason'), [
    ([[0.0, 0.0, 1.0], [0.0, 0.0, 1.0], [1.0, 0.0, 0.0]], 'points 1 and 2 coincide'),
    ([[0.0, 0.0, 1.0], [0.0, 0.0, -1.0]], 'agent 1 is antipodal to all that it sees'),
    ([[0.0, 0.0, 1.0]], '1 points are not valid')])
def test_points_that_cannot_be_are_refused(points, reason):
    with pytest.raises(design.DesignError, match=reason):
        design.check_points(np.array(points))


@pytest.mark.parametrize('a', [1e-4, 1.0, 1e4])
def test_another_shape_that_attracts_is_found_and_counted(a):
    # The weights lead to an octahedron, and something else was asked for.
    octahedron, gain = polyhedra.SOLIDS['octahedron'], Exponential(a)
    weights = polyhedra.weights(octahedron, np.array([1.0, 6.0]), octahedron[0])
    there = stability.transverse(octahedron, weights, gain)
    prism = POINTS['triangular prism']
    outcome = design.try_starts(design.Design(prism, weights, gain, there), 20, longest=30.0)
    assert outcome.formed == 0
    (found, count), = outcome.others
    assert count == 20 - outcome.unsettled > 10
    assert targets.name(found) == 'regular octahedron'


def program(points, gain, spin=None):
    """Return the linear programs for points, and that all edges are allowed."""
    made = design._Program(points, gain, np.zeros(3) if spin is None else spin,
                           design.check_points(points))
    return made, np.ones(len(made.edges), dtype=bool)


@pytest.mark.parametrize(('name', 'gain'), [
    ('tetrahedron', Cosine()), ('tetrahedron', Exponential()), ('octahedron', Exponential()),
    ('octahedron', Rational(0.7, 1.3))], ids=str)
def test_the_first_choice_is_as_good_as_the_best_symmetric_one(name, gain):
    # The least eigenvalue is concave, so that some best weights have the solid's symmetry.
    points = polyhedra.SOLIDS[name]
    most = 0.0
    for ratio in np.geomspace(0.1, 20.0, 100) if name == 'octahedron' else [1.0]:
        weights = polyhedra.weights(points, np.array([1.0, ratio]), points[0]) \
            if name == 'octahedron' else topology.complete(4).weights
        rates = -stability.transverse(points, weights, gain).eigenvalues.real
        most = max(most, np.min(rates) / np.max(rates))
    made, allowed = program(points, gain)
    w, _, decay = made.choose(allowed)
    assert 0.97 * most < decay < most * 1.001
    assert made.ratio(w, 1.0) > 0.98 * decay


@pytest.mark.parametrize('name', POINTS)
def test_the_more_decay_is_given_up_the_more_spin_there_is_up_to_the_most(name):
    made, allowed = program(POINTS[name], Exponential(), SPIN)
    decay = made.choose(allowed)[2]
    shares = []
    for part in (0.9, 0.3):
        w, share, left = made.choose(allowed, part * decay)
        assert np.min(w) >= 0.0
        np.testing.assert_allclose(made.equations @ w, share * made.motion, atol=1e-8)
        assert left > 0.95 * part * decay - 1e-3
        symmetric = np.linalg.eigvalsh(np.einsum('e,eab->ab', w, made.symmetric))
        assert symmetric[-1] < 1.03
        shares.append(share)
    assert 0.0 < shares[0] < shares[1]


@pytest.mark.parametrize('name', POINTS)
@pytest.mark.parametrize('spin', [None, SPIN], ids=['at rest', 'spinning'])
def test_no_other_weights_nearby_are_better_than_those_that_were_improved(name, spin):
    made, allowed = program(POINTS[name], Exponential(), spin)
    w, share, _ = made.choose(allowed, *([] if spin is None else [0.2]))
    improved = made.improve(w, share, allowed)
    reached = made.ratio(improved, share)
    assert reached >= made.ratio(w, share)
    assert np.min(improved) >= 0.0
    np.testing.assert_allclose(made.equations @ improved, share * made.motion, atol=1e-8)
    free = np.linalg.svd(made.equations)[2][np.linalg.matrix_rank(made.equations):]
    rng = np.random.default_rng(0)
    tried = 0
    for size in 10.0**rng.uniform(-4.0, -1.0, 100) * np.max(improved):
        other = np.maximum(improved + size * rng.standard_normal(len(free)) @ free, 0.0)
        if np.max(np.abs(made.equations @ other - share * made.motion)) < 1e-9:
            tried += 1
            assert made.ratio(other, share) < (1.01 if spin is None else 1.06) * reached
    assert tried or np.min(improved) == 0.0


@pytest.mark.parametrize('a', [1e-4, 1e4])
def test_a_design_at_rest_does_not_depend_on_the_unit_of_time(a):
    slow, fast = (design.design(POINTS['four of my own'], Exponential(unit)) for unit in (1.0, a))
    assert np.max(fast.weights) == np.max(slow.weights) == 1.0
    assert fast.slowest == pytest.approx(a * slow.slowest, rel=1e-3)
    assert fast.fastest == pytest.approx(a * slow.fastest, rel=1e-3)


def test_a_design_tells_its_rates_and_of_how_many_neighbours_it_is():
    made = design.design(POINTS['bipyramid'], Exponential())
    values = made.equilibrium.eigenvalues
    assert made.slowest == pytest.approx(-np.max(values.real))
    assert made.fastest == pytest.approx(np.max(np.abs(values)))
    assert made.degree == max(np.count_nonzero(row) for row in made.weights)
    assert made.equilibrium.residual < 1e-9


def test_fewer_neighbours_than_hold_an_agent_are_refused_with_the_agent():
    with pytest.raises(design.DesignError, match=r'sees no more than 1 others; with \d there is'):
        design.design(POINTS['four of my own'], Exponential(), max_degree=1)


def test_points_as_close_or_as_many_as_allowed_are_taken_and_no_others():
    def pair(angle):
        return np.array([[0.0, 0.0, 1.0], [math.sin(angle), 0.0, math.cos(angle)],
                         [0.0, 1.0, 0.0]])

    assert np.array_equal(design.check_points(pair(1.1e-4)), ~np.eye(3, dtype=bool))
    with pytest.raises(design.DesignError, match='points 1 and 2 coincide'):
        design.check_points(pair(0.9e-4))
    many = sphere.random(np.random.default_rng(0), (41,))
    assert design.check_points(many[:40]).shape == (40, 40)
    with pytest.raises(design.DesignError, match='41 points are not valid, expected 2 to 40'):
        design.check_points(many)
    with pytest.raises(design.DesignError, match='agent 3 sees nobody within 1 rad'):
        design.check_points(pair(0.5), 1.0)
    seen = design.check_points(pair(0.5), 0.5 * math.pi)
    assert np.array_equal(seen, ~np.eye(3, dtype=bool)), 'as far as it sees counts'
