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

"""Section 4.2: the coordinates xi, and the closed loop in them."""

from typing import Any

import numpy as np
from tetra_ros2.formation import coordinates, measures, rotation, sphere, stability
from tetra_ros2.paper.claims.preliminaries import lambda_matrix
from tetra_ros2.paper.differences import cosine_matrix_of, cosine_rates, derivative
from tetra_ros2.paper.formations import random_tetrahedra, THIRD
from tetra_ros2.paper.registry import claim, equal, Result, same_spectrum, vanishes, worst_of
from tetra_ros2.paper.system import SystemUnderTest


@claim('xi-round-trip', 'eq:SF:newCoorTransPara',
       'Gamma from xi = Phi(Gamma) and back, where the chirality is known',
       'random formations, and the singular cases at the poles and at Gamma_2 = -Gamma_1')
def _round_trip(system: SystemUnderTest) -> Result:
    gamma = sphere.random(system.rng, (5000, 4))
    north = coordinates.NORTH
    gamma[0, 0], gamma[1, 0], gamma[2, 1], gamma[3, 1] = north, -north, north, -north
    gamma[4, 1] = -gamma[4, 0]
    back = coordinates.inverse(coordinates.transform(gamma), measures.chirality(gamma))
    # Cosines hold only half of the digits of the angles of nearly coincident agents.
    return vanishes(measures.pairwise_cosines(back) - measures.pairwise_cosines(gamma), 1e-9,
                    f'attitudes, away from the singular: '
                    f'{np.max(np.abs(back[5:] - gamma[5:])):.1g}')


@claim('normalising', 'eq:SF:rotMatrix', 'Gamma_j = R3(psi_1) R2(phi_1) R1(gamma) Gamma~_j',
       'Gamma~_1 = [0,0,1], Gamma~_2 = [sin theta_12, 0, cos theta_12] at random formations')
def _normalising(system: SystemUnderTest) -> Result:
    gamma = sphere.random(system.rng, (5000, 4))
    c12 = np.sum(gamma[:, 0] * gamma[:, 1], axis=-1)
    first = np.broadcast_to(coordinates.NORTH, (5000, 3))
    second = np.stack([np.sqrt(1.0 - c12**2), np.zeros(5000), c12], axis=-1)
    turned = np.stack([first, second], axis=1) @ np.swapaxes(
        coordinates.attitude(coordinates.absolute(gamma)), -1, -2)
    return vanishes(turned - gamma[:, :2], 1e-12)


@claim('local-diffeomorphism', 'Section 4.2, Remark',
       'Phi is a local diffeomorphism off the boundary, which is where the four are on a great '
       'circle, or Gamma_1 at a pole, or Gamma_2 = +-Gamma_1',
       'rank of its derivative at 300 random formations and on small circles; on great circles')
def _local_diffeomorphism(system: SystemUnderTest) -> Result:
    rng = system.rng
    on_small = coordinates.from_angles(0.6, rng.uniform(-np.pi, np.pi, (20, 4)))
    on_great = coordinates.from_angles(0.0, rng.uniform(-np.pi, np.pi, (20, 4)))
    turned = [rotation.rotate(rotation.random(rng, (20,))[:, None], points)
              for points in (on_small, on_great)]

    def rank(points: np.ndarray) -> int:
        bases = stability.tangent_basis(points)

        def moved(q: np.ndarray) -> np.ndarray:
            step = np.einsum('iap,kip->kia', bases, q.reshape(-1, 4, 2))
            xi = coordinates.transform(sphere.exp(points, step))
            xi[:, 7:] = np.angle(np.exp(1j * (xi[:, 7:] - coordinates.transform(points)[7:])))
            return xi

        # The angles turn fast near their poles: the step has to be short against the distance.
        apart = np.linalg.norm(np.cross(points[0], [coordinates.NORTH, points[1]]), axis=-1)
        singular = np.linalg.svd(
            derivative(moved, np.zeros(8), 1e-2 * float(np.min(apart))), compute_uv=False)
        return int(np.sum(singular > 1e-6))

    off = [rank(points) for points in (*sphere.random(rng, (300, 4)), *turned[0])]
    on = [rank(points) for points in turned[1]]
    shown = f'{min(off)} to {max(off)}'
    return Result('8, below it on great circles', shown, '-',
                  min(off) == max(off) == 8 and max(on) < 8, f'on great circles {max(on)} at most')


@claim('gram-identity', 'Section 4.2, Lemma', 'the identity among the six cosines',
       'at random formations')
def _gram(system: SystemUnderTest) -> Result:
    cosines = measures.pairwise_cosines(sphere.random(system.rng, (100000, 4)))
    return equal(1.0, 1.0 + np.max(np.abs(coordinates.gram_identity(cosines) - 1.0)), 1e-12)


@claim('eight-degrees', 'Section 4.2', 'the nine coordinates xi have eight degrees of freedom',
       'rank of the derivative of the six cosines: 5, and of the three angles on top of it: 8')
def _eight(system: SystemUnderTest) -> Result:
    ranks = set()
    for points in sphere.random(system.rng, (20, 4)):
        bases = stability.tangent_basis(points)

        def cosines(q: np.ndarray, points: np.ndarray = points,
                    bases: np.ndarray = bases) -> np.ndarray:
            return measures.pairwise_cosines(sphere.exp(
                points, np.einsum('iap,kip->kia', bases, q.reshape(-1, 4, 2))))

        kept = np.linalg.matrix_rank(derivative(cosines, np.zeros(8)), tol=1e-6)
        turned = np.linalg.matrix_rank(stability.rotations(points, bases), tol=1e-6)
        ranks.add((int(kept), int(kept + turned)))
    shown = ' and '.join(str(r) for r in sorted(ranks))
    return Result('(5, 8)', shown, '-', ranks == {(5, 8)})


PRINTED_H = """
2x1^2-2 x1x2-x4 x1x3-x5 x1x4-x2 x1x5-x3 0
x1x2-x4 2x2^2-2 x2x3-x6 x2x4-x1 0 x2x6-x3
x1x3-x5 x2x3-x6 2x3^2-2 0 x3x5-x1 x3x6-x2
x1x4-x2 x2x4-x1 0 2x4^2-2 x4x5-x6 x4x6-x5
x1x5-x3 0 x3x5-x1 x4x5-x6 2x5^2-2 x5x6-x4
0 x2x6-x3 x3x6-x2 x4x6-x5 x5x6-x4 2x6^2-2
"""
"""The 36 entries of h(xi_s) as eq:SF:newCorDynf1Detial prints them, with x for xi."""


def _printed_h(xi_s: np.ndarray) -> np.ndarray:
    """Return h(xi_s) of PRINTED_H, ``(..., 6, 6)``."""
    x = np.moveaxis(xi_s, -1, 0)

    def value(entry: str) -> Any:
        if entry == '0':
            return 0.0 * x[0]
        if entry.startswith('2'):
            return 2.0 * x[int(entry[2]) - 1] ** 2 - 2.0
        i, j, k = (int(c) - 1 for c in entry if c.isdigit())
        return x[i] * x[j] - x[k]

    rows = [[value(entry) for entry in row.split()] for row in PRINTED_H.split('\n')[1:-1]]
    return np.moveaxis(np.array(rows), (0, 1), (-2, -1))


@claim('triangular', 'eq:SF:newCorDynf1Detial', 'dxi_s/dt = h(xi_s) F(xi_s), of xi_s alone',
       'the printed 36 entries against the chain rule on the law, random formations, both gains')
def _triangular(system: SystemUnderTest) -> Result:
    gamma = sphere.random(system.rng, (5000, 4))
    xi_s, worst = measures.pairwise_cosines(gamma), 0.0
    for gain in system.gains:
        closed = np.einsum('kij,kj->ki', _printed_h(xi_s), gain.f(np.arccos(xi_s)))
        worst = max(worst, np.max(np.abs(
            closed - cosine_rates(gamma, system.complete.weights, gain))))
    return vanishes(max(worst, np.max(np.abs(_printed_h(xi_s) - coordinates.h(xi_s)))), 1e-9)


@claim('omega-t-is-a-point', 'Rmk:SF:maniToPoint',
       'all of Omega_T is one equilibrium of the xi_s dynamics, all cosines -1/3',
       'random tetrahedra of both chiralities: their cosines, and the rates of these')
def _point(system: SystemUnderTest) -> Result:
    gamma = random_tetrahedra(system.rng, 200)
    rates = [cosine_rates(gamma, system.complete.weights, gain) for gain in system.gains]
    return vanishes(np.concatenate([measures.pairwise_cosines(gamma) - THIRD, *rates]), 1e-13)


@claim('xi-split', 'eq:SF:proofLinear6',
       'A1 = (xi-1) Lambda + (7 xi+1) I, A2 = (xi^2-xi) Lambda + (xi^2+xi-2) I',
       'differences of the xi_s dynamics at xi_s*, F and its slope taken apart')
def _xi_split(system: SystemUnderTest) -> Result:
    x, big = THIRD, lambda_matrix(6)
    a1 = (x - 1.0) * big + (7.0 * x + 1.0) * np.eye(6)
    a2 = (x * x - x) * big + (x * x + x - 2.0) * np.eye(6)
    worst = 0.0
    for gain in system.gains:
        f, slope = gain.of_cosine(x), gain.of_cosine_derivative(x)
        found = cosine_matrix_of(system.complete.weights, gain)
        worst = max(worst, np.max(np.abs(found - f * a1 - slope * a2)))
    return vanishes(worst, 1e-10)


@claim('xi-spectrum', 'Thm:SF:CMDetile',
       "xi_s: -8F, -(8/3)F' (2), -(8/3)F - (16/9)F' (3)",
       'differences of the xi_s dynamics, five gains, relative')
def _xi_spectrum(system: SystemUnderTest) -> Result:
    return worst_of(same_spectrum(
        np.linalg.eigvals(cosine_matrix_of(system.complete.weights, gain)),
        stability.complete_cosine_spectrum(gain),
        '-8F leaves the Gram surface: no formation moves that way')
        for gain in system.families)
