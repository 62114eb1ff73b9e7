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
The search for relative equilibria: by Newton's method, and by following the closed loop.

What is known of one that was found is in :mod:`~tetra_ros2.formation.stability`.
"""

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray
from tetra_ros2.formation import equivalence, flow, law, measures, polyhedra, sphere
from tetra_ros2.formation._types import Array
from tetra_ros2.formation.gain import Gain
from tetra_ros2.formation.stability import (
    ACCURACY,
    fastest_rate,
    inertia,
    linearization,
    RelativeEquilibrium,
    rotations,
    tangent_basis,
    transverse,
)


def refine(gamma: ArrayLike, weights: Array, gain: Gain, iterations: int = 50,
           longest: float = 0.3) -> tuple[Array, Array]:
    """
    Take Newton steps towards relative equilibria, stable or not.

    :param gamma: reduced attitudes, ``(..., n, 3)``
    :param weights: ``(n, n)``
    :param gain: a :class:`~tetra_ros2.formation.gain.Gain`
    :param iterations: how many steps
    :param longest: the longest step of an agent [rad]
    :returns: reduced attitudes, ``(..., n, 3)``, and the largest velocity left beside a spin of
        the whole [1/s], ``(...)``
    """
    gamma = np.asarray(gamma, dtype=float)
    n = gamma.shape[-2]
    unit = fastest_rate(weights, gain) or 1.0
    for _ in range(iterations):
        left, spin = _beside_spin(gamma, weights, gain)
        bases = tangent_basis(gamma)
        matrix = linearization(gamma, weights, gain, bases, spin)
        turned = rotations(gamma, bases)
        # The spin is unknown too, in the unit of the other rates. The shortest solution leaves
        # the attitude of the whole alone.
        system = np.concatenate([matrix, unit * turned], axis=-1)
        target = np.einsum('...iap,...ia->...ip', bases, left).reshape(*gamma.shape[:-2], 2 * n)
        step = -np.einsum('...ij,...j->...i', np.linalg.pinv(system, rcond=1e-10), target)
        step = step[..., :2 * n].reshape(*gamma.shape[:-2], n, 2)
        moved = np.einsum('...iap,...ip->...ia', bases, step)
        size = np.max(np.linalg.norm(moved, axis=-1), axis=-1)[..., None, None]
        gamma = sphere.normalize(
            sphere.exp(gamma, moved * np.minimum(1.0, longest / np.maximum(size, 1e-300))))
    left, _ = _beside_spin(gamma, weights, gain)
    return gamma, np.max(np.abs(left), axis=(-2, -1))


def _beside_spin(gamma: Array, weights: Array, gain: Gain) -> tuple[Array, Array]:
    """Return the velocities beside a spin of the whole [1/s], and that spin [rad/s]."""
    velocity = law.velocity(gamma, weights, gain)
    spin = measures.angular_velocity(gamma, velocity)
    return velocity - np.cross(spin[..., None, :], gamma), spin


def straighten(gamma: ArrayLike) -> Array:
    """
    Return formations whose agents all lie on a line, to within ACCURACY, exactly on it.

    There the law commands nothing, whatever weights and gain: so this is an equilibrium, and
    Newton's method need not get closer to it, which it often cannot.

    :param gamma: reduced attitudes, ``(..., n, 3)``
    :returns: the same, and those on a line improved, ``(..., n, 3)``
    """
    gamma = np.asarray(gamma, dtype=float)
    _, singular, directions = np.linalg.svd(gamma)
    line = directions[..., 0, :]
    along = np.sign(np.einsum('...ia,...a->...i', gamma, line))
    straight = singular[..., 1] < ACCURACY
    return np.where(straight[..., None, None], along[..., None] * line[..., None, :], gamma)


@dataclass(frozen=True, eq=False)
class Equilibrium(RelativeEquilibrium):
    """
    One relative equilibrium out of many that the law cannot tell apart.

    :param kind: what it looks like; see :func:`classify`
    :param found: from how many starts
    """

    kind: str
    found: int

    @property
    def reduced_attitudes(self) -> Array:
        """Return gamma, unit vectors, ``(n, 3)``."""
        return self.gamma

    @property
    def spin_rate(self) -> float:
        """Return the angular speed of the whole [rad/s]; 0 at rest."""
        return float(np.linalg.norm(self.spin))

    @property
    def stability(self) -> str:
        """
        Return what the linearisation says of the shape.

        ``stable``: every deviation decays. ``unstable``: one grows. ``undecided``: an eigenvalue
        has the real part 0 and none a positive one, so that terms of higher order decide.
        """
        positive, zero, _ = self.inertia
        return 'unstable' if positive else 'undecided' if zero else 'stable'


def find_equilibria(rng: np.random.Generator, weights: Array, gain: Gain, starts: int = 400,
                    tolerance: float = 1e-10,
                    iterations: int = 60) -> tuple[list[Equilibrium], int]:
    """
    Look for relative equilibria, at rest or spinning, by Newton's method from random starts.

    Equilibria are counted as one if the law makes no difference between them: if rotations,
    reflections and automorphisms of the weights join them; see
    :mod:`~tetra_ros2.formation.equivalence`. A reflection turns a spin into the opposite one.

    :param rng: a ``numpy.random.Generator``
    :param weights: ``(n, n)``
    :param gain: a :class:`~tetra_ros2.formation.gain.Gain`
    :param starts: how many
    :param tolerance: the largest velocity beside the spin that counts as none, and the slowest
        spin that counts as one, relative to what the law could command
    :param iterations: of Newton's method
    :returns: a list of :class:`Equilibrium`, the most often found first; and how many starts
        ended nowhere
    """
    n = len(weights)
    gamma = sphere.random(rng, (starts, n))
    # Starts in a plane and starts with coincident agents reach what the others hardly ever do.
    gamma[::3] = sphere.normalize(gamma[::3] * [1.0, 1.0, 0.0])
    gamma[1::6, 0] = gamma[1::6, 1]
    gamma, left = refine(gamma, weights, gain, iterations)
    unit = fastest_rate(weights, gain) or 1.0
    there = straighten(gamma[left < tolerance * unit])
    found: list[list[Any]] = []  # a formation, and how often
    for points in there:
        for entry in found:
            if equivalence.equivalent(points, entry[0], weights, ACCURACY):
                entry[1] += 1
                break
        else:
            found.append([points, 1])
    found.sort(key=lambda entry: -entry[1])
    equilibria = []
    for points, count in found:
        at = transverse(points, weights, gain)
        spin = at.spin if np.linalg.norm(at.spin) > tolerance * unit else np.zeros(3)
        equilibria.append(Equilibrium(
            at.gamma, spin, at.residual, at.matrix, classify(points), count))
    return equilibria, starts - len(there)


def is_coplanar(gamma: ArrayLike, tolerance: float = 1e-6) -> NDArray[np.bool_]:
    """Return whether all lie on one great circle, ``(...)``; the lemma's Omega_C."""
    return np.linalg.svd(np.asarray(gamma, float), compute_uv=False)[..., 2] < tolerance


def classify(gamma: ArrayLike, tolerance: float = 1e-5) -> str:
    """
    Say in words what shape a formation has.

    :param gamma: reduced attitudes, ``(n, 3)``
    :param tolerance: on the cosines
    """
    gamma = np.asarray(gamma, dtype=float)
    cosines = np.sort(measures.pairwise_cosines(gamma))

    def is_like(*expected: float) -> bool:
        return len(expected) == len(cosines) and np.allclose(cosines, expected, 0.0, tolerance)

    if np.all(cosines > 1.0 - tolerance):
        return 'consensus'
    for solid, points in polyhedra.SOLIDS.items():
        if len(points) == len(gamma) and is_like(*np.sort(measures.pairwise_cosines(points))):
            return solid
    if is_like(-1.0, -1.0, 0.0, 0.0, 0.0, 0.0):
        return 'cross'
    if np.all(np.abs(np.abs(cosines) - 1.0) < tolerance):
        one_side = int(np.sum(gamma @ gamma[0] > 0.0))
        fewer = min(one_side, len(gamma) - one_side)
        return f'{len(gamma) - fewer} against {fewer}'
    if is_like(*[-0.5] * 5, 1.0):
        return 'triangle with a pair'
    return 'other coplanar' if is_coplanar(gamma, 10.0 * tolerance) else 'other spatial'


def settle(gamma: Array, weights: Array, gain: Gain, longest: float = 2000.0,
           calm: float = 1e-3) -> Array | None:
    """
    Follow the closed loop until it keeps its shape, and polish what it has come to.

    :param gamma: reduced attitudes at the start, ``(n, 3)``
    :param weights: ``(n, n)``
    :param gain: a :class:`~tetra_ros2.formation.gain.Gain`
    :param longest: when to give up, in units of ``1 / max row sum of W f(0)``
    :param calm: how slow a change of shape, relative to f, lets Newton's method take over
    :returns: reduced attitudes, ``(n, 3)``, or None if the shape keeps changing
    """
    unit = fastest_rate(weights, gain) or 1.0
    for step in flow.follow(gamma, weights, gain, 1e-6):
        here = step.after
        velocity = law.velocity(here, weights, gain)
        spin = measures.angular_velocity(here, velocity)
        if np.max(np.abs(velocity - np.cross(spin, here))) < calm * unit:
            polished, left = refine(here, weights, gain, 25)
            # A saddle is slow as well: only what attracts is where the loop is going.
            if left < 1e-9 * unit and inertia(
                    transverse(polished, weights, gain).eigenvalues)[0] == 0:
                return polished
        if step.end * unit > longest:
            break
    return None
