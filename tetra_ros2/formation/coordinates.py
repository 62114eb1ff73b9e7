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
The coordinates of the paper: roll-pitch-yaw angles of each agent, and xi = Phi(Gamma).

``xi = (xi_s, xi_c)``: the six cosines of the pairwise angles, which say what shape four reduced
attitudes make, and three angles ``phi_1, psi_1, gamma``, which say how that shape lies in the
world. The cosines obey an equation of their own, for any n and any weights.

The paper calls Phi a diffeomorphism. It is two-to-one: a formation and its mirror image in the
plane of Gamma_1 and Gamma_2 have the same xi. The inverse here therefore asks for the chirality,
which tells the two apart unless the four agents are on a small circle.
"""

import numpy as np
from numpy.typing import ArrayLike
from tetra_ros2.formation import measures, sphere
from tetra_ros2.formation._types import Array
from tetra_ros2.formation.gain import Gain

NORTH = np.array([0.0, 0.0, 1.0])

POLE = 1e-12
"""How close to the poles, or to each other's line, two points are on it [rad]: an angle about the
axis means nothing there, and is 0 by definition."""

FLAT = 1e-7
"""How far from one great circle a formation is on it: the root of the rounding of its cosines."""

NO_VOLUME = 1e-12
"""A volume of which the sign means nothing."""


def angles(gamma: ArrayLike) -> tuple[Array, Array]:
    """
    Return the roll-pitch-yaw angles of reduced attitudes; the inverse of :func:`from_angles`.

    The paper supplements ``psi = 0`` at [1, 0, 0], where psi is 0 anyway. What is singular are
    the poles [0, 0, 1] and [0, 0, -1]; psi is 0 there.

    :param gamma: unit vectors, ``(..., 3)``
    :returns: ``phi`` in [-pi/2, pi/2] and ``psi`` in (-pi, pi] [rad], each ``(...)``
    """
    x, y, z = np.moveaxis(np.asarray(gamma, dtype=float), -1, 0)
    equatorial = np.hypot(x, y)
    # The arc sine of the paper loses half of the digits near the poles.
    return np.arctan2(z, equatorial), np.where(equatorial > POLE, np.arctan2(y, x), 0.0)


def from_angles(phi: ArrayLike, psi: ArrayLike) -> Array:
    """Return the reduced attitudes of roll-pitch-yaw angles [rad], ``(..., 3)``; eq:pre:RPY."""
    phi, psi = np.broadcast_arrays(np.asarray(phi, dtype=float), psi)
    return np.stack([
        np.cos(psi) * np.cos(phi), np.sin(psi) * np.cos(phi), np.sin(phi)], axis=-1)


def angle_velocity(phi: ArrayLike, psi: ArrayLike, weights: Array,
                   gain: Gain) -> tuple[Array, Array]:
    """
    Return the closed loop in roll-pitch-yaw angles; eq:PF:ClosedSysRPY1 and 2.

    The paper's second equation lacks the factor cos(phi_j) beside cos(psi_j - psi_i).

    :param phi: ``(..., n)`` [rad], away from the poles
    :param psi: ``(..., n)`` [rad]
    :param weights: ``(n, n)``
    :param gain: a :class:`~tetra_ros2.formation.gain.Gain`
    :returns: ``dphi/dt`` and ``dpsi/dt`` [rad/s], each ``(..., n)``
    """
    phi, psi = np.asarray(phi, dtype=float), np.asarray(psi, dtype=float)
    phi_i, phi_j = phi[..., :, None], phi[..., None, :]
    ahead = psi[..., None, :] - psi[..., :, None]
    cosine = np.cos(phi_i) * np.cos(phi_j) * np.cos(ahead) + np.sin(phi_i) * np.sin(phi_j)
    rate = weights * gain.of_cosine(cosine)
    phi_rate = np.sum(rate * (np.sin(phi_i) * np.cos(phi_j) * np.cos(ahead)
                              - np.cos(phi_i) * np.sin(phi_j)), axis=-1)
    psi_rate = -np.sum(rate * np.sin(ahead) * np.cos(phi_j), axis=-1) / np.cos(phi)
    return phi_rate, psi_rate


def about_z(angle: Array) -> Array:
    """Return the rotation matrices about Z, R1(gamma) and R3(psi_1) of eq:SF:rotMatrix."""
    c, s = np.cos(angle), np.sin(angle)
    zero, one = np.zeros_like(c), np.ones_like(c)
    return np.stack([np.stack([c, -s, zero], axis=-1), np.stack([s, c, zero], axis=-1),
                     np.stack([zero, zero, one], axis=-1)], axis=-2)


def tilt(phi: Array) -> Array:
    """Return R2(phi) of eq:SF:rotMatrix: about Y through pi/2 - phi, so north comes to phi."""
    s, c = np.sin(phi), np.cos(phi)
    zero, one = np.zeros_like(c), np.ones_like(c)
    return np.stack([np.stack([s, zero, c], axis=-1), np.stack([zero, one, zero], axis=-1),
                     np.stack([-c, zero, s], axis=-1)], axis=-2)


def attitude(xi_c: ArrayLike) -> Array:
    """
    Return ``R3(psi_1) R2(phi_1) R1(gamma)``, which takes a normalised formation to the world.

    :param xi_c: ``phi_1, psi_1, gamma`` [rad], ``(..., 3)``
    :returns: rotation matrices, ``(..., 3, 3)``
    """
    phi, psi, gamma = np.moveaxis(np.asarray(xi_c, dtype=float), -1, 0)
    return about_z(psi) @ tilt(phi) @ about_z(gamma)


def absolute(gamma: Array) -> Array:
    """
    Return ``xi_c = (phi_1, psi_1, gamma)`` [rad], ``(..., 3)``; eq:SF:newCoorTransPara.

    Where Gamma_2 is Gamma_1 or, which the paper leaves out, -Gamma_1, the angle gamma is 0.

    :param gamma: reduced attitudes, ``(..., n, 3)`` with n >= 2
    """
    phi, psi = angles(gamma[..., :2, :])
    # With the shared longitude taken out first, nothing is left to cancel near a pole.
    second = np.einsum('...ji,...j->...i', about_z(psi[..., 0]), gamma[..., 1, :])
    x = np.sin(phi[..., 0]) * second[..., 0] - np.cos(phi[..., 0]) * second[..., 2]
    y = second[..., 1]
    twist = np.where(np.hypot(x, y) > POLE, np.arctan2(y, x), 0.0)
    return np.stack([phi[..., 0], psi[..., 0], twist], axis=-1)


def transform(gamma: Array) -> Array:
    """
    Return ``xi = Phi(Gamma)``: six cosines and three angles [rad]; eq:SF:newCoorTrans.

    :param gamma: reduced attitudes, ``(..., 4, 3)``
    :returns: ``(..., 9)``
    """
    return np.concatenate([measures.pairwise_cosines(gamma), absolute(gamma)], axis=-1)


def normalized(gamma: ArrayLike) -> Array:
    """
    Return the formation with Gamma_1 at the north pole and Gamma_2 at y = 0, x >= 0.

    :param gamma: reduced attitudes, ``(..., n, 3)``
    :returns: ``(..., n, 3)``, of the same shape and chirality
    """
    gamma = np.asarray(gamma, dtype=float)
    return gamma @ attitude(absolute(gamma))


def inverse(xi: ArrayLike, chirality: ArrayLike) -> Array:
    """
    Return the formation G of given coordinates ``transform(G)`` and ``chirality(G)``.

    :param xi: six cosines of a formation that exists, and three angles [rad], ``(..., 9)``
    :param chirality: 1 or -1, ``(...)``; any number where the four are on one great circle: there
        they are their own mirror image
    :returns: reduced attitudes, ``(..., 4, 3)``
    :raises ValueError: if the cosines are not those of four points on the sphere; or if the
        chirality does not tell the formation from its mirror image, because it is 0, or because
        the four are on a small circle: both have volume 0 then, and are not the same
    """
    xi = np.asarray(xi, dtype=float)
    cosines = cosine_matrix(xi[..., :6])
    if np.any(np.linalg.eigvalsh(cosines)[..., 0] < -1e-9) or np.any(
            np.abs(np.linalg.det(cosines)) > 1e-9):
        raise ValueError('no four points on the sphere have these cosines')
    values, vectors = np.linalg.eigh(cosines)
    # The Gram matrix has rank 3 at most, so three coordinates hold all of it.
    shape = vectors[..., 1:] * np.sqrt(np.maximum(values[..., None, 1:], 0.0))
    volume = np.linalg.det(shape[..., 1:, :] - shape[..., :1, :])
    great_circle = values[..., 1] < FLAT**2
    if np.any(~great_circle & ((np.asarray(chirality) == 0) | (np.abs(volume) < NO_VOLUME))):
        raise ValueError('the chirality does not tell this formation from its mirror image')
    mirrored = volume * np.asarray(chirality) < 0.0
    shape = sphere.normalize(np.where(mirrored, -1.0, 1.0)[..., None, None] * shape)
    return normalized(shape) @ np.swapaxes(attitude(xi[..., 6:]), -1, -2)


def cosine_matrix(cosines: ArrayLike) -> Array:
    """
    Return the Gram matrix ``Gamma_i^T Gamma_j`` of pairwise cosines.

    :param cosines: for i < j in lexicographic order, ``(..., n (n - 1) / 2)``
    :returns: symmetric with unit diagonal, ``(..., n, n)``
    """
    cosines = np.asarray(cosines, dtype=float)
    n = round((1.0 + np.sqrt(1.0 + 8.0 * cosines.shape[-1])) / 2.0)
    matrix = np.broadcast_to(np.eye(n), (*cosines.shape[:-1], n, n)).copy()
    i, j = np.triu_indices(n, k=1)
    matrix[..., i, j] = matrix[..., j, i] = cosines
    result: Array = matrix
    return result


def gram_identity(cosines: ArrayLike) -> Array:
    """
    Return the left side of the identity among six cosines, which is 1 on the sphere.

    It is one minus the determinant of the Gram matrix: four vectors in space are dependent. So
    the nine coordinates xi have eight degrees of freedom.

    :param cosines: xi_s, ``(..., 6)``
    """
    c12, c13, c14, c23, c24, c34 = np.moveaxis(np.asarray(cosines, dtype=float), -1, 0)
    result: Array = (
        c12**2 + c13**2 + c14**2 + c23**2 + c24**2 + c34**2
        - (c14 * c23)**2 - (c13 * c24)**2 - (c12 * c34)**2
        - 2.0 * (c12 * c13 * c23 + c23 * c24 * c34 + c13 * c14 * c34 + c12 * c14 * c24)
        + 2.0 * (c13 * c14 * c23 * c24 + c12 * c13 * c24 * c34 + c12 * c14 * c23 * c34))
    return result


def h(xi_s: Array) -> Array:
    """
    Return the matrix h of ``dxi_s/dt = h F(xi_s)``, complete graph; eq:SF:newCorDynf1Detial.

    :param xi_s: six cosines, ``(..., 6)``
    :returns: ``(..., 6, 6)``
    """
    c = cosine_matrix(xi_s)
    pairs = np.array(measures.pairs(4)) - 1
    matrix = np.zeros((*c.shape[:-2], 6, 6))
    for row, (i, j) in enumerate(pairs):
        for column, pair in enumerate(pairs):
            for near, far in ((i, j), (j, i)):
                if near in pair:
                    k = pair[0] + pair[1] - near
                    matrix[..., row, column] += c[..., near, k] * c[..., i, j] - c[..., k, far]
    return matrix


def cosine_velocity(cosines: Array, weights: Array, gain: Gain) -> Array:
    """
    Return the closed dynamics of the cosines, any n and weights; eq:RF:newCorDynf1 written out.

    ``d c_ij / dt = sum_k W(i,k) F(c_ik) (c_ik c_ij - c_kj) + W(j,k) F(c_jk) (c_jk c_ij - c_ki)``

    :param cosines: for i < j in lexicographic order, ``(..., n (n - 1) / 2)``
    :param weights: ``(n, n)``
    :param gain: a :class:`~tetra_ros2.formation.gain.Gain`
    :returns: of the shape of ``cosines`` [1/s]
    """
    c = cosine_matrix(cosines)
    return _upper(_symmetric(_generator(c, weights * gain.of_cosine(c)) @ c))


def cosine_jacobian(cosines: Array, weights: Array, gain: Gain) -> Array:
    """
    Return the derivative of :func:`cosine_velocity`, ``(m, m)`` [1/s]; eq:SF:proofCM.

    :param cosines: ``(m,)`` with ``m = n (n - 1) / 2``, none of them 1 or -1
    :param weights: ``(n, n)``
    :param gain: a :class:`~tetra_ros2.formation.gain.Gain`
    """
    c = cosine_matrix(cosines)
    off = ~np.eye(len(c), dtype=bool)
    rate, slope = weights * gain.of_cosine(c), np.zeros_like(c)
    slope[off] = (weights * gain.of_cosine_derivative(np.where(off, c, 0.0)))[off]
    change = cosine_matrix(np.eye(len(cosines))) - np.eye(len(c))
    generator_change = _generator(c, slope * change) + _diagonal(rate * change)
    changes = _symmetric(generator_change @ c + _generator(c, rate) @ change)
    result: Array = _upper(changes).T
    return result


def _generator(c: Array, rate: Array) -> Array:
    """Return M such that ``dGamma/dt = M Gamma`` row by row: diagonal of sum rate c, less rate."""
    return _diagonal(rate * c) - rate


def _diagonal(terms: Array) -> Array:
    result: Array = np.sum(terms, axis=-1)[..., None] * np.eye(terms.shape[-1])
    return result


def _symmetric(matrix: Array) -> Array:
    return matrix + np.swapaxes(matrix, -1, -2)


def _upper(matrix: Array) -> Array:
    i, j = np.triu_indices(matrix.shape[-1], k=1)
    return matrix[..., i, j]
