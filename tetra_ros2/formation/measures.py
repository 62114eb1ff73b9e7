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

"""What can be said of a formation by looking at it, whoever made it and why."""

import itertools

import numpy as np
from numpy.typing import ArrayLike
from tetra_ros2.formation import rotation, sphere
from tetra_ros2.formation._types import Array


def pairs(n: int) -> tuple[tuple[int, int], ...]:
    """Return all couples (i, j) of agents with i < j in lexicographic order, from 1."""
    return tuple(itertools.combinations(range(1, n + 1), 2))


def _ends(gamma: ArrayLike) -> tuple[Array, Array]:
    """Return the two ends of all pairs, each of shape ``(..., n (n - 1) / 2, 3)``."""
    gamma = np.asarray(gamma, dtype=float)
    i, j = np.triu_indices(gamma.shape[-2], k=1)
    return gamma[..., i, :], gamma[..., j, :]


def pairwise_cosines(gamma: ArrayLike) -> Array:
    """
    Return ``cos(theta_ij)`` for i < j in lexicographic order; for n = 4 the paper's xi_s.

    :param gamma: reduced attitudes, ``(..., n, 3)``
    :returns: ``(..., n (n - 1) / 2)``
    """
    first, second = _ends(gamma)
    result: Array = np.sum(first * second, axis=-1)
    return result


def pairwise_angles(gamma: ArrayLike) -> Array:
    """Return ``theta_ij`` [rad] for i < j in lexicographic order, ``(..., n (n - 1) / 2)``."""
    return sphere.geodesic_distance(*_ends(gamma))


def shape_error(gamma: ArrayLike, target_angles: Array) -> Array:
    """
    Return the largest distance of a pairwise angle from the target [rad], ``(...)``.

    Where the target has angles of different sizes, which of them belongs to which pair is not
    part of the target: both sides are compared in ascending order.

    :param gamma: reduced attitudes, ``(..., n, 3)``
    :param target_angles: the target's pairwise angles [rad] in ascending order
    """
    angles = np.sort(pairwise_angles(gamma), axis=-1)
    error: Array = np.max(np.abs(angles - target_angles), axis=-1)
    return error


def chirality(gamma: ArrayLike) -> Array:
    """
    Return the handedness of four points, ``(...)``: 1 or -1, and 0 where they are coplanar.

    It is the sign of the volume ``det[Gamma_2 - Gamma_1, Gamma_3 - Gamma_1, Gamma_4 - Gamma_1]``.
    Rotations keep it, mirrors and odd permutations of the agents change it.

    :param gamma: reduced attitudes, ``(..., 4, 3)``
    """
    gamma = np.asarray(gamma, dtype=float)
    result: Array = np.sign(np.linalg.det(gamma[..., 1:, :] - gamma[..., :1, :]))
    return result


def angular_velocity(gamma: ArrayLike, velocity: Array) -> Array:
    """
    Return the angular velocity [rad/s] of the formation as one rigid body, ``(..., 3)``.

    It is the W that minimises the sum of ``|dGamma_i/dt - W x Gamma_i|^2``: exact where the
    formation keeps its shape. Where all points lie on one line W is the shortest such vector.

    :param gamma: reduced attitudes, ``(..., n, 3)``
    :param velocity: ``dGamma/dt`` [1/s], ``(..., n, 3)``
    """
    gamma = np.asarray(gamma, dtype=float)
    outer = gamma[..., :, None] * gamma[..., None, :]
    inertia = np.sum(np.eye(3) - outer, axis=-3)
    momentum = np.sum(np.cross(gamma, velocity), axis=-2)
    inverse = np.linalg.pinv(inertia, hermitian=True)
    spin: Array = np.einsum('...ij,...j->...i', inverse, momentum)
    return spin


def mean_angular_velocity(before: ArrayLike, after: Array, elapsed: float) -> Array:
    """
    Return the constant angular velocity [rad/s] that best takes one sample to the next.

    Points on one line do not tell how they turn about it; they count as not doing so.

    :param before: reduced attitudes, ``(..., n, 3)``
    :param after: reduced attitudes, less than half a turn later, ``(..., n, 3)``
    :param elapsed: time between the two [s]
    :returns: in the world frame, ``(..., 3)``
    """
    before = np.asarray(before, dtype=float)
    turn = rotation.align(before, after)
    first = before[..., 0, :]
    on_a_line = np.all(np.linalg.norm(
        np.cross(first[..., None, :], before), axis=-1) < 1e-9, axis=-1)
    shortest = rotation.between(first, rotation.rotate(turn, first))
    return rotation.log(np.where(on_a_line[..., None], shortest, turn)) / elapsed
