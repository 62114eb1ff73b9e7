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

import math
import re

from hypothesis import given
from hypothesis import strategies as st
import numpy as np
import pytest
from strategies import any_gain, assert_close, formations, quaternions
from tetra_ros2.formation import law, measures, rings, rotation, shapes, sphere, targets
from tetra_ros2.formation import topology as topologies
from tetra_ros2.formation.gain import Cosine, Exponential, Gain
from tetra_ros2.formation.topology import Topology

ROUNDING = 1e-14
ROTATING = [(k, p) for k in (1, 2, 3, 4) for p in (0, 1)]
TETRAHEDRON = shapes.TETRAHEDRON.points
MIRROR_IMAGE = TETRAHEDRON @ np.diag([1.0, -1.0, 1.0])
FACTORS = st.floats(0.01, 5.0)


@pytest.mark.parametrize('shape, angles', [
    (shapes.ANTIPODAL, [math.pi]),
    (shapes.TRIANGLE, [2.0 * math.pi / 3.0] * 3),
    (shapes.TETRAHEDRON, [math.acos(-1.0 / 3.0)] * 6),
    (shapes.OCTAHEDRON, [math.pi / 2.0] * 12 + [math.pi] * 3),
])
def test_a_shape_is_on_the_sphere_and_has_its_angles_in_ascending_order(shape, angles):
    assert_close(np.linalg.norm(shape.points, axis=-1), 1.0, atol=ROUNDING)
    assert_close(np.sum(shape.points, axis=0), 0.0, atol=ROUNDING)
    assert_close(shape.angles, angles, atol=ROUNDING)


def test_theta_star_is_the_angle_of_the_tetrahedron():
    assert math.cos(shapes.THETA_STAR) == pytest.approx(-1.0 / 3.0, abs=ROUNDING)


@pytest.mark.parametrize('n, shape', [
    (2, shapes.ANTIPODAL), (3, shapes.TRIANGLE), (4, shapes.TETRAHEDRON), (5, None),
    (6, shapes.OCTAHEDRON), (7, None)])
def test_the_complete_graphs_have_their_known_shapes_whatever_their_common_weight(n, shape):
    topology = topologies.complete(n)
    assert shapes.known_shape(topology) is shape
    assert shapes.known_shape(Topology('custom', 0.3 * topology.weights)) is shape


@pytest.mark.parametrize('k, p', ROTATING)
def test_the_rotating_graphs_lead_to_the_tetrahedron(k, p):
    assert shapes.known_shape(topologies.rotating(k, p)) is shapes.TETRAHEDRON


@pytest.mark.parametrize('n', [2, 3, 4, 6])
def test_attraction_and_blindness_lead_to_no_known_shape(n):
    complete = topologies.complete(n).weights
    assert shapes.known_shape(Topology('custom', -complete)) is None
    assert shapes.known_shape(Topology('custom', 0.0 * complete)) is None


@pytest.mark.parametrize('n', [3, 6])
def test_unequal_weights_lead_to_no_known_shape_but_of_four(n):
    weights = topologies.complete(n).weights.copy()
    weights[0, 1] = 2.0
    assert shapes.known_shape(Topology('custom', weights)) is None


@st.composite
def balanced(draw):
    """Draw weights that are sums of the paper's graphs, in any proportion."""
    return sum(
        (draw(FACTORS) * topologies.rotating(k, p).weights for k, p in ROTATING),
        start=draw(FACTORS) * topologies.complete().weights)


def shape_velocity(weights):
    """Return d cos(theta_ij) / dt at the tetrahedron, for all pairs."""
    velocity = law.velocity(TETRAHEDRON, weights, Cosine())
    change = velocity @ TETRAHEDRON.T
    return (change + change.T)[np.triu_indices(4, k=1)]


@given(balanced())
def test_weights_under_which_the_tetrahedron_keeps_its_shape_are_known_to(weights):
    assert_close(shape_velocity(weights), 0.0, atol=1e-12 * np.max(weights))
    assert shapes.known_shape(Topology('custom', weights)) is shapes.TETRAHEDRON


@given(balanced(), st.permutations(range(4)).map(lambda order: order[:2]), FACTORS)
def test_weights_under_which_the_tetrahedron_changes_are_not_known(weights, edge, more):
    weights = weights.copy()
    weights[edge[0], edge[1]] += more
    assert np.max(np.abs(shape_velocity(weights))) > 1e-3
    assert shapes.known_shape(Topology('custom', weights)) is None


@given(balanced(), st.permutations(range(4)))
def test_whether_a_shape_is_known_does_not_depend_on_the_agents_names(weights, order):
    renamed = Topology('custom', weights[np.ix_(order, order)])
    assert shapes.known_shape(renamed) is shapes.TETRAHEDRON


@pytest.mark.parametrize('k, p', ROTATING)
@given(st.sampled_from([TETRAHEDRON, MIRROR_IMAGE]), quaternions(), any_gain())
def test_the_predicted_spin_is_that_of_the_papers_proposition(k, p, gamma, q, gain):
    topology = topologies.rotating(k, p)
    gamma = rotation.rotate(q, gamma)
    rate = math.sqrt(3.0) / 2.0 * gain.f(math.acos(-1.0 / 3.0))
    sense = shapes.predicted_sense(topology, measures.chirality(gamma))
    assert sense in (1, -1)
    assert_close(
        shapes.predicted_angular_velocity(gamma, topology, gain), sense * rate * gamma[k - 1],
        atol=1e-13 * gain.a)


@pytest.mark.parametrize('k, p', ROTATING)
@given(st.sampled_from([TETRAHEDRON, MIRROR_IMAGE]), quaternions(), any_gain())
def test_the_closed_loop_turns_the_tetrahedron_as_predicted(k, p, gamma, q, gain):
    topology = topologies.rotating(k, p)
    gamma = rotation.rotate(q, gamma)
    spin = shapes.predicted_angular_velocity(gamma, topology, gain)
    assert_close(
        law.velocity(gamma, topology.weights, gain), np.cross(spin, gamma), atol=1e-13 * gain.a)


def test_the_papers_own_normalised_tetrahedron_turns_clockwise():
    # Gamma_1 at the north pole, Gamma_2 in the plane XOZ, 2, 3, 4 counter-clockwise seen from
    # above: the paper finds d gamma / dt = -sqrt(3)/2 f(theta*).
    azimuth = 2.0 * math.pi / 3.0 * np.arange(3)
    r = 2.0 * math.sqrt(2.0) / 3.0
    gamma = np.vstack([
        [0.0, 0.0, 1.0],
        np.stack([r * np.cos(azimuth), r * np.sin(azimuth), np.full(3, -1.0 / 3.0)], axis=-1)])
    spin = shapes.predicted_angular_velocity(gamma, topologies.rotating(1, 1), Cosine(a=3.0))
    assert_close(spin, [0.0, 0.0, -math.sqrt(3.0) / 2.0 * 3.0 * 2.0 / 3.0], atol=ROUNDING)


@pytest.mark.parametrize('k, p', ROTATING)
def test_the_mirror_image_and_the_other_direction_turn_the_other_way(k, p):
    sense = shapes.predicted_sense(topologies.rotating(k, p), 1)
    assert shapes.predicted_sense(topologies.rotating(k, p), -1) == -sense
    assert shapes.predicted_sense(topologies.rotating(k, 1 - p), 1) == -sense


@given(quaternions(), any_gain())
def test_under_the_complete_graph_no_spin_is_predicted(q, gain):
    spin = shapes.predicted_angular_velocity(
        rotation.rotate(q, TETRAHEDRON), topologies.complete(), gain)
    assert_close(spin, 0.0, atol=1e-13 * gain.a)


@given(balanced(), quaternions(), any_gain())
def test_every_tetrahedron_of_a_weighted_graph_turns_as_predicted(weights, q, gain):
    gamma = rotation.rotate(q, TETRAHEDRON)
    spin = shapes.predicted_angular_velocity(gamma, Topology('custom', weights), gain)
    assert_close(
        law.velocity(gamma, weights, gain), np.cross(spin, gamma),
        atol=1e-13 * gain.a * np.max(weights))


@pytest.mark.parametrize('gamma', [TETRAHEDRON, MIRROR_IMAGE])
@given(formations(4), st.floats(-8.0, -2.0))
def test_near_the_tetrahedron_the_prediction_is_that_of_the_nearest(gamma, offsets, exponent):
    offset = 10.0**exponent
    near = sphere.normalize(gamma + offset * offsets)
    topology, gain = topologies.rotating(2, 1), Cosine()
    assert_close(
        shapes.predicted_angular_velocity(near, topology, gain),
        shapes.predicted_angular_velocity(gamma, topology, gain), atol=4.0 * offset)


@pytest.mark.parametrize(('gain', 'reserved'), [
    (Cosine(), True), (Exponential(), False), (Exponential(b=5.0), False)], ids=str)
def test_a_pair_approaches_the_antipodal_shape_slowly_only_where_the_gain_vanishes(
        gain, reserved):
    assert (shapes.reservation(topologies.complete(2), gain) is not None) is reserved


class HalfAngles(Gain):
    """The cosine gain in other words: what is 0 at pi there is of the size of rounding here."""

    def f(self, theta, xp=np):
        return 2.0 * self.a * xp.cos(0.5 * theta)**2


@pytest.mark.parametrize('graph', [topologies.complete(2), targets.ring(4), targets.ring(6)])
def test_a_gain_that_vanishes_at_pi_to_rounding_vanishes_there(graph):
    assert HalfAngles().f(math.pi) > 0.0
    said = shapes.reservation(graph, HalfAngles())
    assert said is not None
    assert said == shapes.reservation(graph, Cosine())


@pytest.mark.parametrize(('graph', 'gain', 'what'), [
    (topologies.complete(4), Cosine(), None), (topologies.complete(6), Exponential(), None),
    (topologies.complete(6), Cosine(), 'a continuum, of which the octahedron is but one'),
    (topologies.complete(5), Cosine(), None), (targets.ring(5), Cosine(), None),
    (targets.ring(6), Exponential(), None),
    (targets.ring(6), Cosine(), r'ring of 6 approaches the pair of antipodal clusters of 3 only'),
    (targets.polyhedron('cube'), Exponential(), None),
    (targets.polyhedron('cube', [1.0, 0.0, 0.0]), Exponential(),
     'cube will not come out under this gain: it is not stable'),
    (targets.given(topologies.complete(4), targets.directions(
        [1, 0, 0, 0, 1, 0, 0, 0, 1, -1, -1, -1])), Exponential(),
     'formation of 4 given directions is no formation of these weights .* changes its shape at')],
    ids=str)
def test_a_gain_that_is_a_bad_choice_for_a_shape_is_warned_of(graph, gain, what):
    said = shapes.reservation(graph, gain)
    if what is None:
        assert said is None
    else:
        assert re.search(what, said)


def test_beyond_sixty_agents_nobody_computes_eigenvalues_to_warn():
    for n, warned in ((60, True), (61, False)):
        points = sphere.random(np.random.default_rng(0), (n,))
        graph = targets.given(topologies.complete(n), points)
        assert (shapes.reservation(graph, Exponential()) is not None) is warned


@pytest.mark.parametrize('seed', range(4))
def test_chirality_tells_the_shape_from_its_mirror_image_where_they_differ(seed):
    q = rotation.random(np.random.default_rng(seed), (1,))

    def handed(points, graph, order=slice(None)):
        return tuple(shapes.chirality(rotation.rotate(q, sign * points)[order], graph)
                     for sign in (1.0, -1.0))

    assert handed(TETRAHEDRON, topologies.rotating()) == (-1, 1)
    assert handed(TETRAHEDRON, topologies.rotating(), [1, 0, 2, 3]) == (1, -1)
    spinning = targets.polyhedron('octahedron', spin=0.5)
    assert handed(spinning.shape.points, spinning) in ((1, -1), (0, 0))
    points = targets.directions([1, 0, 0, 0, 1, 0, 0, 0, 1, -1, -1, 0.5, 0.2, -1, -1])
    uneven = np.arange(25.0).reshape(5, 5) * (1.0 - np.eye(5))
    graph = targets.given(Topology('custom', uneven), points)
    assert handed(points, graph) == (1, -1)
    assert handed(shapes.OCTAHEDRON.points, topologies.complete(6)) == (0, 0), 'may be exchanged'
    assert handed(rings.points(5), targets.ring(5)) == (0, 0), 'it is flat'
    assert handed(rings.points(5), topologies.complete(5)) == (0, 0), 'no shape is known'


@pytest.mark.parametrize('name', ['octahedron', 'cube', 'icosahedron'])
@given(quaternions(), st.sampled_from(['vertex', 'edge', 'face']), st.sampled_from([1.0, -1.0]))
def test_the_axis_turns_with_the_formation_and_is_mirrored_with_it(name, q, axis, sign):
    graph = targets.polyhedron(name, axis=axis, spin=0.5)
    assert_close(shapes.axis_direction(rotation.rotate(q, sign * graph.shape.points), graph),
                 sign * rotation.rotate(q, graph.axis), atol=1e-12)


@given(quaternions(), st.sampled_from([3, 5, 7]))
def test_the_axis_of_a_ring_is_the_normal_of_its_plane(q, n):
    graph = targets.ring(n, 0.5)
    found = shapes.axis_direction(rotation.rotate(q, rings.points(n)), graph)
    turning = law.velocity(rings.points(n), graph.weights, Exponential())
    spin = measures.angular_velocity(rings.points(n), turning)
    assert abs(found @ rotation.rotate(q, spin)) == pytest.approx(np.linalg.norm(spin))


def test_without_an_axis_there_is_no_direction_and_no_sense():
    assert shapes.axis_direction(TETRAHEDRON, topologies.complete()) is None
    assert shapes.axis_direction(np.tile([1.0, 0.0, 0.0], (5, 1)), targets.ring(5, 0.5)) is None
    with pytest.raises(ValueError, match='no agent on an axis'):
        shapes.predicted_sense(topologies.complete(), 1)
