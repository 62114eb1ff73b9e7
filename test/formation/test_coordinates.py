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

"""The coordinates of the paper: what defines them, and where they are singular."""

from hypothesis import given
from hypothesis import strategies as st
import numpy as np
import pytest
from strategies import any_gain, assert_close
from tetra_ros2.formation import coordinates, law, measures, rotation, shapes, sphere, topology
from tetra_ros2.formation.gain import Cosine, Exponential

RNG = np.random.default_rng(3)
FORMATIONS = sphere.random(RNG, (500, 4))
GRAPHS = (topology.complete(4), topology.rotating(3, 0))


def test_angles_and_points_are_inverse_to_each_other():
    points = FORMATIONS.reshape(-1, 3)
    assert np.allclose(coordinates.from_angles(*coordinates.angles(points)), points, atol=1e-15)


@pytest.mark.parametrize('pole', [1.0, -1.0])
def test_longitude_is_zero_at_both_poles(pole):
    phi, psi = coordinates.angles(np.array([0.0, 0.0, pole]))
    assert psi == 0.0
    assert phi == pytest.approx(pole * np.pi / 2.0)


def test_the_point_that_the_paper_calls_singular_is_not():
    tiny = 1e-6
    _, psi = coordinates.angles(sphere.normalize(np.array([1.0, tiny, 0.0])))
    assert psi == pytest.approx(tiny)


def test_xi_and_the_chirality_give_the_formation_back():
    back = coordinates.inverse(
        coordinates.transform(FORMATIONS), measures.chirality(FORMATIONS))
    assert np.max(np.abs(back - FORMATIONS)) < 1e-9


def mirror_image(formation):
    """Return the mirror image in the plane of the first two."""
    normal = sphere.normalize(np.cross(formation[..., 0, :], formation[..., 1, :]))
    return formation - 2.0 * np.sum(
        formation * normal[..., None, :], axis=-1, keepdims=True) * normal[..., None, :]


def test_xi_does_not_tell_a_formation_from_its_mirror_image():
    xi = coordinates.transform(FORMATIONS)
    image = coordinates.inverse(xi, -measures.chirality(FORMATIONS))
    assert np.allclose(coordinates.transform(image), xi, atol=1e-7)
    assert np.allclose(image, mirror_image(FORMATIONS), atol=1e-7)
    assert np.max(np.abs(image - FORMATIONS)) > 0.1


def circle(latitude, count=200):
    """Return formations on circles of one latitude about random axes, ``(count, 4, 3)``."""
    rng = np.random.default_rng(11)
    flat = coordinates.from_angles(latitude, rng.uniform(-np.pi, np.pi, (count, 4)))
    return rotation.rotate(rotation.random(rng, (count,))[:, None], flat)


@pytest.mark.parametrize('chirality', [-1, 0, 1])
def test_on_a_great_circle_every_chirality_gives_the_formation_back(chirality):
    formations = circle(0.0)
    back = coordinates.inverse(coordinates.transform(formations), np.full(200, chirality))
    assert np.max(np.abs(back - formations)) < 1e-6


@pytest.mark.parametrize('chirality', [-1, 0, 1])
def test_on_a_small_circle_no_chirality_tells_a_formation_from_its_mirror_image(chirality):
    formations = circle(0.7)
    assert np.allclose(coordinates.transform(mirror_image(formations))[:, :6],
                       coordinates.transform(formations)[:, :6])
    for formation in formations:
        with pytest.raises(ValueError, match='mirror image'):
            coordinates.inverse(coordinates.transform(formation), chirality)


def test_a_chirality_of_zero_is_refused_where_it_decides():
    with pytest.raises(ValueError, match='mirror image'):
        coordinates.inverse(coordinates.transform(FORMATIONS[0]), 0)


def test_two_agents_in_one_place_are_on_a_small_circle_with_the_others():
    formation = FORMATIONS[0].copy()
    formation[1] = formation[0]
    with pytest.raises(ValueError, match='mirror image'):
        coordinates.inverse(coordinates.transform(formation), 1)


@pytest.mark.parametrize('off', [1e-3, 1e-5, 1e-8])
def test_near_a_small_circle_the_chirality_still_decides(off):
    formations = circle(0.7)
    formations[:, 3] = sphere.normalize(formations[:, 3] + off * FORMATIONS[:200, 0])
    back = coordinates.inverse(
        coordinates.transform(formations), measures.chirality(formations))
    assert np.max(np.abs(back - formations)) < 1e-6


@pytest.mark.parametrize('case', ['first at a pole', 'second at a pole', 'opposite'])
def test_singular_formations_come_back_too(case):
    formation = FORMATIONS[0].copy()
    if case == 'first at a pole':
        formation[0] = coordinates.NORTH
    elif case == 'second at a pole':
        formation[1] = -coordinates.NORTH
    else:
        formation[1] = -formation[0]
        # The angle gamma is 0 by definition: only a formation that lies so comes back as it was.
        formation = coordinates.inverse(
            coordinates.transform(formation), measures.chirality(formation))
    back = coordinates.inverse(coordinates.transform(formation), measures.chirality(formation))
    assert np.max(np.abs(back - formation)) < 1e-7


def test_cosines_of_no_formation_are_refused():
    with pytest.raises(ValueError, match='no four points'):
        coordinates.inverse(np.array([-0.9] * 6 + [0.0] * 3), 1)


def test_a_normalised_formation_has_the_first_agent_at_the_north_pole():
    shape = coordinates.normalized(FORMATIONS)
    assert np.allclose(shape[:, 0], coordinates.NORTH, atol=1e-14)
    assert np.allclose(shape[:, 1, 1], 0.0, atol=1e-14)
    assert np.all(shape[:, 1, 0] >= 0.0)
    assert np.allclose(measures.pairwise_cosines(shape), measures.pairwise_cosines(FORMATIONS))


def test_the_normalised_tetrahedron_is_the_reference_shape():
    assert np.allclose(coordinates.normalized(shapes.TETRAHEDRON.points),
                       shapes.TETRAHEDRON.points, atol=1e-15)


@pytest.mark.parametrize('graph', GRAPHS, ids=lambda graph: graph.kind)
@pytest.mark.parametrize('gain', [Cosine(1.3), Exponential(0.7, 1.1)])
def test_the_cosines_obey_an_equation_of_their_own(graph, gain):
    velocity = law.velocity(FORMATIONS, graph.weights, gain)
    i, j = np.triu_indices(4, k=1)
    chain_rule = np.sum(velocity[:, i] * FORMATIONS[:, j] + FORMATIONS[:, i] * velocity[:, j], -1)
    cosines = measures.pairwise_cosines(FORMATIONS)
    assert np.allclose(
        coordinates.cosine_velocity(cosines, graph.weights, gain), chain_rule, atol=1e-13)
    if graph.kind == 'complete':
        h = coordinates.h(cosines)
        assert np.allclose(np.einsum('kij,kj->ki', h, gain.of_cosine(cosines)), chain_rule,
                           atol=1e-13)


def test_so_do_those_of_six_agents():
    graph, gain = topology.complete(6), Exponential(2.0)
    formations = sphere.random(RNG, (50, 6))
    ahead = formations + 1e-7 * law.velocity(formations, graph.weights, gain)
    behind = formations - 1e-7 * law.velocity(formations, graph.weights, gain)
    rate = (measures.pairwise_cosines(ahead) - measures.pairwise_cosines(behind)) / 2e-7
    cosines = measures.pairwise_cosines(formations)
    assert np.allclose(
        coordinates.cosine_velocity(cosines, graph.weights, gain), rate, atol=1e-6)


@pytest.mark.parametrize('graph', GRAPHS, ids=lambda graph: graph.kind)
def test_their_jacobian_is_the_derivative_of_that_equation(graph):
    cosines = measures.pairwise_cosines(FORMATIONS[7])
    step = 1e-6 * np.eye(6)
    numeric = (coordinates.cosine_velocity(cosines + step, graph.weights, Exponential())
               - coordinates.cosine_velocity(cosines - step, graph.weights, Exponential())) / 2e-6
    exact = coordinates.cosine_jacobian(cosines, graph.weights, Exponential())
    assert np.allclose(exact, numeric.T, atol=1e-8)


def test_six_cosines_of_a_formation_satisfy_the_identity():
    cosines = measures.pairwise_cosines(FORMATIONS)
    assert np.allclose(coordinates.gram_identity(cosines), 1.0, atol=1e-13)
    assert abs(coordinates.gram_identity(cosines[0] + 0.1) - 1.0) > 1e-3


@pytest.mark.parametrize('sign', [1.0, -1.0])
def test_the_angle_gamma_is_zero_where_the_second_agent_is_on_the_line_of_the_first(sign):
    formation = FORMATIONS[0].copy()
    formation[1] = sign * formation[0]
    assert coordinates.absolute(formation)[2] == 0.0


def test_four_directions_at_right_angles_need_a_fourth_dimension():
    with pytest.raises(ValueError, match='no four points'):
        coordinates.inverse(np.zeros(9), 1)


def test_a_small_circle_is_told_from_a_great_one_by_a_millionth():
    formations = circle(3e-6, 20)
    for formation in formations:
        with pytest.raises(ValueError, match='mirror image'):
            coordinates.inverse(coordinates.transform(formation), 0)


@given(st.lists(st.floats(-1.3, 1.3), min_size=4, max_size=4),
       st.lists(st.floats(-3.0, 3.0), min_size=4, max_size=4), any_gain(),
       st.sampled_from([graph.weights for graph in GRAPHS]))
def test_in_roll_pitch_yaw_angles_the_closed_loop_is_the_same(phi, psi, gain, weights):
    phi, psi = np.array(phi), np.array(psi)
    phi_rate, psi_rate = coordinates.angle_velocity(phi, psi, weights, gain)
    north = np.stack([-np.sin(phi) * np.cos(psi), -np.sin(phi) * np.sin(psi), np.cos(phi)], -1)
    east = np.stack([-np.sin(psi), np.cos(psi), np.zeros(4)], -1)
    expected = law.velocity(coordinates.from_angles(phi, psi), weights, gain)
    assert_close(phi_rate[:, None] * north + (psi_rate * np.cos(phi))[:, None] * east, expected,
                 atol=1e-12 * gain.f(0.0))
