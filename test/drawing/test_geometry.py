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

"""The faces of a formation are those of its convex hull, in order and right side out."""

from hypothesis import given
from hypothesis import strategies as st
import numpy as np
import pytest
from tetra_ros2.drawing import geometry
from tetra_ros2.formation import shapes, sphere

PHI = (1.0 + np.sqrt(5.0)) / 2.0


def even(vectors):
    """Return the cyclic permutations of vectors with all signs, as unit vectors."""
    found = {tuple(np.round(np.roll(np.array(v) * signs, k), 12) + 0.0)
             for v in vectors for k in range(3)
             for signs in np.array(np.meshgrid([1, -1], [1, -1], [1, -1])).T.reshape(-1, 3)}
    return sphere.normalize(np.array(sorted(found)))


SOLIDS = {
    'tetrahedron': (shapes.TETRAHEDRON.points, 4, 3),
    'octahedron': (shapes.OCTAHEDRON.points, 8, 3),
    'cube': (even([(1, 1, 1)]), 6, 4),
    'icosahedron': (even([(0, 1, PHI)]), 20, 3),
    'dodecahedron': (even([(1, 1, 1), (0, 1 / PHI, PHI)]), 12, 5),
}


def volumes(points, faces):
    """Return six times the signed volume that each face spans with the centre."""
    return np.array([np.linalg.det(points[list(face[:3])]) for face in faces])


@pytest.mark.parametrize('name', SOLIDS)
@pytest.mark.parametrize('seed', range(3))
def test_a_platonic_solid_has_its_faces_however_it_is_turned(name, seed):
    points, count, corners = SOLIDS[name]
    rng = np.random.default_rng(seed)
    turned = points @ np.linalg.qr(rng.standard_normal((3, 3)))[0]
    faces = geometry.polygons(turned + 1e-5 * rng.standard_normal(turned.shape))
    assert [len(face) for face in faces] == [corners] * count
    assert np.all(volumes(turned, faces) > 0.1), 'counter-clockwise as seen from outside'
    assert len(geometry.sides(faces)) == count * corners // 2
    assert len(turned) - count * corners // 2 + count == 2, 'Euler'
    assert len(geometry.triangles(faces)) == count * (corners - 2)
    assert np.all(volumes(turned, geometry.triangles(faces)) > 0.1)
    side = np.linalg.norm(np.diff(turned[geometry.sides(faces)], axis=1), axis=-1)
    np.testing.assert_allclose(side, side[0, 0], atol=1e-9, err_msg='no diagonal is a side')


@given(st.integers(4, 40), st.integers(0, 10**6))
def test_all_points_lie_on_or_below_every_face(n, seed):
    points = sphere.normalize(np.random.default_rng(seed).standard_normal((n, 3)))
    faces = geometry.polygons(points)
    if not faces:
        pytest.skip('SciPy is wanted for so many') if n > geometry.FEW else pytest.fail('no faces')
    assert {i for face in faces for i in face} == set(range(n)), 'on a sphere all are corners'
    for face in faces:
        a, b, c = points[list(face[:3])]
        normal = np.cross(b - a, c - a)
        heights = (points - a) @ normal / np.linalg.norm(normal)
        assert np.all(heights < 30 * geometry.FLAT), 'the normal points outwards'


@pytest.mark.parametrize('n', [2, 3, 5, 30, 61])
def test_points_in_one_plane_have_one_face_and_too_few_or_too_many_none(n):
    angle = np.arange(n) * 2.0 * np.pi / n
    ring = np.stack([np.cos(angle), np.sin(angle), 0.0 * angle], axis=-1)
    faces = geometry.polygons(ring)
    if n in (2, 61):
        assert faces == ()
        assert geometry.faces(ring).shape == (0, 3)
        assert geometry.sides(faces).shape == (0, 2)
        return
    assert len(faces) == 1
    face, = faces
    assert face[0] == 0
    assert face in (tuple(range(n)), (0, *range(n - 1, 0, -1)))


def test_coinciding_points_are_no_error():
    assert geometry.polygons(np.tile([0.0, 0.0, 1.0], (4, 1))) == ()
    twice = np.concatenate([shapes.TETRAHEDRON.points, shapes.TETRAHEDRON.points[:1]])
    assert all(len(face) >= 3 for face in geometry.polygons(twice))


def test_a_guess_is_kept_as_long_as_it_is_right():
    points = SOLIDS['dodecahedron'][0]
    faces = geometry.polygons(points)
    turn = np.linalg.qr(np.random.default_rng(1).standard_normal((3, 3)))[0]
    turn *= np.linalg.det(turn)  # a rotation: the mirror image has its faces inside out
    assert geometry.polygons(points @ turn, faces) is faces
    other = geometry.polygons(-points, faces)
    assert other is not faces
    assert np.all(volumes(-points, other) > 0.0)
    assert geometry.polygons(points[:4], faces) is not faces
    dented = points.copy()
    dented[0] = sphere.normalize(dented[0] + 0.2 * dented[1])
    assert geometry.polygons(dented, faces) is not faces


def test_the_graticule_is_made_of_circles_on_the_sphere():
    lines = geometry.graticule(step=30.0, points=37)
    assert lines.shape == (5 + 6, 37, 3)
    np.testing.assert_allclose(np.linalg.norm(lines, axis=-1), 1.0, atol=1e-12)
    np.testing.assert_allclose(lines[:, 0], lines[:, -1], atol=1e-12, err_msg='they close')
    turn = np.linspace(0.0, 2.0 * np.pi, 37)
    np.testing.assert_allclose(lines[:5, :, 2], np.sin(np.radians([-60, -30, 0, 30, 60]))[:, None]
                               + 0.0 * turn, atol=1e-12)
    np.testing.assert_allclose(lines[5], np.stack(
        [np.cos(turn), 0.0 * turn, np.sin(turn)], axis=-1), atol=1e-12)


@given(st.integers(0, 10**6), st.integers(2, 9))
def test_an_arc_goes_the_shortest_way_at_an_even_pace(seed, count):
    start, end = sphere.normalize(np.random.default_rng(seed).standard_normal((2, 3)))
    arc = geometry.along_arc(start, end, count)
    np.testing.assert_allclose(arc[[0, -1]], [start, end], atol=1e-9)
    np.testing.assert_allclose(np.linalg.norm(arc, axis=-1), 1.0, atol=1e-9)
    steps = sphere.geodesic_distance(arc[:-1], arc[1:])
    np.testing.assert_allclose(
        steps, sphere.geodesic_distance(start, end) / (count - 1), atol=1e-6)
