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
How the closed loop behaves near a formation that rests or spins steadily.

A formation that turns as one rigid body is a relative equilibrium: at rest in a frame that turns
with it. Rotating it as a whole gives another one, so three eigenvalues of its linearisation say
nothing about its shape. :func:`transverse` takes them out.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike
from tetra_ros2.formation import coordinates, law, measures, sphere
from tetra_ros2.formation._types import Array, Spectrum
from tetra_ros2.formation.gain import Gain

LEGENDRE = np.polynomial.legendre.leggauss(48)
"""Nodes and weights on [-1, 1]; 48 of them integrate any gain here to rounding."""

ZERO = 1e-9
"""A real part below this, relative to the largest eigenvalue, is zero to rounding."""

SLOW = 1e-7
"""A real part below this, relative to the largest eigenvalue, is no rate that anybody sees."""

ACCURACY = 1e-4
"""
How far from an equilibrium Newton's method may end, in rad.

Where the linearisation is singular the residual can vanish with the third power of the distance,
as for antipodal agents under the cosine gain. Rounding of 1e-16 then hides a distance of 5e-6.
"""


def lyapunov(gamma: ArrayLike, weights: Array, gain: Gain) -> Array:
    """
    Return ``V = sum W(i,j) int_theta_ij^pi f(x) sin(x) dx`` over ordered pairs, ``(...)``.

    From the proof of Thm:SF:stableEquiSet; with symmetric weights V never grows.

    :param gamma: reduced attitudes, ``(..., n, 3)``
    :param weights: ``(n, n)``
    :param gain: a :class:`~tetra_ros2.formation.gain.Gain`
    """
    gamma = np.asarray(gamma, dtype=float)
    theta = sphere.geodesic_distance(gamma[..., :, None, :], gamma[..., None, :, :])
    nodes, node_weights = LEGENDRE
    half = 0.5 * (np.pi - theta)
    x = half[..., None] * nodes + 0.5 * (np.pi + theta)[..., None]
    integral = half * np.sum(node_weights * gain.f(x) * np.sin(x), axis=-1)
    result: Array = np.sum(weights * integral, axis=(-2, -1))
    return result


def lyapunov_rate(gamma: Array, velocity: Array, weights: Array, gain: Gain) -> Array:
    """
    Return the derivative of V along any motion [1/s^2], ``(...)``, by the chain rule.

    Along the closed loop of symmetric weights it is ``-2 sum |w_i|^2``; Thm:SF:stableEquiSet.

    :param gamma: reduced attitudes, ``(..., n, 3)``
    :param velocity: ``dGamma/dt`` [1/s], ``(..., n, 3)``
    :param weights: ``(n, n)``
    :param gain: a :class:`~tetra_ros2.formation.gain.Gain`
    """
    theta = sphere.geodesic_distance(gamma[..., :, None, :], gamma[..., None, :, :])
    product = velocity @ np.swapaxes(gamma, -1, -2)
    cosine_rate = product + np.swapaxes(product, -1, -2)
    result: Array = np.sum(weights * gain.f(theta) * cosine_rate, axis=(-2, -1))
    return result


def fastest_rate(weights: Array, gain: Gain) -> float:
    """Return a bound of the angular velocity that the law can command [rad/s]; 0 for no edge."""
    return float(np.max(np.sum(np.abs(weights), axis=1)) * gain.f(0.0))


def tangent_basis(gamma: Array) -> Array:
    """
    Return orthonormal bases of the tangent planes, as columns, ``(..., n, 3, 2)``.

    :param gamma: unit vectors, ``(..., n, 3)``
    """
    # A normal of the least aligned basis vector is the best conditioned.
    least = np.eye(3)[np.argmin(np.abs(gamma), axis=-1)]
    first = sphere.normalize(np.cross(gamma, least))
    return np.stack([first, np.cross(gamma, first)], axis=-1)


def _bring_down(blocks: Array, bases: Array) -> Array:
    """Return ``B_i^T blocks_ij B_j`` as one matrix, ``(..., 2 n, 2 n)``."""
    small = np.einsum('...iap,...ijab,...jbq->...ipjq', bases, blocks, bases)
    size = 2 * bases.shape[-3]
    result: Array = small.reshape(*small.shape[:-4], size, size)
    return result


def linearization(gamma: ArrayLike, weights: Array, gain: Gain, bases: Array,
                  spin: Array | None = None) -> Array:
    """
    Return the derivative of the closed loop's right-hand side in tangent coordinates.

    At an equilibrium this is the system matrix, similar to the paper's A_zeta.

    :param gamma: reduced attitudes, ``(..., n, 3)``
    :param weights: ``(n, n)``
    :param gain: a :class:`~tetra_ros2.formation.gain.Gain`
    :param bases: of :func:`tangent_basis`
    :param spin: angular velocity of the frame [rad/s], ``(..., 3)``; the world's by default
    :returns: ``(..., 2 n, 2 n)`` [1/s]
    """
    gamma = np.asarray(gamma, dtype=float)
    n = gamma.shape[-2]
    theta = sphere.geodesic_distance(gamma[..., :, None, :], gamma[..., None, :, :])
    c, s = np.cos(theta), np.sin(theta)
    # away_ij = c_ij Gamma_i - Gamma_j is the way i flees from j, of length sin theta_ij.
    away = c[..., None] * gamma[..., :, None, :] - gamma[..., None, :, :]
    rate = weights * gain.f(theta)
    slope = np.divide(-(weights * gain.derivative(theta)), s, out=np.zeros_like(s), where=s > 1e-9)
    identity = np.eye(3)
    outer = away[..., :, None] * away[..., None, :]
    mixed = away[..., :, None] * np.swapaxes(away, -2, -3)[..., None, :]
    blocks = -slope[..., None, None] * mixed - rate[..., None, None] * identity
    own = np.sum((rate * c)[..., None, None] * identity - slope[..., None, None] * outer, axis=-3)
    if spin is not None:
        own = own - sphere.hat(spin)[..., None, :, :]
    i = np.arange(n)
    # An agent has no edge to itself: the diagonal of `blocks` is zero so far.
    blocks[..., i, i, :, :] = own
    return _bring_down(blocks, bases)


def rotations(gamma: Array, bases: Array) -> Array:
    """
    Return what the three rotations of the whole do to it, in tangent coordinates.

    :param gamma: reduced attitudes, ``(..., n, 3)``
    :param bases: of :func:`tangent_basis`
    :returns: ``(..., 2 n, 3)``
    """
    moved = np.cross(np.eye(3)[:, None, :], gamma[..., None, :, :])  # (..., 3, n, 3)
    small = np.einsum('...iap,...eia->...ipe', bases, moved)
    result: Array = small.reshape(*small.shape[:-3], 2 * gamma.shape[-2], 3)
    return result


def complement(vectors: Array, accuracy: float = 1e-9) -> Array:
    """
    Return an orthonormal basis of the complement of the columns' span, ``(m, m - rank)``.

    :param vectors: the columns, ``(m, k)``
    :param accuracy: what is shorter than this, relative to the longest, counts as zero
    """
    u, singular, _ = np.linalg.svd(vectors)
    return u[:, int(np.sum(singular > accuracy * max(singular[0], 1e-300))):]


@dataclass(frozen=True, eq=False)
class RelativeEquilibrium:
    """
    A formation that keeps its shape, and its linearisation.

    :param gamma: reduced attitudes, ``(n, 3)``
    :param spin: its angular velocity in the world frame [rad/s], ``(3,)``; zero at rest
    :param residual: the largest velocity beside the spin [1/s]
    :param matrix: the linearisation transverse to the rotations, in the turning frame, [1/s]
    """

    gamma: Array
    spin: Array
    residual: float
    matrix: Array

    @property
    def eigenvalues(self) -> Spectrum:
        """Return the transverse eigenvalues [1/s], the slowest first."""
        values = np.linalg.eigvals(self.matrix)
        return values[np.lexsort((values.imag, -values.real))]

    @property
    def inertia(self) -> tuple[int, int, int]:
        """Return how many transverse eigenvalues have positive, zero and negative real part."""
        return inertia(self.eigenvalues)

    @property
    def decaying(self) -> Spectrum:
        """Return the eigenvalues of the deviations that decay [1/s], the slowest first."""
        values = self.eigenvalues
        result: Spectrum = values[values.real < -SLOW * np.max(np.abs(values), initial=0.0)]
        return result

    @property
    def is_hyperbolic(self) -> bool:
        """Return whether no eigenvalue has a real part of zero, to within SLOW."""
        values = self.eigenvalues
        return bool(np.all(np.abs(values.real) > SLOW * np.max(np.abs(values), initial=0.0)))

    @property
    def spins(self) -> bool:
        """Return whether it turns, and does not just seem to by rounding."""
        return bool(np.linalg.norm(self.spin)
                    > ZERO * np.max(np.abs(self.eigenvalues), initial=0.0))


def inertia(eigenvalues: ArrayLike) -> tuple[int, int, int]:
    """Return how many eigenvalues have a positive, a zero and a negative real part."""
    real = np.real(eigenvalues)
    zero = np.abs(real) <= ZERO * max(1e-300, float(np.max(np.abs(eigenvalues), initial=0.0)))
    return (int(np.sum((real > 0) & ~zero)), int(np.sum(zero)),
            int(np.sum((real < 0) & ~zero)))


def transverse(gamma: ArrayLike, weights: Array, gain: Gain) -> RelativeEquilibrium:
    """
    Return the :class:`RelativeEquilibrium` at hand; its residual says how nearly it is one.

    :param gamma: reduced attitudes, ``(n, 3)``
    :param weights: ``(n, n)``
    :param gain: a :class:`~tetra_ros2.formation.gain.Gain`
    """
    gamma = np.asarray(gamma, dtype=float)
    velocity = law.velocity(gamma, weights, gain)
    spin = measures.angular_velocity(gamma, velocity)
    bases = tangent_basis(gamma)
    matrix = linearization(gamma, weights, gain, bases, spin)
    # Agents on a line do not notice rotations about it: there are but two that move them.
    across = complement(rotations(gamma, bases), ACCURACY)
    # The rotations span an invariant subspace, so this is the map on the quotient.
    return RelativeEquilibrium(
        gamma, spin, float(np.max(np.abs(velocity - np.cross(spin, gamma)))),
        across.T @ matrix @ across)


def sorted_spectrum(eigenvalues: ArrayLike) -> Spectrum:
    """Return eigenvalues in an order fit for comparing, by real, then imaginary part."""
    values = np.asarray(eigenvalues, dtype=complex)
    return values[np.lexsort((values.imag, np.round(values.real, 9)))]


def complete_spectrum(gain: Gain) -> Array:
    """
    Return the paper's spectrum at the tetrahedron under the complete graph [1/s], ``(8,)``.

    ``{2 sqrt2 f' (2), (4 sqrt2 / 3) f' - (8/3) f (3), 0 (3)}``; eq:SF:proofEigen.
    """
    theta = np.arccos(-1.0 / 3.0)
    f, slope = gain.f(theta), gain.derivative(theta)
    return np.array([2.0 * np.sqrt(2.0) * slope] * 2
                    + [4.0 * np.sqrt(2.0) / 3.0 * slope - 8.0 / 3.0 * f] * 3 + [0.0] * 3)


def complete_cosine_spectrum(gain: Gain) -> Array:
    """
    Return the paper's spectrum of the xi_s dynamics, complete graph [1/s], ``(6,)``.

    ``{-8 F, -(8/3) F' (2), -(8/3) F - (16/9) F' (3)}``. The first belongs to the direction in
    which all six cosines grow together. It leaves the surface of the Gram identity, so no
    formation ever moves along it: -8 F is a rate that nobody can measure.
    """
    f, slope = gain.of_cosine(-1.0 / 3.0), gain.of_cosine_derivative(-1.0 / 3.0)
    return np.array([-8.0 * f] + [-8.0 / 3.0 * slope] * 2
                    + [-8.0 / 3.0 * f - 16.0 / 9.0 * slope] * 3)


def angle_linearization(gamma: Array, weights: Array, gain: Gain) -> Array:
    """
    Return the linearisation in roll-pitch-yaw angles at an equilibrium; A_zeta.

    :param gamma: an equilibrium away from the poles, ``(n, 3)``
    :param weights: ``(n, n)``
    :param gain: a :class:`~tetra_ros2.formation.gain.Gain`
    :returns: ``(2 n, 2 n)`` [1/s], in the paper's order phi_1, psi_1, phi_2, ...
    """
    phi, psi = coordinates.angles(gamma)
    n = len(gamma)
    # Unit vectors north and east, and how far one radian of phi or psi goes along them.
    bases = np.stack([
        np.stack([-np.sin(phi) * np.cos(psi), -np.sin(phi) * np.sin(psi), np.cos(phi)], axis=-1),
        np.stack([-np.sin(psi), np.cos(psi), np.zeros(n)], axis=-1)], axis=-1)
    scale = np.stack([np.ones(n), np.cos(phi)], axis=-1).ravel()
    result: Array = linearization(gamma, weights, gain, bases) * scale / scale[:, None]
    return result


def mirrored(gamma: ArrayLike) -> Array:
    """Return the mirror image in the plane x-z, of the other chirality, ``(..., n, 3)``."""
    return np.asarray(gamma) * [1.0, -1.0, 1.0]


def rotating_spectrum(gain: Gain) -> Spectrum:
    """
    Return the transverse spectrum at the tetrahedron under the rotating graph [1/s], ``(5,)``.

    The paper says of it that it is Hurwitz (thm:RF:LocalStable). The cycle of three splits the
    cosines into sectors: one real eigenvalue, ``-(4/3) F - (8/9) F'``, and the two of a matrix
    on the sector that turns by a third of a circle per agent, with their conjugates. A sixth
    one of the xi_s dynamics, -4 F, leaves the surface of the Gram identity, as -8 F does in
    :func:`complete_cosine_spectrum`.
    """
    f, slope = gain.of_cosine(-1.0 / 3.0), gain.of_cosine_derivative(-1.0 / 3.0)
    r = 1j * np.sqrt(3.0)
    sector = (f * np.array([[-2.0 / 3.0 - r / 2.0, -7.0 / 12.0 + r / 4.0],
                            [-1.0 / 3.0 - r / 3.0, -2.0 / 3.0 + r / 3.0]])
              + slope * np.array([[-10.0 / 9.0, 4.0 / 9.0],
                                  [1.0 / 9.0 + r / 9.0, -10.0 / 9.0 + 2.0 * r / 9.0]]))
    pair = np.linalg.eigvals(sector)
    return np.array([-4.0 / 3.0 * f - 8.0 / 9.0 * slope, *pair, *np.conj(pair)])
