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

"""What a value from outside must be before the law or the plant may use it."""

import math

UNIT_TOLERANCE = 1e-3
"""How far from 1 the length of a measured direction may be."""

SHORTEST, LONGEST = (1.0 - UNIT_TOLERANCE) ** 2, (1.0 + UNIT_TOLERANCE) ** 2
"""Bounds of the squared length of a measured direction."""


class Rejected(Exception):
    """A message that must not be used; its text is the reason, to count by."""

    MALFORMED = 'malformed'
    WRONG_FRAME = 'wrong frame'
    IMPOSSIBLE_STAMP = 'impossible stamp'
    OLD_STAMP = 'old stamp'
    FUTURE_STAMP = 'stamp from the future'
    NOT_FINITE = 'not finite'
    NOT_UNIT = 'not a unit vector'
    TOO_FAST = 'faster than max_angular_velocity'


def require_unit(x: float, y: float, z: float) -> None:
    """Raise Rejected unless (x, y, z) is a unit vector, to within UNIT_TOLERANCE."""
    # A NaN makes every comparison false, so that one test on the good path sees all there is.
    if not SHORTEST <= x * x + y * y + z * z <= LONGEST:
        refuse_direction(x, y, z)


def refuse_direction(x: float, y: float, z: float) -> None:
    """Raise Rejected for a vector that is not a unit vector, with the reason."""
    finite = all(map(math.isfinite, (x, y, z)))
    raise Rejected(Rejected.NOT_UNIT if finite else Rejected.NOT_FINITE)


def require_rate(x: float, y: float, z: float, limit: float) -> None:
    """Raise Rejected unless (x, y, z) [rad/s] is finite and not longer than ``limit``."""
    if not x * x + y * y + z * z <= limit * limit:
        finite = all(map(math.isfinite, (x, y, z)))
        raise Rejected(Rejected.TOO_FAST if finite else Rejected.NOT_FINITE)
