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

"""What stands between the commands and a body that can break."""

import math

from tetra_ros2.formation._types import Vector
from tetra_ros2.formation.checks import Rejected, require_rate

STILL: Vector = (0.0, 0.0, 0.0)

TURNING = 'turning as commanded'
WAITING = 'held, no command yet'
SILENT = 'held, no recent command'
TOO_FAST = 'held, commanded faster than max_angular_velocity'
STOPPED = 'emergency stop'


class Watchdog:
    """
    Holds a body unless there is a recent command that it may follow.

    :param timeout: how old the last command may be [s]
    :param max_rate: how fast it may be [rad/s]; a faster one holds the body until a slower one
        comes
    """

    def __init__(self, timeout: float, max_rate: float) -> None:
        self.stopped = False  # by the emergency stop; nothing else releases it
        self._timeout, self._max_rate = timeout, max_rate
        self._rate = STILL
        self._stamp = 0
        self._heard_at = -math.inf
        self._too_fast = False

    def command(self, stamp: int, rate: Vector, now: float) -> None:
        """
        Take a command.

        :param stamp: of the measurements that it answers [ns]
        :param rate: angular velocity in the body frame [rad/s]
        :param now: when it came, on a clock that never goes back [s]
        :raises Rejected: if it is not finite, too fast, or older than the one before
        """
        # After a silence any stamp will do: whoever commands may have been started anew.
        if stamp < self._stamp and now - self._heard_at <= self._timeout:
            raise Rejected(Rejected.OLD_STAMP)
        try:
            require_rate(*rate, self._max_rate)
        except Rejected:
            self._rate, self._too_fast = STILL, True
            self._heard_at = now
            raise
        self._rate, self._stamp, self._heard_at, self._too_fast = rate, stamp, now, False

    def rate(self, now: float) -> tuple[Vector, str]:
        """Return what the body may do now [rad/s], and why."""
        if self.stopped:
            return STILL, STOPPED
        if self._heard_at == -math.inf:
            return STILL, WAITING
        if now - self._heard_at > self._timeout:
            return STILL, SILENT
        return self._rate, TOO_FAST if self._too_fast else TURNING
