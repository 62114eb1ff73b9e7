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
