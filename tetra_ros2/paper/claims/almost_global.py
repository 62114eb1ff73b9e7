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

"""Section 4.3 and Appendix A.2: every other equilibrium is unstable."""

import dataclasses
import itertools
import math

import numpy as np
from tetra_ros2.formation import coordinates, equilibria, law, measures, sphere
from tetra_ros2.formation.gain import Gain
from tetra_ros2.paper.claims._common import starts_that_form
from tetra_ros2.paper.differences import derivative, out_of_plane
from tetra_ros2.paper.formations import coplanar
from tetra_ros2.paper.registry import claim, Result, vanishes
from tetra_ros2.paper.system import SystemUnderTest


@claim('inequality', 'Thm:SFG:Inequality',
       'four angles of sum 2 pi: sum cos^2 + cos >= 0, zero only at pi/2',
       'least value at random points after descent; distance from pi/2 where it is below 1e-3')
def _inequality(system: SystemUnderTest) -> Result:
    rng = system.rng
    x = rng.dirichlet(np.ones(4), system.times(40000)) * 2.0 * np.pi
    x = x[np.max(x, axis=1) <= np.pi]

    def value(x: np.ndarray) -> np.ndarray:
        total: np.ndarray = np.sum(np.cos(x) ** 2 + np.cos(x), axis=1)
        return total

    # Descend along the constraint as well, or the least values are never seen.
    low = x[np.argsort(value(x))[:2000]]
    for _ in range(300):
        slope = -np.sin(2.0 * low) - np.sin(low)
        low = np.clip(low - 0.05 * (slope - np.mean(slope, axis=1, keepdims=True)), 0.0, np.pi)
        low *= 2.0 * np.pi / np.sum(low, axis=1, keepdims=True)
    everything = np.concatenate([x, low[np.max(low, axis=1) <= np.pi]])
    values = value(everything)
    least = float(np.min(values))
    off = np.max(np.abs(everything[values < 1e-3] - 0.5 * np.pi), initial=0.0)
    return Result('>= 0', least, 1e-12, least >= -1e-12 and off < 0.05,
                  f'within {off:.2g} rad of (pi/2, ...) where below 1e-3')


KKT_POINTS = {(0.0, *[2.0 * math.pi / 3.0] * 3): 1.25, (0.0, 0.0, math.pi, math.pi): 4.0,
              (*[0.5 * math.pi] * 4,): 0.0}
"""Solutions of the KKT condition and values of G there, as Appendix A.2 prints them."""


def _kkt_points(rng: np.random.Generator, starts: int) -> np.ndarray:
    """
    Return what Newton's method finds of the points that satisfy the KKT condition, sorted.

    Some x_i are 0 or pi and the others between, in every combination. Of those between, the slope
    of G is the multiplier lambda_E. At 0 the slope, which is 0, must not be below it, at pi not
    above it.
    """
    points = []
    for zeros, pis in itertools.product(range(5), repeat=2):
        inside = 4 - zeros - pis
        fixed = [0.0] * zeros + [math.pi] * pis
        if inside < 0:
            continue
        if inside == 0:  # lambda_E = 0 will do
            points += [np.array(fixed)] if pis == 2 else []
            continue
        y = rng.uniform(0.0, math.pi, (starts, inside))
        unknown = np.append(y, rng.uniform(-2.0, 2.0, (starts, 1)), axis=1)
        for _ in range(40):
            x, multiplier = unknown[:, :-1], unknown[:, -1:]
            left = np.append(-np.sin(2.0 * x) - np.sin(x) - multiplier,
                             np.sum(x, axis=1, keepdims=True) - (2.0 - pis) * math.pi, axis=1)
            slope = np.zeros((starts, inside + 1, inside + 1))
            i = np.arange(inside)
            slope[:, i, i] = -2.0 * np.cos(2.0 * x) - np.cos(x)
            slope[:, i, -1], slope[:, -1, i] = -1.0, 1.0
            step = np.einsum('kij,kj->ki', np.linalg.pinv(slope, rcond=1e-12), left)
            unknown = unknown - step * np.minimum(
                1.0, 0.3 / np.maximum(np.max(np.abs(step), axis=1, keepdims=True), 1e-300))
        x, multiplier = unknown[:, :-1], unknown[:, -1]
        solved = (np.max(np.abs(left), axis=1) < 1e-12) & np.all(
            (x > 1e-6) & (x < math.pi - 1e-6), axis=1)
        if zeros:
            solved &= multiplier <= 1e-9
        if pis:
            solved &= multiplier >= -1e-9
        points += [np.sort(np.append(fixed, values)) for values in x[solved]]
    return np.array(points)


@claim('kkt-points', 'Appendix A.2',
       'the KKT points are (0, 2pi/3 x3), (0, 0, pi, pi), (pi/2 x4); G = 5/4, 4, 0',
       "Newton's method from 2000 starts for each set of active constraints: all it finds are "
       'these, and all of these are found')
def _kkt(system: SystemUnderTest) -> Result:
    points = _kkt_points(system.rng, system.times(2000))
    printed = np.array(list(KKT_POINTS))
    apart = np.max(np.abs(points[:, None] - printed), axis=-1)
    found = set(np.argmin(apart, axis=1).tolist())
    off_value = np.max(np.abs(np.sum(np.cos(printed) ** 2 + np.cos(printed), axis=1)
                              - list(KKT_POINTS.values())))
    off = max(float(np.max(np.min(apart, axis=1))), float(off_value))
    return Result(0.0, off, 1e-6, len(found) == 3 and off < 1e-6,
                  f'{len(points)} solutions, {len(found)} points')


@claim('coplanar-decouples', 'eq:SFG:ClosedSysRPY1',
       'on the equator the linearised angles phi and psi are decoupled, as given',
       'differences of the angle dynamics at random coplanar formations, both gains')
def _decouples(system: SystemUnderTest) -> Result:
    worst = 0.0
    for gain in system.gains:
        for gamma, psi in zip(*coplanar(system.rng, 20)):
            theta = sphere.geodesic_distance(gamma[:, None], gamma)
            # The derivatives of the law jump at 0 and pi; differences need room.
            if np.min(np.minimum(theta, np.pi - theta)[~np.eye(4, dtype=bool)]) < 0.05:
                continue

            def rates(x: np.ndarray, gain: Gain = gain) -> np.ndarray:
                points = coordinates.from_angles(x[:, :4], x[:, 4:])
                velocity = law.velocity(points, system.complete.weights, gain)
                p, s = x[:, :4], x[:, 4:]
                return np.concatenate([velocity[..., 2] / np.cos(p), (
                    np.cos(s) * velocity[..., 1] - np.sin(s) * velocity[..., 0]) / np.cos(p)], 1)

            found = derivative(rates, np.concatenate([np.zeros(4), psi]))
            f = (1.0 - np.eye(4)) * gain.f(theta)
            slope = (1.0 - np.eye(4)) * gain.derivative(theta)
            along = f * np.cos(theta) + slope * np.sin(theta)
            claimed = np.zeros((8, 8))
            claimed[:4, :4] = np.diag(np.sum(f * np.cos(theta), axis=1)) - f
            claimed[4:, 4:] = np.diag(np.sum(along, axis=1)) - along
            worst = max(worst, np.max(np.abs(found - claimed)))
    return vanishes(worst, 1e-7)


@claim('coplanar-form', 'eq:SFG:vAv',
       'v^T A v = a sum cos^2 + cos over the cycle + 2 a (1 + cos(theta_13))^2, v = [1,0,-1,0]',
       'A of the law at random coplanar formations in cyclic order, first gain')
def _coplanar_form(system: SystemUnderTest) -> Result:
    gain, worst = system.gains[0], 0.0
    a = gain.a
    for _, psi in zip(*coplanar(system.rng, 200)):
        gamma = coordinates.from_angles(np.zeros(4), np.sort(psi))
        matrix = out_of_plane(gamma, system.complete.weights, gain)
        v = np.array([1.0, 0.0, -1.0, 0.0])
        c = gamma @ gamma.T
        cycle = c[[0, 1, 2, 3], [1, 2, 3, 0]]
        claimed = a * np.sum(cycle**2 + cycle) + 2.0 * a * (c[0, 2] + 1.0) ** 2
        worst = max(worst, abs(v @ matrix @ v - claimed))
    return vanishes(worst, 1e-9)


def _coplanar_equilibria(weights: np.ndarray, gain: Gain) -> np.ndarray:
    """
    Return all equilibria on the equator, longitudes ``(k, 4)`` with the first 0.

    By Newton's method from every point of a grid of 20 degrees.
    """
    grid = np.radians(np.arange(0.0, 360.0, 20.0)) + 0.01
    psi = np.stack(np.meshgrid(grid, grid, grid), axis=-1).reshape(-1, 3)
    psi = psi[np.all(np.diff(psi, axis=1) >= 0.0, axis=1)]  # every order of the three is alike

    def rates(psi: np.ndarray) -> np.ndarray:
        everybody = np.append(np.zeros((*psi.shape[:-1], 1)), psi, axis=-1)
        ahead = everybody[..., :, None] - everybody[..., None, :]
        theta = np.abs(np.angle(np.exp(1j * ahead)))
        total: np.ndarray = np.sum(weights * gain.f(theta) * np.sin(ahead), axis=-1)
        return total[..., 1:]

    for _ in range(40):
        left = rates(psi)
        slope = np.stack([(rates(psi + 1e-6 * e) - rates(psi - 1e-6 * e)) / 2e-6
                          for e in np.eye(3)], axis=-1)
        step = np.einsum('kij,kj->ki', np.linalg.pinv(slope, rcond=1e-9), left)
        size = np.max(np.abs(step), axis=1, keepdims=True)
        psi = psi - step * np.minimum(1.0, 0.3 / np.maximum(size, 1e-300))
    everybody = np.append(np.zeros((len(psi), 1)), psi, axis=-1)
    still = np.max(np.abs(law.velocity(coordinates.from_angles(
        np.zeros_like(everybody), everybody), weights, gain)), axis=(-2, -1))
    found: np.ndarray = everybody[still < 1e-9 * gain.a]
    return found


@claim('coplanar-unstable', 'Thm:SFG:CoplaneUnStable', 'every coplanar equilibrium is unstable',
       'the smallest of their largest eigenvalues, relative to a; equilibria from a grid over all '
       'coplanar formations, a = 1 and two more')
def _coplanar_unstable(system: SystemUnderTest) -> Result:
    least, kinds, count = math.inf, set(), 0
    for factor in (1.0, 0.3, 4.0):
        gain = dataclasses.replace(system.gains[0], a=factor * system.gains[0].a)
        psi = _coplanar_equilibria(system.complete.weights, gain)
        gamma = coordinates.from_angles(np.zeros_like(psi), psi)
        count += len(gamma)
        kinds |= {equilibria.classify(points) for points in gamma}
        _, different = np.unique(
            np.round(np.sort(measures.pairwise_cosines(gamma)), 6), axis=0, return_index=True)
        for points in gamma[different]:
            bend = np.linalg.eigvals(out_of_plane(points, system.complete.weights, gain))
            least = min(least, float(np.max(bend.real)) / gain.a)
    return Result('> 0', least if count else math.nan, 0.0, count > 0 and least > 1e-6,
                  f'{count} found: {", ".join(sorted(kinds))}')


@claim('cross', 'Thm:SFG:CoplaneUnStable', "the cross's A has the eigenvalues {2a, -2a, 0, 0}",
       'differences of the law at the cross, first gain')
def _cross(system: SystemUnderTest) -> Result:
    gain = system.gains[0]
    gamma = coordinates.from_angles(np.zeros(4), -np.pi + np.arange(1, 5) * np.pi / 2.0)
    found = np.linalg.eigvals(out_of_plane(gamma, system.complete.weights, gain))
    return vanishes(np.sort(found.real) - np.array([-2.0, 0.0, 0.0, 2.0]) * gain.a, 1e-9)


@claim('decomposition', 'Thm:SF:Equilibria', 'Omega = Omega_T + coplanar equilibria',
       "equilibria found by Newton's method that are neither, first gain; velocities are "
       'proportional to a, so that one a speaks for all')
def _decomposition(system: SystemUnderTest) -> Result:
    found, lost = system.equilibria
    gain, weights = system.gains[0], system.complete.weights
    gamma = sphere.random(system.rng, (100, 4))
    here = law.velocity(gamma, weights, gain)
    proportional = max(float(np.max(np.abs(law.velocity(
        gamma, weights, dataclasses.replace(gain, a=factor * gain.a)) / factor - here)))
        for factor in (1e-3, 0.3, 7.0, 1e3))
    strange = sum(e.found for e in found
                  if e.kind != 'tetrahedron' and not equilibria.is_coplanar(e.gamma, 1e-5))
    total = sum(e.found for e in found)
    tetrahedra = sum(e.found for e in found if e.kind == 'tetrahedron')
    return Result(
        0, strange, 0,
        strange == 0 and tetrahedra > 0 and total > lost and proportional < 1e-12,
        f'{total} equilibria from {total + lost} starts, {tetrahedra} tetrahedra')


@claim('polynomial-system', 'Thm:SF:Equilibria', 'its only positive solution is f_ij = 2a/3',
       "Newton's method on the six equations from random positive starts")
def _polynomials(system: SystemUnderTest) -> Result:
    a = getattr(system.gains[0], 'a', 1.0)
    rng = system.rng
    f = a * np.exp(rng.uniform(math.log(0.02), math.log(6.0), (system.times(3000), 6)))

    def equations(f: np.ndarray) -> np.ndarray:
        f12, f13, f14, f23, f24, f34 = np.moveaxis(f, -1, 0)
        c = coordinates.cosine_matrix(f / a - 1.0)
        factors = np.stack([f12 * f13, f12 * f23, f13 * f23, f14 * f23], axis=-1)
        return np.concatenate([np.stack([f12 * f34 - f13 * f24, f12 * f34 - f14 * f23], axis=-1),
                               np.einsum('...ij,...j->...i', c, factors)], axis=-1)

    for _ in range(60):
        left = equations(f)
        slope = np.stack([(equations(f + 1e-6 * e) - equations(f - 1e-6 * e)) / 2e-6
                          for e in np.eye(6)], axis=-1)
        step = -np.einsum('...ij,...j->...i', np.linalg.pinv(slope, rcond=1e-12), left)
        size = np.max(np.abs(step), axis=-1, keepdims=True)
        f = f + step * np.minimum(1.0, 0.3 * a / np.maximum(size, 1e-300))
    solved = f[(np.max(np.abs(equations(f)), axis=-1) < 1e-12 * a**4) & np.all(f >= 0.0, axis=-1)]
    # Newton's method goes to solutions with a vanishing f_ij as well; they come to below 1e-6.
    positive = solved[np.min(solved, axis=-1) > 1e-6 * a]
    return vanishes(positive - 2.0 * a / 3.0 if len(positive) else math.nan, 1e-6,
                    f'{len(positive)} positive solutions from {len(f)} starts up to 6a, '
                    f'{len(solved) - len(positive)} with an f_ij of 0')


claim('almost-global', 'Section 4.3, Theorem', 'almost every start forms; complete graph, f1',
      'uniform random starts that formed, of how many', graph='complete', which=0,
      starts=3000)(starts_that_form)
