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
The rotation group SO(3) as unit quaternions, ``(..., 4)`` in ROS order ``x y z w``.

A quaternion ``q`` stands for the attitude ``R`` that takes body coordinates to world coordinates;
``multiply(p, q)`` stands for the product of the matrices in the same order.
"""

import numpy as np
from numpy.typing import ArrayLike
from tetra_ros2.formation import sphere
from tetra_ros2.formation._types import Array

IDENTITY = np.array([0.0, 0.0, 0.0, 1.0])


def multiply(p: ArrayLike, q: ArrayLike) -> Array:
    """Return the products of quaternions, ``(..., 4)``."""
    p, q = np.asarray(p, dtype=float), np.asarray(q, dtype=float)
    px, py, pz, pw = p[..., 0], p[..., 1], p[..., 2], p[..., 3]
    qx, qy, qz, qw = q[..., 0], q[..., 1], q[..., 2], q[..., 3]
    return np.stack([
        pw * qx + px * qw + py * qz - pz * qy,
        pw * qy - px * qz + py * qw + pz * qx,
        pw * qz + px * qy - py * qx + pz * qw,
        pw * qw - px * qx - py * qy - pz * qz,
    ], axis=-1)


def inverse(q: ArrayLike) -> Array:
    """Return the inverses of unit quaternions, ``(..., 4)``."""
    return np.asarray(q) * [-1.0, -1.0, -1.0, 1.0]


def rotate(q: ArrayLike, v: ArrayLike) -> Array:
    """
    Rotate vectors: body to world coordinates if ``q`` is an attitude.

    :param q: unit quaternions, ``(..., 4)``
    :param v: vectors, ``(..., 3)``, broadcast against ``q``
    :returns: vectors, ``(..., 3)``
    """
    q, v = np.asarray(q, dtype=float), np.asarray(v, dtype=float)
    t = 2.0 * sphere.cross(q[..., :3], v)
    return v + q[..., 3:] * t + sphere.cross(q[..., :3], t)


def exp(w: ArrayLike) -> Array:
    """
    Return the rotation about ``w`` through the angle ``|w|``.

    :param w: rotation vectors [rad], ``(..., 3)``
    :returns: unit quaternions, ``(..., 4)``
    """
    w = np.asarray(w, dtype=float)
    half = 0.5 * np.linalg.norm(w, axis=-1, keepdims=True)
    # numpy's sinc(t) is sin(pi t) / (pi t), with its limit 1 at 0: no branch for small angles.
    return np.concatenate([0.5 * np.sinc(half / np.pi) * w, np.cos(half)], axis=-1)


def log(q: ArrayLike) -> Array:
    """
    Return the shortest rotation vectors of unit quaternions; the inverse of ``exp`` below pi.

    :param q: unit quaternions, ``(..., 4)``
    :returns: rotation vectors [rad], of length at most pi, ``(..., 3)``
    """
    q = np.asarray(q, dtype=float)
    q = np.where(q[..., 3:] < 0.0, -q, q)  # q and -q are one rotation; take the shorter way round
    sine = np.linalg.norm(q[..., :3], axis=-1, keepdims=True)
    angle = 2.0 * np.arctan2(sine, q[..., 3:])
    # angle / sine -> 2 as the angle vanishes
    ratio = np.divide(angle, sine, out=np.full_like(sine, 2.0), where=sine > 0.0)
    vector: Array = q[..., :3] * ratio
    return vector


def renormalize(q: ArrayLike, tolerance: float = 1e-14) -> Array:
    """
    Return ``q`` brought back to length one where it left it by more than ``tolerance``.

    Products of unit quaternions keep their length but for rounding, so this seldom acts. One
    Newton step suffices for the error of the many products that can have gone before.

    :param q: quaternions of nearly unit length, ``(..., 4)``
    :returns: unit quaternions, ``(..., 4)``
    """
    q = np.asarray(q, dtype=float)
    excess = np.sum(q * q, axis=-1, keepdims=True) - 1.0
    return np.where(np.abs(excess) > tolerance, q * (1.0 - 0.5 * excess), q)


def to_matrix(q: Array) -> Array:
    """Return the rotation matrices of unit quaternions, ``(..., 3, 3)``."""
    return np.stack([rotate(q, e) for e in np.eye(3)], axis=-1)


def from_matrix(matrix: ArrayLike) -> Array:
    """
    Return the unit quaternions of rotation matrices, with ``w >= 0``.

    :param matrix: rotation matrices, ``(..., 3, 3)``
    :returns: unit quaternions, ``(..., 4)``
    """
    m = np.asarray(matrix, dtype=float)
    xx, yy, zz = m[..., 0, 0], m[..., 1, 1], m[..., 2, 2]
    x = m[..., 2, 1] - m[..., 1, 2]
    y = m[..., 0, 2] - m[..., 2, 0]
    z = m[..., 1, 0] - m[..., 0, 1]
    xy = m[..., 0, 1] + m[..., 1, 0]
    xz = m[..., 0, 2] + m[..., 2, 0]
    yz = m[..., 1, 2] + m[..., 2, 1]
    # 4 q q^T: each row is q, scaled by its own component; the longest is the most accurate one.
    rows = np.stack([
        np.stack([1.0 + xx - yy - zz, xy, xz, x], axis=-1),
        np.stack([xy, 1.0 - xx + yy - zz, yz, y], axis=-1),
        np.stack([xz, yz, 1.0 - xx - yy + zz, z], axis=-1),
        np.stack([x, y, z, 1.0 + xx + yy + zz], axis=-1),
    ], axis=-2)
    best = np.argmax(np.linalg.norm(rows, axis=-1), axis=-1)
    q = np.take_along_axis(rows, best[..., None, None], axis=-2)[..., 0, :]
    q = q / np.linalg.norm(q, axis=-1, keepdims=True)
    result: Array = np.where(q[..., 3:] < 0.0, -q, q)
    return result


def random(rng: np.random.Generator, shape: int | tuple[int, ...] = ()) -> Array:
    """
    Draw attitudes uniformly on SO(3), so that every pointing axis is uniform on the sphere.

    :param rng: a ``numpy.random.Generator``
    :param shape: the leading shape
    :returns: unit quaternions, ``(*shape, 4)``
    """
    q = rng.standard_normal((*np.atleast_1d(shape).astype(int), 4))
    result: Array = q / np.linalg.norm(q, axis=-1, keepdims=True)
    return result


def between(x: ArrayLike, y: ArrayLike) -> Array:
    """
    Return the shortest rotations that take unit vectors ``x`` to unit vectors ``y``.

    :param x: unit vectors, ``(..., 3)``
    :param y: unit vectors, ``(..., 3)``
    :returns: unit quaternions, ``(..., 4)``; a half turn about some normal where ``y == -x``
    """
    x, y = np.broadcast_arrays(np.asarray(x, dtype=float), np.asarray(y, dtype=float))
    axis = np.cross(x, y)
    # Where the two are parallel or opposite any normal serves: that of the least aligned basis
    # vector is the best conditioned.
    normal = np.cross(x, np.eye(3)[np.argmin(np.abs(x), axis=-1)])
    length = np.linalg.norm(axis, axis=-1, keepdims=True)
    axis = sphere.normalize(np.where(length > 0.0, axis, normal))
    # Of nearly opposite vectors the product is mostly rounding; what is left of it along x would
    # turn x out of the plane of the two.
    axis = sphere.normalize(sphere.project(x, axis))
    return exp(sphere.geodesic_distance(x, y)[..., None] * axis)


def align(x: ArrayLike, y: ArrayLike) -> Array:
    """
    Return the rotation that best takes the points ``x`` to the points ``y`` (Kabsch, Wahba).

    :param x: points, ``(..., n, 3)``
    :param y: points, ``(..., n, 3)``
    :returns: unit quaternions, ``(..., 4)``, minimising the sum of ``|y_i - R x_i|^2``
    """
    u, _, vt = np.linalg.svd(np.swapaxes(np.asarray(y, float), -1, -2) @ np.asarray(x, float))
    proper = np.stack([np.ones(u.shape[:-2]), np.ones(u.shape[:-2]),
                       np.sign(np.linalg.det(u @ vt))], axis=-1)
    return from_matrix((u * proper[..., None, :]) @ vt)
