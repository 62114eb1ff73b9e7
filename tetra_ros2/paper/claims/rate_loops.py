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
Beyond the paper: bodies that take time to turn as they are told.

What :mod:`tetra_ros2.formation.rate_loop` predicts from a linearisation in body frames is held
against an integration on the sphere that knows nothing of body frames.
"""

import math

import numpy as np
from tetra_ros2.formation import law, measures, rate_loop, sphere, stability
from tetra_ros2.formation.gain import Gain
from tetra_ros2.paper.formations import TETRAHEDRON
from tetra_ros2.paper.registry import claim, equal, Result
from tetra_ros2.paper.system import SystemUnderTest

WHERE = 'beyond the paper'


def follow(gamma: np.ndarray, velocity: np.ndarray, weights: np.ndarray, gain: Gain,
           bandwidth: np.ndarray, h: float, steps: int) -> np.ndarray:
    """
    Integrate ``D v / dt = k (law - v)`` by RK4; return the pairwise angles and the end.

    :param gamma: reduced attitudes at the start, ``(..., n, 3)``
    :param velocity: tangent vectors there [1/s], ``(..., n, 3)``
    :param bandwidth: k [1/s], ``(..., 1, 1)``
    :param h: of a step [s]
    :returns: gamma after every step, ``(steps, ..., n, 3)``
    """
    def slope(state: np.ndarray) -> np.ndarray:
        points, moving = state
        pulled = bandwidth * (law.velocity(points, weights, gain) - moving)
        return np.stack([moving, pulled - np.sum(moving**2, axis=-1, keepdims=True) * points])

    state = np.stack(np.broadcast_arrays(gamma, velocity))
    kept = []
    for _ in range(steps):
        a = slope(state)
        b = slope(state + 0.5 * h * a)
        c = slope(state + 0.5 * h * b)
        state = state + h / 6.0 * (a + 2.0 * b + 2.0 * c + slope(state + h * c))
        points = sphere.normalize(state[0])
        state = np.stack([points, sphere.project(points, state[1])])
        kept.append(points)
    return np.stack(kept)


def disturbed(system: SystemUnderTest, there: rate_loop.RateLoopEquilibrium, size: float
              ) -> tuple[np.ndarray, np.ndarray]:
    """Return a relative equilibrium, a little off: reduced attitudes and their velocities."""
    gamma = sphere.normalize(there.gamma + size * system.rng.standard_normal((4, 3)))
    return gamma, sphere.project(gamma, np.cross(there.spin, gamma))


@claim('rate-loop-at-rest', WHERE,
       'a rate loop k makes two roots of s^2 + k s - k lambda of each lambda; no k is too small',
       'decay of the angles in an integration on the sphere, complete graph, k = 1')
def _at_rest(system: SystemUnderTest) -> Result:
    weights, gain, k = system.complete.weights, system.gains[0], 1.0
    values = stability.transverse(TETRAHEDRON, weights, gain).eigenvalues
    slowest = min(-rate_loop.eigenvalues_at_rest(values, k).real)
    there = rate_loop.rate_loop_equilibrium(TETRAHEDRON, weights, gain, k)
    angles = measures.pairwise_angles(follow(
        *disturbed(system, there, 1e-3), weights, gain, np.full((1, 1), k), 0.02, 1500))
    left = np.max(np.abs(angles - np.arccos(-1.0 / 3.0)), axis=-1)
    # Peaks of two windows, each longer than a beat of what swings.
    measured = math.log(np.max(left[400:700]) / np.max(left[1000:1300])) / 12.0
    return equal(slowest, measured, 0.03 * slowest)


@claim('rate-loop-spin', WHERE,
       'with a rate loop the spinning tetrahedron shifts, and spins more slowly',
       'spin after an integration on the sphere, rotating graph, k = 1')
def _spin(system: SystemUnderTest) -> Result:
    weights, gain, k = system.rotating.weights, system.gains[0], 1.0
    there = rate_loop.rate_loop_equilibrium(TETRAHEDRON, weights, gain, k)
    start = TETRAHEDRON, law.velocity(TETRAHEDRON, weights, gain)
    gamma = follow(*start, weights, gain, np.full((1, 1), k), 0.02, 4000)
    spin = measures.mean_angular_velocity(gamma[-2], gamma[-1], 0.02)
    shift = np.max(np.abs(measures.pairwise_angles(gamma[-1])
                          - measures.pairwise_angles(there.gamma)))
    predicted = float(np.linalg.norm(there.spin))
    found = equal(predicted, float(np.linalg.norm(spin)), 1e-6,
                  f'the angles are predicted to {shift:.1e} rad')
    return Result(found.predicted, found.measured, found.tolerance,
                  found.passed and shift < 1e-5, found.note)


@claim('rate-loop-limit', WHERE,
       'the spinning formation is stable above a bandwidth of the rate loop, and not below',
       'where disturbances neither grow nor decay in integrations on the sphere, rotating graph')
def _limit(system: SystemUnderTest) -> Result:
    weights, gain = system.rotating.weights, system.gains[0]
    limit = rate_loop.min_bandwidth(TETRAHEDRON, weights, gain)
    factors = np.array([0.92, 0.96, 1.0, 1.04, 1.08])
    starts = [disturbed(system, rate_loop.rate_loop_equilibrium(
        TETRAHEDRON, weights, gain, k), 1e-4) for k in factors * limit]
    gamma, velocity = (np.stack(part) for part in zip(*starts, strict=True))
    gammas = follow(gamma, velocity, weights, gain, (factors * limit)[:, None, None], 0.1, 2400)
    angles = measures.pairwise_angles(gammas)
    early, late = (np.max(np.ptp(angles[at:at + 300], axis=0), axis=-1) for at in (900, 2100))
    growth = np.log(late / early) / 120.0
    # Growth falls with the bandwidth; it is interpolated to where it is none.
    measured = limit * float(np.interp(0.0, growth[::-1], factors[::-1])) \
        if np.all(np.diff(growth) < 0.0) else math.nan
    return equal(limit, measured, 0.05 * limit)
