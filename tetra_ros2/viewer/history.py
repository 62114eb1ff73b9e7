# Copyright 2026 The tetra_ros2 authors
# SPDX-License-Identifier: Apache-2.0

"""The recent past of a formation, as far as somebody who looks wants to know of it."""

from collections import deque

import numpy as np

from tetra_ros2.formation import measures

WINDOW = 30.0
"""How far back it goes [s]."""

SAMPLES = 600
"""How many samples it holds: as many as a chart can show."""

LINEAR = 0.1
"""The error below which it decays as the linearisation has it [rad]."""

ROUNDING = 1e-13
"""The error below which there is nothing left to decay [rad]."""


class History:
    """
    States of the last half minute, thinned, and the newest one.

    A state that is older than the last one begins a new history: the plant was started again.
    """

    def __init__(self):
        self.stamp = None  # of the newest state [ns]
        self.gamma = None  # the newest state, (n, 3)
        self.started_at = None  # stamp of the first state [ns]
        self._samples = deque(maxlen=SAMPLES)

    def add(self, stamp, gamma):
        """
        Take a state.

        :param stamp: its time [ns]
        :param gamma: reduced attitudes, ``(n, 3)``
        """
        anew = self.stamp is not None and (stamp < self.stamp or len(gamma) != len(self.gamma))
        if self.stamp is None or anew:
            self._samples.clear()
            self.started_at = stamp
        self.stamp, self.gamma = stamp, gamma
        if not self._samples or stamp - self._samples[-1][0] >= WINDOW / SAMPLES * 1e9:
            self._samples.append((stamp, gamma))

    def wants(self, stamp):
        """Return whether a state of this time would be kept, beyond being the newest."""
        return not self._samples or stamp < self._samples[-1][0] \
            or stamp - self._samples[-1][0] >= WINDOW / SAMPLES * 1e9

    def samples(self):
        """Return times since the first state [s], ``(k,)``, and states, ``(k, n, 3)``."""
        kept = list(self._samples)
        if kept[-1][0] != self.stamp:
            kept.append((self.stamp, self.gamma))
        times = (np.array([stamp for stamp, _ in kept]) - self.started_at) / 1e9
        return times, np.stack([gamma for _, gamma in kept])

    def trail(self, seconds):
        """Return the states of the last so many seconds, oldest first, ``(k, n, 3)``."""
        since = self.stamp - seconds * 1e9
        kept = []
        for stamp, gamma in reversed(self._samples):
            if stamp < since:
                break
            kept.append(gamma)
        return np.stack([*kept[::-1], self.gamma])


def spin_rate(times, gamma):
    """Return how fast the formation turns as a whole at the end [rad/s], or None."""
    if len(times) < 2:
        return None
    return float(np.linalg.norm(measures.mean_angular_velocity(
        gamma[-2], gamma[-1], times[-1] - times[-2])))


def decay_rate(times, error, least=5):
    """
    Return how fast the error decays exponentially in the newest part in which it does [1/s].

    :param times: [s], ``(k,)``
    :param error: [rad], ``(k,)``
    :param least: how many samples it takes
    :returns: None where it does not, or has come to its floor
    """
    settled = error[-1] if len(error) > 20 and np.ptp(error[-20:]) < 0.05 * error[-1] else 0.0
    # Well above where it ends: near its floor it is no exponential any more.
    usable = (error < LINEAR) & (error > max(20.0 * settled, ROUNDING))
    breaks = np.flatnonzero(~usable)
    ends = np.flatnonzero(usable)
    if not len(ends):
        return None
    last = ends[-1] + 1
    first = breaks[breaks < last][-1] + 1 if np.any(breaks < last) else 0
    if last - first < least:
        return None
    slope = np.polyfit(times[first:last], np.log(error[first:last]), 1)[0]
    return -float(slope) if slope < 0.0 else None
