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

"""The rigid bodies, in plain floats: the plant's state, its exact step, what each sees."""

from collections.abc import Iterable, Sequence
import math

from tetra_ros2.formation._types import Matrix, Quaternion, Vector

RENORMALIZE_BEYOND = 1e-14
"""How far the squared length of a quaternion may leave 1 by rounding before it is brought back."""


class RigidBodies:
    """
    Attitudes R_i of n rigid bodies with pointing axes b_i, under angular velocities held constant.

    :param attitudes: unit quaternions x y z w, body to world, n of them
    :param axes: pointing axes in the body frames, unit vectors (x, y, z), n of them
    """

    def __init__(self, attitudes: Iterable[Iterable[float]],
                 axes: Iterable[Iterable[float]]) -> None:
        self.attitudes: list[Quaternion] = [
            (x, y, z, w) for x, y, z, w in (map(float, q) for q in attitudes)]
        self.axes: tuple[Vector, ...] = tuple(
            (x, y, z) for x, y, z in (map(float, b) for b in axes))
        self._matrices: list[Matrix] = [(0.0,) * 9] * len(self.axes)  # of R_i
        self.reduced: list[Vector] = [(0.0,) * 3] * len(self.axes)  # Gamma_i = R_i b_i
        for i in range(len(self.axes)):
            self._refresh(i, *self.attitudes[i])

    def step(self, h: float, rates: Sequence[Vector]) -> None:
        """
        Turn every body for a time ``h`` [s] at a constant rate: ``R_i <- R_i exp(h w_i^)``.

        That is the exact solution of the kinematics, whatever the size of h.

        :param h: the time [s]
        :param rates: angular velocities w_i (x, y, z) in the body frames [rad/s]
        """
        for i, (wx, wy, wz) in enumerate(rates):
            speed = math.sqrt(wx * wx + wy * wy + wz * wz)
            if speed == 0.0:
                continue
            half = 0.5 * h * speed
            s = math.sin(half) / speed
            c = math.cos(half)
            wx *= s
            wy *= s
            wz *= s
            x, y, z, w = self.attitudes[i]
            x, y, z, w = (w * wx + x * c + y * wz - z * wy,
                          w * wy - x * wz + y * c + z * wx,
                          w * wz + x * wy - y * wx + z * c,
                          w * c - x * wx - y * wy - z * wz)
            excess = x * x + y * y + z * z + w * w - 1.0
            if not -RENORMALIZE_BEYOND < excess < RENORMALIZE_BEYOND:
                scale = 1.0 - 0.5 * excess
                x, y, z, w = scale * x, scale * y, scale * z, scale * w
            self.attitudes[i] = (x, y, z, w)
            self._refresh(i, x, y, z, w)

    def place(self, i: int, attitude: Quaternion) -> None:
        """
        Put body i, counted from 0, where it is found to be.

        :param attitude: a unit quaternion x y z w, body to world
        """
        self.attitudes[i] = attitude
        self._refresh(i, *attitude)

    def _refresh(self, i: int, x: float, y: float, z: float, w: float) -> None:
        """Recompute what follows from the attitude of body i, counted from 0."""
        x2, y2, z2 = x + x, y + y, z + z
        xx, yy, zz = x * x2, y * y2, z * z2
        xy, xz, yz = x * y2, x * z2, y * z2
        wx, wy, wz = w * x2, w * y2, w * z2
        m = (1.0 - yy - zz, xy + wz, xz - wy,
             xy - wz, 1.0 - xx - zz, yz + wx,
             xz + wy, yz - wx, 1.0 - xx - yy)
        self._matrices[i] = m
        bx, by, bz = self.axes[i]
        self.reduced[i] = (m[0] * bx + m[3] * by + m[6] * bz,
                           m[1] * bx + m[4] * by + m[7] * bz,
                           m[2] * bx + m[5] * by + m[8] * bz)

    def seen_by(self, i: int, others: Iterable[int]) -> list[Vector]:
        """
        Return what body i sees: ``y_ij = R_i^T R_j b_j`` for each j of ``others``.

        :param i: the body that looks, counted from 0
        :param others: the bodies it looks at, counted from 0
        :returns: a list of unit vectors (x, y, z) in the frame of body i
        """
        a, b, c, d, e, f, g, h, k = self._matrices[i]
        reduced = self.reduced
        seen = []
        for j in others:
            x, y, z = reduced[j]
            seen.append((a * x + b * y + c * z, d * x + e * y + f * z, g * x + h * y + k * z))
        return seen
