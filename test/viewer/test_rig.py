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

"""What hangs on the tips of the axes is where it should be, whatever the tips do."""

from collections import Counter

import numpy as np
import pytest
from tetra_ros2.drawing import geometry
from tetra_ros2.formation import shapes, sphere
from tetra_ros2.viewer.rig import CENTER, Rig, TIPS

RNG = np.random.default_rng(5)


def skinned(mesh, bones):
    """Return vertices as a browser puts them, when the bones are elsewhere."""
    moved = bones - mesh['bone_positions']
    return mesh['vertices'] + mesh['skin_weights'] @ moved


def directions(n):
    return sphere.normalize(RNG.standard_normal((n, 3)))


def test_a_rod_goes_from_tip_to_tip_and_is_as_thick_as_it_should_be():
    rig = Rig()
    rig.add_rod(0, 2, ((0.25, 0.02), (1.0, 0.02)), fine=True)
    mesh = rig.mesh(directions(3))
    now = directions(3)
    points = skinned(mesh, rig.positions(now))
    start, end = 0.75 * now[0] + 0.25 * now[2], now[2]
    way = (end - start) / np.linalg.norm(end - start)
    along = (points - start) @ way
    away = np.linalg.norm(points - start - along[:, None] * way, axis=1)
    assert np.min(along) == pytest.approx(0.0, abs=0.021)
    assert np.max(along) == pytest.approx(np.linalg.norm(end - start), abs=0.021)
    assert np.max(away) == pytest.approx(0.02, abs=0.001)


def test_an_axis_begins_in_the_middle():
    rig = Rig()
    rig.add_rod(CENTER, 1, ((0.0, 0.0), (1.0, 0.0)))
    mesh = rig.mesh(directions(2))
    now = directions(2)
    points = skinned(mesh, rig.positions(now))
    assert {tuple(p) for p in np.round(points, 9) + 0.0} == {
        (0.0, 0.0, 0.0), tuple(np.round(now[1], 9) + 0.0)}


def test_faces_have_their_corners_at_the_tips():
    points = shapes.OCTAHEDRON.points
    rig = Rig()
    for face in geometry.polygons(points):
        rig.add_face(face)
    mesh = rig.mesh(points)
    now = directions(6)
    corners = skinned(mesh, rig.positions(now))[mesh['faces']]
    assert len(corners) == 8
    for i in range(6):
        at = np.all(np.isclose(corners, now[i]), axis=-1)
        assert np.sum(at) == 4, 'four faces meet in each corner'


@pytest.mark.parametrize('kind', range(len(TIPS)))
def test_a_tip_is_closed_and_about_its_agent(kind):
    rig = Rig()
    rig.add_tip(0, 0.1, kind)
    mesh = rig.mesh(directions(1))
    now = directions(1)
    points = skinned(mesh, rig.positions(now))
    np.testing.assert_allclose(points.mean(axis=0), now[0], atol=1e-9)
    assert 0.05 < np.max(np.linalg.norm(points - now, axis=1)) < 0.2
    edges = Counter((min(a, b), max(a, b)) for face in mesh['faces'].tolist()
                    for a, b in zip(face, face[1:] + face[:1], strict=True))
    assert set(edges.values()) == {2}
    outward = np.cross(*np.diff(points[mesh['faces']], axis=1).transpose(1, 0, 2))
    arms = points[mesh['faces']].mean(axis=1) - now
    assert len(set(np.sign(np.sum(outward * arms, axis=1)))) == 1, 'all turn the same way'


def test_every_point_is_held_by_whole_weights_of_four_bones_at_most():
    rig = Rig()
    rig.add_rod(CENTER, 0, ((0.0, 0.01), (1.0, 0.01)), fine=True)
    rig.add_rod(0, 3, ((0.1, 0.01), (0.9, 0.01), (0.9, 0.03), (0.95, 0.0)))
    rig.add_tip(3, 0.1, 1)
    mesh = rig.mesh(directions(4))
    assert rig.agents == [CENTER, 0, 3]
    np.testing.assert_allclose(mesh['skin_weights'].sum(axis=1), 1.0)
    assert np.all(np.sum(mesh['skin_weights'] > 0.0, axis=1) <= 4)
    assert np.min(mesh['faces']) == 0
    assert np.max(mesh['faces']) == len(mesh['vertices']) - 1
