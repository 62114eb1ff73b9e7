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

"""One who watches a formation as it goes, in plain floats: how far it is, and since when."""

from collections.abc import Sequence
import math

import numpy as np
from tetra_ros2.formation import measures
from tetra_ros2.formation._types import Array
from tetra_ros2.formation.checks import Rejected, require_unit
from tetra_ros2.formation.shapes import admissible_angles, known_shape
from tetra_ros2.formation.topology import Topology

LEAP = 2.0
"""How many times as fast as the law can command a body may seem to be before it has leapt."""

JITTER = 0.02
"""And by how much more [rad]: samples are a little late, and bodies have a life of their own."""


class Observer:
    """
    Cosines, error and time to form, sample by sample.

    The error is the largest distance of a pairwise angle from the known shape's [rad]. Where no
    shape is known it is how fast the fastest of them changes [rad/s]: the formation has formed
    when its shape has come to rest, that is when this is below the tolerance as a fraction of
    what the law could command.

    A formation whose bodies have leapt farther between two samples than any law could take them
    was placed anew. Then all that is said of it begins anew.

    :param topology: a :class:`~tetra_ros2.formation.topology.Topology`
    :param tolerance: the error below which it has formed [rad, or a fraction of ``fastest``]
    :param fastest: the fastest rate that the law can command [rad/s]; may be changed at any time
    """

    def __init__(self, topology: Topology, tolerance: float, fastest: float = 1.0) -> None:
        self.tolerance = tolerance
        self.shape = known_shape(topology)
        self.fastest = fastest
        self.pairs = measures.pairs(topology.n)
        self.count = 0  # samples seen
        self.restarts = 0  # how often the bodies were placed anew
        self.first_stamp: int | None = None  # of the very first sample [ns]
        self.stamp: int | None = None  # of the last one [ns]
        self.started_at: int | None = None  # stamp of the first one since the last restart [ns]
        # since when the error has stayed below the tolerance [ns]
        self.formed_at: int | None = None
        self.poses: Sequence[float] | None = None
        self.previous_poses: Sequence[float] | None = None
        self.previous_stamp: int | None = None
        self.cosines: list[float] = []
        self.error = math.inf
        self._pairs = [(i - 1, j - 1) for i, j in self.pairs]
        self._starts = range(0, 7 * topology.n, 7)
        # How far from the shape, agents exchanged where the graph allows it.
        self._distance = None if self.shape is None else admissible_angles(topology).error
        self._angles: list[float] | None = None
        self._reduced: list[Sequence[float]] = []

    def observe(self, stamp: int, poses: Sequence[float]) -> bool:
        """
        Take a sample.

        :param stamp: its time [ns]
        :param poses: for each agent Gamma_i (x, y, z) and its quaternion (x, y, z, w), in a row
        :returns: whether it is a new one, and not the last one again
        :raises Rejected: if it is older than the last, or holds anything but unit vectors
        """
        if self.stamp is not None and stamp <= self.stamp:
            if stamp == self.stamp:
                return False
            raise Rejected(Rejected.OLD_STAMP)
        reduced = [poses[start:start + 3] for start in self._starts]
        for x, y, z in reduced:
            require_unit(x, y, z)
        if self.stamp is not None and self._have_leapt(reduced, stamp - self.stamp):
            self.restart()
        self._reduced = reduced
        cosines, angles = [], []
        for i, j in self._pairs:
            (ax, ay, az), (bx, by, bz) = reduced[i], reduced[j]
            cosine = ax * bx + ay * by + az * bz
            cx, cy, cz = ay * bz - az * by, az * bx - ax * bz, ax * by - ay * bx
            cosines.append(cosine)
            angles.append(math.atan2(math.sqrt(cx * cx + cy * cy + cz * cz), cosine))
        self.cosines = cosines
        if self._distance is not None:
            self.error = self._distance(angles)
        elif self._angles is not None and self.stamp is not None:
            change = max([abs(a - b) for a, b in zip(angles, self._angles)])
            self.error = change / (stamp - self.stamp) * 1e9
        self._angles = angles
        scale = self.fastest if self.shape is None else 1.0
        if not self.error < self.tolerance * scale:
            self.formed_at = None
        elif self.formed_at is None:
            self.formed_at = stamp
        self.count += 1
        if self.started_at is None:
            self.started_at = stamp
        if self.first_stamp is None:
            self.first_stamp = stamp
        if self.poses is not None:
            self.previous_stamp, self.previous_poses = self.stamp, self.poses
        self.stamp, self.poses = stamp, poses
        return True

    def _have_leapt(self, reduced: list[Sequence[float]], elapsed: int) -> bool:
        """Return whether a body has moved as none could in this time [ns]."""
        angle = LEAP * self.fastest * elapsed / 1e9 + JITTER
        if angle >= math.pi:
            return False
        chord = 2.0 - 2.0 * math.cos(angle)  # its square
        for (ax, ay, az), (bx, by, bz) in zip(reduced, self._reduced):
            x, y, z = ax - bx, ay - by, az - bz
            if x * x + y * y + z * z > chord:
                return True
        return False

    def restart(self) -> None:
        """Begin anew: the next sample is the first of another run."""
        self.restarts += 1
        self.started_at = self.formed_at = None
        self.poses = self.previous_poses = self.previous_stamp = self._angles = None
        self.error = math.inf

    @property
    def elapsed(self) -> float:
        """
        Return the time from the first sample to the last [s].

        :raises ValueError: if there was none
        """
        if self.stamp is None or self.started_at is None:
            raise ValueError('nothing has been observed')
        return (self.stamp - self.started_at) / 1e9

    @property
    def interval(self) -> float:
        """
        Return the time between the last two samples [s].

        :raises ValueError: if there were no two
        """
        if self.stamp is None or self.previous_stamp is None:
            raise ValueError('less than two samples have been observed')
        return (self.stamp - self.previous_stamp) / 1e9

    @property
    def time_to_form(self) -> float | None:
        """Return the time from the first sample to the one since which it has formed [s]."""
        if self.formed_at is None or self.started_at is None:
            return None
        return (self.formed_at - self.started_at) / 1e9

    @property
    def reduced_attitudes(self) -> Array:
        """Return the last Gamma, ``(n, 3)``."""
        return np.array(self.poses).reshape(-1, 7)[:, :3]

    @property
    def attitudes(self) -> Array:
        """Return the last attitudes, unit quaternions ``(n, 4)``."""
        return np.array(self.poses).reshape(-1, 7)[:, 3:]

    @property
    def angular_velocity(self) -> Array:
        """Return the angular velocity of the formation between the last two samples [rad/s]."""
        before = np.array(self.previous_poses).reshape(-1, 7)[:, :3]
        return measures.mean_angular_velocity(before, self.reduced_attitudes, self.interval)
