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
The sampled loop without a network: measure, command, hold for a time h, again.

:class:`SampledLoop` is the twin of what the nodes do in lockstep: the same classes called in the
same order, hence the same to the last bit. :func:`simulate` is an implementation of its own, on
arrays with any leading axes, for many formations at once; it agrees with the other to rounding,
as numpy's elementary functions and sums round differently from the C library's.
"""

from typing import Any

import numpy as np
from numpy.typing import ArrayLike
from tetra_ros2.formation import law, rotation
from tetra_ros2.formation._types import Array
from tetra_ros2.formation.bodies import RigidBodies
from tetra_ros2.formation.controller import Controller
from tetra_ros2.formation.gain import Gain
from tetra_ros2.formation.sensing import Sensors
from tetra_ros2.formation.topology import Topology


def period_of(rate: float) -> int:
    """Return the period of a rate [Hz] in whole nanoseconds: stamps and steps then agree."""
    return max(round(1e9 / rate), 1)


def sample_time(rate: float) -> float:
    """Return the length of a step [s] of plant and simulation at a rate [Hz]."""
    return period_of(rate) / 1e9


class SampledLoop:
    """
    One formation in plain floats.

    :param attitudes: unit quaternions x y z w, body to world, ``(n, 4)``
    :param axes: pointing axes in the body frames, unit vectors, ``(n, 3)``
    :param topology: a :class:`~tetra_ros2.formation.topology.Topology`
    :param gain: a :class:`~tetra_ros2.formation.gain.Gain`
    :param sensing: what :class:`~tetra_ros2.formation.sensing.Sensors` takes beside the bodies,
        for measurements that are not perfect
    """

    def __init__(self, attitudes: Array, axes: Array, topology: Topology, gain: Gain,
                 **sensing: Any) -> None:
        self.bodies = RigidBodies(attitudes, axes)
        self.steps = 0
        self._seen = []
        self._controllers = []
        for i in range(1, topology.n + 1):
            neighbors = topology.neighbors(i)
            self._seen.append([j - 1 for j, _ in neighbors])
            self._controllers.append(
                Controller(self.bodies.axes[i - 1], [weight for _, weight in neighbors], gain))
        self._sensors = Sensors(self.bodies.seen_by, self._seen, **sensing) if sensing else None

    def advance(self, h: float, steps: int = 1) -> None:
        """Take a number of steps of length h [s]."""
        seen_by = self.bodies.seen_by if self._sensors is None else self._sensors.seen_by
        for _ in range(steps):
            self.steps += 1
            if self._sensors is not None:
                self._sensors.sample(self.steps)
            rates = [(0.0, 0.0, 0.0)] * len(self._controllers)
            for i, controller in enumerate(self._controllers):
                for slot, seen in enumerate(seen_by(i, self._seen[i])):
                    rate = controller.receive(slot, self.steps, seen, 0.0)
                    if rate is not None:
                        rates[i] = rate
            self.bodies.step(h, rates)


def step(attitudes: Array, axes: Array, weights: Array, gain: Gain, h: float) -> Array:
    """
    Return the attitudes one step of the sampled loop later.

    :param attitudes: unit quaternions x y z w, body to world, ``(..., n, 4)``
    :param axes: pointing axes in the body frames, unit vectors, ``(..., n, 3)``
    :param weights: ``(n, n)``
    :param gain: a :class:`~tetra_ros2.formation.gain.Gain`
    :param h: length of the step [s]
    :returns: unit quaternions, ``(..., n, 4)``
    """
    gamma = rotation.rotate(attitudes, axes)
    seen = rotation.rotate(rotation.inverse(attitudes)[..., :, None, :], gamma[..., None, :, :])
    rates = law.angular_velocity(axes, seen, weights, gain)
    return rotation.renormalize(rotation.multiply(attitudes, rotation.exp(h * rates)))


def simulate(attitudes: ArrayLike, axes: Array, weights: Array, gain: Gain, h: float,
             steps: int, every: int | None = None) -> Array:
    """
    Run the sampled loop.

    :param attitudes: unit quaternions x y z w, body to world, ``(..., n, 4)``
    :param axes: pointing axes in the body frames, unit vectors, ``(..., n, 3)``
    :param weights: ``(n, n)``
    :param gain: a :class:`~tetra_ros2.formation.gain.Gain`
    :param h: length of a step [s]
    :param steps: how many of them
    :param every: keep the state before the first step and after every so many
    :returns: the last attitudes, ``(..., n, 4)``; or, with ``every``, all those kept, with time
        as the first axis: ``(1 + steps // every, ..., n, 4)``
    """
    attitudes = np.array(attitudes, dtype=float)
    kept = [attitudes]
    for k in range(1, steps + 1):
        attitudes = step(attitudes, axes, weights, gain, h)
        if every is not None and k % every == 0:
            kept.append(attitudes)
    return np.stack(kept) if every is not None else attitudes
