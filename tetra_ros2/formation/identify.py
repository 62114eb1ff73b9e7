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
The law of a formation, read off its motion: who counts how much, and under which gain.

A recording holds no parameters. The law is linear in the weights, so that for each family of
gains they follow by least squares from what the agents commanded, and the family that leaves
nothing over is the right one. Only the product ``W(i, j) f`` shows in a motion: here the largest
weight is 1, as in the paper's graphs.
"""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np
from tetra_ros2.formation import gain as gains
from tetra_ros2.formation import sphere
from tetra_ros2.formation._types import Array
from tetra_ros2.formation.topology import Topology

TOLERANCE = 1e-3
"""Residual, relative to the commands, above which no family of gains explains them."""

EXACT = 1e-7
"""Residual below which there is no need to look any further."""

SAMPLES = 300
"""How many states are looked at; most of them early, when there is something to see."""


@dataclass(frozen=True, eq=False)
class Identified:
    """
    A law that explains what was commanded.

    :param topology: a custom :class:`~tetra_ros2.formation.topology.Topology`, largest weight 1
    :param gain: a :class:`~tetra_ros2.formation.gain.Gain`
    :param residual: what it leaves unexplained of the commands, relative to them
    """

    topology: Topology
    gain: gains.Gain
    residual: float

    @property
    def rounded(self) -> Topology:
        """Return the topology with its weights rounded to what one would write down."""
        return Topology('custom', np.round(self.topology.weights, 7))


def identify(gamma: Array, rates: Array,
             edges: Sequence[tuple[int, int]]) -> Identified | None:
    """
    Return the law that a formation obeyed, or None if no family of gains explains its commands.

    :param gamma: reduced attitudes in the world frame, ``(k, n, 3)``
    :param rates: angular velocities w_i in the world frame that answer these states [rad/s],
        ``(k, n, 3)``; NaN where there are none
    :param edges: (i, j) for each j that agent i sees, from 1
    """
    complete = np.flatnonzero(np.all(np.isfinite(rates), axis=(-2, -1)))
    if not len(complete) or not edges:
        return None
    early = np.geomspace(1.0, len(complete), SAMPLES).astype(int) - 1
    chosen = complete[np.unique(early)]
    gamma, rates = gamma[chosen], rates[chosen]
    best = None
    for family in gains.KINDS.values():
        for b in (1.0, *_shapes(family, gamma, rates, edges)):
            found = _fit(family, b, gamma, rates, edges)
            if found is not None and (best is None or found.residual < best.residual):
                best = found
            if best is not None and best.residual < EXACT:
                return best
    return best if best is not None and best.residual < TOLERANCE else None


def _shapes(family: type[gains.Gain], gamma: Array, rates: Array,
            edges: Sequence[tuple[int, int]]) -> Iterator[float]:
    """Yield the shape parameter b that explains the commands best, for families that have one."""
    theta = np.linspace(0.1, 3.0, 5)
    if np.array_equal(family(1.0, 1.0).f(theta), family(1.0, 0.9).f(theta)):
        return

    def residual(logarithm: float) -> float:
        found = _fit(family, float(np.exp(logarithm)), gamma, rates, edges)
        return np.inf if found is None else found.residual

    grid = np.linspace(-2.5, 2.0, 19)
    k = int(np.argmin([residual(x) for x in grid]))
    low, high = grid[max(k - 1, 0)], grid[min(k + 1, len(grid) - 1)]
    golden = (np.sqrt(5.0) - 1.0) / 2.0
    for _ in range(40):
        left, right = high - golden * (high - low), low + golden * (high - low)
        if residual(left) < residual(right):
            high = right
        else:
            low = left
    yield float(np.exp(0.5 * (low + high)))


def _fit(family: type[gains.Gain], b: float, gamma: Array, rates: Array,
         edges: Sequence[tuple[int, int]]) -> Identified | None:
    """Return the law of a family and a shape that explains the commands best, or None."""
    try:
        unit = family(1.0, b)
    except ValueError:
        return None  # not a gain, for this b
    n = gamma.shape[1]
    products = np.zeros((n, n))
    left, total = 0.0, 0.0
    for i in range(n):
        seen = [j - 1 for a, j in edges if a == i + 1]
        target = rates[:, i].ravel()
        total += float(target @ target)
        if not seen:
            left += float(target @ target)
            continue
        own, others = gamma[:, i, None], gamma[:, seen]
        rate = unit.f(sphere.geodesic_distance(own, others))[..., None]
        columns = np.moveaxis(-rate * np.cross(own, others), 1, 2).reshape(-1, len(seen))
        solution, _, rank, _ = np.linalg.lstsq(columns, target, rcond=1e-9)
        if rank < len(seen):
            return None  # the motion does not tell one neighbour from another
        products[i, seen] = solution
        rest = target - columns @ solution
        left += float(rest @ rest)
    a = float(np.max(np.abs(products)))
    if total == 0.0 or a == 0.0:
        return None
    weights = products / a
    # A weight of nothing but rounding belongs to an edge that is there but does not count.
    weights[np.abs(weights) < 1e-12] = 0.0
    return Identified(Topology('custom', weights), family(a, b), float(np.sqrt(left / total)))
