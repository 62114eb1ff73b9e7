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
Who sees whom, and how much it counts: weighted directed graphs on the agents 1..n.

Edge (i, j) means that agent i sees agent j, and W(i, j) weighs what it sees. To add a topology,
write a function that returns a Topology and name it in KINDS. Those that are made for a shape are
in ``targets``.
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass, field
import math
from typing import TYPE_CHECKING

import numpy as np

if TYPE_CHECKING:  # an agent loads this module, and is not to know of any shape
    from tetra_ros2.formation.shapes import Shape


@dataclass(frozen=True, eq=False)
class Topology:
    """
    A weighted directed graph.

    :param kind: one of KINDS
    :param weights: W, shape ``(n, n)``, n >= 2, dimensionless; zero where there is no edge
    :param axis_agent: the agent on the axis of rotation (the paper's k), if there is one
    :param direction: the paper's p, rotating topology only
    :param shape: the shape that the weights are made for, if they are
    :param axis: what it is to turn about, a unit vector in the frame of the shape's points
    :param axis_name: the axis in words
    :raises ValueError: if ``weights`` is not such a matrix
    """

    kind: str
    weights: np.ndarray = field(repr=False)
    axis_agent: int | None = None
    direction: int | None = None
    shape: Shape | None = None
    axis: np.ndarray | None = field(default=None, repr=False)
    axis_name: str | None = None

    def __post_init__(self) -> None:
        """Check the weights and freeze them."""
        weights = np.array(self.weights, dtype=float)
        if weights.ndim != 2 or weights.shape[0] != weights.shape[1] or len(weights) < 2:
            raise ValueError(f'weights must have the shape (n, n), n >= 2, not {weights.shape}')
        if not np.all(np.isfinite(weights)):
            raise ValueError('weights must be finite')
        if np.any(np.diag(weights)):
            raise ValueError('an agent has no edge to itself')
        weights.setflags(write=False)
        object.__setattr__(self, 'weights', weights)

    @property
    def n(self) -> int:
        """Return the number of agents."""
        return len(self.weights)

    @property
    def edges(self) -> tuple[tuple[int, int, float], ...]:
        """Return each (i, j, W(i, j)) with W(i, j) != 0, in lexicographic order."""
        return tuple((i, j, weight) for i in range(1, self.n + 1)
                     for j, weight in self.neighbors(i))

    def neighbors(self, i: int) -> tuple[tuple[int, float], ...]:
        """Return the (j, W(i, j)) that agent i sees, in order of j."""
        row = self.weights[i - 1]
        return tuple((int(j) + 1, float(row[j])) for j in np.flatnonzero(row))

    @property
    def agents_without_neighbors(self) -> tuple[int, ...]:
        """Return the agents that see nobody, and therefore never move."""
        return tuple(i for i in range(1, self.n + 1) if not self.neighbors(i))


def complete(n: int = 4) -> Topology:
    """Return the graph in which everybody sees everybody else; Graph As:SF:completegraph."""
    return Topology('complete', np.ones((n, n)) - np.eye(n))


def rotating(k: int = 1, p: int = 1) -> Topology:
    """
    Return the weighted graph of a spinning tetrahedron; Graph As:RF:weighedgraph.

    Agent k sees the three others and they see it, with weight 1/2; each of the three sees with
    weight 1 its successor skipping k (p = 1) or its predecessor skipping k (p = 0).

    :param k: the agent on the axis, 1 to 4
    :param p: the direction, 0 or 1
    :raises ValueError: if k or p is none of these
    """
    if k not in (1, 2, 3, 4):
        raise ValueError(f'k must be 1, 2, 3 or 4, not {k!r}')
    if p not in (0, 1):
        raise ValueError(f'p must be 0 or 1, not {p!r}')
    weights = np.zeros((4, 4))
    weights[k - 1, :] = weights[:, k - 1] = 0.5
    weights[k - 1, k - 1] = 0.0
    others = others_in_order(k)
    for i, successor in zip(others, others[1:] + others[:1]):
        seen, by = (successor, i) if p == 1 else (i, successor)
        weights[by - 1, seen - 1] = 1.0
    return Topology('rotating', weights, axis_agent=k, direction=p,
                    axis_name=f'the direction of agent_{k}')


def others_in_order(k: int) -> tuple[int, int, int]:
    """
    Return the three agents other than k, each followed by its successor skipping k, Suc^k.

    The paper's modulo stands for counting on from 4 to 1, before it looks for k: so Suc^1(4) = 2.
    """
    one, two, three = ((k - 1 + step) % 4 + 1 for step in (1, 2, 3))
    return one, two, three


def custom(n: int, edges: Iterable[tuple[int, int] | tuple[int, int, float]]) -> Topology:
    """
    Return any weighted directed graph.

    :param n: number of agents, at least 2
    :param edges: (i, j) or (i, j, weight): agent i sees agent j
    :raises EdgeError: if an edge is repeated, joins an agent to itself or to one that does not
        exist, or has a weight that is zero or not finite
    """
    weights = np.zeros((n, n))
    for index, (i, j, *rest) in enumerate(edges):
        weight = rest[0] if rest else 1.0
        for agent in (i, j):
            if not 1 <= agent <= n:
                raise EdgeError(index, f'there is no agent {agent} among {n}')
        if i == j:
            raise EdgeError(index, f'agent {i} cannot see itself')
        if weights[i - 1, j - 1]:
            raise EdgeError(index, f'agent {i} sees agent {j} more than once')
        if not (math.isfinite(weight) and weight):
            raise EdgeError(index, f'a weight must be finite and not 0, not {weight!r}')
        weights[i - 1, j - 1] = weight
    return Topology('custom', weights)


class EdgeError(ValueError):
    """An edge that cannot be; ``index`` tells which, from 0."""

    def __init__(self, index: int, problem: str) -> None:
        super().__init__(problem)
        self.index = index


KINDS = ('complete', 'rotating', 'custom', 'polyhedron', 'ring')

POLYHEDRA = ('tetrahedron', 'octahedron', 'cube', 'icosahedron', 'dodecahedron')
"""The names of the Platonic solids; what they look like is in ``polyhedra``."""
