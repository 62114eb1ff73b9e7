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

"""Section 2 and Appendix A.1: the sphere, and matrices."""

import math

import numpy as np
from tetra_ros2.formation import rotation, sphere
from tetra_ros2.paper.registry import claim, Result, vanishes
from tetra_ros2.paper.system import SystemUnderTest


@claim('geodesic', 'Section 2.1', 'Gamma_j = exp(theta_ij k_ij^) Gamma_i',
       'identity at random pairs')
def _geodesic(system: SystemUnderTest) -> Result:
    x, y = sphere.random(system.rng, (2, 10000))
    cross = np.cross(x, y)
    theta = np.arccos(np.clip(np.sum(x * y, axis=-1), -1.0, 1.0))
    k = cross / np.sin(theta)[:, None]
    return vanishes(rotation.rotate(rotation.exp(theta[:, None] * k), x) - y, 1e-9)


@claim('geodesic-ends', 'Section 2.1',
       'where theta_ij is 0 or pi, any unit k_ij orthogonal to Gamma_i will do',
       'identity at random points and random such k_ij, Gamma_j = Gamma_i and -Gamma_i')
def _geodesic_ends(system: SystemUnderTest) -> Result:
    x, any_vector = sphere.random(system.rng, (2, 10000))
    k = sphere.normalize(np.cross(x, any_vector))
    return vanishes([rotation.rotate(rotation.exp(theta * k), x) - math.cos(theta) * x
                     for theta in (0.0, math.pi)], 1e-12)


@claim('kinematics', 'eq:pre:DGamma', 'dGamma_i/dt = omega_i^ Gamma_i, and Gamma stays unit',
       'difference quotient of R b under R <- R exp(h w^), random attitudes')
def _kinematics(system: SystemUnderTest) -> Result:
    rng = system.rng
    attitudes, axis = rotation.random(rng, (1000,)), sphere.random(rng)
    w = rng.standard_normal((1000, 3))
    gamma = rotation.rotate(attitudes, axis)

    def after(h: float) -> np.ndarray:
        return rotation.rotate(rotation.multiply(rotation.exp(h * w), attitudes), axis)

    rate = (after(1e-5) - after(-1e-5)) / 2e-5
    return vanishes(rate - np.einsum('kij,kj->ki', sphere.hat(w), gamma), 1e-8)


@claim('cosine-formula', 'Thm:PR:cosine',
       'cos(ij) = cos(ik) cos(jk) + sin(ik) sin(jk) k_ik . k_jk', 'identity at random triples')
def _cosine_formula(system: SystemUnderTest) -> Result:
    gi, gj, gk = sphere.random(system.rng, (3, 100000))

    def angle_and_normal(a: np.ndarray, b: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        theta = np.arccos(np.clip(np.sum(a * b, axis=-1), -1.0, 1.0))
        return theta, np.cross(a, b) / np.sin(theta)[:, None]

    (ik, k_ik), (jk, k_jk) = angle_and_normal(gi, gk), angle_and_normal(gj, gk)
    right = np.cos(ik) * np.cos(jk) + np.sin(ik) * np.sin(jk) * np.sum(k_ik * k_jk, axis=-1)
    return vanishes(np.sum(gi * gj, axis=-1) - right, 1e-11)


@claim('simultaneous', 'Thm:pre:simuDiagonalize',
       'diagonalisable A, B: simultaneously so if and only if AB = BA',
       'random commuting and not commuting pairs; the eigenvectors of A + B on both')
def _simultaneous(system: SystemUnderTest) -> Result:
    rng, worst, least = system.rng, 0.0, math.inf
    for _ in range(50):
        p = rng.standard_normal((6, 6)) + 3.0 * np.eye(6)
        a, b = (p @ np.diag(rng.standard_normal(6)) @ np.linalg.inv(p) for _ in range(2))
        other = rng.standard_normal((6, 6))
        for matrix, commutes in ((b, True), (other + other.T, False)):
            vectors = np.linalg.eig(a + matrix)[1]
            left = 0.0
            for m in (a, matrix):
                turned = np.linalg.solve(vectors, m @ vectors)
                left = max(left, np.max(np.abs(turned - np.diag(np.diag(turned)))))
            worst, least = (max(worst, left), least) if commutes else (worst, min(least, left))
    return Result(0.0, worst, 1e-6, worst < 1e-6 and least > 1e-3,
                  f'not commuting: {least:.2g} is left off the diagonal at least')


@claim('exchange-commutes', 'Thm:PR:AJCommutative',
       'A symmetric and persymmetric commutes with the exchange matrix J; J^T J = I',
       'random matrices of 2 to 9 rows')
def _exchange(system: SystemUnderTest) -> Result:
    worst = 0.0
    for n in range(2, 10):
        j = np.fliplr(np.eye(n))
        a = system.rng.standard_normal((n, n))
        a = a + a.T
        a = a + j @ a.T @ j
        worst = max(worst, np.max(np.abs(a @ j - j @ a)), np.max(np.abs(j.T @ j - np.eye(n))))
    return vanishes(worst, 1e-13)


def lambda_matrix(n: int) -> np.ndarray:
    """Return Lambda_n = E_n - J of Thm:PR:lambdaMatrix."""
    return np.ones((n, n)) - np.fliplr(np.eye(n))


@claim('lambda-even', 'Thm:PR:lambdaMatrix', 'Lambda_n has n - 1 and (-1)^i, i = 2..n; n even',
       'eigenvalues for n = 2, 4, ..., 40', parity=0)
@claim('lambda-odd', 'Thm:PR:lambdaMatrix', 'Lambda_n has n - 1 and (-1)^i, i = 2..n; n odd',
       'eigenvalues for n = 3, 5, ..., 41', parity=1)
def _lambda(system: SystemUnderTest, parity: int) -> Result:
    worst = 0.0
    for n in range(2 + parity, 42, 2):
        claimed = np.sort([n - 1.0, *((-1.0) ** np.arange(2, n + 1))])
        worst = max(worst, np.max(np.abs(np.linalg.eigvalsh(lambda_matrix(n)) - claimed)))
    return vanishes(worst, 1e-11)


@claim('ones-determinant', 'Appendix A.1', 'det(lambda I - E_n) = (lambda - n) lambda^(n-1)',
       'at random lambda, n = 2..12, relative')
def _ones_determinant(system: SystemUnderTest) -> Result:
    worst = 0.0
    for n in range(2, 13):
        for value in system.rng.uniform(-2.0 * n, 2.0 * n, 20):
            claimed = (value - n) * value ** (n - 1)
            found = np.linalg.det(value * np.eye(n) - np.ones((n, n)))
            worst = max(worst, abs(found - claimed) / max(abs(value), 1.0) ** n)
    return vanishes(worst, 1e-11)


@claim('exchange-spectrum', 'Appendix A.1', 'J has the eigenvalues (-1)^i, i = 1..6',
       'eigenvalues of the exchange matrix of six rows')
def _exchange_spectrum(_system: SystemUnderTest) -> Result:
    found = np.linalg.eigvalsh(np.fliplr(np.eye(6)))
    return vanishes(found - np.sort((-1.0) ** np.arange(1, 7)), 1e-13,
                    'for odd n these are the eigenvalues of -J')
