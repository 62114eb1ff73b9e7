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
Bodies whose parts hang on the tips of the axes, and so move with them in one and the same picture.

A browser applies poses, among them those of bones, in the picture in which they arrive, and
vertices in the next one. Whatever is drawn of an agent therefore consists of fixed offsets from
points that divide the way between two tips: bones carry them, and nothing lags behind.
"""

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

CENTER = -1
"""Instead of the number of an agent, the middle of the sphere."""

_PHI = 0.5 * (1.0 + 5.0 ** 0.5)
_CORNERS = np.array([
    [-1, _PHI, 0], [1, _PHI, 0], [-1, -_PHI, 0], [1, -_PHI, 0], [0, -1, _PHI], [0, 1, _PHI],
    [0, -1, -_PHI], [0, 1, -_PHI], [_PHI, 0, -1], [_PHI, 0, 1], [-_PHI, 0, -1], [-_PHI, 0, 1],
]) / np.hypot(1.0, _PHI)
_FACES = np.array([
    [0, 11, 5], [0, 5, 1], [0, 1, 7], [0, 7, 10], [0, 10, 11], [1, 5, 9], [5, 11, 4], [11, 10, 2],
    [10, 7, 6], [7, 1, 8], [3, 9, 4], [3, 4, 2], [3, 2, 6], [3, 6, 8], [3, 8, 9], [4, 9, 5],
    [2, 4, 11], [6, 2, 10], [8, 6, 7], [9, 8, 1]])


def _rounder(corners: NDArray[np.float64], faces: NDArray[np.int64]) -> tuple[
        NDArray[np.float64], NDArray[np.int64]]:
    """Return a ball with four faces in the place of each."""
    points, known, made = corners.tolist(), {}, []

    def middle(a: int, b: int) -> int:
        key = (min(a, b), max(a, b))
        if key not in known:
            known[key] = len(points)
            points.append((np.add(points[a], points[b])
                           / np.linalg.norm(np.add(points[a], points[b]))).tolist())
        return int(known[key])

    for a, b, c in faces.tolist():
        ab, bc, ca = middle(a, b), middle(b, c), middle(c, a)
        made += [[a, ab, ca], [b, bc, ab], [c, ca, bc], [ab, bc, ca]]
    return np.array(points), np.array(made)


_BALL = _rounder(*_rounder(_CORNERS, _FACES))
_CUBE = (np.array([[x, y, z] for x in (-1, 1) for y in (-1, 1) for z in (-1, 1)]) * 0.8,
         np.array([[0, 1, 3], [0, 3, 2], [4, 6, 7], [4, 7, 5], [0, 4, 5], [0, 5, 1],
                   [2, 3, 7], [2, 7, 6], [0, 2, 6], [0, 6, 4], [1, 5, 7], [1, 7, 3]]))
_OCTAHEDRON = (np.concatenate([np.eye(3), -np.eye(3)]) * 1.3,
               np.array([[0, 1, 2], [1, 3, 2], [3, 4, 2], [4, 0, 2],
                         [1, 0, 5], [3, 1, 5], [4, 3, 5], [0, 4, 5]]))
TIPS = (_BALL, _CUBE, _OCTAHEDRON)
"""What tells agents apart that have the same colour: a ball, a cube, an octahedron."""

_COARSE, _FINE = (_CORNERS, _FACES), _rounder(_CORNERS, _FACES)


class Rig:
    """
    A body that hangs on the tips of some axes.

    Where three or four tips carry a point together, it lies in the face that they span.
    """

    def __init__(self) -> None:
        self._bones: dict[int, int] = {}  # of each agent that something hangs on, from 0
        self._offsets: list[NDArray[np.float64]] = []
        self._holds: list[dict[int, float]] = []
        self._faces: list[NDArray[np.int64]] = []

    @property
    def agents(self) -> list[int]:
        """Return the agents that it hangs on, from 0, and :data:`CENTER`, bone by bone."""
        return list(self._bones)

    def _add(self, offsets: NDArray[np.float64], holds: Sequence[dict[int, float]],
             faces: NDArray[np.int64]) -> None:
        for hold in holds:
            for agent in hold:
                self._bones.setdefault(agent, len(self._bones))
        self._faces.append(faces + len(self._holds))
        self._offsets.append(offsets)
        self._holds += holds

    def add_tip(self, agent: int, radius: float, kind: int = 0) -> None:
        """Put something on the tip of an axis; which of :data:`TIPS`, and how large."""
        points, faces = TIPS[kind % len(TIPS)]
        self._add(radius * points, [{agent: 1.0}] * len(points), faces)

    def add_rod(self, start: int, end: int, profile: Sequence[tuple[float, float]],
                fine: bool = False) -> None:
        """
        Put a rod from one tip to another: a small ball that is drawn along.

        :param start: an agent, from 0, or :data:`CENTER`
        :param end: another
        :param profile: how thick it is where: pairs of a part of the way and a radius
        :param fine: whether somebody will look closely
        """
        points, faces = _FINE if fine else _COARSE
        count = len(points)
        for part, radius in profile:
            self._add(radius * points, [{start: 1.0 - part, end: part}] * count, faces)
        ridges = np.array(sorted({(min(a, b), max(a, b)) for face in faces.tolist()
                                  for a, b in zip(face, (*face[1:], face[0]), strict=True)}))
        i, j = ridges.T
        for k in range(len(profile) - 1):
            first = len(self._holds) - (len(profile) - k) * count
            swept = np.concatenate([np.stack([i, j, j + count], axis=-1),
                                    np.stack([i, j + count, i + count], axis=-1)])
            self._faces.append(swept + first)

    def add_face(self, corners: Sequence[int]) -> None:
        """Put a flat face between tips."""
        fan = np.array([[0, k, k + 1] for k in range(1, len(corners) - 1)])
        self._add(np.zeros((len(corners), 3)), [{i: 1.0} for i in corners], fan)

    def positions(self, gamma: NDArray[np.float64]) -> NDArray[np.float64]:
        """Return where the bones are in a state: ``(bones, 3)``."""
        places = np.concatenate([gamma, np.zeros((1, 3))])
        return places[self.agents]

    def mesh(self, gamma: NDArray[np.float64]) -> dict[str, NDArray[np.float64]]:
        """
        Return the body in a state, as ``add_mesh_skinned`` of viser takes it.

        :param gamma: reduced attitudes, ``(n, 3)``
        """
        weights = np.zeros((len(self._holds), len(self._bones)))
        for row, hold in enumerate(self._holds):
            for agent, weight in hold.items():
                weights[row, self._bones[agent]] += weight
        bones = self.positions(gamma)
        return {'vertices': np.concatenate(self._offsets) + weights @ bones,
                'faces': np.concatenate(self._faces), 'skin_weights': weights,
                'bone_positions': bones, 'bone_wxyzs': np.tile([1.0, 0.0, 0.0, 0.0],
                                                               (len(bones), 1))}
