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
Which agents may change places, and how far a formation is from its shape when they may.

A graph whose agents 1 and 2 see alike and are seen alike cannot tell which of them goes where. A
permutation that keeps all weights is an automorphism of the graph; it takes formations to
formations. So what counts as the shape is the target's matrix of pairwise angles, and every
matrix that automorphisms make of it: mostly one, but fifteen for six agents that all see each
other, as any of the fifteen ways to pair them makes an octahedron.
"""

from collections.abc import Iterator, Sequence
import math

import numpy as np
from tetra_ros2.formation import measures

MOST_MATRICES = 120
"""How many admissible matrices are kept; beyond that they are looked for when they are needed."""

SAME_WEIGHT = 1e-9
"""Weights closer than this, relative to the largest, are the same."""

SAME_ANGLE = 1e-7
"""Angles closer than this are the same [rad]."""

Permutation = tuple[int, ...]


def level_indices(values: np.ndarray, tolerance: float) -> np.ndarray:
    """Return small integers that are equal where values are, from 0 up in order of value."""
    order = np.sort(values, axis=None)
    steps = np.concatenate([[False], np.diff(order) > tolerance])
    levels = order[steps]
    return np.searchsorted(levels, values, side='right')


def weight_colors(weights: np.ndarray) -> np.ndarray:
    """Return small integers that are equal where weights are, ``(n, n)``."""
    weights = np.asarray(weights, dtype=float)
    return level_indices(weights, SAME_WEIGHT * float(np.max(np.abs(weights), initial=0.0)))


def isomorphisms(a: np.ndarray, b: np.ndarray, fixed: int = 0) -> Iterator[Permutation]:
    """
    Yield the permutations p with ``a[i, j] == b[p[i], p[j]]`` for all i and j.

    :param a: integers, ``(n, n)``
    :param b: integers, ``(n, n)``
    :param fixed: only those with ``p[i] = i`` for the first so many i
    """
    n = len(a)

    def signatures(matrix: np.ndarray) -> list[bytes]:
        rows = np.column_stack(
            [np.diag(matrix), np.sort(matrix, axis=1), np.sort(matrix, axis=0).T])
        return [row.tobytes() for row in rows]

    from_a, from_b = signatures(a), signatures(b)
    likely = [[j for j in range(n) if from_a[i] == from_b[j]] for i in range(n)]
    for i in range(fixed):
        likely[i] = [i] if i in likely[i] else []
    first, second = a.tolist(), b.tolist()
    image: list[int] = []

    def extend() -> Iterator[Permutation]:
        i = len(image)
        if i == n:
            yield tuple(image)
            return
        for j in likely[i]:
            if j not in image and all(
                    first[i][k] == second[j][image[k]] and first[k][i] == second[image[k]][j]
                    for k in range(i)):
                image.append(j)
                yield from extend()
                image.pop()

    return extend()


def generators(weights: np.ndarray) -> list[Permutation]:
    """
    Return permutations that generate the automorphisms of a graph, the identity not among them.

    ``W(p(i), p(j)) = W(i, j)`` for each p; agents count from 0. There is one for each agent that
    another one can be exchanged for while all agents before it stay.

    :param weights: ``(n, n)``
    """
    colors = weight_colors(weights)
    n = len(colors)
    found = []
    for k in range(n):
        # Every automorphism that fixes 0 .. k - 1 is one of these and one that fixes k as well.
        for j in range(k + 1, n):
            order = list(range(n))
            order[k], order[j] = j, k
            exchanged = colors[np.ix_(order, order)]
            # p(k) = j is wanted: with the names of k and j exchanged, k stays.
            p = next(isomorphisms(colors, exchanged, k + 1), None)
            if p is not None:
                found.append(tuple(order[q] for q in p))
    return found


class AdmissibleAngles:
    """
    The matrices of pairwise angles that count as a shape under a graph.

    The error of a formation is the largest distance of a pairwise angle from the target's, in the
    admissible matrix that is nearest. Any two admissible matrices differ by ``gap`` in some pair,
    the least difference between angles of the target. So within half of the gap of one of them
    no other is nearer, and one is compared with. Further away the error is the least over all, if
    they are few enough to be kept. If not, it is the distance of the sorted angles instead, and
    at least half of the gap: a lower bound, exact again within half of the gap.

    :param points: one copy of the target shape, unit vectors, ``(n, 3)``
    :param weights: ``(n, n)``; None if every automorphism is known to keep the target's angles
    """

    def __init__(self, points: np.ndarray, weights: np.ndarray | None) -> None:
        n = len(points)
        self._i, self._j = np.triu_indices(n, k=1)
        angles = np.zeros((n, n))
        angles[self._i, self._j] = measures.pairwise_angles(points)
        self._angles = angles + angles.T
        self._classes = level_indices(self._angles, SAME_ANGLE)
        levels = np.unique(np.round(self._angles[self._i, self._j], 9))
        steps = np.diff(levels)
        steps = steps[steps > SAME_ANGLE]
        self.gap = float(np.min(steps, initial=math.inf))
        self._sorted = np.sort(self._angles[self._i, self._j])
        self.permutations: list[Permutation] = [tuple(range(n))]
        self.is_complete = True
        if weights is not None and self.gap < math.inf:
            self._weights = weight_colors(weights)
            self.is_complete = self._find_all(generators(weights))
        self._lists = [self._list(p) for p in self.permutations]
        self._best = 0

    def _list(self, p: Permutation) -> list[float]:
        order = np.array(p)
        return [float(x) for x in self._angles[order[self._i], order[self._j]]]

    def _find_all(self, moves: list[Permutation]) -> bool:
        """Collect a permutation for each admissible matrix; return whether that is all."""
        known = {self._classes.tobytes()}
        waiting = list(self.permutations)
        while waiting:
            p = waiting.pop()
            for move in moves:
                q = tuple(p[k] for k in move)
                order = np.array(q)
                matrix = self._classes[np.ix_(order, order)].tobytes()
                if matrix not in known:
                    if len(self.permutations) == MOST_MATRICES:
                        del self.permutations[1:]
                        return False
                    known.add(matrix)
                    self.permutations.append(q)
                    waiting.append(q)
        return True

    def error(self, angles: Sequence[float]) -> float:
        """
        Return how far the worst pairwise angle is from the nearest admissible matrix [rad].

        :param angles: theta_ij for i < j, lexicographic [rad], plain floats
        """
        lists = self._lists
        worst = max([abs(a - b) for a, b in zip(angles, lists[self._best])])
        if worst < 0.5 * self.gap:
            return worst
        if not self.is_complete:
            return self._bounded_error(angles)
        for index, targets in enumerate(lists):
            for a, b in zip(angles, targets):
                if abs(a - b) >= worst:
                    break
            else:
                worst = max([abs(a - b) for a, b in zip(angles, targets)])
                self._best = index
        return worst

    def _bounded_error(self, angles: Sequence[float]) -> float:
        bound = float(np.max(np.abs(np.sort(angles) - self._sorted)))
        if bound >= 0.5 * self.gap:
            return bound
        # Only the matrix with these classes can be within half of the gap.
        nearest = np.argmin(np.abs(np.asarray(angles)[:, None] - self._sorted), axis=1)
        classes = np.zeros_like(self._classes)
        ranks = np.sort(self._classes[self._i, self._j])[nearest]
        classes[self._i, self._j] = classes[self._j, self._i] = ranks
        np.fill_diagonal(classes, np.diag(self._classes))
        base = int(np.max(classes)) + 1
        p = next(isomorphisms(self._weights * base + classes,
                              self._weights * base + self._classes), None)
        if p is None:
            return max(bound, 0.5 * self.gap)
        self._lists[0], self.permutations[0] = self._list(p), p
        return max(abs(a - b) for a, b in zip(angles, self._lists[0]))

    def errors(self, gamma: np.ndarray) -> np.ndarray:
        """
        Return the error of many formations [rad], ``(...)``.

        :param gamma: reduced attitudes, ``(..., n, 3)``
        """
        angles = measures.pairwise_angles(gamma)
        flat = angles.reshape(-1, angles.shape[-1])
        if self.is_complete:
            worst = np.min([np.max(np.abs(flat - np.array(targets)), axis=-1)
                            for targets in self._lists], axis=0)
        else:
            worst = np.array([self.error(row) for row in flat.tolist()])
        result: np.ndarray = worst.reshape(angles.shape[:-1])
        return result

    def nearest(self, gamma: np.ndarray) -> Permutation:
        """
        Return the permutation p for which the agents are nearest to ``points[p]``.

        :param gamma: reduced attitudes, ``(n, 3)``
        """
        self.error(measures.pairwise_angles(gamma).tolist())
        return self.permutations[self._best]
