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

"""One agent, in plain floats: what it does with what it sees."""

from collections.abc import Callable, Iterable, Sequence
import math
from typing import Any

from tetra_ros2.formation._types import Vector
from tetra_ros2.formation.checks import LONGEST, refuse_direction, Rejected, SHORTEST
from tetra_ros2.formation.gain import Gain

NEVER = -math.inf

AHEAD = 600_000_000
"""
How far a measurement's stamp may be ahead of the newest one in use [ns], if nobody set it.

A true one is not, as long as the plant sends again before ``measurement_timeout`` is over: after
that what was seen is forgotten, and any stamp is welcome.
"""

LONGEST_LEAP = 4
"""Or how many times as far as from the last round but one to the last."""


class Controller:
    """
    The control law of one agent, and the bookkeeping of the measurements that it needs.

    Measurements arrive one neighbour at a time. A *round* is one measurement of every neighbour,
    all of one stamp; the law answers a round as soon as it is complete, and again whenever it has
    been sent once more. All that this class knows is the agent's own axis, how much each
    neighbour counts, and what was seen of them, in the agent's body frame.

    No stamp of one message may keep out the true ones that come after it. So a stamp far ahead of
    those in use is refused, unless the agent's own clock says the same; one that is not far ahead
    is taken, and gives way to the next one of the same neighbour that is as new as what the
    others say. If every neighbour speaks of another time, it is the plant's clock that was set,
    and all of them are believed.

    :param axis: the agent's pointing axis b_i in its body frame, a unit vector (x, y, z)
    :param weights: W(i, j) for each neighbour; a neighbour's index here is its *slot* below
    :param gain: a :class:`~tetra_ros2.formation.gain.Gain`; may be replaced at any time
    :param clock: returns the time on the agent's own clock [ns]; 0 where it has none
    :ivar received: how many measurements were taken
    :ivar ahead: how far a stamp may be ahead of the newest one in use [ns]
    """

    def __init__(self, axis: Iterable[float], weights: Iterable[float], gain: Gain,
                 clock: Callable[[], int] = lambda: 0) -> None:
        x, y, z = axis
        self.axis: Vector = x, y, z
        self.weights = tuple(weights)
        self.gain = gain
        self.stamp = 0  # of the newest measurement seen [ns]
        self.received = 0
        self.ahead = AHEAD
        self._clock = clock
        # For each slot the stamp that was refused last, and what was seen.
        self._suspects: dict[int, tuple[int, Sequence[float]]] = {}
        self._answered = self._step = 0  # the last round's stamp, and how far it leapt
        self.heard_at = [NEVER] * len(self.weights)
        self._seen: list[Any] = [None] * len(self.weights)  # x, y, z, once there are any
        self._stamps = [0] * len(self.weights)
        self._all = (1 << len(self.weights)) - 1
        self._missing = self._all  # the slots from which the round still waits, one bit each
        self._others = [self._all & ~(1 << slot) for slot in range(len(self.weights))]

    def receive(self, slot: int, stamp: int, seen: Sequence[float],
                now: float) -> Vector | None:
        """
        Take a measurement; return the angular velocity if it completes a round, otherwise None.

        :param slot: which neighbour was measured
        :param stamp: when it was measured [ns]
        :param seen: the neighbour's pointing axis y_ij in this agent's body frame (x, y, z)
        :param now: when it was received, on any clock that never goes back [s]
        :returns: the command (x, y, z) [rad/s] in the body frame, for the time ``self.stamp``
        :raises Rejected: if it is older than one already used, from too far ahead, not finite or
            not a unit vector; it is not used then
        """
        x, y, z = seen
        if not SHORTEST <= x * x + y * y + z * z <= LONGEST:
            refuse_direction(x, y, z)
        # Nearly always it is that of the newest one in use, which was looked at.
        if stamp != self.stamp:
            if stamp < self._stamps[slot] or stamp > self.stamp + self.ahead:
                self._doubt(slot, stamp, seen, now)
            if stamp > self.stamp:
                self.stamp = stamp
                self._missing = self._all
        if self._suspects:
            self._suspects.pop(slot, None)
        self._seen[slot] = seen
        self._stamps[slot] = stamp
        self.heard_at[slot] = now
        self.received += 1
        if stamp != self.stamp:
            return None  # late: the others are already in a newer round
        self._missing &= self._others[slot]
        if self._missing:
            return None
        self._missing = self._all
        if stamp != self._answered:
            self._step, self._answered = stamp - self._answered, stamp
        return self.angular_velocity()

    def _doubt(self, slot: int, stamp: int, seen: Sequence[float], now: float) -> None:
        """
        Raise Rejected for a stamp that is not to be believed, or make room for it.

        :param slot: which neighbour was measured
        :param stamp: when, as the message has it [ns]
        :param seen: what was measured
        :param now: when it was received [s]
        """
        if not self.stamp:
            return  # nothing is in use yet
        if stamp > self.stamp:
            # There was a gap, or the plant takes long steps.
            if abs(stamp - self._clock()) < self.ahead or not self._step \
                    or stamp - self.stamp <= LONGEST_LEAP * self._step:
                return
        elif self._is_better(slot, stamp):
            self._stamps[slot] = 0
            self.stamp = max(self._stamps)
            self._missing = sum(1 << k for k, s in enumerate(self._stamps) if s != self.stamp)
            return
        reason = Rejected.FUTURE_STAMP if stamp > self.stamp else Rejected.OLD_STAMP
        self._suspects[slot] = stamp, seen
        stamps = [s for s, _ in self._suspects.values()]
        if len(stamps) < len(self._stamps) or len(stamps) == 1 \
                or max(stamps) - min(stamps) > self.ahead:
            raise Rejected(reason)
        # Every neighbour speaks of another time: the plant's clock was set.
        suspects = dict(self._suspects)
        self.forget()
        for k, (s, direction) in suspects.items():
            self._stamps[k], self._seen[k], self.heard_at[k] = s, direction, now
        self.stamp, self._step = max(stamps), 0
        self._missing = sum(1 << k for k, s in enumerate(self._stamps) if s != self.stamp)

    def _is_better(self, slot: int, stamp: int) -> bool:
        """Return whether it is the stamp in use, and not this older one, that is wrong."""
        in_use = self._stamps[slot]
        others = [s for k, s in enumerate(self._stamps) if k != slot and self._seen[k] is not None]
        if others:
            return stamp >= max(others)
        clock = self._clock()
        return clock > 0 and abs(stamp - clock) < min(in_use - clock, self.ahead)

    def angular_velocity(self) -> Vector:
        """
        Return ``-sum_j W(i, j) f(theta_ij) b_i x y_ij`` [rad/s] in the body frame; eq:RF:Control.

        It takes the newest measurement of each neighbour, all of which must have been seen.
        """
        bx, by, bz = self.axis
        f = self.gain.of_one_cosine
        # The sum comes before the product, which is linear. Where the cosine tells little of
        # theta, near 0 and pi, the product is as small as the error of theta: nothing is lost.
        x = y = z = 0.0
        for weight, (u, v, w) in zip(self.weights, self._seen):
            cosine = bx * u + by * v + bz * w
            if not -1.0 <= cosine <= 1.0:  # by rounding, or as a measurement is not quite a unit
                cosine = math.copysign(1.0, cosine)
            rate = weight * f(cosine)
            x += rate * u
            y += rate * v
            z += rate * w
        return y * bz - z * by, z * bx - x * bz, x * by - y * bx

    @property
    def complete(self) -> bool:
        """Return whether there is a measurement of every neighbour."""
        return None not in self._seen

    @property
    def oldest_stamp(self) -> int:
        """Return the stamp of the oldest measurement in use [ns]."""
        return min(self._stamps, default=0)

    def unseen(self) -> list[int]:
        """Return the slots of the neighbours of which there is no measurement."""
        return [slot for slot, seen in enumerate(self._seen) if seen is None]

    def forget(self, before: float = math.inf) -> None:
        """
        Forget the measurements of neighbours not heard since a time.

        What they say next is welcome, whatever its stamp: it may be of a plant that was started
        again, with a clock that was started again.

        :param before: forget those last heard before this time [s]; by default all
        """
        forgotten = False
        for slot, heard_at in enumerate(self.heard_at):
            if heard_at < before and self._seen[slot] is not None:
                self.heard_at[slot], self._seen[slot], self._stamps[slot] = NEVER, None, 0
                forgotten = True
        if forgotten:  # otherwise a round that is half there goes on
            self.stamp, self._missing = max(self._stamps), self._all
            self._suspects.clear()
