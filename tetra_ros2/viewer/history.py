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

"""The recent past of a formation, as far as somebody who looks wants to know of it."""

from collections import deque

import numpy as np
from numpy.typing import NDArray
from tetra_ros2.drawing import geometry

WINDOW = 30.0
"""How far back it goes [s]."""

SAMPLES = 600
"""How many samples it holds: as many as a chart can show."""

PERIOD = WINDOW / SAMPLES
"""How far they are apart at least [s]."""


class History:
    """
    States of the last half minute, thinned, and the newest one.

    A state that is older than the last one begins a new history, and so does one that nobody
    can have turned to: the plant was started again, or reset.
    """

    def __init__(self) -> None:
        self.stamp: int | None = None  # of the newest state [ns]
        self.gamma: NDArray[np.float64] | None = None  # the newest state, (n, 3)
        self.started_at: int | None = None  # stamp of the first state [ns]
        self.fastest: float | None = None  # how fast an agent can turn [rad/s], if that is known
        self._samples: deque[tuple[int, NDArray[np.float64]]] = deque(maxlen=SAMPLES + 1)

    def add(self, stamp: int, gamma: NDArray[np.float64]) -> None:
        """
        Take a state.

        :param stamp: its time [ns]
        :param gamma: reduced attitudes, ``(n, 3)``
        """
        if self.stamp is None or self._is_elsewhere(stamp, gamma):
            self._samples.clear()
            self.started_at = stamp
        self.stamp, self.gamma = stamp, gamma
        if not self._samples or stamp - self._samples[-1][0] >= PERIOD * 1e9:
            self._samples.append((stamp, gamma))
        while self._samples[0][0] < stamp - WINDOW * 1e9:
            self._samples.popleft()

    def restart(self) -> None:
        """Forget all states: what comes next has nothing to do with them."""
        self.stamp = self.gamma = self.started_at = None
        self._samples.clear()

    def _is_elsewhere(self, stamp: int, gamma: NDArray[np.float64]) -> bool:
        if self.stamp is None or self.gamma is None:
            return True
        if stamp < self.stamp or gamma.shape != self.gamma.shape:
            return True
        return geometry.is_elsewhere(
            self.gamma, gamma, (stamp - self.stamp) / 1e9, self.fastest)

    def wants(self, stamp: int) -> bool:
        """Return whether a state of this time would be kept, beyond being the newest."""
        return not self._samples or stamp < self._samples[-1][0] \
            or stamp - self._samples[-1][0] >= PERIOD * 1e9

    def samples(self) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """Return times since the first state [s], ``(k,)``, and states, ``(k, n, 3)``."""
        if self.stamp is None or self.gamma is None or self.started_at is None:
            return np.empty(0), np.empty((0, 0, 3))
        kept = list(self._samples)
        if kept[-1][0] != self.stamp:
            kept.append((self.stamp, self.gamma))
        times = (np.array([stamp for stamp, _ in kept]) - self.started_at) / 1e9
        return times, np.stack([gamma for _, gamma in kept])

    def trail(self, seconds: float) -> NDArray[np.float64]:
        """Return the states of the last so many seconds, oldest first, ``(k, n, 3)``."""
        assert self.stamp is not None
        assert self.gamma is not None
        since = self.stamp - seconds * 1e9
        kept = [self.gamma]
        for stamp, gamma in reversed(self._samples):
            if stamp < since:
                break
            if stamp < self.stamp:
                kept.append(gamma)
        return np.stack(kept[::-1])
