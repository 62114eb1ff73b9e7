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

"""The control law and the closed loop, on arrays."""

from typing import Any, Protocol

import numpy as np
from numpy.typing import ArrayLike
from tetra_ros2.formation import sphere
from tetra_ros2.formation._types import Array


class Repulsion(Protocol):
    """What the law asks of a gain; any function of the distance will do."""

    def f(self, theta: Any, /) -> Any:
        """Return how fast an agent at the distance ``theta`` [rad] is fled from [rad/s]."""


def angular_velocity(pointing: ArrayLike, seen: ArrayLike, weights: Array,
                     gain: Repulsion) -> Array:
    """
    Return what the law commands: ``w_i = -sum_j W(i, j) f(theta_ij) b_i x y_ij``; eq:RF:Control.

    The formula is the same in every frame, as long as each agent's own axis and what it sees are
    in one: with ``b_i`` and ``y_ij`` it is agent i's body frame, with ``Gamma_i`` and ``Gamma_j``
    (see :func:`world_angular_velocity`) the world.

    :param pointing: pointing axes, unit vectors, ``(..., n, 3)``
    :param seen: what agent i sees of agent j, unit vectors, ``(..., n, m, 3)``
    :param weights: ``(n, m)``
    :param gain: a :class:`~tetra_ros2.formation.gain.Gain`
    :returns: angular velocities [rad/s], ``(..., n, 3)``, in the frame of the arguments
    """
    pointing, seen = np.asarray(pointing)[..., None, :], np.asarray(seen)
    cross = sphere.cross(pointing, seen)
    theta = np.arctan2(np.linalg.norm(cross, axis=-1), np.sum(pointing * seen, axis=-1))
    result: Array = -np.sum((weights * gain.f(theta))[..., None] * cross, axis=-2)
    return result


def world_angular_velocity(gamma: ArrayLike, weights: Array, gain: Repulsion) -> Array:
    """
    Return the law's angular velocities in the world frame [rad/s], ``(..., n, 3)``.

    :param gamma: reduced attitudes, unit vectors, ``(..., n, 3)``
    :param weights: ``(n, n)``
    :param gain: a :class:`~tetra_ros2.formation.gain.Gain`
    """
    return angular_velocity(gamma, np.asarray(gamma)[..., None, :, :], weights, gain)


def velocity(gamma: ArrayLike, weights: Array, gain: Repulsion) -> Array:
    """
    Return the closed loop's right-hand side ``dGamma_i/dt``; eq:RF:ClosedSystem.

    :param gamma: reduced attitudes, unit vectors, ``(..., n, 3)``
    :param weights: ``(n, n)``
    :param gain: a :class:`~tetra_ros2.formation.gain.Gain`
    :returns: tangent vectors [1/s], ``(..., n, 3)``
    """
    gamma = np.asarray(gamma, dtype=float)
    theta = sphere.geodesic_distance(gamma[..., :, None, :], gamma[..., None, :, :])
    pull = np.sum((weights * gain.f(theta))[..., None] * gamma[..., None, :, :], axis=-2)
    # Gamma_i x (Gamma_i x v) = -project(Gamma_i, v)
    return -sphere.project(gamma, pull)
