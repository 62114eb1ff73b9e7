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

"""What a recording says of the joints of bodies with mass; no ROS in here."""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray
from rosbags.typesys import get_typestore, Stores
from tetra_ros2.formation._types import JointLimits
from tetra_ros2.formation.checks import Rejected
from tetra_ros2.wire.joints import decode, limits_from_diagnostics

Array = NDArray[np.float64]

TYPE = 'sensor_msgs/msg/JointState'
DIAGNOSTICS_TYPE = 'diagnostic_msgs/msg/DiagnosticArray'

MOST = 1000
"""So many of the last diagnostics are searched for those of the plant."""


@dataclass(frozen=True, eq=False)
class Joints:
    """
    The joints of one body over time.

    :param names: of the joints
    :param stamps: time of each sample [ns], strictly increasing, ``(m,)``
    :param positions: [rad], ``(m, j)``; NaN where none was told, and so below
    :param velocities: [rad/s], ``(m, j)``
    :param efforts: torques of the motors [N m], ``(m, j)``
    """

    names: tuple[str, ...]
    stamps: NDArray[np.int64]
    positions: Array
    velocities: Array
    efforts: Array

    def between(self, first: int, last: int) -> 'Joints':
        """Return the part of it from one stamp to another [ns]."""
        part = (self.stamps >= first) & (self.stamps <= last)
        return replace(self, stamps=self.stamps[part], positions=self.positions[part],
                       velocities=self.velocities[part], efforts=self.efforts[part])


def read(messages: Sequence[bytes]) -> Joints | None:
    """
    Return the joints that messages tell of, in the order of time.

    :param messages: sensor_msgs/JointState as bytes; those that cannot be read, that are of other
        joints than the first, or not newer than the one before, are left out
    :returns: None if nothing is left
    """
    names: tuple[str, ...] | None = None
    stamps: list[int] = []
    rows = []
    for message in messages:
        try:
            state = decode(message)
        except Rejected:
            continue
        if names is None:
            names = state.names
        if state.names != names or not names or (stamps and state.stamp <= stamps[-1]):
            continue
        nothing = (np.nan,) * len(names)
        stamps.append(state.stamp)
        rows.append((state.positions or nothing) + (state.velocities or nothing)
                    + (state.efforts or nothing))
    if names is None or not rows:
        return None
    positions, velocities, efforts = np.array(rows).reshape(-1, 3, len(names)).swapaxes(0, 1)
    return Joints(names, np.array(stamps, dtype=np.int64), positions, velocities, efforts)


def limits(messages: Sequence[bytes], plant: str, joints: Sequence[str]) -> dict[str, JointLimits]:
    """
    Return what joints can do, as far as the plant has told.

    :param messages: diagnostic_msgs/DiagnosticArray as bytes
    :param plant: full name of the plant's node
    :param joints: names of the joints
    """
    store = get_typestore(Stores.ROS2_JAZZY)
    for message in reversed(messages[-MOST:]):
        try:
            array: Any = store.deserialize_cdr(message, DIAGNOSTICS_TYPE)
            statuses = array.status
        except Exception:  # whoever sent it; the reader of messages has no one error for that
            continue
        for status in statuses:
            if status.name == plant:
                return limits_from_diagnostics({v.key: v.value for v in status.values}, joints)
    return {}
