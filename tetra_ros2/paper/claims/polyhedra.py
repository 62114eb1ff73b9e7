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
Beyond the paper: the Platonic solids about any axis, and rings.

These are claims of ``docs/polyhedra.md``, where their proofs are. The last proposition of the
paper is the tetrahedron about a vertex.
"""

import itertools
import math

import numpy as np
from tetra_ros2.formation import (
    batch,
    law,
    measures,
    polyhedra,
    rings,
    shapes,
    sphere,
    stability,
)
from tetra_ros2.paper.registry import claim, equal, negative, Result, vanishes
from tetra_ros2.paper.system import SystemUnderTest

PAGE = 'docs/polyhedra.md'


def cuboctahedron() -> np.ndarray:
    """Return the middles of the edges of a cube, as unit vectors, ``(12, 3)``."""
    points = {tuple(s * np.array(p)) for p in itertools.permutations((0.0, 1.0, 1.0))
              for s in map(np.array, itertools.product((1.0, -1.0), repeat=3))}
    return sphere.normalize(np.unique(np.array(sorted(points)) + 0.0, axis=0))


@claim('solid-classes', PAGE, 'seen from a vertex, every class of distance of the five solids is '
       'balanced and isotropic', 'sums and second moments of the tangent parts, all vertices')
def _classes(system: SystemUnderTest) -> Result:
    return vanishes([deviation for points in polyhedra.SOLIDS.values()
                     for deviation in (*polyhedra.imbalance(points),
                                       *polyhedra.anisotropy(points))], 1e-14)


@claim('solid-others', PAGE, 'the cuboctahedron, on twofold axes, is balanced and not isotropic; '
       'a triangular prism is neither', 'the same sums')
def _others(system: SystemUnderTest) -> Result:
    points, azimuth = cuboctahedron(), 2.0 * math.pi / 3.0 * np.arange(3)
    side = np.stack([np.cos(azimuth), np.sin(azimuth), np.full(3, math.sqrt(3.0) / 2.0)], axis=-1)
    prism = sphere.normalize(np.concatenate([side, side * [1.0, 1.0, -1.0]]))
    balanced = float(np.max(polyhedra.imbalance(points)))
    skew = min(float(np.max(polyhedra.anisotropy(points))),
               float(np.max(polyhedra.imbalance(prism))),
               float(np.max(polyhedra.anisotropy(prism))))
    return Result(0.0, balanced, 1e-14, balanced < 1e-14 and skew > 0.1,
                  f'the others are off by {skew:.2g} at least')


@claim('solid-spin', PAGE, 'W = S_c + alpha_c e . (P_i x P_j) turns a solid with '
       '-(e / 2) sum_c alpha_c k_c f sin^2, whatever e, S_c, alpha_c and the gain',
       'the law at the vertices of the five, random axes, weights and gains, relative')
def _spin(system: SystemUnderTest) -> Result:
    rng, worst = system.rng, 0.0
    for points in polyhedra.SOLIDS.values():
        classes = polyhedra.distance_classes(points)
        for gain in system.families:
            for _ in range(system.times(10)):
                e = sphere.random(rng)
                strong, alpha = rng.normal(size=(2, len(classes.angles)))
                twist = np.einsum('a,ija->ij', e, np.cross(points[:, None], points[None]))
                weights = strong[classes.of_pair] + alpha[classes.of_pair] * twist
                np.fill_diagonal(weights, 0.0)
                omega = -0.5 * e * np.sum(
                    alpha * classes.sizes * gain.f(classes.angles) * np.sin(classes.angles)**2)
                moved = law.velocity(points, weights, gain)
                scale = gain.f(0.0) * np.max(np.abs(weights)) * len(points)
                worst = max(worst, np.max(np.abs(moved - np.cross(omega, points))) / scale)
    return vanishes(worst, 1e-14)


@claim('solid-weights', PAGE, 'no weight is negative while alpha_c is at most S_c over the '
       'largest |e . (P_i x P_j)| of the class',
       'the least weight at the largest spin, random axes')
def _weights(system: SystemUnderTest) -> Result:
    least = []
    for name, points in polyhedra.SOLIDS.items():
        classes = polyhedra.distance_classes(points)
        for _ in range(system.times(20)):
            full = polyhedra.weights(
                points, np.array(polyhedra.CLASS_WEIGHTS[name]), sphere.random(system.rng), 1.0)
            least += [np.min(full[classes.of_pair == c]) for c, weight in enumerate(
                polyhedra.CLASS_WEIGHTS[name]) if weight and classes.angles[c] < 3.0]
    return vanishes(least, 0.0)


@claim('solid-paper', 'Section 5', 'the last proposition is the tetrahedron about a vertex, S = '
       '1/2 and the largest alpha', 'weights against As:RF:weighedgraph, spin against '
       'sqrt(3)/2 f(theta*), both gains')
def _paper(system: SystemUnderTest) -> Result:
    points = polyhedra.SOLIDS['tetrahedron']
    worst = np.max(np.abs(polyhedra.weights(points, np.array([0.5]), points[0], 1.0)
                          - system.rotating.weights))
    for gain in system.gains:
        rate = polyhedra.spin_rate(points, np.array([0.5]), points[0], 1.0, gain)
        worst = max(worst, abs(rate - math.sqrt(3.0) / 2.0 * gain.f(shapes.THETA_STAR)))
    return vanishes(worst, 1e-14)


@claim('solid-mirror', PAGE, 'the mirror image turns the other way, seen from the same agents',
       'the law at the mirrored vertices, spin along the mirrored axis')
def _mirror(system: SystemUnderTest) -> Result:
    worst = 0.0
    for name, points in polyhedra.SOLIDS.items():
        strong = np.array(polyhedra.CLASS_WEIGHTS[name])
        weights = polyhedra.weights(points, strong, points[0], 0.5)
        gain = system.gains[1]
        rate = polyhedra.spin_rate(points, strong, points[0], 0.5, gain)
        image = stability.mirrored(points)
        turning = measures.angular_velocity(image, law.velocity(image, weights, gain))
        worst = max(worst, np.max(np.abs(turning + rate * image[0])) / abs(rate))
    return vanishes(worst, 1e-12)


@claim('solid-stable', PAGE, 'with the recommended weights all five are stable under f2, at rest '
       'and at half of the largest spin', 'largest real part over the spectral radius, vertex, '
       'edge, face and a generic axis')
def _stable(system: SystemUnderTest) -> Result:
    worst = []
    axes: tuple[str | np.ndarray, ...] = (*polyhedra.AXES, np.array([0.3, 0.5, 0.8]))
    for name, points in polyhedra.SOLIDS.items():
        for axis, spin in itertools.product(axes, (0.0, 0.5)):
            weights = polyhedra.weights(
                points, np.array(polyhedra.CLASS_WEIGHTS[name]),
                polyhedra.axis_direction(points, axis), spin)
            values = stability.transverse(points, weights, system.gains[1]).eigenvalues
            worst.append(np.max(values.real) / np.max(np.abs(values)))
    return negative(worst)


@claim('solid-starts', PAGE, 'random starts come to the solid under f2',
       'uniform random starts, every pair of agents at its own distance, all five')
def _starts(system: SystemUnderTest) -> Result:
    gain, count, formed = system.gains[1], system.times(40), 0
    for name, points in polyhedra.SOLIDS.items():
        weights = polyhedra.weights(
            points, np.array(polyhedra.CLASS_WEIGHTS[name]), points[0])
        h = 0.5 / stability.fastest_rate(weights, gain)
        steps, _ = batch.run(sphere.random(system.rng, (count, len(points))), weights, gain,
                             measures.pairwise_angles(points), 0.02, h, round(60.0 / h), 1,
                             labelled=True)
        formed += int(np.sum(steps != batch.NEVER))
    return equal(5 * count, formed, 0, 'see docs/polyhedra.md for 100,000 of each')


@claim('ring-spin', PAGE, 'a ring of odd n is a star that turns with spin f sin(pi / n); of '
       'even n it is at rest', 'the law at the shapes of n = 2 to 15, all gains')
def _ring_spin(system: SystemUnderTest) -> Result:
    worst = 0.0
    for n, gain in itertools.product(range(2, 16), system.families):
        points = rings.points(n)
        theta = math.pi * (n - 1) / n if n % 2 else math.pi
        rate = 0.6 * gain.f(theta) * math.sin(math.pi / n) * (n % 2)
        moved = law.velocity(points, rings.weights(n, 0.6), gain)
        worst = max(worst, np.max(np.abs(moved - np.cross([0.0, 0.0, rate], points))))
    return vanishes(worst, 1e-14)


@claim('ring-rate', PAGE, 'the slowest rate of a ring has a closed form, whatever its spin',
       'spectra of n = 2 to 15, all gains, relative to the spectral radius')
def _ring_rate(system: SystemUnderTest) -> Result:
    worst = 0.0
    for n, gain, spin in itertools.product(range(2, 16), system.families, (0.0, 0.6)):
        values = stability.transverse(rings.points(n), rings.weights(n, spin), gain).eigenvalues
        # Of the cosine gain and even n all are zero to rounding.
        scale = max(float(np.max(np.abs(values))), 1e-3 * gain.f(0.0))
        worst = max(worst, abs(-np.max(values.real) - rings.slowest_rate(n, gain)) / scale)
    return vanishes(worst, 1e-8)
