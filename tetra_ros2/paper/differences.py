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
Linearisations from differences of the law itself.

They are slower and less exact than those of :mod:`tetra_ros2.formation.stability`, and owe
nothing to them.
"""

from collections.abc import Callable

import numpy as np
from numpy.typing import ArrayLike
from tetra_ros2.formation import coordinates, law, measures, shapes, sphere, stability
from tetra_ros2.formation.gain import Gain
from tetra_ros2.formation.law import Repulsion
from tetra_ros2.paper.formations import proof_point, THIRD


def derivative(function: Callable[[np.ndarray], np.ndarray], x: np.ndarray,
               step: float = 4e-3) -> np.ndarray:
    """Return the matrix of sixth-order central differences; exact to 1e-12 on smooth maps."""
    change = step * np.eye(len(x))
    total: np.ndarray = np.zeros(())
    for k, factor in ((1, 45.0), (2, -9.0), (3, 1.0)):
        total = total + factor * (function(x + k * change) - function(x - k * change))
    matrix: np.ndarray = total.T / (60.0 * step)
    return matrix


def differentiated_law(gamma: np.ndarray, weights: np.ndarray, gain: Repulsion,
                       spin: ArrayLike = 0.0) -> tuple[np.ndarray, np.ndarray]:
    """
    Return the linearisation that differences of the law itself give, ``(2 n, 2 n)``.

    That is slower and less exact than :func:`tetra_ros2.formation.stability.linearization`, and
    owes nothing to it.

    :param gamma: where, ``(n, 3)``: at rest, or at rest in a frame that turns with ``spin``
    """
    bases = stability.tangent_basis(gamma)

    def in_tangent(q: np.ndarray) -> np.ndarray:
        q = q.reshape(-1, len(gamma), 2)
        moved = sphere.exp(gamma, np.einsum('iap,kip->kia', bases, q))
        velocity = law.velocity(moved, weights, gain) - np.cross(np.asarray(spin), moved) \
            if np.any(spin) else law.velocity(moved, weights, gain)
        rates: np.ndarray = np.einsum('iap,kia->kip', bases, velocity).reshape(len(q), -1)
        return rates

    return derivative(in_tangent, np.zeros(2 * len(gamma))), bases


def transverse_spectrum(gamma: np.ndarray, weights: np.ndarray, gain: Repulsion) -> np.ndarray:
    """Return the eigenvalues of :func:`differentiated_law` less those of the rotations."""
    velocity = law.velocity(gamma, weights, gain)
    spin = measures.angular_velocity(gamma, velocity)
    matrix, bases = differentiated_law(gamma, weights, gain, spin)
    across = stability.complement(stability.rotations(gamma, bases))
    return np.linalg.eigvals(across.T @ matrix @ across)


def angle_matrix(weights: np.ndarray, gain: Repulsion) -> np.ndarray:
    """Return A_zeta at the proof point from differences of the law, order phi_1, psi_1, ..."""
    phi, psi = coordinates.angles(proof_point())

    def rates(x: np.ndarray) -> np.ndarray:
        gamma = coordinates.from_angles(x[:, 0::2], x[:, 1::2])
        velocity = law.velocity(gamma, weights, gain)
        p, s = x[:, 0::2], x[:, 1::2]
        phi_rate = velocity[..., 2] / np.cos(p)
        psi_rate = (np.cos(s) * velocity[..., 1] - np.sin(s) * velocity[..., 0]) / np.cos(p)
        return np.stack([phi_rate, psi_rate], axis=-1).reshape(len(x), -1)

    return derivative(rates, np.stack([phi, psi], axis=-1).ravel())


def out_of_plane(gamma: np.ndarray, weights: np.ndarray, gain: Repulsion) -> np.ndarray:
    """Return the system matrix of phi on the equator, from differences of the law, ``(4, 4)``."""
    psi = np.arctan2(gamma[:, 1], gamma[:, 0])
    return derivative(
        lambda phi: law.velocity(coordinates.from_angles(phi, psi), weights, gain)[..., 2]
        / np.cos(phi), np.zeros(4), 1e-3)


def cosine_rates(gamma: np.ndarray, weights: np.ndarray, gain: Repulsion) -> np.ndarray:
    """Return d cos(theta_ij) / dt by the chain rule on the law, ``(..., 6)``."""
    velocity = law.velocity(gamma, weights, gain)
    i, j = np.triu_indices(4, k=1)
    rates: np.ndarray = np.sum(velocity[..., i, :] * gamma[..., j, :]
                               + gamma[..., i, :] * velocity[..., j, :], axis=-1)
    return rates


def cosine_matrix_of(weights: np.ndarray, gain: Gain) -> np.ndarray:
    """Return the linearisation of the xi_s dynamics at xi_s*, from differences."""
    return derivative(lambda xi: coordinates.cosine_velocity(xi, weights, gain),
                      np.full(6, THIRD))


class FixedSlope:
    """A gain with a given value and a given slope at theta*, to tell A1 from A2."""

    def __init__(self, value: float, slope: float) -> None:
        self.value, self.slope = value, slope

    def f(self, theta: ArrayLike) -> np.ndarray:
        """Return f at theta."""
        return self.value + self.slope * (np.asarray(theta, dtype=float) - shapes.THETA_STAR)
