# Copyright 2026 The tetra_ros2 authors
# SPDX-License-Identifier: Apache-2.0

"""Runs of the real nodes in lockstep, kept sample by sample, and what can be read off them."""

from dataclasses import dataclass

import numpy as np

from tetra_ros2.formation import measures, sampling
from tetra_ros2.formation.observer import Observer


@dataclass(frozen=True, eq=False)
class Run:
    """
    The samples of a run.

    :param times: since the first sample [s], ``(k,)``
    :param gamma: reduced attitudes, ``(k, n, 3)``
    :param h: time from one sample to the next [s]
    """

    times: np.ndarray
    gamma: np.ndarray
    h: float


class _Keeper(Observer):
    """An observer that keeps every sample."""

    def __init__(self, topology, tolerance):
        super().__init__(topology, tolerance)
        self.stamps, self.samples = [], []

    def observe(self, stamp, poses):
        new = super().observe(stamp, poses)
        if new:
            self.stamps.append(stamp)
            self.samples.append(poses)
        return new


def node_parameters(topology, gain):
    """
    Return the parameters that make nodes of a topology and a gain.

    :param topology: a :class:`~tetra_ros2.formation.topology.Topology`
    :param gain: a :class:`~tetra_ros2.formation.gain.Gain`
    """
    return {'topology.kind': 'custom', 'topology.n': topology.n,
            'topology.edges': [f'{i} {j} {weight!r}' for i, j, weight in topology.edges],
            'gain.kind': gain.kind, 'gain.a': gain.a, 'gain.b': gain.b}


def run_nodes(topology, gain, duration, *, rate=100.0, seed=0, attitudes=None, parameters=None):
    """
    Run plant, agents and monitor in lockstep, and keep all that the monitor saw.

    :param topology: a :class:`~tetra_ros2.formation.topology.Topology`
    :param gain: a :class:`~tetra_ros2.formation.gain.Gain`
    :param duration: formation time [s]
    :param rate: steps per second of formation time [Hz]
    :param seed: of the random initial attitudes
    :param attitudes: initial attitudes, unit quaternions ``(n, 4)``, instead
    :param parameters: more of the launcher's parameters
    """
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
    h = round(1e9 / rate) / 1e9
    if np.any(np.abs(np.diff(stamps) / 1e9 - h) > 1e-12):
        raise RuntimeError('a sample of the run was lost')
    samples = np.array(keeper.samples).reshape(len(stamps), topology.n, 7)
    return Run((stamps - stamps[0]) / 1e9, samples[:, :, :3], h)


def decay_rate(run, topology, gain, largest=1e-3, smallest=1e-8, modes=5):
    """
    Return the slowest rate at which a run's shape approaches its limit [1/s].

    Read off the samples alone: the linear map that best takes each deviation of the cosines from
    their limit to the one some time later (dynamic mode decomposition). Its largest eigenvalue
    is the slowest mode. A straight line through the logarithm of the error would do as well
    where that mode is real and alone; under the rotating graph there are two slow pairs of
    complex ones.

    :param run: a :class:`Run` that has come close to a tetrahedron
    :param topology: its topology
    :param gain: its gain
    :param largest: deviation from which on the motion is linear enough
    :param smallest: deviation below which rounding disturbs
    :param modes: how many there are: five cosines of four agents are independent
    :returns: NaN if the run does not approach the shape that it ends near
    """
    limit = sampling.sampled_equilibrium(run.gamma[-1], topology.weights, gain, run.h).gamma
    deviation = measures.pairwise_cosines(run.gamma) - measures.pairwise_cosines(limit)
    size = np.max(np.abs(deviation), axis=1)
    above = np.flatnonzero(size > largest)
    first = above[-1] + 1 if len(above) else 0
    below = np.flatnonzero(size[first:] < smallest)
    last = first + (below[0] if len(below) else len(size) - first)
    lag = max(1, (last - first) // 40)
    if last - first < 4 * modes or size[last - 1] > 0.1 * size[first]:
        return float('nan')
    before, after = deviation[first:last - lag], deviation[first + lag:last]
    scale = 1.0 / np.linalg.norm(before, axis=1, keepdims=True)
    u, s, vt = np.linalg.svd(scale * before, full_matrices=False)
    kept = min(modes, int(np.sum(s > 1e-4 * s[0])))
    u, s, vt = u[:, :kept], s[:kept], vt[:kept]
    # Rows are samples: after = before M, seen within the directions that the samples explore.
    step = (u.T @ (scale * after) @ vt.T) / s[:, None]
    slowest = np.max(np.abs(np.linalg.eigvals(step)))
    return float(-np.log(slowest) / (lag * run.h))
