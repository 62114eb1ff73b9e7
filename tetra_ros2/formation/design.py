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
Weights for a formation of one's own: any directions, at rest or turning.

Points P_1 .. P_n turn as one body with the angular velocity Omega exactly if for each i ``sum_j
W(i, j) f(theta_ij) (I - P_i P_i^T) P_j = -Omega x P_i``: two linear equations in agent i's own
weights, and with W >= 0 a linear program. What it leaves free decides how fast deviations decay.

The linearisation is linear in the weights. Its symmetric part bounds all rates from below and from
above, and where the weights are symmetric it is the whole of it. So :func:`design` maximises the
least eigenvalue of the symmetric part, with the largest held at 1, by linear programs that are cut
down by one eigenvector after another, and then improves on the true eigenvalues by further linear
programs in a trust region. Only this module of the mathematics needs SciPy.
"""

from collections.abc import Callable
from dataclasses import dataclass
import math
from typing import Any

import numpy as np
from scipy.optimize import linprog
from tetra_ros2.formation import equilibria, equivalence, law, measures, sphere, stability
from tetra_ros2.formation._types import Array
from tetra_ros2.formation.gain import Gain
from tetra_ros2.formation.stability import RelativeEquilibrium
from tetra_ros2.formation.symmetry import AdmissibleAngles

MAX_AGENTS = 40
"""The programs have n (n - 1) unknowns."""

CLOSEST = 1e-4
"""Points closer than this are taken to coincide [rad]."""

DECAY_KEPT = 0.6
"""Spinning: how much of the best decay is kept for the sake of smaller weights."""

LEAST_DECAY = 1e-3
"""Slowest over fastest rate below which weights do not count as a choice."""


TRIED_VERTICES = 12
"""How many vertices are tried where the symmetric part decides nothing."""


class DesignError(ValueError):
    """There are no such weights; the text says why."""


@dataclass(frozen=True, eq=False)
class Design:
    """
    Weights for which given points are a stable formation.

    :param points: the points, unit vectors, ``(n, 3)``
    :param weights: W >= 0, ``(n, n)``
    :param gain: the gain function
    :param equilibrium: the formation and its linearisation
    """

    points: Array
    weights: Array
    gain: Gain
    equilibrium: RelativeEquilibrium

    @property
    def slowest(self) -> float:
        """Return the rate at which the slowest deviation decays [1/s]."""
        return -float(self.equilibrium.eigenvalues[0].real)

    @property
    def fastest(self) -> float:
        """Return the largest modulus of an eigenvalue [1/s]."""
        return float(np.max(np.abs(self.equilibrium.eigenvalues)))

    @property
    def degree(self) -> int:
        """Return how many others an agent sees, at most."""
        return int(np.max(np.sum(self.weights != 0.0, axis=1)))


def check_points(points: Array, visible: float = math.pi) -> np.ndarray:
    """
    Return who can see whom, ``(n, n)``, after a look at the points.

    :param points: unit vectors, ``(n, 3)``
    :param visible: agents further apart than this do not see each other [rad]
    :raises DesignError: if points coincide, or an agent is antipodal to all that it sees
    """
    n = len(points)
    if not 2 <= n <= MAX_AGENTS:
        raise DesignError(f'{n} points are not valid, expected 2 to {MAX_AGENTS}')
    angles = sphere.geodesic_distance(points[:, None], points[None])
    np.fill_diagonal(angles, math.nan)
    for i, j in np.argwhere(angles < CLOSEST):
        raise DesignError(f'points {i + 1} and {j + 1} coincide')
    seen = angles <= visible
    for i in range(n):
        if not np.any(seen[i]):
            raise DesignError(f'agent {i + 1} sees nobody within {visible:g} rad')
        if np.all(angles[i, seen[i]] > math.pi - CLOSEST):
            raise DesignError(f'agent {i + 1} is antipodal to all that it sees: nothing turns it '
                              'back')
    return np.asarray(seen)


def constraints(points: Array, gain: Gain, spin: Array) -> tuple[Array, Array]:
    """
    Return the equations ``A_i w_i = b_i`` of each agent's weights, ``(n, 2, n)`` and ``(n, 2)``.

    :param points: unit vectors, ``(n, 3)``
    :param gain: the gain function
    :param spin: Omega [rad/s], ``(3,)``
    """
    bases = stability.tangent_basis(points)
    f = gain.f(sphere.geodesic_distance(points[:, None], points[None]))
    a = np.einsum('iap,ij,ja->ipj', bases, f, points)
    a[np.arange(len(points)), :, np.arange(len(points))] = 0.0
    return a, -np.einsum('iap,ia->ip', bases, np.cross(spin, points))


def _solve(cost: Array, **program: Any) -> Array | None:
    """Return the solution of a linear program, or None if there is none."""
    result = linprog(cost, method='highs', **program)
    return np.asarray(result.x) if result.status == 0 else None


def blocking_direction(points: Array, gain: Gain, spin: Array, seen: np.ndarray, i: int
                       ) -> Array | None:
    """
    Return a direction that proves that no weights hold agent i, or None if some do.

    It is a tangent d at P_i. All that agent i sees lies on its side, ``d . P_j > 0`` or, spinning,
    ``d . P_j >= 0``, so that the law drives the agent against d; but it is to stay, or to move
    along d. By Farkas' lemma there is one exactly if there are no weights, not all of them zero.

    :param points: unit vectors, ``(n, 3)``
    :param gain: the gain function
    :param spin: Omega [rad/s], ``(3,)``
    :param seen: who can see whom, ``(n, n)``
    :param i: the agent, from 0
    :returns: a unit vector, ``(3,)``
    """
    a, b = constraints(points, gain, spin)
    columns, target = a[i][:, seen[i]], b[i]
    scale = float(np.max(np.abs(columns)))
    moves = float(np.linalg.norm(target)) > 1e-12 * max(1.0, float(np.linalg.norm(spin)))
    # Unknowns: d and t. Maximise t where d . a_j >= t, or >= 0 and d . b <= -t.
    least = np.column_stack([-columns.T / scale, np.full(columns.shape[1], 0.0 if moves else 1.0)])
    if moves:
        least = np.vstack([least, [*(target / np.linalg.norm(target)), 1.0]])
    found = _solve(np.array([0.0, 0.0, -1.0]), A_ub=least, b_ub=np.zeros(len(least)),
                   bounds=[(-1.0, 1.0), (-1.0, 1.0), (None, 1.0)])
    if found is None or found[2] < 1e-9:
        return None
    direction = stability.tangent_basis(points)[i] @ found[:2]
    return np.asarray(direction / np.linalg.norm(direction))


class _Program:
    """The linear programs of one set of points, gain and spin; unknowns are weights of edges."""

    def __init__(self, points: Array, gain: Gain, spin: Array, seen: np.ndarray) -> None:
        self.points, self.gain, self.spin = points, gain, spin
        self.edges = np.argwhere(seen)
        n, count = len(points), len(self.edges)
        a, b = constraints(points, gain, spin)
        self.equations = np.zeros((2 * n, count))
        for e, (i, j) in enumerate(self.edges):
            self.equations[2 * i:2 * i + 2, e] = a[i, :, j]
        self.motion = b.ravel()
        self.spins = bool(np.linalg.norm(spin) > 0.0)
        bases = stability.tangent_basis(points)
        self.across = stability.complement(stability.rotations(points, bases))
        one = np.zeros((count, n, n))
        one[np.arange(count), self.edges[:, 0], self.edges[:, 1]] = 1.0
        whole = stability.linearization(
            np.broadcast_to(points, (count, n, 3)), one, gain, bases)
        self.parts = self.across.T @ whole @ self.across
        turning = stability.linearization(points, np.zeros((n, n)), gain, bases, spin)
        self.turning = self.across.T @ turning @ self.across
        symmetric = -0.5 * (self.parts + np.swapaxes(self.parts, -1, -2))
        self.symmetric = symmetric
        f = gain.f(sphere.geodesic_distance(*np.moveaxis(points[self.edges], 1, 0)))
        self.most = 20.0 / np.maximum(f, 1e-3 * float(np.max(f)))
        directions = [*np.eye(len(symmetric[0])), *np.linalg.eigh(np.sum(symmetric, axis=0))[1].T]
        self.slow_cuts = [self._along(x) for x in directions]
        self.fast_cuts = list(self.slow_cuts)

    def weights(self, w: Array) -> Array:
        """Return the matrix of the weights of the edges."""
        matrix = np.zeros((len(self.points),) * 2)
        matrix[self.edges[:, 0], self.edges[:, 1]] = w
        return matrix

    def choose(self, allowed: np.ndarray, spin_for: float | None = None,
               rounds: int = 60) -> tuple[Array, float, float] | None:
        """
        Return weights with the greatest least decay, the fastest being 1; share of spin; decay.

        :param allowed: which edges may be used
        :param spin_for: maximise the spin in place of the decay, which is to be no less than this
        :param rounds: how often the program is cut down
        """
        size, count = len(self.across.T), len(self.edges)
        bounds: list[tuple[float | None, float | None]] = [
            (0.0, m if ok else 0.0) for m, ok in zip(self.most, allowed)]
        bounds += [(0.0, None if self.spins else 0.0), (None, 1.0)]  # share of the spin, decay
        equations = np.column_stack([self.equations, -self.motion, np.zeros(len(self.motion))])
        cost = np.zeros(count + 2)
        if spin_for is None:
            cost[-1] = -1.0
        else:
            cost[-2], bounds[-1] = -1.0, (spin_for, 1.0)
        best, wanted = None, -math.inf
        for _ in range(rounds):
            slow, fast = np.array(self.slow_cuts), np.array(self.fast_cuts)
            program = np.vstack([
                np.column_stack([-slow, np.zeros(len(slow)), np.ones(len(slow))]),
                np.column_stack([fast, np.zeros((len(fast), 2))])])
            found = _solve(cost, A_ub=program, A_eq=equations, b_eq=np.zeros(len(equations)),
                           b_ub=np.repeat([0.0, 1.0], [len(slow), len(fast)]), bounds=bounds)
            if found is None:
                break
            w = np.maximum(found[:-2], 0.0)
            values, vectors = np.linalg.eigh(np.einsum('e,eab->ab', w, self.symmetric))
            decay = float(values[0] / max(values[-1], 1e-9))
            # Spinning fast comes after decaying as fast as is asked for.
            worth = decay if spin_for is None else min(decay, spin_for) + 1e-3 * float(found[-2])
            if worth > wanted:
                best, wanted = (w, float(found[-2]), decay), worth
            promised = float(found[-1])
            if values[0] > promised - 0.02 * abs(promised) - 1e-4 and values[-1] < 1.02:
                break
            # A few of the worst on either side: they are often of one kind.
            for k in range(min(3, size)):
                if values[k] < promised - 1e-4:
                    self.slow_cuts.append(self._along(vectors[:, k]))
                if values[-1 - k] > 1.0 + 1e-4:
                    self.fast_cuts.append(self._along(vectors[:, -1 - k]))
        return best

    def _along(self, x: Array) -> Array:
        """Return how each weight adds to the decay along a direction, ``(edges,)``."""
        return np.asarray(np.einsum('a,eab,b->e', x, self.symmetric, x, optimize=True))

    def vertices(self, allowed: np.ndarray) -> list[Array]:
        """Return some weights that hold the points at rest, the weights of each agent of sum 1."""
        n, count = len(self.points), len(self.edges)
        sums = np.zeros((n, count))
        sums[self.edges[:, 0], np.arange(count)] = 1.0
        rng = np.random.default_rng(0)
        found = [_solve(rng.uniform(size=count), A_eq=np.vstack([self.equations, sums]),
                        b_eq=np.repeat([0.0, 1.0], [len(self.equations), n]),
                        bounds=[(0.0, 1.0 if ok else 0.0) for ok in allowed])
                 for _ in range(TRIED_VERTICES)]
        vertices = [w for w in found if w is not None]
        if not vertices:
            raise DesignError('no weights satisfy the equations of all agents at once')
        # Their mean has most of the weights that can be greater than zero.
        return [np.asarray(np.mean(vertices, axis=0)), *vertices]

    def spectrum(self, w: Array, share: float) -> tuple[Array, Array, Array]:
        """Return eigenvalues, left and right eigenvectors, of the true linearisation."""
        matrix = np.einsum('e,eab->ab', w, self.parts) + share * self.turning
        values, right = np.linalg.eig(matrix)
        left = np.linalg.pinv(right)
        return values, left, right

    def ratio(self, w: Array, share: float) -> float:
        """Return the slowest decay over the fastest rate; negative if something grows."""
        values = np.linalg.eigvals(np.einsum('e,eab->ab', w, self.parts) + share * self.turning)
        return float(-np.max(values.real) / max(float(np.max(np.abs(values))), 1e-300))

    def improve(self, w: Array, share: float, allowed: np.ndarray, steps: int = 15) -> Array:
        """Return weights with a greater ratio of true eigenvalues, by sequential programs."""
        reach, here = 0.3, self.ratio(w, share)
        size = float(np.max(w))
        for _ in range(steps):
            values, left, right = self.spectrum(w, share)
            change = np.einsum('ka,eab,bk->ke', left, self.parts, right, optimize=True)
            fastest = float(np.max(np.abs(values)))
            inward = np.conj(values) / np.maximum(np.abs(values), 1e-300)
            speed = np.real(inward[:, None] * change)
            # Unknowns: the change of w, the decay t. Fast modes may not become faster.
            upper = np.vstack([
                np.column_stack([np.real(change), np.ones(len(values))]),
                np.column_stack([speed, np.zeros(len(values))])])
            limit = np.concatenate([-np.real(values), fastest - np.abs(values)])
            bounds = [(max(-v, -reach * size), reach * size) if ok else (-v, -v)
                      for v, ok in zip(w, allowed)] + [(None, None)]
            cost = np.zeros(len(w) + 1)
            cost[-1] = -1.0
            found = _solve(cost, A_ub=upper, b_ub=limit, bounds=bounds,
                           A_eq=np.column_stack([self.equations, np.zeros(len(self.motion))]),
                           b_eq=np.zeros(len(self.motion)))
            if found is None:
                break
            tried = np.maximum(w + found[:-1], 0.0)
            there = self.ratio(tried, share)
            if there > here + 1e-6:
                w, here, reach = tried, there, min(0.5, 1.5 * reach)
            else:
                reach *= 0.4
                if reach < 1e-4:
                    break
        return w


def design(points: Array, gain: Gain, *, spin: Array | None = None, visible: float = math.pi,
           max_degree: int | None = None) -> Design:
    """
    Return nonnegative weights for which points are a stable formation under a gain.

    :param points: unit vectors, ``(n, 3)``
    :param gain: the gain function
    :param spin: the angular velocity of the whole [rad/s], in the frame of the points; None for
        a formation at rest, whose largest weight is then 1
    :param visible: agents further apart than this do not see each other [rad]
    :param max_degree: how many others an agent may see at most; None for any number
    :raises DesignError: if there are none, or none that is stable was found
    """
    points = sphere.normalize(points)
    omega = np.zeros(3) if spin is None else np.asarray(spin, dtype=float)
    seen = check_points(points, visible)
    for i in range(len(points)):
        direction = blocking_direction(points, gain, omega, seen, i)
        if direction is not None:
            where = ', '.join(f'{x:.3g}' for x in direction)
            raise DesignError(
                f'no weights hold agent {i + 1}: all that it sees lies on the side of [{where}], '
                + ('from which it flees' if spin is None else
                   'from which it flees, while it is to move towards it'))
    program = _Program(points, gain, omega, seen)
    everything = np.ones(len(program.edges), dtype=bool)
    w, share = _best(program, everything)
    if max_degree is not None:
        w, share = _thin(program, w, share, max_degree)
    matrix = program.weights(w / share)
    matrix[matrix < 1e-9 * np.max(matrix)] = 0.0
    if spin is None:
        matrix /= np.max(matrix)
    equilibrium = stability.transverse(points, matrix, gain)
    made = Design(points, matrix, gain, equilibrium)
    if equilibrium.residual > 1e-6 * made.fastest or made.slowest < LEAST_DECAY * made.fastest:
        raise DesignError(
            f'no stable choice of weights was found: the best has its slowest rate at '
            f'{made.slowest / made.fastest:.2g} of the fastest')
    return made


def _best(program: _Program, allowed: np.ndarray) -> tuple[Array, float]:
    """Return the best weights found, and the share of the spin that they are for."""
    chosen = program.choose(allowed)
    if chosen is None:
        raise DesignError('no weights satisfy the equations of all agents at once')
    w, share, decay = chosen
    if program.spins:
        slower = program.choose(allowed, DECAY_KEPT * max(decay, 0.0)) if decay > 0.0 else None
        if slower is not None and slower[1] > share:
            w, share, _ = slower
        if share < 1e-6:
            raise DesignError('nothing turns: the weights would have to be without bound')
    else:
        share = 1.0
        if decay < LEAST_DECAY:
            # The symmetric part is no help. Some vertices of the program are where to begin.
            w = max(program.vertices(allowed), key=lambda w: program.ratio(w, 1.0))
    improved = program.improve(w, share, allowed)
    if program.ratio(improved, share) > 1.05 * program.ratio(w, share):
        w = improved
    if program.ratio(w, share) < LEAST_DECAY:
        raise DesignError(
            'no stable choice of weights was found, by the symmetric part or from '
            f'{TRIED_VERTICES} vertices of the program: at the best '
            + ('a deviation grows' if program.ratio(w, share) < -1e-9 else 'one does not decay'))
    return w, share


def _thin(program: _Program, w: Array, share: float, most: int) -> tuple[Array, float]:
    """Return weights of so many edges an agent, at most: the least go first."""
    allowed = w > 1e-7 * np.max(w)
    kept = np.zeros_like(allowed)
    sources = program.edges[:, 0]
    while True:
        degrees = np.bincount(sources[allowed], minlength=len(program.points))
        crowded = np.flatnonzero(degrees > most)
        if not len(crowded):
            return w, share
        trial = allowed.copy()
        chosen = []
        for i in crowded:
            candidates = np.flatnonzero((sources == i) & allowed & ~kept)
            if not len(candidates):
                raise DesignError(
                    f'no stable choice of weights was found in which agent {i + 1} sees no more '
                    f'than {most} others; with {degrees[i]} there is one')
            chosen.append(int(candidates[np.argmin(w[candidates])]))
        trial[chosen] = False
        try:
            w, share = _best(program, trial)
            allowed = trial & (w > 1e-7 * np.max(w))
        except DesignError:
            if len(chosen) == 1:
                kept[chosen] = True
                continue
            # One at a time, to learn which of them is needed.
            for e in chosen:
                trial = allowed.copy()
                trial[e] = False
                try:
                    w, share = _best(program, trial)
                    allowed = trial & (w > 1e-7 * np.max(w))
                    break
                except DesignError:
                    kept[e] = True


@dataclass(frozen=True, eq=False)
class Outcome:
    """
    What became of random starts.

    :param starts: how many
    :param formed: how many came to the points
    :param others: other formations that they came to, each with how often, most often first
    :param unsettled: how many had come to nothing
    """

    starts: int
    formed: int
    others: tuple[tuple[Array, int], ...]
    unsettled: int


def try_starts(made: Design, starts: int, seed: int = 0, longest: float = 60.0,
               progress: Callable[[], None] = lambda: None) -> Outcome:
    """
    Follow uniform random starts, and see what they come to.

    :param made: the design
    :param starts: how many
    :param seed: of the starts
    :param longest: when to give up, in units of the time constant of the slowest mode
    :param progress: called now and then
    """
    points, weights, gain = made.points, made.weights, made.gain
    admissible = AdmissibleAngles(points, weights)
    tolerance = min(0.05, 0.25 * admissible.gap)
    gamma = sphere.random(np.random.default_rng(seed), (starts, len(points)))
    h = min(0.5 / made.fastest, 1.0 / stability.fastest_rate(weights, gain))
    active, formed = np.arange(starts), np.zeros(starts, dtype=bool)
    for step in range(int(longest / (made.slowest * h))):
        here = gamma[active]
        middle = sphere.exp(here, 0.5 * h * law.velocity(here, weights, gain))
        # The midpoint rule: held commands would take a spinning formation off its points.
        gamma[active] = sphere.normalize(here + h * law.velocity(middle, weights, gain))
        if step % 20 == 19:
            progress()
            close = admissible.errors(gamma[active]) < tolerance
            formed[active[close]] = True
            active = active[~close]
            if not len(active):
                break
    others: list[tuple[Array, int]] = []
    unsettled, came = 0, int(np.sum(formed))
    for point in gamma[active]:
        found, left = equilibria.refine(point, weights, gain)
        if left < 1e-8 * made.fastest and admissible.errors(found) < 1e-4:
            came += 1
            continue
        if left > 1e-8 * made.fastest or \
                np.max(np.abs(measures.pairwise_angles(found) - measures.pairwise_angles(point))) \
                > 0.2:
            unsettled += 1
            continue
        for k, (other, count) in enumerate(others):
            if equivalence.equivalent(found, other, weights, 1e-5):
                others[k] = other, count + 1
                break
        else:
            others.append((found, 1))
    others.sort(key=lambda entry: -entry[1])
    return Outcome(starts, came, tuple(others), unsettled)
