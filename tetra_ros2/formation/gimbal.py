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
A pan-tilt gimbal as a body: what its two joints can do of what a body is told.

The base is fixed. Pan turns about the z axis of the base, tilt then about the y axis, and what
points is the x axis: ``R = Rz(pan) Ry(tilt)``. A positive tilt points down, as pitch does in
REP 103. The reduced attitude is all that two joints can set; how the body is rolled about it
follows. That is enough: the law never asks for a turn about the pointing axis.
"""

from collections.abc import Sequence
import math

Limits = tuple[float, float]

ENDLESS: Limits = (-math.inf, math.inf)
"""The limits of a joint that has none."""

DAMPING = 0.05
"""
Cosine of the tilt below which the pan joint is spared.

With the pointing axis on the pan axis, no pan rate moves it; near it, a small motion would take a
large one.
"""


def joint_rates(y: float, z: float, tilt: float) -> tuple[float, float]:
    """
    Return the rates of pan and tilt [rad/s] that move the pointing axis as told.

    :param y: angular velocity about the body's y axis [rad/s]
    :param z: angular velocity about the body's z axis [rad/s]
    :param tilt: [rad]
    """
    c = math.cos(tilt)
    return z * (c / max(c * c, DAMPING * DAMPING)), y


def body_rates(pan_rate: float, tilt_rate: float, tilt: float) -> tuple[float, float, float]:
    """Return the angular velocity in the body frame [rad/s] that the joints give it."""
    return -math.sin(tilt) * pan_rate, tilt_rate, math.cos(tilt) * pan_rate


def attitude(pan: float, tilt: float) -> tuple[float, float, float, float]:
    """Return the unit quaternion x y z w of ``Rz(pan) Ry(tilt)``."""
    cp, sp = math.cos(0.5 * pan), math.sin(0.5 * pan)
    ct, st = math.cos(0.5 * tilt), math.sin(0.5 * tilt)
    return -sp * st, cp * st, sp * ct, cp * ct


def angles(direction: Sequence[float], pan_limits: Limits = ENDLESS,
           tilt_limits: Limits = ENDLESS) -> tuple[float, float] | None:
    """
    Return the pan and tilt [rad] that point along a direction, the smallest pan that will do.

    :param direction: a unit vector (x, y, z) in the frame of the base
    :param pan_limits: lower and upper [rad]
    :param tilt_limits: lower and upper [rad]
    :returns: None if the limits exclude it
    """
    x, y, z = direction
    tilt = math.asin(max(-1.0, min(1.0, -z)))
    pan = math.atan2(y, x)
    ways = [(pan + turn * math.pi, math.pi - tilt if turn % 2 else tilt)
            for turn in range(-4, 5)]
    ways += [(p, t - 2.0 * math.pi) for p, t in ways if t > 0.5 * math.pi]
    for p, t in sorted(ways, key=lambda way: (abs(way[0]), abs(way[1]))):
        if pan_limits[0] <= p <= pan_limits[1] and tilt_limits[0] <= t <= tilt_limits[1]:
            return p, t
    return None
