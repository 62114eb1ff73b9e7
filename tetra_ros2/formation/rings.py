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
Rings: n agents that see their two neighbours alone, and what forms of them.

With an odd number every agent comes to lie (n - 1) pi / n from both neighbours, on one great
circle: a regular star polygon, for n = 3 a triangle. With an even number neighbours are opposite,
so that there are two clusters of n / 2 agents, one at each end of a diameter. Where an agent
minds its two neighbours unequally, the star turns in its plane.
"""

import math

import numpy as np
from tetra_ros2.formation.gain import Gain


def neighbor_angle(n: int) -> float:
    """Return the angle between neighbours in the ring [rad]: (n - 1) pi / n, or pi."""
    return math.pi * (n - n % 2) / n


def points(n: int) -> np.ndarray:
    """Return what forms of n agents, unit vectors, ``(n, 3)``, in order counter-clockwise."""
    # Whole multiples of pi / n keep coincident and opposite agents exactly so.
    steps = np.arange(n) * (n - n % 2) % (2 * n)
    circle = np.stack([np.cos(steps * math.pi / n), np.sin(steps * math.pi / n),
                       np.zeros(n)], axis=-1)
    if n % 2 == 0:
        circle = np.where(steps[:, None] == 0, [1.0, 0.0, 0.0], [-1.0, 0.0, 0.0])
    return circle


def name(n: int) -> str:
    """Return the name of what forms of n agents."""
    if n == 2:
        return 'antipodal pair'
    if n == 3:
        return 'equilateral triangle on a great circle'
    if n % 2:
        return f'regular star polygon {{{n}/{n // 2}}} on a great circle'
    return f'pair of antipodal clusters of {n // 2}'


def weights(n: int, spin: float = 0.0) -> np.ndarray:
    """
    Return ``W(i, i - 1) = (1 + spin) / 2`` and ``W(i, i + 1) = (1 - spin) / 2``, ``(n, n)``.

    :param n: number of agents, at least 2
    :param spin: from -1 to 1; greater than 0 turns each agent away from the one before it
    """
    matrix = np.zeros((n, n))
    i = np.arange(n)
    matrix[i, i - 1] += 0.5 * (1.0 + spin)
    matrix[i, (i + 1) % n] += 0.5 * (1.0 - spin)
    return matrix


def spin_rate(n: int, spin: float, gain: Gain) -> float:
    """
    Return the angular velocity in the plane [rad/s]: ``spin f(theta) sin(theta)``.

    Greater than 0 is the sense in which the shorter way leads from each agent to the next.

    :param n: number of agents
    :param spin: as for :func:`weights`
    :param gain: a :class:`~tetra_ros2.formation.gain.Gain`
    """
    if n % 2 == 0:
        return 0.0
    return spin * float(gain.f(neighbor_angle(n))) * math.sin(math.pi / n)


def slowest_rate(n: int, gain: Gain) -> float:
    """
    Return how fast the slowest deviation decays [1/s], whatever the spin.

    For even n it is ``f(pi) (1 - cos(2 pi / n))``. For odd n it is the lesser of ``(f cos(pi / n)
    - f' sin(pi / n)) (1 - cos(2 pi / n))``, in the plane, and ``f (cos(pi / n) - cos(3 pi /
    n))``, out of it, with f at the angle between neighbours. For even n and a gain with f(pi) =
    0, such as the cosine gain, it is zero: the clusters form, but only as some power of time.

    :param n: number of agents, at least 2
    :param gain: a :class:`~tetra_ros2.formation.gain.Gain`
    """
    theta = neighbor_angle(n)
    f, slope = float(gain.f(theta)), float(gain.derivative(theta))
    step = math.pi / n
    if n % 2 == 0:
        return f * (1.0 - math.cos(2.0 * step))
    inside = (f * math.cos(step) - slope * math.sin(step)) * (1.0 - math.cos(2.0 * step))
    return min(inside, f * (math.cos(step) - math.cos(3.0 * step)))
