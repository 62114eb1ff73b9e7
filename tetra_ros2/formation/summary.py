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

"""What a run came to: did it form, how long did it take, and what does theory say."""

from dataclasses import dataclass
import math

import numpy as np
from tetra_ros2.formation import measures, shapes
from tetra_ros2.formation._types import Array
from tetra_ros2.formation.gain import Gain
from tetra_ros2.formation.observer import Observer
from tetra_ros2.formation.topology import Topology


@dataclass(frozen=True)
class Spin:
    """
    A rotation of the formation as one rigid body.

    :param rate: angular speed [rad/s]
    :param period: of one turn [s]; infinite at rest
    :param axis: agent on the axis, where the topology has one
    :param sense: about the axis, seen from outside the sphere: 1 counter-clockwise, -1 clockwise,
        0 at rest or without an axis
    :param about: the axis in words, where the topology has one
    """

    rate: float
    period: float
    axis: int | None
    sense: int
    about: str | None = None


@dataclass(frozen=True)
class Summary:
    """
    The outcome of a run.

    :param shape: name of the shape, or None if the topology has no known one
    :param formed: whether the error stayed below the tolerance to the end
    :param tolerance: [rad], or a fraction of the fastest rate where no shape is known
    :param time_to_form: formation time from the start until the error stayed below [s], or None
    :param duration: formation time that passed [s]
    :param error: final error: how far the worst pairwise angle is from the shape [rad], or how
        fast the shape still changes [rad/s] where none is known
    :param angles: final pairwise angles theta_ij for i < j, lexicographic [rad]
    :param chirality: 1 or -1, 0 where there is none; of
        :func:`~tetra_ros2.formation.shapes.chirality`
    :param measured: the spin at the end; None if there was but one sample
    :param predicted: the spin that theory predicts for the topology, the gain and the chirality
        that came out; None if no shape is known or it did not form
    :param axis_drift: how fast the direction of the agent on the axis still moves [rad/s]
    """

    shape: str | None
    formed: bool
    tolerance: float
    time_to_form: float | None
    duration: float
    error: float
    angles: tuple[float, ...]
    chirality: int
    measured: Spin | None
    predicted: Spin | None
    axis_drift: float | None


def summarize(observer: Observer, topology: Topology, gain: Gain) -> Summary:
    """
    Summarise a run.

    :param observer: an :class:`~tetra_ros2.formation.observer.Observer` that saw it
    :param topology: its :class:`~tetra_ros2.formation.topology.Topology`
    :param gain: its :class:`~tetra_ros2.formation.gain.Gain`
    :raises ValueError: if the observer has seen nothing
    """
    if not observer.count:
        raise ValueError('nothing has been observed')
    gamma = observer.reduced_attitudes
    formed = observer.formed_at is not None
    axis = topology.axis_agent
    measured = predicted = drift = None
    if observer.previous_stamp is not None:
        measured = _spin(observer.angular_velocity, gamma, topology)
        if axis is not None:
            before = np.array(observer.previous_poses).reshape(-1, 7)[axis - 1, :3]
            drift = float(np.linalg.norm(gamma[axis - 1] - before) / observer.interval)
    if observer.shape is not None and formed:
        predicted = _spin(
            shapes.predicted_angular_velocity(gamma, topology, gain), gamma, topology)
    return Summary(
        shape=observer.shape.name if observer.shape is not None else None,
        formed=formed,
        tolerance=observer.tolerance,
        time_to_form=observer.time_to_form,
        duration=observer.elapsed,
        error=observer.error,
        angles=tuple(measures.pairwise_angles(gamma).tolist()),
        chirality=shapes.chirality(gamma, topology),
        measured=measured,
        predicted=predicted,
        axis_drift=drift,
    )


def _spin(angular_velocity: Array, gamma: Array, topology: Topology) -> Spin:
    rate = float(np.linalg.norm(angular_velocity))
    if rate < 1e-9:  # rounding, over a sample time
        return Spin(rate, math.inf, topology.axis_agent, 0, topology.axis_name)
    direction = shapes.axis_direction(gamma, topology)
    sense = 0 if direction is None else int(np.sign(angular_velocity @ direction))
    return Spin(rate, 2.0 * math.pi / rate, topology.axis_agent, sense, topology.axis_name)
