# Copyright 2026 The tetra_ros2 authors
# SPDX-License-Identifier: Apache-2.0

"""Section 4.3 and Appendix A.2: every other equilibrium is unstable."""

import math

import numpy as np

from tetra_ros2.formation import coordinates, law, sphere, stability
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

    def value(x):
        return np.sum(np.cos(x) ** 2 + np.cos(x), axis=1)

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


@claim('kkt-points', 'Appendix A.2',
       'the KKT points are (0, 2pi/3 x3), (0, 0, pi, pi), (pi/2 x4); G = 5/4, 4, 0',
       'projected gradient and multipliers there; none of lower value from 2000 starts')
def _kkt(_system: SystemUnderTest) -> Result:
    left = 0.0
    for x, value in (((0.0, *[2.0 * np.pi / 3.0] * 3), 1.25), ((0.0, 0.0, np.pi, np.pi), 4.0),
                     ([0.5 * np.pi] * 4, 0.0)):
        x = np.array(x)
        left = max(left, abs(np.sum(np.cos(x) ** 2 + np.cos(x)) - value),
                   abs(np.sum(x) - 2.0 * np.pi))
        slope = -np.sin(2.0 * x) - np.sin(x)
        inside = (x > 0.0) & (x < np.pi)
        common = np.mean(slope[inside]) if np.any(inside) else 0.0
        left = max(left, np.max(np.abs(slope[inside] - common), initial=0.0),
                   np.max(common - slope[x == 0.0], initial=0.0),
                   np.max(slope[x == np.pi] - common, initial=0.0))
    return vanishes(left, 1e-12)


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

            def rates(x, gain=gain):
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


@claim('coplanar-unstable', 'Thm:SFG:CoplaneUnStable', 'every coplanar equilibrium is unstable',
       "the smallest of their largest eigenvalues; equilibria found by Newton's method")
def _coplanar_unstable(system: SystemUnderTest) -> Result:
    found, _ = system.equilibria
    flat = [e for e in found if stability.is_coplanar(e.gamma, 1e-5)]
    kinds = ', '.join(sorted({e.kind for e in flat}))
    least = min((float(np.max(e.eigenvalues.real)) for e in flat), default=math.nan)
    return Result('> 0', least, 0.0, least > 1e-6, kinds)


@claim('cross', 'Thm:SFG:CoplaneUnStable', "the cross's A has the eigenvalues {2a, -2a, 0, 0}",
       'differences of the law at the cross, first gain')
def _cross(system: SystemUnderTest) -> Result:
    gain = system.gains[0]
    gamma = coordinates.from_angles(np.zeros(4), -np.pi + np.arange(1, 5) * np.pi / 2.0)
    found = np.linalg.eigvals(out_of_plane(gamma, system.complete.weights, gain))
    return vanishes(np.sort(found.real) - np.array([-2.0, 0.0, 0.0, 2.0]) * gain.a, 1e-9)


@claim('decomposition', 'Thm:SF:Equilibria', 'Omega = Omega_T + coplanar equilibria',
       "equilibria found by Newton's method that are neither, first gain")
def _decomposition(system: SystemUnderTest) -> Result:
    found, lost = system.equilibria
    strange = sum(e.found for e in found
                  if e.kind != 'tetrahedron' and not stability.is_coplanar(e.gamma, 1e-5))
    total = sum(e.found for e in found)
    tetrahedra = sum(e.found for e in found if e.kind == 'tetrahedron')
    return Result(0, strange, 0, strange == 0 and tetrahedra > 0 and total > lost,
                   f'{total} equilibria from {total + lost} starts, {tetrahedra} tetrahedra')


@claim('polynomial-system', 'Thm:SF:Equilibria', 'its only positive solution is f_ij = 2a/3',
       "Newton's method on the six equations from random positive starts")
def _polynomials(system: SystemUnderTest) -> Result:
    a = getattr(system.gains[0], 'a', 1.0)
    rng = system.rng
    f = rng.uniform(0.02, 2.0 * a, (system.times(3000), 6))

    def equations(f):
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
    solved = f[(np.max(np.abs(equations(f)), axis=-1) < 1e-12) & np.all(f > 1e-3 * a, axis=-1)]
    # f = 2a is theta = 0 and beyond; the lemma's f comes from angles.
    solved = solved[np.all(solved <= 2.0 * a, axis=-1)]
    return vanishes(solved - 2.0 * a / 3.0 if len(solved) else math.nan, 1e-6,
                    f'{len(solved)} solutions with 0 < f_ij <= 2a')


claim('almost-global', 'Section 4.3, Theorem', 'almost every start forms; complete graph, f1',
      'uniform random starts that formed, of how many', graph='complete', which=0,
      starts=3000)(starts_that_form)
