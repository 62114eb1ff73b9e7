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

"""An attitude that comes from elsewhere: what of it may be used, and for how long."""

from collections.abc import Sequence
import math

from tetra_ros2.formation._types import Quaternion, Vector
from tetra_ros2.formation.checks import LONGEST, Rejected, SHORTEST

JUMP = 'jump'
"""Why a pose is rejected that the body could not have reached."""

NOT_UNIT = 'not a unit quaternion'
"""Why a pose is rejected whose quaternion has another length than 1."""

WAITING = 'not seen yet'
LOST = 'no recent pose'
FROZEN = 'frozen'
JUMPING = 'jumping'
TRACKED = 'tracked'

RATE_FLOOR = 1e-3
"""Two poses count as at least this far apart in time [s], whatever their stamps say."""

SLACK = 0.02
"""What a pose may be off by itself, apart from the motion of the body [rad]."""


def unit_quaternion(attitude: Sequence[float]) -> Quaternion:
    """
    Return an attitude that comes from elsewhere, with a length of exactly 1.

    :param attitude: x y z w
    :raises Rejected: if it is not four finite numbers, or not of length 1 to within UNIT_TOLERANCE
    """
    try:
        x, y, z, w = map(float, attitude)
    except (TypeError, ValueError):
        raise Rejected(Rejected.MALFORMED) from None
    square = x * x + y * y + z * z + w * w
    if not math.isfinite(square):
        raise Rejected(Rejected.NOT_FINITE)
    if not SHORTEST <= square <= LONGEST:
        raise Rejected(NOT_UNIT)
    scale = 1.0 / math.sqrt(square)
    return x * scale, y * scale, z * scale, w * scale


class Tracker:
    """
    Follows the attitude of one body, by the poses that are told of it.

    A pose is a jump if the body would have had to turn too fast to it from the one before. What
    it has jumped to is believed when it has stayed there for as long as poses may be missing: then
    it was the motion capture that had been wrong, or the body was carried about. A pose that stays
    the same to the last bit is no measurement: if it does so for as long as poses may be missing,
    and the body was told to turn meanwhile, it is frozen. A body that was told nothing may well
    rest.

    :ivar repeats: whether the source has no noise, so that the same pose again says nothing

    :param timeout: how old the last good pose may be [s]
    :param max_rate: how fast the body can turn [rad/s]
    :param frozen_angle: how far it may be told to turn while its pose stays the same [rad]; 0 for
        as far as it likes
    """

    def __init__(self, timeout: float, max_rate: float, frozen_angle: float) -> None:
        self.attitude: Quaternion | None = None
        self.received = self.jumps = 0
        self.repeats = not frozen_angle
        self._timeout, self._max_rate, self._frozen_angle = timeout, max_rate, frozen_angle
        self._stamp = 0
        self._heard_at = -math.inf  # of the last good pose
        self._raw: Quaternion | None = None
        self._changed_at = -math.inf  # when the pose was last another than the one before
        self._told = 0.0  # how far it was told to turn since then
        self._astray: Quaternion | None = None  # where it has jumped to
        self._astray_stamp = 0
        self._astray_since = math.inf

    def receive(self, stamp: int, attitude: Quaternion, now: float) -> None:
        """
        Take a pose.

        :param stamp: when it was measured [ns]
        :param attitude: a quaternion x y z w, body to world
        :param now: when it came, on a clock that never goes back [s]
        :raises Rejected: if it is not finite, not a unit quaternion, not newer than the last one,
            or a jump
        """
        unit = unit_quaternion(attitude)
        lost = now - self._heard_at > self._timeout
        if stamp <= self._stamp and not (lost and stamp != self._stamp):
            raise Rejected(Rejected.OLD_STAMP)
        if attitude != self._raw:
            self._raw, self._changed_at, self._told = attitude, now, 0.0
        if not lost and self.attitude is not None \
                and not self._reachable(self.attitude, self._stamp, unit, stamp):
            self._go_astray(unit, stamp, now)
        self.attitude, self._stamp, self._heard_at = unit, stamp, now
        self._astray, self._astray_since = None, math.inf
        self.received += 1

    def _reachable(self, before: Quaternion, then: int, after: Quaternion, stamp: int) -> bool:
        elapsed = max((stamp - then) / 1e9, RATE_FLOOR)
        cosine = abs(sum(a * b for a, b in zip(before, after)))
        return 2.0 * math.acos(min(1.0, cosine)) <= self._max_rate * elapsed + SLACK

    def _go_astray(self, unit: Quaternion, stamp: int, now: float) -> None:
        """Refuse a jump, unless it has been the same story for long enough."""
        if self._astray is None or not self._reachable(
                self._astray, self._astray_stamp, unit, stamp):
            self._astray_since = now
        self._astray, self._astray_stamp = unit, stamp
        if now - self._astray_since < self._timeout:
            self.jumps += 1
            raise Rejected(JUMP)

    def told(self, rate: Vector, elapsed: float) -> None:
        """Take note of what the body is told to do: an angular velocity [rad/s] for a time [s]."""
        x, y, z = rate
        self._told += elapsed * math.sqrt(x * x + y * y + z * z)

    def state(self, now: float) -> str:
        """Return TRACKED if the attitude may be used, or why not."""
        if self.attitude is None:
            return WAITING
        if not self.repeats and self._told > self._frozen_angle \
                and now - self._changed_at > self._timeout:
            return FROZEN
        if now - self._heard_at > self._timeout:
            return JUMPING if self._astray is not None else LOST
        return TRACKED
