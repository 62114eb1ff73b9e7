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

"""Sensors as they are: noisy, late, and now and then without an answer; in plain floats."""

from collections import deque
from collections.abc import Callable, Iterable, Sequence
import math
import random

from tetra_ros2.formation._types import Vector

SeenBy = Callable[[int, Sequence[int]], list[Vector]]


class Sensors:
    """
    What n bodies measure of each other, with noise, delay and loss, the same for the same seed.

    Noise turns each measured direction by a small Gaussian angle. Delay hands out what was
    measured some samples ago, or the first sample while there is none so old. A measurement that
    is lost is replaced by the one handed out before it, as by a receiver that holds its input.

    :param seen_by: the exact sight, ``RigidBodies.seen_by``; may be replaced when bodies are
    :param others: for each body, counted from 0, whom it looks at; None for nobody
    :param noise: standard deviation of a direction per axis [rad]
    :param delay: how many samples old the measurements are
    :param loss: the probability that a measurement is lost
    :param seed: of noise and loss
    """

    def __init__(self, seen_by: SeenBy, others: Iterable[Sequence[int] | None], *,
                 noise: float = 0.0, delay: int = 0, loss: float = 0.0, seed: int = 0) -> None:
        self._others = [list(o or ()) for o in others]
        self._noise, self._delay, self._loss = noise, delay, loss
        self._random = random.Random(seed)
        self.restart(seen_by)

    def restart(self, seen_by: SeenBy) -> None:
        """Look at other bodies from now on; what was on its way is forgotten."""
        self._exact = seen_by
        self._on_the_way: deque[list[list[Vector]]] = deque(maxlen=self._delay + 1)
        self._given: list[list[Vector]] = []
        self._stamp: int | None = None

    def sample(self, stamp: int) -> None:
        """Measure, unless it was done already for this time, of whatever unit."""
        if stamp == self._stamp:
            return
        self._stamp = stamp
        gauss, noise = self._random.gauss, self._noise
        measured = []
        for i, others in enumerate(self._others):
            row = self._exact(i, others)
            if noise:
                row = [_unit(x + gauss(0.0, noise), y + gauss(0.0, noise), z + gauss(0.0, noise))
                       for x, y, z in row]
            measured.append(row)
        self._on_the_way.append(measured)
        due = self._on_the_way[0]
        if self._loss and self._given:
            due = [[before if self._random.random() < self._loss else new
                    for before, new in zip(old_row, new_row)]
                   for old_row, new_row in zip(self._given, due)]
        self._given = due

    def seen_by(self, i: int, _others: Sequence[int]) -> list[Vector]:
        """Return what body i sees of the others as of the last sample."""
        return self._given[i]


def _unit(x: float, y: float, z: float) -> Vector:
    length = math.sqrt(x * x + y * y + z * z)
    return x / length, y / length, z / length


def delay_in_steps(delay: float, h: float) -> int:
    """Return how many steps of length h [s] it takes for a delay [s]: the next whole number."""
    return math.ceil(delay / h - 1e-9)
