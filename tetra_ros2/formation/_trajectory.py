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

"""A run of a formation in this process, and what came of it."""

from __future__ import annotations

from dataclasses import dataclass
import math
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import ArrayLike
from tetra_ros2.formation import flow, measures, rotation, shapes
from tetra_ros2.formation._types import Array
from tetra_ros2.formation.sensing import delay_in_steps
from tetra_ros2.formation.simulation import sample_time, SampledLoop

if TYPE_CHECKING:
    from tetra_ros2.formation._formation import Formation

UNIT_TOLERANCE = 1e-3
"""How far from 1 the length of what a user gave may be."""


@dataclass(frozen=True, eq=False)
class Trajectory:
    """
    How a formation moved, sample by sample.

    :param formation: what moved
    :param times: [s], ``(k,)``, the first is 0
    :param attitudes: R_i, unit quaternions x y z w, body to world, ``(k, n, 4)``
    :param reduced_attitudes: ``Gamma_i = R_i b_i``, unit vectors, ``(k, n, 3)``
    """

    formation: Formation
    times: Array
    attitudes: Array
    reduced_attitudes: Array

    @property
    def angles(self) -> Array:
        """Return theta_ij [rad] for i < j in lexicographic order, ``(k, n (n - 1) / 2)``."""
        return measures.pairwise_angles(self.reduced_attitudes)

    @property
    def errors(self) -> Array:
        """
        Return the largest distance of a pairwise angle from the known shape's [rad], ``(k,)``.

        Agents count as exchanged where the graph allows it.

        :raises ValueError: if no shape is known for the topology
        """
        shape = self.formation.shape
        if shape is None:
            raise ValueError(
                'no shape is known for this topology; compare angles with what you expect')
        return shapes.admissible_angles(self.formation.topology).errors(self.reduced_attitudes)

    def time_to_form(self, tolerance: float = 1e-3) -> float | None:
        """
        Return the time since which the error has stayed below a tolerance [s], or None.

        :param tolerance: [rad]
        :raises ValueError: if no shape is known for the topology
        """
        too_far = np.flatnonzero(~(self.errors < tolerance))
        first = int(too_far[-1]) + 1 if len(too_far) else 0
        return float(self.times[first]) if first < len(self.times) else None

    def spin(self) -> Array:
        """
        Return the angular velocity of the whole between the last two samples [rad/s], ``(3,)``.

        :raises ValueError: if there is but one sample
        """
        if len(self.times) < 2:
            raise ValueError('one sample does not tell how the formation turns')
        before, after = self.reduced_attitudes[-2:]
        return measures.mean_angular_velocity(before, after, self.times[-1] - self.times[-2])

    def predicted_spin(self) -> Array:
        """
        Return the angular velocity of the whole that the law gives at the end [rad/s], ``(3,)``.

        It is evaluated at the ideal shape, laid over the last sample.

        :raises ValueError: if no shape is known for the topology
        """
        if self.formation.shape is None:
            raise ValueError('no shape is known for this topology, so no spin is predicted')
        return shapes.predicted_angular_velocity(
            self.reduced_attitudes[-1], self.formation.topology, self.formation.gain)


def initial_attitudes(initial: ArrayLike | None, seed: int | None, axes: Array) -> Array:
    """
    Return the attitudes that a user asked for, unit quaternions ``(n, 4)``.

    :param initial: unit quaternions ``(n, 4)``, reduced attitudes ``(n, 3)``, or None
    :param seed: of random ones
    :param axes: pointing axes, unit vectors, ``(n, 3)``
    :raises ValueError: if ``initial`` is none of these
    """
    n = len(axes)
    if initial is None:
        return rotation.random(np.random.default_rng(seed), (n,))
    given = np.array(initial, dtype=float)
    if given.shape not in ((n, 4), (n, 3)):
        raise ValueError(f'initial must have the shape ({n}, 4), quaternions, or ({n}, 3), '
                         f'reduced attitudes, not {given.shape}')
    lengths = np.linalg.norm(given, axis=-1)
    if not np.all(np.abs(lengths - 1.0) <= UNIT_TOLERANCE):
        raise ValueError('initial must be unit quaternions or unit vectors')
    given = given / lengths[:, None]
    return given if given.shape[1] == 4 else rotation.between(axes, given)


def simulate(formation: Formation, initial: ArrayLike | None, seed: int | None,
             duration: float, rate: float, continuous: bool, noise: float, delay: float,
             loss: float) -> Trajectory:
    """Do what :meth:`~tetra_ros2.formation.Formation.simulate` says."""
    for name, value in (('duration', duration), ('rate', rate)):
        if not 0.0 < value < math.inf:
            raise ValueError(f'{name} must be finite and greater than 0, not {value!r}')
    if seed is None:
        seed = int(np.random.default_rng().integers(2**31))
    axes = formation.pointing_axes
    attitudes = initial_attitudes(initial, seed, axes)
    if not (0.0 <= noise <= 1.0 and 0.0 <= delay < math.inf and 0.0 <= loss <= 1.0):
        raise ValueError('noise and loss must be from 0 to 1, delay finite and not negative, '
                         f'not {noise!r}, {loss!r} and {delay!r}')
    if rate > 1e9:
        raise ValueError(f'rate must be 1e9 Hz at most, not {rate!r}')
    h = sample_time(rate)
    times = h * np.arange(round(duration / h) + 1, dtype=float)
    steps = delay_in_steps(delay, h)
    sensing = {'noise': noise, 'delay': steps, 'loss': loss, 'seed': seed} \
        if noise or steps or loss else {}
    if continuous:
        if sensing:
            raise ValueError('the measurements of a continuous loop are exact')
        kept = flow.attitudes(attitudes, axes, formation.topology.weights, formation.gain, times)
        return Trajectory(formation, times, kept, rotation.rotate(kept, axes))
    loop = SampledLoop(attitudes, axes, formation.topology, formation.gain, **sensing)
    kept = np.empty((len(times), formation.n, 4))
    reduced = np.empty((len(times), formation.n, 3))
    kept[0], reduced[0] = loop.bodies.attitudes, loop.bodies.reduced
    for k in range(1, len(times)):
        loop.advance(h)
        kept[k], reduced[k] = loop.bodies.attitudes, loop.bodies.reduced
    return Trajectory(formation, times, kept, reduced)
