# Copyright 2026 The tetra_ros2 authors
# SPDX-License-Identifier: Apache-2.0

"""How fast theory lets a formation that is nearly there become what it is going to be."""

import numpy as np

from tetra_ros2.formation import law, measures, sphere

STEP = 1e-5
"""Of the central differences [rad]."""


def transverse_eigenvalues(gamma, weights, gain):
    """
    Return the eigenvalues of the closed loop's linearisation that tell of the shape [1/s].

    Rotating a formation as a whole gives another one just as good: its three directions are taken
    out, and the frame turns with the formation where it spins. At the tetrahedron under the
    complete graph these are the five of eq:SF:proofEigen that are not zero.

    :param gamma: reduced attitudes of a formation that keeps its shape, ``(n, 3)``
    :param weights: ``(n, n)``
    :param gain: a :class:`~tetra_ros2.formation.gain.Gain`
    :returns: complex, the slowest first, ``(2 n - 3,)``; ``(2,)`` for an antipodal pair
    """
    gamma = np.asarray(gamma, dtype=float)
    n = len(gamma)
    basis = _tangent_basis(gamma)
    moved = np.zeros((2 * n, n, 3))
    for column in range(2 * n):
        moved[column, column // 2] = basis[column // 2, column % 2]
    spin = measures.angular_velocity(gamma, law.velocity(gamma, weights, gain))

    def velocity(points):
        return law.velocity(points, weights, gain) - np.cross(spin, points)

    change = (velocity(sphere.exp(gamma, STEP * moved))
              - velocity(sphere.exp(gamma, -STEP * moved))) / (2.0 * STEP)
    matrix = np.einsum('ipa,cia->ipc', basis, change).reshape(2 * n, 2 * n)
    turned = np.einsum('ipa,eia->ipe', basis, np.cross(np.eye(3)[:, None], gamma)).reshape(-1, 3)
    u, singular, _ = np.linalg.svd(turned)
    across = u[:, int(np.sum(singular > 1e-6)):]
    # The rotations span an invariant subspace, so this is the map on the quotient.
    values = np.linalg.eigvals(across.T @ matrix @ across)
    return values[np.argsort(-values.real, kind='stable')]


def slowest_rate(gamma, weights, gain):
    """
    Return the rate at which the error of a formation nearby decays in the end [1/s].

    :param gamma: reduced attitudes of a formation that keeps its shape, ``(n, 3)``
    :param weights: ``(n, n)``
    :param gain: a :class:`~tetra_ros2.formation.gain.Gain`
    :returns: None where it does not decay
    """
    rate = -float(transverse_eigenvalues(gamma, weights, gain)[0].real)
    return rate if rate > 1e-6 else None


def _tangent_basis(gamma):
    """Return two orthonormal tangent vectors at each point, ``(n, 2, 3)``."""
    least = np.eye(3)[np.argmin(np.abs(gamma), axis=-1)]
    first = sphere.normalize(np.cross(gamma, least))
    return np.stack([first, np.cross(gamma, first)], axis=-2)
