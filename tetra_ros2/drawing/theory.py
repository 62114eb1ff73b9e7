# Copyright 2026 The tetra_ros2 authors
# SPDX-License-Identifier: Apache-2.0

"""The numbers of theory beside those that were measured, and how to write them down."""

from dataclasses import dataclass
from functools import cached_property

import numpy as np

from tetra_ros2.formation import measures, shapes, stability
from tetra_ros2.formation import topology as topologies
from tetra_ros2.viewer.history import decay_rate, spin_rate


@dataclass(frozen=True, eq=False)
class Theory:
    """
    What is known of a formation beside its states.

    :param n: number of agents
    :param topology: who sees whom, or None if that is not known
    :param gain: the gain function, or None if that is not known
    """

    n: int
    topology: object = None
    gain: object = None

    @property
    def shape(self):
        """Return the shape that is to come out; that of equal weights where they are unknown."""
        return shapes.known_shape(self._topology)

    @cached_property
    def _topology(self):
        return self.topology or topologies.complete(self.n)

    def error(self, gamma):
        """Return how far the worst pairwise angle is [rad], from the last one's if need be."""
        if self.shape is not None:
            return shapes.admissible_angles(self._topology).errors(gamma)
        angles = measures.pairwise_angles(gamma)
        return np.max(np.abs(angles - angles[-1]), axis=-1)

    def rates(self, gamma):
        """
        Return how fast it spins [rad/s] and how fast its error decays [1/s], each or None.

        :param gamma: reduced attitudes at hand, ``(n, 3)``
        """
        if self.topology is None or self.gain is None or self.topology.n != self.n:
            return None, None
        shape = self.shape
        if shape is None or self.n == 2:  # a pair may approach its shape slower than any rate
            return None, None
        # The mirror image spins and decays alike.
        there = stability.transverse(shape.points, self.topology.weights, self.gain)
        slowest = -float(there.eigenvalues[0].real)
        return float(np.linalg.norm(there.spin)), slowest if slowest > 1e-6 else None


def table(theory, times, gamma, error, rates):
    """
    Return the numbers as a Markdown table.

    :param theory: a :class:`Theory`
    :param times: [s], ``(k,)``
    :param gamma: reduced attitudes, ``(k, n, 3)``
    :param error: [rad], ``(k,)``
    :param rates: as :meth:`Theory.rates` has them
    """
    spin, decay = rates
    cosines = measures.pairwise_cosines(gamma[-1])
    targets = '—'
    if theory.shape is not None:
        targets = ', '.join(f'{value:.4f}' for value in np.unique(
            np.round(np.cos(theory.shape.angles), 6)))
    measured_spin = spin_rate(times, gamma)
    rows = [
        ('cosines', targets, f'{np.min(cosines):.4f} … {np.max(cosines):.4f}'),
        ('spin [rad/s]', _number(spin), _number(measured_spin)),
        ('turn [s]', _period(spin), _period(measured_spin))]
    if theory.shape is not None:  # otherwise there is nothing known to be away from
        rows[1:1] = [('error [rad]', '0', f'{error[-1]:.2e}')]
        rows += [('decay [1/s]', _number(decay), _number(decay_rate(times, error)))]
    lines = ['|  | theory | measured |', '|:--|--:|--:|']
    return '\n'.join(lines + [f'| {name} | {a} | {b} |' for name, a, b in rows])


def _number(value):
    return '—' if value is None else f'{value:.4f}'


def _period(rate):
    if rate is None:
        return '—'
    return f'{2.0 * np.pi / rate:.3f}' if rate > 1e-3 else 'at rest'
