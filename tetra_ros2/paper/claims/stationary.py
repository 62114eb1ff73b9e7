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

"""Sections 4.1 and 4.2: the equilibria attract, and the tetrahedron among them is stable."""

import math
from typing import Any

import numpy as np
from numpy.typing import ArrayLike
from tetra_ros2.formation import flow, law, shapes, sphere, stability
from tetra_ros2.formation import gain as gains
from tetra_ros2.paper.claims._common import rate_of_run
from tetra_ros2.paper.differences import (
    angle_matrix,
    differentiated_law,
    FixedSlope,
    transverse_spectrum,
)
from tetra_ros2.paper.formations import random_tetrahedra, TETRAHEDRON
from tetra_ros2.paper.registry import claim, negative, Result, same_spectrum, vanishes, worst_of
from tetra_ros2.paper.system import SystemUnderTest


class _Square:
    """A gain that is nonnegative, bounded and smooth, and satisfies no other assumption."""

    def __init__(self, coefficients: np.ndarray) -> None:
        values = np.polynomial.chebyshev.chebval(np.linspace(-1.0, 1.0, 400), coefficients)
        self.coefficients = coefficients / np.max(np.abs(values))

    def f(self, theta: ArrayLike) -> np.ndarray:
        """Return f at theta, at most 1: the square of a polynomial, which has zeros."""
        x = np.asarray(theta) * (2.0 / math.pi) - 1.0
        square: np.ndarray = np.polynomial.chebyshev.chebval(x, self.coefficients) ** 2
        return square


def _nonnegative(system: SystemUnderTest, count: int) -> list[Any]:
    """Return the two gains under test, and random nonnegative ones."""
    return [*system.gains, *(_Square(c) for c in system.rng.standard_normal((count, 5)))]


@claim('lyapunov', 'Thm:SF:stableEquiSet', "V' = -2 sum |omega_i|^2 along the closed loop",
       'difference quotient of V along the flow at random formations, both gains and 50 random '
       'nonnegative f')
def _lyapunov(system: SystemUnderTest) -> Result:
    weights, worst = system.complete.weights, 0.0
    full = 1.0 - np.eye(4)
    gamma = sphere.random(system.rng, (100, 4))
    for gain in _nonnegative(system, 50):
        velocity = law.velocity(gamma, weights, gain)

        def along(t: float, velocity: np.ndarray = velocity, gain: Any = gain) -> np.ndarray:
            return stability.lyapunov(sphere.exp(gamma, t * velocity), full, gain)

        rate = (8.0 * (along(1e-3) - along(-1e-3)) - (along(2e-3) - along(-2e-3))) / 0.012
        speed = np.sum(law.world_angular_velocity(gamma, weights, gain) ** 2, axis=(-2, -1))
        worst = max(worst, np.max(np.abs(rate + 2.0 * speed)))
    return vanishes(worst, 1e-6)


@claim('omega-attracts', 'Thm:SF:stableEquiSet', 'every trajectory approaches the equilibria',
       'speed left after a long time from random starts, relative to the largest f, and the '
       'largest rise of V on the way; both gains and 8 random nonnegative f')
def _omega_attracts(system: SystemUnderTest) -> Result:
    weights, full = system.complete.weights, 1.0 - np.eye(4)
    speed, rise = 0.0, -math.inf
    theta = np.linspace(0.0, math.pi, 400)
    for gain in _nonnegative(system, 8):
        largest = float(np.max(gain.f(theta)))
        start = sphere.random(system.rng, (system.times(10), 4))
        path = flow.reduced_attitudes(
            start, weights, gain, np.linspace(0.0, 400.0 / largest, 21), 1e-9)
        left = np.max(np.abs(law.velocity(path[-1], weights, gain))) / largest
        value = np.array([stability.lyapunov(gamma, full, gain) for gamma in path])
        speed, rise = max(speed, left), max(rise, np.max(np.diff(value, axis=0)))
    return Result(0.0, float(speed), 1e-3, bool(speed < 1e-3 and rise < 1e-6),
                  f'V rises by {max(rise, 0.0):.1g} at most; equilibria of these f attract '
                  'algebraically, not exponentially, where f vanishes')


class _Polynomial:
    """A gain that satisfies no assumption."""

    def __init__(self, coefficients: np.ndarray) -> None:
        self.coefficients = coefficients

    def f(self, theta: ArrayLike) -> np.ndarray:
        value: np.ndarray = np.polynomial.polynomial.polyval(
            np.asarray(theta), self.coefficients)
        return value


@claim('omega-t-in-omega', 'Rmk:SF:OmegaTinEqm', 'Omega_T is in Omega whatever the gain',
       'speed at random tetrahedra under 200 random gains, rising and falling and negative')
def _omega_t(system: SystemUnderTest) -> Result:
    rng, worst = system.rng, 0.0
    gamma = random_tetrahedra(rng, 50)
    for _ in range(200):
        gain = _Polynomial(rng.standard_normal(5))
        speed = law.velocity(gamma, system.complete.weights, gain)
        worst = max(worst, np.max(np.abs(speed)) / abs(gain.f(shapes.THETA_STAR)))
    return vanishes(worst, 1e-11)


@claim('disjoint-equilibria', 'Section 4.1', 'there are other equilibria besides Omega_T',
       "kinds of equilibrium found by Newton's method, first gain")
def _disjoint(system: SystemUnderTest) -> Result:
    kinds = sorted({e.kind for e in system.equilibria[0]})
    return Result('> 1', len(kinds), 0, len(kinds) > 1, ', '.join(kinds))


@claim('assumption', 'As:SF:f', "f1 and f2 are bounded, f > 0 and f' < 0 on (0, pi)",
       'both at 10001 points')
def _assumption(system: SystemUnderTest) -> Result:
    found = [gains.violation(gain, 10001) for gain in system.gains]
    broken = [text for text in found if text]
    return Result('holds', 'holds' if not broken else 'violated', '-', not broken,
                  '; '.join(broken))


@claim('assumption-any-a', 'Section 4.3, after As:SFG:f',
       'f = a cos(theta) + a fulfills As:SF:f for every a > 0',
       'f and its difference quotient at 10001 points, a from 1e-9 to 1e9; none is left for a = 0')
def _assumption_any_a(system: SystemUnderTest) -> Result:
    family, theta = type(system.gains[0]), np.linspace(0.0, math.pi, 10003)
    least, steepest, largest = math.inf, -math.inf, 0.0
    for a in np.geomspace(1e-9, 1e9, 37):
        f = family(a).f(theta) / a
        least, largest = min(least, np.min(f[1:-1])), max(largest, np.max(np.abs(f)))
        steepest = max(steepest, np.max(np.diff(f)))
        printed = math.cos(1.0) + 1.0
        largest = max(largest, 1e9 * abs(family(a).f(1.0) / a - printed))
    return Result("f > 0, f' < 0, |f| <= 2 a", f'f >= {least:.1g} a, falling', '-',
                  least > 0.0 and steepest < 0.0 and largest <= 2.0)


@claim('proof-spectrum', 'eq:SF:proofEigen',
       "at eq:SF:proofPoint: 2 sqrt2 f' (2), (4 sqrt2/3) f' - (8/3) f (3), 0 (3)",
       'differences of the law in RPY coordinates, five gains, relative')
def _proof_spectrum(system: SystemUnderTest) -> Result:
    return worst_of(same_spectrum(
        np.linalg.eigvals(angle_matrix(system.complete.weights, gain)),
        stability.complete_spectrum(gain)) for gain in system.families)


@claim('commuting-split', 'Section 4.2', "A_zeta = A1 f + A2 f', and A1 A2 = A2 A1",
       'A1 and A2 from gains with f = 1 or slope 1 alone at theta*; then the two gains')
def _commuting(system: SystemUnderTest) -> Result:
    weights = system.complete.weights
    a1 = angle_matrix(weights, FixedSlope(1.0, 0.0))
    a2 = angle_matrix(weights, FixedSlope(0.0, 1.0))
    left = np.max(np.abs(a1 @ a2 - a2 @ a1))
    for gain in system.gains:
        split = gain.f(shapes.THETA_STAR) * a1 + gain.derivative(shapes.THETA_STAR) * a2
        left = max(left, np.max(np.abs(split - angle_matrix(weights, gain))))
    # f on its own, without slope: the paper's three -8/3; the slope on its own: 2 sqrt2 twice.
    values = np.sort(np.linalg.eigvals(a1).real), np.sort(np.linalg.eigvals(a2).real)
    left = max(left, np.max(np.abs(values[0] - np.array([-8 / 3] * 3 + [0.0] * 5))),
               np.max(np.abs(values[1] - np.array(
                   [0.0] * 3 + [4 * math.sqrt(2) / 3] * 3 + [2 * math.sqrt(2)] * 2))))
    return vanishes(left, 1e-9)


@claim('centre-manifold', 'Thm:SF:ExistCM',
       'a centre manifold of dimension 3 at every tetrahedron, the rest is stable',
       'inertia of the linearisation at random tetrahedra of both chiralities, both gains')
def _centre(system: SystemUnderTest) -> Result:
    odd = set()
    for gain in system.gains:
        for gamma in random_tetrahedra(system.rng, 6):
            matrix, _ = differentiated_law(gamma, system.complete.weights, gain)
            values = np.linalg.eigvals(matrix)
            values = np.where(np.abs(values) < 1e-7 * np.max(np.abs(values)), 0.0, values)
            odd.add(stability.inertia(values))
    shown = ' and '.join(str(i) for i in sorted(odd))
    return Result('(0, 3, 5)', shown, '-', odd == {(0, 3, 5)}, 'positive, zero, negative')


@claim('centre-is-omega-t', 'Thm:SF:CMDetile', 'the centre manifold is Omega_T',
       'sine of the angle between the kernel of the linearisation and the tangent of Omega_T')
def _centre_is_omega_t(system: SystemUnderTest) -> Result:
    worst = 0.0
    for gain in system.gains:
        for gamma in random_tetrahedra(system.rng, 6):
            matrix, bases = differentiated_law(gamma, system.complete.weights, gain)
            tangent = np.linalg.qr(stability.rotations(gamma, bases))[0]
            kernel = np.linalg.svd(matrix)[2][-3:].T
            apart = kernel - tangent @ (tangent.T @ kernel)
            worst = max(worst, float(np.linalg.norm(apart, 2)))
    return vanishes(worst, 1e-9)


@claim('locally-exponential', 'Thm:SF:CMDetile', 'Omega_T is locally exponentially stable',
       'largest transverse eigenvalue of the differentiated law, five gains')
def _locally_exponential(system: SystemUnderTest) -> Result:
    return negative([np.max(transverse_spectrum(
        TETRAHEDRON, system.complete.weights, gain).real) for gain in system.families])


claim('rate-complete-f1', 'Thm:SF:CMDetile', "slowest rate -max(2 sqrt2 f', ...), complete, f1",
      'slowest mode in a run of the nodes', nodes=True, graph='complete', which=0)(
          rate_of_run)


claim('rate-complete-f2', 'Thm:SF:CMDetile', "slowest rate -max(2 sqrt2 f', ...), complete, f2",
      'slowest mode in a run of the nodes', nodes=True, graph='complete', which=1)(
          rate_of_run)


@claim('stationary', 'Section 4.2, end', 'the formation reached is stationary',
       'speed of the formation at the end of runs of the nodes, both gains', nodes=True)
def _stationary(system: SystemUnderTest) -> Result:
    speeds = []
    for gain in system.gains:
        run = system.run('complete', gain)
        speeds.append(np.max(np.abs(run.gamma[-1] - run.gamma[-2])) / run.h)
    return vanishes(speeds, 1e-6, 'rad/s')
