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

"""Runs of the real nodes in lockstep, kept sample by sample, and what can be read off them."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import ArrayLike
from tetra_ros2.formation import measures, sampling
from tetra_ros2.formation.decay import decay_rate
from tetra_ros2.formation.gain import Gain
from tetra_ros2.formation.observer import Observer
from tetra_ros2.formation.simulation import sample_time
from tetra_ros2.formation.topology import Topology


@dataclass(frozen=True, eq=False)
class NodeRun:
    """
    The samples of a run.

    :param times: since the first sample [s], ``(k,)``
    :param gamma: reduced attitudes, ``(k, n, 3)``
    :param h: time from one sample to the next [s]
    """

    times: np.ndarray
    gamma: np.ndarray
    h: float

    def angular_velocity(self, count: int = 100) -> np.ndarray:
        """Return that of the formation over its last ``count`` steps [rad/s], ``(3,)``."""
        return measures.mean_angular_velocity(
            self.gamma[-1 - count], self.gamma[-1], count * self.h)


class _Keeper(Observer):
    """An observer that keeps every sample."""

    def __init__(self, topology: Topology, tolerance: float) -> None:
        super().__init__(topology, tolerance)
        self.stamps: list[int] = []
        self.samples: list[Sequence[float]] = []

    def observe(self, stamp: int, poses: Sequence[float]) -> bool:
        new = super().observe(stamp, poses)
        if new:
            self.stamps.append(stamp)
            self.samples.append(poses)
        return new


def node_parameters(topology: Topology, gain: Gain) -> dict[str, Any]:
    """Return the parameters that make nodes of a topology and a gain."""
    return {'topology.kind': 'custom', 'topology.n': topology.n,
            'topology.edges': [f'{i} {j} {weight!r}' for i, j, weight in topology.edges],
            'gain.kind': gain.kind, 'gain.a': gain.a, 'gain.b': gain.b}


def run_nodes(topology: Topology, gain: Gain, duration: float, *, rate: float = 100.0,
              seed: int = 0, attitudes: ArrayLike | None = None,
              parameters: dict[str, Any] | None = None) -> NodeRun:
    """
    Run plant, agents and monitor in lockstep, and keep all that the monitor saw.

    :param duration: formation time [s]
    :param rate: steps per second of formation time [Hz]
    :param seed: of the random initial attitudes
    :param attitudes: initial attitudes, unit quaternions ``(n, 4)``, instead
    :param parameters: more of the launcher's parameters
    """
    # The launcher needs ROS. Whoever checks mathematics only has to do without.
    from tetra_ros2.launcher import Launcher
    given = {**node_parameters(topology, gain), 'plant:rate': rate, **(parameters or {})}
    if attitudes is not None:
        given['plant:initial_attitudes'] = np.ravel(attitudes).tolist()
    with Launcher('complete', seed=seed, mode='lockstep', parameters=given,
                  ros_arguments=['--log-level', 'warn']) as formation:
        keeper = _Keeper(topology, formation.monitor.observer.tolerance)
        formation.monitor.observer = keeper
        formation.run_for(duration)
    stamps = np.array(keeper.stamps)
    h = sample_time(rate)
    if np.any(np.abs(np.diff(stamps) / 1e9 - h) > 1e-12):
        raise RuntimeError('a sample of the run was lost')
    samples = np.array(keeper.samples).reshape(len(stamps), topology.n, 7)
    return NodeRun((stamps - stamps[0]) / 1e9, samples[:, :, :3], h)


def slowest_rate(run: NodeRun, topology: Topology, gain: Gain) -> float:
    """
    Return the slowest rate at which the shape of a run approaches its limit [1/s].

    :param run: that has come close to a formation
    :returns: NaN if the run does not approach the shape that it ends near
    """
    limit = sampling.sampled_equilibrium(run.gamma[-1], topology.weights, gain, run.h).gamma
    return decay_rate(run.gamma, run.h, limit)
