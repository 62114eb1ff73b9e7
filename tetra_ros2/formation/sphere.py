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

"""The unit sphere S^2, home of the reduced attitudes ``Gamma = R b``."""

import numpy as np
from numpy.typing import ArrayLike
from tetra_ros2.formation._types import Array


def hat(x: ArrayLike) -> Array:
    """
    Return the skew matrices of vectors, x^ with ``x^ @ y == cross(x, y)``; eq:pre:hat.

    :param x: vectors, ``(..., 3)``
    :returns: skew-symmetric matrices, ``(..., 3, 3)``
    """
    x = np.asarray(x, dtype=float)
    matrix = np.zeros((*x.shape, 3))
    matrix[..., 0, 1], matrix[..., 0, 2] = -x[..., 2], x[..., 1]
    matrix[..., 1, 0], matrix[..., 1, 2] = x[..., 2], -x[..., 0]
    matrix[..., 2, 0], matrix[..., 2, 1] = -x[..., 1], x[..., 0]
    return matrix


def cross(x: Array, y: Array) -> Array:
    """
    Return the cross products, ``(..., 3)``: what ``numpy.cross`` does, several times as fast.

    :param x: vectors, ``(..., 3)``
    :param y: vectors, ``(..., 3)``, broadcast against ``x``
    """
    a, b, c = x[..., 0], x[..., 1], x[..., 2]
    u, v, w = y[..., 0], y[..., 1], y[..., 2]
    return np.stack([b * w - c * v, c * u - a * w, a * v - b * u], axis=-1)


def geodesic_distance(x: ArrayLike, y: ArrayLike) -> Array:
    """
    Return the angle between unit vectors [rad], in [0, pi].

    Half the angle is that between the diagonal and a side of the rhombus on x and y. So computed
    it has full relative accuracy near 0 and full accuracy near pi, where the arc cosine of the
    paper loses half of the digits.

    :param x: unit vectors, ``(..., 3)``
    :param y: unit vectors, ``(..., 3)``, broadcast against ``x``
    :returns: angles, ``(...)``
    """
    x, y = np.asarray(x, dtype=float), np.asarray(y, dtype=float)
    side, diagonal = np.linalg.norm(x - y, axis=-1), np.linalg.norm(x + y, axis=-1)
    angle: Array = 2.0 * np.arctan2(side, diagonal)
    return angle


def exp(x: Array, v: Array) -> Array:
    """
    Follow the great circle from ``x`` with initial velocity ``v`` for one unit of time.

    :param x: unit vectors, ``(..., 3)``
    :param v: tangent vectors, orthogonal to ``x`` [rad], ``(..., 3)``
    :returns: unit vectors, ``(..., 3)``
    """
    angle = np.linalg.norm(v, axis=-1, keepdims=True)
    result: Array = np.cos(angle) * x + np.sinc(angle / np.pi) * v
    return result


def project(x: Array, v: Array) -> Array:
    """Return the parts of ``v`` tangent to the sphere at unit vectors ``x``, ``(..., 3)``."""
    result: Array = v - np.sum(np.asarray(x) * v, axis=-1, keepdims=True) * x
    return result


def normalize(x: ArrayLike) -> Array:
    """
    Return ``x`` scaled to length one, ``(..., 3)``.

    :raises ValueError: if a vector is zero or not finite
    """
    x = np.asarray(x, dtype=float)
    # Scaling first keeps the squares of very long and very short vectors in range.
    scale = np.max(np.abs(x), axis=-1, keepdims=True)
    if not np.all((scale > 0.0) & np.isfinite(scale)):
        raise ValueError('a direction must be finite and not zero')
    x = x / scale
    result: Array = x / np.linalg.norm(x, axis=-1, keepdims=True)
    return result


def random(rng: np.random.Generator, shape: int | tuple[int, ...] = ()) -> Array:
    """
    Draw points uniformly on the sphere.

    :param rng: a ``numpy.random.Generator``
    :param shape: the leading shape
    :returns: unit vectors, ``(*shape, 3)``
    """
    return normalize(rng.standard_normal((*np.atleast_1d(shape).astype(int), 3)))
