# Copyright 2026 The tetra_ros2 authors
# SPDX-License-Identifier: Apache-2.0

"""The formations that the paper speaks of."""

import numpy as np
from tetra_ros2.formation import coordinates, rotation, shapes, stability

THIRD = -1.0 / 3.0


TETRAHEDRON = shapes.TETRAHEDRON.points


def proof_point() -> np.ndarray:
    """Return the tetrahedron at which the paper linearises, ``(4, 3)``; eq:SF:proofPoint."""
    i = np.arange(4)
    return coordinates.from_angles(
        (-1.0) ** i * np.arcsin(np.sqrt(3.0) / 3.0), np.pi / 4.0 + i * np.pi / 2.0)


def random_tetrahedra(rng: np.random.Generator, count: int) -> np.ndarray:
    """Return tetrahedra of both chiralities at random attitudes, ``(count, 4, 3)``."""
    turned = rotation.rotate(rotation.random(rng, (count,))[:, None, :], TETRAHEDRON)
    turned[1::2] = stability.mirrored(turned[1::2])
    return turned


def coplanar(rng: np.random.Generator, count: int) -> tuple[np.ndarray, np.ndarray]:
    """Return formations on the equator, ``(count, 4, 3)``, and their longitudes."""
    psi = rng.uniform(-np.pi, np.pi, (count, 4))
    return coordinates.from_angles(np.zeros_like(psi), psi), psi
