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

"""Names of types that many modules use."""

import math
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]
"""An array of floats."""

Spectrum = NDArray[np.inexact[Any]]
"""Eigenvalues, or Floquet multipliers: complex, or real where all of them are."""

Vector = tuple[float, float, float]
"""A vector in plain floats, x y z."""

Matrix = tuple[float, float, float, float, float, float, float, float, float]
"""A rotation matrix in plain floats, column by column."""

Quaternion = tuple[float, float, float, float]
"""A unit quaternion in plain floats, x y z w."""


class JointLimits(NamedTuple):
    """
    What a joint can do; infinite where it has no limit.

    :param low: least position [rad]
    :param high: greatest position [rad]
    :param speed: greatest speed, either way [rad/s]
    :param torque: greatest torque of its motor, either way [N m]
    """

    low: float = -math.inf
    high: float = math.inf
    speed: float = math.inf
    torque: float = math.inf
