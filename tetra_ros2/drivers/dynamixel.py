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
What a Dynamixel servo of the X series says over Protocol 2.0: addresses and units.

From the manufacturer's public control table of the X series (XL430, XM430, XH430 and others).
"""

import math

OPERATING_MODE = 11  # 1 byte
TORQUE_ENABLE = 64  # 1 byte
BUS_WATCHDOG = 98  # 1 byte, in units of 20 ms; 255 once it has fired, until 0 is written
GOAL_VELOCITY = 104  # 4 bytes, signed
PRESENT_VELOCITY = 128  # 4 bytes, signed
PRESENT_POSITION = 132  # 4 bytes, signed

VELOCITY_MODE = 1
WATCHDOG_UNIT = 0.02
"""[s]"""
WATCHDOG_FIRED = 255
VELOCITY_UNIT = 0.229 * 2.0 * math.pi / 60.0
"""[rad/s]; 0.229 revolutions a minute"""
POSITION_UNIT = 2.0 * math.pi / 4096.0
"""[rad]"""
CENTER = 2048
"""The position in the middle of a turn."""


def signed(value: int) -> int:
    """Return a 4 byte register as the signed number that it is."""
    return value - (1 << 32) if value >= 1 << 31 else value


def unsigned(value: int) -> int:
    """Return a signed number as a 4 byte register."""
    return value & 0xFFFFFFFF
