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

"""The solid that a formation spans, and the lines on the sphere under it."""

from collections.abc import Sequence
import itertools

import numpy as np
from numpy.typing import ArrayLike, NDArray

FLAT = 1e-3
"""Points as close to the plane of a face as this belong to it, so that a cube has six faces."""

FEW = 24
"""Up to so many points, to try all triples of them is quick; beyond, SciPy is wanted."""

MOST_POINTS = 60
"""Of more points the faces would tell a person nothing, and are not looked for."""

FASTEST = 20.0
"""How fast an agent may turn where nothing is known [rad/s]; faster, it was put elsewhere."""

Polygon = tuple[int, ...]


def polygons(points: ArrayLike, guess: Sequence[Polygon] = ()) -> Sequence[Polygon]:
    """
    Return the faces of the convex hull of points on the sphere.

    No point on a sphere lies inside the hull, so that a plane through three of them bears a face
    if and only if all others are on one side of it. Faces that lie in one plane to within
    :data:`FLAT` are one. Three points, or points on one circle, have a single face.

    :param points: unit vectors, ``(n, 3)``
    :param guess: the faces at another time; returned themselves if they still are the faces
    :returns: for each face the indices of its corners from 0, counter-clockwise as seen from
        outside, the smallest first; none for less than three points, more than
        :data:`MOST_POINTS`, or more than :data:`FEW` where SciPy is not installed
    """
    gamma = np.asarray(points, dtype=float)
    if not 3 <= len(gamma) <= MOST_POINTS:
        return ()
    if guess and _fits(guess, gamma):
        return guess
    normals, offsets = _supporting_planes(gamma)
    heights = normals @ gamma.T - offsets[:, None]
    found: list[set[int]] = []
    kept: list[Polygon] = []
    belongs, first = np.unique(np.abs(heights) <= FLAT, axis=0, return_index=True)
    # Those with most corners first: what shares three with one of them is a part of it.
    for index in np.argsort(-np.sum(belongs, axis=1), kind='stable'):
        corners = np.flatnonzero(belongs[index])
        if any(len(face.intersection(corners.tolist())) > 2 for face in found):
            continue
        found.append(set(corners.tolist()))
        kept.append(_in_order(corners, gamma, normals[first[index]]))
    return tuple(sorted(kept))


def triangles(faces: Sequence[Polygon]) -> NDArray[np.intp]:
    """Return faces as triangles, ``(m, 3)``, as :func:`polygons` has them."""
    fans = [(face[0], *pair) for face in faces for pair in itertools.pairwise(face[1:])]
    return np.array(fans, dtype=np.intp).reshape(-1, 3)


def sides(faces: Sequence[Polygon]) -> NDArray[np.intp]:
    """Return the edges of a solid, each once, as pairs of indices in ascending order."""
    pairs = {tuple(sorted(pair)) for face in faces
             for pair in zip(face, (*face[1:], face[0]), strict=True)}
    return np.array(sorted(pairs), dtype=np.intp).reshape(-1, 2)


def faces(points: ArrayLike) -> NDArray[np.intp]:
    """Return the faces of the convex hull of points on the sphere as triangles, ``(m, 3)``."""
    return triangles(polygons(points))


def _planes(gamma: NDArray[np.float64], triples: NDArray[np.intp]) -> tuple[
        NDArray[np.float64], NDArray[np.float64]]:
    """Return unit normals and offsets of the planes through triples of points that span one."""
    a, b, c = (gamma[triples[:, k]] for k in range(3))
    normals = np.cross(b - a, c - a)
    lengths = np.linalg.norm(normals, axis=1)
    spanning = lengths > 1e-9
    normals = normals[spanning] / lengths[spanning, None]
    return normals, np.sum(normals * a[spanning], axis=1)


def _supporting_planes(gamma: NDArray[np.float64]) -> tuple[
        NDArray[np.float64], NDArray[np.float64]]:
    """Return normals that point outwards, and offsets, of planes with all points on one side."""
    if len(gamma) > FEW:
        try:
            from scipy.spatial import ConvexHull, QhullError  # an extra, and only here
        except ImportError:
            return np.empty((0, 3)), np.empty(0)
        try:
            equations = ConvexHull(gamma).equations
        except QhullError:  # they lie in one plane
            triples = np.array([[0, len(gamma) // 3, 2 * len(gamma) // 3]])
            return _planes(gamma, triples)
        return equations[:, :3], -equations[:, 3]
    triples = np.array(list(itertools.combinations(range(len(gamma)), 3)), dtype=np.intp)
    normals, offsets = _planes(gamma, triples)
    heights = normals @ gamma.T - offsets[:, None]
    below, above = np.all(heights <= FLAT, axis=1), np.all(heights >= -FLAT, axis=1)
    sign = np.where(below, 1.0, -1.0)
    chosen = below | above
    return (sign[:, None] * normals)[chosen], (sign * offsets)[chosen]


def _in_order(corners: NDArray[np.intp], gamma: NDArray[np.float64],
              normal: NDArray[np.float64]) -> Polygon:
    """Return the corners of a face counter-clockwise about its normal."""
    arms = gamma[corners] - np.mean(gamma[corners], axis=0)
    angles = np.arctan2(np.cross(arms[0], arms) @ normal, arms @ arms[0])
    turned = corners[np.argsort(angles)].tolist()
    start = turned.index(min(turned))
    return (*turned[start:], *turned[:start])


def _fits(guess: Sequence[Polygon], gamma: NDArray[np.float64]) -> bool:
    """Return whether faces are those of the hull of other points, too."""
    if max(map(max, guess)) >= len(gamma):
        return False
    normals, offsets = _planes(gamma, np.array([face[:3] for face in guess], dtype=np.intp))
    if len(normals) != len(guess):
        return False
    heights = normals @ gamma.T - offsets[:, None]
    on = np.zeros(heights.shape, dtype=bool)
    for k, face in enumerate(guess):
        on[k, list(face)] = True
    return bool(np.all(np.where(on, np.abs(heights) <= FLAT, heights < -FLAT)))


def is_elsewhere(before: NDArray[np.float64], after: NDArray[np.float64], elapsed: float,
                 fastest: float | None = None) -> bool:
    """
    Return whether a formation was put where it is, as it cannot have turned there.

    :param before: reduced attitudes, ``(n, 3)``
    :param after: the same some time later
    :param elapsed: that time [s]
    :param fastest: how fast an agent can turn [rad/s], if that is known
    """
    # As no agent turns faster than the law lets it, this is never too strict.
    reach = 0.1 + 1.2 * (fastest or FASTEST) * elapsed
    nearest = float(np.min(np.sum(before * after, axis=-1)))
    return reach < np.pi and nearest < np.cos(reach)


def graticule(step: float = 30.0, points: int = 73) -> NDArray[np.float64]:
    """
    Return meridians and parallels of the unit sphere as polylines.

    :param step: angle between two of them [deg]
    :param points: of each line
    :returns: ``(lines, points, 3)``
    """
    turn = np.linspace(0.0, 2.0 * np.pi, points)
    lines = []
    for latitude in np.radians(np.arange(-90.0 + step, 90.0 - 1e-9, step)):
        lines.append(np.stack([np.cos(latitude) * np.cos(turn), np.cos(latitude) * np.sin(turn),
                               np.full(points, np.sin(latitude))], axis=-1))
    for longitude in np.radians(np.arange(0.0, 180.0 - 1e-9, step)):
        lines.append(np.stack([np.cos(turn) * np.cos(longitude), np.cos(turn) * np.sin(longitude),
                               np.sin(turn)], axis=-1))
    return np.array(lines)


def along_arc(start: ArrayLike, end: ArrayLike, points: int) -> NDArray[np.float64]:
    """
    Return points on the great circle from one unit vector to another.

    :param start: ``(..., 3)``
    :param end: ``(..., 3)``
    :param points: how many, both ends among them
    :returns: ``(..., points, 3)``
    """
    fraction = np.linspace(0.0, 1.0, points)[:, None]
    start, end = np.asarray(start)[..., None, :], np.asarray(end)[..., None, :]
    cross = np.linalg.norm(np.cross(start, end), axis=-1, keepdims=True)
    theta = np.arctan2(cross, np.sum(start * end, axis=-1, keepdims=True))
    # Where the two ends are opposite or the same, the chord does as well as any circle.
    with np.errstate(divide='ignore', invalid='ignore'):
        arc = (np.sin((1.0 - fraction) * theta) * start + np.sin(fraction * theta) * end) / cross
    line: NDArray[np.float64] = np.where(
        cross > 1e-6, arc, (1.0 - fraction) * start + fraction * end)
    return line
