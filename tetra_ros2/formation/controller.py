# Copyright 2026 The tetra_ros2 authors
# SPDX-License-Identifier: Apache-2.0

"""One agent, in plain floats: what it does with what it sees."""

from collections.abc import Iterable
import math
from typing import Any

from tetra_ros2.formation._types import Vector
from tetra_ros2.formation.checks import LONGEST, refuse_direction, Rejected, SHORTEST
from tetra_ros2.formation.gain import Gain

NEVER = -math.inf


class Controller:
    """
    The control law of one agent, and the bookkeeping of the measurements that it needs.

    Measurements arrive one neighbour at a time. A *round* is one measurement of every neighbour,
    all of one stamp; the law answers a round as soon as it is complete, and again whenever it has
    been sent once more. All that this class knows is the agent's own axis, how much each
    neighbour counts, and what was seen of them, in the agent's body frame.

    :param axis: the agent's pointing axis b_i in its body frame, a unit vector (x, y, z)
    :param weights: W(i, j) for each neighbour; a neighbour's index here is its *slot* below
    :param gain: a :class:`~tetra_ros2.formation.gain.Gain`; may be replaced at any time
    :ivar received: how many measurements were taken
    """

    def __init__(self, axis: Iterable[float], weights: Iterable[float], gain: Gain) -> None:
        x, y, z = axis
        self.axis: Vector = x, y, z
        self.weights = tuple(weights)
        self.gain = gain
        self.stamp = 0  # of the newest measurement seen [ns]
        self.received = 0
        self.heard_at = [NEVER] * len(self.weights)
        self._seen: list[Any] = [None] * len(self.weights)  # a Vector, once there is one
        self._stamps = [0] * len(self.weights)
        self._all = (1 << len(self.weights)) - 1
        self._missing = self._all  # the slots from which the round still waits, one bit each

    def receive(self, slot: int, stamp: int, seen: Vector, now: float) -> Vector | None:
        """
        Take a measurement; return the angular velocity if it completes a round, otherwise None.

        :param slot: which neighbour was measured
        :param stamp: when it was measured [ns]
        :param seen: the neighbour's pointing axis y_ij in this agent's body frame (x, y, z)
        :param now: when it was received, on any clock that never goes back [s]
        :returns: the command (x, y, z) [rad/s] in the body frame, for the time ``self.stamp``
        :raises Rejected: if it is older than one already used, not finite or not a unit vector;
            nothing has changed then
        """
        x, y, z = seen
        if not SHORTEST <= x * x + y * y + z * z <= LONGEST:
            refuse_direction(x, y, z)
        if stamp < self._stamps[slot]:
            raise Rejected(Rejected.OLD_STAMP)
        self._seen[slot] = seen
        self._stamps[slot] = stamp
        self.heard_at[slot] = now
        self.received += 1
        if stamp != self.stamp:
            if stamp < self.stamp:
                return None  # late: the others are already in a newer round
            self.stamp = stamp
            self._missing = self._all
        self._missing &= ~(1 << slot)
        if self._missing:
            return None
        self._missing = self._all
        return self.angular_velocity()

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
        Forget the measurements of neighbours not heard since: what they say next is welcome.

        They were silent for longer than the time-out. The next message may come from a plant that
        was started again and whose clock begins anew, so any stamp is accepted then.

        :param before: forget those last heard before this time [s]; by default all
        """
        for slot, heard_at in enumerate(self.heard_at):
            if heard_at < before:
                self.heard_at[slot], self._seen[slot], self._stamps[slot] = NEVER, None, 0
        self.stamp, self._missing = max(self._stamps, default=0), self._all
