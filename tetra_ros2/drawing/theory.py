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

"""The numbers of theory beside those that were measured, and how to write them down."""

from dataclasses import dataclass, replace
from functools import cached_property
import math
from typing import Any

import numpy as np
from numpy.typing import NDArray
from tetra_ros2.formation import (
    decay,
    law,
    measures,
    polyhedra,
    sampling,
    shapes,
    stability,
)
from tetra_ros2.formation import topology as topologies
from tetra_ros2.formation.topology import Topology

NEAR = 0.02
"""Error [rad] below which a formation is at its equilibrium, to look where that is exactly."""

CLOSE = 0.05
"""How far a cosine may be from that of a solid which the formation is taken for."""

STILL = 1e-4
"""How much a solid may change by itself, in parts of the gain; weights are read off commands."""

MOST_SAMPLED = 12
"""Agents up to which the equilibrium of the sampled loop is found while somebody watches."""

Rates = tuple[float | None, float | None]


@dataclass(frozen=True, eq=False)
class Theory:
    """
    What is known of a formation beside its states.

    :param n: number of agents
    :param topology: who sees whom, or None if that is not known
    :param gain: the gain function, or None if that is not known
    :param h: the time from one sample to the next [s], or None if that is not known
    """

    n: int
    topology: Topology | None = None
    gain: Any = None
    h: float | None = None

    @property
    def known(self) -> bool:
        """Return whether it is known by which law the agents move."""
        return self.topology is not None and self.gain is not None and self.topology.n == self.n

    def agrees_with(self, other: 'Theory') -> bool:
        """Return whether this and another say the same."""
        return (self.n, type(self.gain), self.gain, self.h) == (
            other.n, type(other.gain), other.gain, other.h) and (
            (self.topology is None) == (other.topology is None)) and (
            self.topology is None or other.topology is None
            or np.array_equal(self.topology.weights, other.topology.weights))

    @cached_property
    def shape(self) -> shapes.Shape | None:
        """Return the shape that is to come out; that of equal weights where they are unknown."""
        return shapes.known_shape(self._topology)

    @cached_property
    def _topology(self) -> Topology:
        return self.topology or topologies.complete(self.n)

    @cached_property
    def fastest(self) -> float | None:
        """Return a rate [rad/s] that no agent exceeds, or None if the law is not known."""
        if self.topology is None or self.gain is None:
            return None
        return float(np.max(np.sum(np.abs(self.topology.weights), axis=1)) * self.gain.f(0.0))

    def error(self, gamma: NDArray[np.float64]) -> NDArray[np.float64]:
        """Return how far the worst pairwise angle is [rad], from the last one's if need be."""
        if self.shape is not None:
            return shapes.admissible_angles(self._topology).errors(gamma)
        angles = measures.pairwise_angles(gamma)
        error: NDArray[np.float64] = np.max(np.abs(angles - angles[-1]), axis=-1)
        return error

    @cached_property
    def rates(self) -> Rates:
        """Return how fast it spins [rad/s] and how fast its error decays [1/s], each or None."""
        if self.topology is None or not self.known or self.shape is None or self.n == 2:
            return None, None  # a pair may approach its shape slower than any rate
        # The mirror image spins the other way, and as fast.
        there = stability.transverse(self.shape.points, self.topology.weights, self.gain)
        slowest = -float(there.eigenvalues[0].real)
        return float(np.linalg.norm(there.spin)), slowest if slowest > 1e-6 else None

    def _sampled_near(self, gamma: NDArray[np.float64]) -> sampling.SampledEquilibrium | None:
        """Return the equilibrium of the loop with its sampling, or None if that is not known."""
        if self.topology is None or not self.known or self.shape is None or self.h is None \
                or not 2 < self.n <= MOST_SAMPLED or self.rates[1] is None:
            return None
        try:
            found = sampling.sampled_equilibrium(gamma, self.topology.weights, self.gain, self.h)
        except np.linalg.LinAlgError:
            return None
        return found if found.residual < 1e-9 else None

    @cached_property
    def _sampled(self) -> sampling.SampledEquilibrium | None:
        return None if self.shape is None else self._sampled_near(self.shape.points)

    @cached_property
    def floor(self) -> float | None:
        """Return the error [rad] that sampling leaves in the end, or None if not known."""
        return None if self._sampled is None else float(self.error(self._sampled.gamma[None])[0])

    @cached_property
    def _limits(self) -> dict[bytes, sampling.SampledEquilibrium | None]:
        return {}

    def limit(self, gamma: NDArray[np.float64]) -> NDArray[np.float64] | None:
        """
        Return what a formation near its shape approaches, ``(n, 3)``, or None if not known.

        :param gamma: reduced attitudes, ``(n, 3)``; they tell which agent is where in the shape
        """
        key = np.round(4.0 * measures.pairwise_cosines(gamma)).astype(np.int8).tobytes()
        if key not in self._limits:
            self._limits[key] = self._sampled_near(gamma)
        there = self._limits[key]
        return None if there is None else there.gamma

    @cached_property
    def sampled_rates(self) -> Rates:
        """Return what :attr:`rates` are with the sampling of the loop, each or None."""
        there = self._sampled
        if there is None or self.h is None:
            return None, None
        slowest = float(-np.log(np.abs(there.floquet_multipliers()[0])) / self.h)
        return float(np.linalg.norm(there.spin)), slowest if slowest > 1e-6 else None

    def decay_rate(self, times: NDArray[np.float64], gamma: NDArray[np.float64]) -> float | None:
        """
        Return how fast the shape is seen to approach its limit [1/s], or None if it is not seen.

        :param times: [s], ``(k,)``
        :param gamma: reduced attitudes, ``(k, n, 3)``
        """
        if self.shape is None or self.error(gamma[-1:])[0] > NEAR:
            return None
        limit = self.limit(gamma[-1])
        if limit is None:
            return None
        rate = decay.decay_rate(gamma, times, limit)
        return None if math.isnan(rate) else rate


def recognize(topology: Topology, gain: Any, gamma: NDArray[np.float64]) -> Topology:
    """
    Return a topology with the shape that came out, if that is a Platonic solid and stays one.

    A recording does not tell for which shape its weights were made.

    :param topology: who sees whom
    :param gain: the gain function
    :param gamma: reduced attitudes at the end, ``(n, 3)``
    """
    if shapes.known_shape(topology) is not None:
        return topology
    for name, points in polyhedra.SOLIDS.items():
        if len(points) != topology.n:
            continue
        seen, classes = gamma @ gamma.T, np.unique(np.round(points @ points.T, 9))
        gram = classes[np.argmin(np.abs(seen[..., None] - classes), axis=-1)]
        if np.max(np.abs(gram - seen)) > CLOSE:
            return topology
        values, vectors = np.linalg.eigh(gram)
        corners = vectors[:, -3:] * np.sqrt(np.maximum(values[-3:], 0.0))
        if not np.allclose(corners @ corners.T, gram, atol=1e-9):
            return topology
        velocity = law.velocity(corners, topology.weights, gain)
        spin = measures.angular_velocity(corners, velocity)
        if np.max(np.abs(velocity - np.cross(spin, corners))) > STILL * gain.f(0.0):
            return topology
        return replace(topology, shape=shapes.Shape(
            name if name == 'cube' else f'regular {name}', corners))
    return topology


def spin_rate(times: NDArray[np.float64], gamma: NDArray[np.float64]) -> float | None:
    """Return how fast the formation turns as a whole at the end [rad/s], or None."""
    if len(times) < 2 or times[-1] <= times[-2]:
        return None
    return float(np.linalg.norm(measures.mean_angular_velocity(
        gamma[-2], gamma[-1], float(times[-1] - times[-2]))))


def table(theory: Theory, times: NDArray[np.float64], gamma: NDArray[np.float64],
          since: float = -math.inf) -> str:
    """
    Return the numbers of theory and of a run as a Markdown table.

    :param theory: a :class:`Theory`
    :param times: [s], ``(k,)``
    :param gamma: reduced attitudes, ``(k, n, 3)``
    :param since: time from which on theory has been true [s]
    """
    cosines = measures.pairwise_cosines(gamma[-1])
    targets = '—'
    if theory.shape is not None:
        targets = _cosines(np.cos(theory.shape.angles))
    measured_spin = spin_rate(times, gamma)
    (spin, slowest), (sampled_spin, sampled_slowest) = theory.rates, theory.sampled_rates
    rows = [
        ('cosines', targets, '', f'{np.min(cosines):.4f} … {np.max(cosines):.4f}'),
        ('spin [rad/s]', _number(spin), _number(sampled_spin), _number(measured_spin)),
        ('turn [s]', _period(spin), _period(sampled_spin), _period(measured_spin))]
    if theory.shape is not None:  # otherwise there is nothing known to be away from
        late = times >= since
        measured = theory.decay_rate(times[late], gamma[late]) if np.any(late) else None
        rows[1:1] = [('error [rad]', '0', _offset(theory),
                      f'{theory.error(gamma[-1:])[0]:.2e}')]
        rows += [('decay [1/s]', _number(slowest), _number(sampled_slowest), _number(measured))]
    if theory.sampled_rates == (None, None):
        lines = ['|  | theory | measured |', '|:--|--:|--:|']
        return '\n'.join(lines + [f'| {name} | {a} | {c} |' for name, a, _, c in rows])
    rate = f'{1.0 / (theory.h or 1.0):.4g} Hz'
    lines = [f'|  | theory | at {rate} | measured |', '|:--|--:|--:|--:|']
    return '\n'.join(lines + [f'| {name} | {a} | {b} | {c} |' for name, a, b, c in rows])


def _cosines(values: NDArray[np.float64]) -> str:
    """Return the cosines of a shape, at most a few of them."""
    distinct = np.unique(np.round(values, 6)) + 0.0
    if len(distinct) > 5:
        return f'{distinct[0]:.4f} … {distinct[-1]:.4f}'
    return ', '.join(f'{value:.4f}' for value in distinct)


def _offset(theory: Theory) -> str:
    """Return the error that sampling leaves."""
    if theory.floor is None:
        return '—'
    return '0' if theory.floor < 1e-9 else f'{theory.floor:.2e}'


def _number(value: float | None) -> str:
    return '—' if value is None else f'{value:.4f}'


def _period(rate: float | None) -> str:
    if rate is None:
        return '—'
    return f'{2.0 * np.pi / rate:.3f}' if rate > 1e-3 else 'at rest'
