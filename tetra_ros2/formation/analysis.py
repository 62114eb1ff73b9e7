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

"""What theory says of a formation: the numbers that an engineer has to choose."""

from __future__ import annotations

from dataclasses import dataclass
import math
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import ArrayLike
from tetra_ros2.formation import (
    equilibria,
    measures,
    rotation,
    sampling,
    sensing,
    shapes,
    stability,
)
from tetra_ros2.formation._trajectory import initial_attitudes
from tetra_ros2.formation.simulation import sample_time

if TYPE_CHECKING:
    from tetra_ros2.formation._formation import Formation

MAX_AGENTS = 60
"""Linear algebra on the 2 n coordinates of more would take minutes."""

MAX_HISTORY = 1500
"""So many numbers may describe the last states of a late loop: three for each agent and step."""

TRADE_OFF = (0.9, 0.5, 0.2, 0.1, 0.05, 0.02)
"""Fractions of the greatest sample time at which the greatest delay is looked for."""


class NotAnalyzable(ValueError):
    """
    A formation that has no numbers to give, or too many.

    :param problem: what is wrong
    :param key: what it is wrong with: ``topology`` or ``delay``
    """

    def __init__(self, problem: str, key: str = 'topology') -> None:
        super().__init__(problem)
        self.key = key


@dataclass(frozen=True)
class Analysis:
    """
    What theory says of a formation.

    :param agents: number of agents
    :param edges: number of edges
    :param strongly_connected: whether everybody is seen by everybody, directly or not
    :param symmetric: whether W(i, j) = W(j, i)
    :param shape: name of the shape that attracts, or None if it has none
    :param reduced_attitudes: one copy of it, a unit vector for each agent
    :param angles: its pairwise angles [rad], ascending
    :param hyperbolic: whether every deviation from the shape decays; otherwise the shape is one
        of a continuum, and drifts among the others
    :param spin_rate: angular speed of the formation [rad/s], 0 at rest
    :param period: of one turn [s], None at rest
    :param eigenvalues: real and imaginary parts of the transverse ones [1/s], the slowest first
    :param slowest_rate: of the modes that decay [1/s]
    :param fastest_rate: of all of them [1/s]
    :param settling_time: for the error to fall from ``start`` to ``error`` [s]
    :param rate: of the loop [Hz]
    :param delay_steps: how many steps the measurements are late
    :param sampled_rate: slowest rate of the loop at that rate and delay [1/s]; negative if it
        grows
    :param sampled_spin_rate: angular speed of the formation in that loop [rad/s]
    :param offset: how far sampling and delay take the angles from the shape [rad]
    :param max_sample_time: below which the loop is stable without delay [s]
    :param max_delay: below which it is stable without sampling [s]
    :param max_delay_steps: how many whole steps measurements may be late at that rate; -1: none
    :param max_delay_by_rate: for several rates [Hz] the number of steps, and that in seconds
    :param noise: standard deviation of a measured direction, per axis [rad]
    :param angle_deviation: standard deviation of the worst pairwise angle that it leaves [rad]
    :param mean_error: mean of the formation error that it leaves [rad]
    """

    agents: int
    edges: int
    strongly_connected: bool
    symmetric: bool
    shape: str | None
    reduced_attitudes: tuple[tuple[float, float, float], ...]
    angles: tuple[float, ...]
    hyperbolic: bool
    spin_rate: float
    period: float | None
    eigenvalues: tuple[tuple[float, float], ...]
    slowest_rate: float
    fastest_rate: float
    settling_time: float
    rate: float
    delay_steps: int
    sampled_rate: float
    sampled_spin_rate: float
    offset: float
    max_sample_time: float
    max_delay: float
    max_delay_steps: int
    max_delay_by_rate: tuple[tuple[float, int, float], ...]
    noise: float
    angle_deviation: float | None
    mean_error: float | None

    @property
    def is_stable(self) -> bool:
        """Return whether deviations decay at that rate and delay."""
        return self.sampled_rate > 0.0


def analyze(formation: Formation, *, rate: float, delay: float, noise: float, start: float,
            error: float, initial: ArrayLike | None, seed: int) -> Analysis:
    """
    Do what :meth:`~tetra_ros2.formation.Formation.analyze` says.

    :raises NotAnalyzable: if there is no formation to analyse
    :raises ValueError: if an argument is not valid
    """
    for name, value in (('rate', rate), ('noise', noise), ('start', start), ('error', error)):
        if not 0.0 < value < math.inf:
            raise ValueError(f'{name} must be finite and greater than 0, not {value!r}')
    if not 0.0 <= delay < math.inf:
        raise ValueError(f'delay must be finite and 0 or greater, not {delay!r}')
    if error >= start:
        raise ValueError(f'error must be less than start, {start!r}, not {error!r}')
    topology, gain, weights = formation.topology, formation.gain, formation.topology.weights
    h = sample_time(rate)
    delay_steps = sensing.delay_in_steps(delay, h)
    if 3 * topology.n * (delay_steps + 1) > MAX_HISTORY:
        raise NotAnalyzable(
            f'{delay_steps} steps of delay are too many to analyse, expected '
            f'{MAX_HISTORY // (3 * topology.n) - 1} at most for {topology.n} agents', 'delay')
    equilibrium, shape = attractor(formation, initial, seed)
    gamma, decaying = equilibrium.gamma, equilibrium.decaying
    spin = float(np.linalg.norm(equilibrium.spin)) if equilibrium.spins else 0.0
    there = sampling.delayed_equilibrium(gamma, weights, gain, h, delay_steps)
    hyperbolic = equilibrium.is_hyperbolic
    multipliers = there.floquet_multipliers() if hyperbolic and spin else \
        sampling.floquet_multipliers_at_rest(decaying, h, delay_steps)
    slowest = float(np.max(np.abs(multipliers)))
    stable = hyperbolic and there.residual < 1e-9 and slowest < 1.0
    deviation, mean_error = there.steady_angles(noise) if stable else (None, None)
    max_sample_time = sampling.max_sample_time(gamma, weights, gain)

    def max_delay_steps(step: float) -> int:
        return sampling.max_delay_steps(gamma, weights, gain, step) \
            if step < max_sample_time else -1

    trade_off = []
    for fraction in TRADE_OFF:
        step = float(f'{fraction * max_sample_time:.2g}')
        steps = max_delay_steps(step)
        trade_off.append((1.0 / step, steps, steps * step))
    angles = measures.pairwise_angles(gamma)
    sampled_angles = measures.pairwise_angles(there.gamma)
    return Analysis(
        agents=topology.n,
        edges=len(topology.edges),
        strongly_connected=len(components(weights)[0]) == 1,
        symmetric=bool(np.all(weights == weights.T)),
        shape=shape.name if shape is not None else None,
        reduced_attitudes=tuple((float(x), float(y), float(z)) for x, y, z in gamma),
        angles=tuple(np.sort(angles).tolist()),
        hyperbolic=hyperbolic,
        spin_rate=spin,
        period=2.0 * math.pi / spin if spin else None,
        eigenvalues=tuple((float(v.real), float(v.imag)) for v in equilibrium.eigenvalues),
        slowest_rate=float(np.min(-decaying.real)),
        fastest_rate=float(np.max(np.abs(decaying))),
        settling_time=math.log(start / error) / float(np.min(-decaying.real)),
        rate=rate,
        delay_steps=delay_steps,
        sampled_rate=-math.log(slowest) / h,
        sampled_spin_rate=float(np.linalg.norm(there.spin)) if spin else 0.0,
        offset=float(np.max(np.abs(sampled_angles - angles))) if stable and spin else 0.0,
        max_sample_time=max_sample_time,
        max_delay=sampling.max_delay(gamma, weights, gain),
        max_delay_steps=max_delay_steps(h),
        max_delay_by_rate=tuple(trade_off),
        noise=noise,
        angle_deviation=None if deviation is None else float(np.max(deviation)),
        mean_error=mean_error,
    )


def attractor(formation: Formation, initial: ArrayLike | None = None, seed: int = 0
              ) -> tuple[stability.RelativeEquilibrium, shapes.Shape | None]:
    """
    Return the relative equilibrium that attracts, and its shape where that has a name.

    That is the shape that the topology is known to lead to, if it is stable. Otherwise the closed
    loop is followed from somewhere until it keeps its shape.

    :param formation: the formation
    :param initial: where to begin; see :meth:`~tetra_ros2.formation.Formation.simulate`
    :param seed: of random attitudes in its place
    :raises NotAnalyzable: if there is none, or there are too many agents to find it
    """
    topology, gain = formation.topology, formation.gain
    if topology.n > MAX_AGENTS:
        raise NotAnalyzable(
            f'{topology.n} agents are too many to analyse, expected {MAX_AGENTS} at most')
    parts = components(topology.weights)[1]
    if len(parts) > 1:
        shown = ' and '.join(str(set(part)) for part in parts)
        raise NotAnalyzable(
            f'agents {shown} do not see one another, so there is no one formation to analyse')
    shape = shapes.known_shape(topology)
    if shape is not None:
        equilibrium = stability.transverse(shape.points, topology.weights, gain)
        if equilibrium.inertia[0] == 0 and len(equilibrium.decaying):
            return equilibrium, shape
    axes = formation.pointing_axes
    begin = rotation.rotate(initial_attitudes(initial, seed, axes), axes)
    gamma = equilibria.settle(begin, topology.weights, gain)
    if gamma is None:
        raise NotAnalyzable('its shape goes on changing, so there is no formation to analyse')
    equilibrium = stability.transverse(gamma, topology.weights, gain)
    # Where f is zero at the distance kept, the law's linear part is nothing but rounding: what is
    # left of a deviation decays ever more slowly.
    pull = float(np.max(np.sum(np.abs(topology.weights), axis=1)) * gain.f(0.5 * math.pi))
    if not len(equilibrium.decaying) or abs(equilibrium.decaying[0]) < stability.SLOW * pull:
        raise NotAnalyzable(
            'no deviation from its formation decays exponentially, so it has no rate')
    return equilibrium, None


def components(weights: ArrayLike) -> tuple[list[tuple[int, ...]], list[tuple[int, ...]]]:
    """
    Return the strongly and the weakly connected components of a graph, as lists of agents.

    :param weights: ``(n, n)``
    """
    def classes(together: np.ndarray) -> list[tuple[int, ...]]:
        return sorted({tuple((np.flatnonzero(row) + 1).tolist()) for row in together})

    def reach(edges: np.ndarray) -> np.ndarray:
        n = len(edges)
        reached = edges | np.eye(n, dtype=bool)
        for _ in range(int(n).bit_length()):
            reached = reached @ reached
        return reached

    edges = np.asarray(weights) != 0.0
    forward = reach(edges)
    return classes(forward & forward.T), classes(reach(edges | edges.T))
