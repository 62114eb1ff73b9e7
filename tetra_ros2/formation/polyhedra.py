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
The five Platonic solids, and the weights under which the law turns one about any axis.

Let P_i be the vertices, theta_c the distances that occur between them, nearest first, and e a
unit vector fixed in the solid. With ``W(i, j) = S_c + alpha_c e . (P_i x P_j)`` for a pair at
distance theta_c the solid is a relative equilibrium and turns with the angular velocity
``-(e / 2) sum_c alpha_c k_c f(theta_c) sin(theta_c)^2``, where k_c vertices are at distance
theta_c from any one. ``docs/polyhedra.md`` has the proof. It needs of the points that each class
of distances is balanced and isotropic, which :func:`imbalance` and :func:`anisotropy` measure.
"""

from dataclasses import dataclass
import itertools
import math

import numpy as np
from tetra_ros2.formation import sphere
from tetra_ros2.formation.gain import Gain

SAME = 1e-6
"""Cosines closer than this are of one class of distances."""

_PHI = (1.0 + math.sqrt(5.0)) / 2.0


def _cyclic(x: float, y: float, z: float) -> list[tuple[float, float, float]]:
    """Return the points (+-x, +-y, +-z) and their cyclic permutations, each once."""
    found: dict[tuple[float, float, float], None] = {}
    for shift in range(3):
        for signs in itertools.product((1.0, -1.0), repeat=3):
            point = [s * c + 0.0 for s, c in zip(signs, (x, y, z))]
            found[tuple(point[-shift:] + point[:-shift])] = None  # type: ignore[index]
    return list(found)


def _unit(points: list[tuple[float, float, float]]) -> np.ndarray:
    array = sphere.normalize(points)
    array.setflags(write=False)
    return array


SOLIDS = {
    # In this order four agents that lie like these have chirality 1.
    'tetrahedron': _unit([(1.0, 1.0, 1.0), (-1.0, 1.0, -1.0), (1.0, -1.0, -1.0),
                          (-1.0, -1.0, 1.0)]),
    'octahedron': _unit([(1.0, 0.0, 0.0), (0.0, 1.0, 0.0), (0.0, 0.0, 1.0),
                         (-1.0, 0.0, 0.0), (0.0, -1.0, 0.0), (0.0, 0.0, -1.0)]),
    'cube': _unit(_cyclic(1.0, 1.0, 1.0)),
    'icosahedron': _unit(_cyclic(0.0, 1.0, _PHI)),
    'dodecahedron': _unit(_cyclic(1.0, 1.0, 1.0) + _cyclic(0.0, 1.0 / _PHI, _PHI)),
}
"""The vertices P_i of each solid, unit vectors ``(n, 3)``; agent i is at ``[i - 1]``."""

CLASS_WEIGHTS = {
    'tetrahedron': (0.5,),
    'octahedron': (1.0, 6.0),
    'cube': (0.0, 1.0, 4.0),
    'icosahedron': (0.0, 1.0, 3.0),
    'dodecahedron': (0.0, 0.0, 0.6, 1.0, 2.0),
}
"""Recommended S_c, nearest class first; ``docs/polyhedra.md`` says of which gain."""

AXES = ('vertex', 'edge', 'face')
"""The axes that have a name: of agent 1, of an edge of its, of a face of its."""


@dataclass(frozen=True, eq=False)
class DistanceClasses:
    """
    The pairs of points sorted by distance.

    :param angles: theta_c [rad], ascending, ``(m,)``
    :param of_pair: which class a pair belongs to, from 0, ``(n, n)``; -1 on the diagonal
    """

    angles: np.ndarray
    of_pair: np.ndarray

    @property
    def sizes(self) -> np.ndarray:
        """Return k_c, how many points are at each distance from the first, ``(m,)``."""
        sizes: np.ndarray = np.sum(
            self.of_pair[0] == np.arange(len(self.angles))[:, None], axis=1)
        return sizes

    @property
    def multiples(self) -> np.ndarray:
        """Return how many points are at each distance from each one, ``(n, m)``."""
        multiples: np.ndarray = np.sum(
            self.of_pair[:, :, None] == np.arange(len(self.angles)), axis=1)
        return multiples


def distance_classes(points: np.ndarray) -> DistanceClasses:
    """Return the classes of distance of unit vectors ``(n, 3)``."""
    n = len(points)
    cosines = points @ points.T
    order = np.sort(cosines[~np.eye(n, dtype=bool)])[::-1]
    first = np.flatnonzero(np.concatenate([[True], np.diff(order) < -SAME]))
    of_pair = np.sum(cosines[:, :, None] < order[first] - SAME, axis=-1)
    np.fill_diagonal(of_pair, -1)
    angles = sphere.geodesic_distance(points[:, None], points[None])
    return DistanceClasses(
        np.array([np.mean(angles[of_pair == c]) for c in range(len(first))]), of_pair)


def _tangential(points: np.ndarray) -> np.ndarray:
    """Return ``(I - P_i P_i^T) P_j``, ``(n, n, 3)``."""
    cosines = points @ points.T
    result: np.ndarray = points[None, :, :] - cosines[:, :, None] * points[:, None, :]
    return result


def imbalance(points: np.ndarray) -> np.ndarray:
    """
    Return the longest sum over a class of the parts of P_j tangent at P_i, ``(m,)``.

    Where it is zero, equal weights in the class hold every point.

    :param points: unit vectors, ``(n, 3)``
    """
    classes, tangential = distance_classes(points), _tangential(points)
    return np.array([np.max(np.linalg.norm(np.sum(
        np.where((classes.of_pair == c)[..., None], tangential, 0.0), axis=1), axis=-1))
        for c in range(len(classes.angles))])


def anisotropy(points: np.ndarray) -> np.ndarray:
    """
    Return how far the second moments of each class are from isotropic, ``(m,)``.

    The largest entry of ``sum_j u_j u_j^T - (k_c / 2) sin(theta_c)^2 (I - P_i P_i^T)`` over all
    i, where u_j is the part of P_j tangent at P_i, and k_c the mean size of the class.

    :param points: unit vectors, ``(n, 3)``
    """
    classes, tangential = distance_classes(points), _tangential(points)
    planes = np.eye(3) - points[:, :, None] * points[:, None, :]
    outer = tangential[..., :, None] * tangential[..., None, :]
    worst = []
    for c, angle in enumerate(classes.angles):
        inside = classes.of_pair == c
        moments = np.sum(np.where(inside[..., None, None], outer, 0.0), axis=1)
        size = np.sum(inside) / len(points)
        worst.append(np.max(np.abs(moments - 0.5 * size * np.sin(angle)**2 * planes)))
    return np.array(worst)


def twist(points: np.ndarray, axis: np.ndarray) -> np.ndarray:
    """Return ``e . (P_i x P_j)``, ``(n, n)``, antisymmetric."""
    products = np.cross(points[:, None, :], points[None, :, :])
    twist: np.ndarray = np.einsum('a,ija->ij', axis, products)
    return twist


def weights(points: np.ndarray, class_weights: np.ndarray, axis: np.ndarray,
            spin: float = 0.0) -> np.ndarray:
    """
    Return the weights that hold the points, or turn them about an axis, ``(n, n)``.

    ``W(i, j) = S_c + alpha_c e . (P_i x P_j)``, where ``alpha_c = -spin S_c / max |e . (P_i x
    P_j)|`` over the class: with spin 1 or -1 the smallest weight of each class is zero.

    :param points: unit vectors, ``(n, 3)``
    :param class_weights: S_c, nearest class first, ``(m,)``
    :param axis: e, a unit vector
    :param spin: from -1 to 1; greater than 0 is counter-clockwise about the axis
    """
    classes, turning = distance_classes(points), twist(points, axis)
    matrix = np.zeros_like(turning)
    for c, weight in enumerate(class_weights):
        inside = classes.of_pair == c
        most = float(np.max(np.abs(turning[inside])))
        if most < SAME:  # antipodes: nothing turns
            most = math.inf
        matrix[inside] = weight * (1.0 - spin * turning[inside] / most)
    # One minus one is not always zero in floating point, and an edge of 1e-17 is an edge.
    matrix[np.abs(matrix) < 1e-12 * np.max(np.abs(matrix), initial=0.0)] = 0.0
    return matrix


def spin_rate(points: np.ndarray, class_weights: np.ndarray, axis: np.ndarray, spin: float,
              gain: Gain) -> float:
    """
    Return the angular velocity about the axis [rad/s], in closed form.

    ``-(1 / 2) sum_c alpha_c k_c f(theta_c) sin(theta_c)^2`` with the alpha_c of :func:`weights`.

    :param points: unit vectors of balanced, isotropic classes, ``(n, 3)``
    :param class_weights: S_c, nearest class first, ``(m,)``
    :param axis: e, a unit vector
    :param spin: from -1 to 1
    :param gain: a :class:`~tetra_ros2.formation.gain.Gain`
    """
    classes, turning = distance_classes(points), np.abs(twist(points, axis))
    total = 0.0
    for c, (weight, angle, size) in enumerate(zip(class_weights, classes.angles, classes.sizes)):
        most = float(np.max(turning[classes.of_pair == c]))
        if most >= SAME:
            alpha = -spin * weight / most
            total -= 0.5 * alpha * size * float(gain.f(angle)) * math.sin(angle)**2
    return total


def axis_agents(points: np.ndarray, name: str) -> tuple[int, ...]:
    """
    Return the agents whose directions add up to a named axis, from 1.

    :param points: the vertices of a solid, ``(n, 3)``
    :param name: one of AXES
    """
    cosines = points @ points.T
    nearest = float(np.max(cosines[0, 1:]))
    ring = [j for j in range(1, len(points)) if cosines[0, j] > nearest - SAME]
    if name == 'vertex':
        return (1,)
    if name == 'edge':
        return 1, ring[0] + 1
    for other in ring[1:]:
        normal = np.cross(points[ring[0]] - points[0], points[other] - points[0])
        heights = points @ (normal / np.linalg.norm(normal))
        heights = heights if heights[0] > 0.0 else -heights
        if np.all(heights <= heights[0] + SAME):
            return tuple((np.flatnonzero(heights > heights[0] - SAME) + 1).tolist())
    raise ValueError(f'there is no face at the first of these {len(points)} points')


def axis_direction(points: np.ndarray, axis: str | np.ndarray) -> np.ndarray:
    """
    Return the unit vector of an axis in the frame of the points, ``(3,)``.

    :param points: the vertices of a solid, ``(n, 3)``
    :param axis: one of AXES, or a vector in the frame of the points
    :raises ValueError: if the vector is zero or not finite
    """
    if isinstance(axis, str):
        axis = np.sum([points[i - 1] for i in axis_agents(points, axis)], axis=0)
    return sphere.normalize(axis)
