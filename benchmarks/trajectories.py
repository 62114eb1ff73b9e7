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
Trajectories of the continuous closed loop by three methods, each as coarse as it may be.

The starts are uniform and the same for all. A method's accuracy is set to the coarsest of a list
at which, over a sample of the starts, the final error is at most 1e-6: the largest distance of a
reduced attitude from where a solution with far smaller tolerances has it.
"""

from functools import partial
import os
import time

import numpy as np
from scipy.integrate import solve_ivp
from tetra_ros2.formation import flow
from tetra_ros2.formation.gain import Cosine

ERROR = 1e-6
DURATION = 10.0
"""Formation time [s]; by then nearly all of these starts have formed."""

SAMPLE = 20
WEIGHTS = np.ones((4, 4)) - np.eye(4)
"""The complete graph."""

STEPS = (40, 60, 80, 100, 120, 160, 200, 240, 260, 280, 300, 320, 340, 360, 380, 400, 500, 640,
         800, 1600)
TOLERANCES = tuple(10.0 ** (-0.25 * k) for k in range(16, 54))


def starts(count):
    """Return uniform reduced attitudes of four agents, ``(count, 4, 3)``."""
    gamma = np.random.default_rng(20).normal(size=(count, 4, 3))
    return gamma / np.linalg.norm(gamma, axis=-1, keepdims=True)


def velocity_of_one(_time, state):
    """Return the right-hand side for one formation, as one gives it to SciPy, ``(12,)``."""
    gamma = state.reshape(4, 3)
    pull = (WEIGHTS * (1.0 + gamma @ gamma.T)) @ gamma
    return (np.einsum('ij,ij->i', gamma, pull)[:, None] * gamma - pull).ravel()


def velocity(gamma):
    """Return the right-hand side for many formations, ``(m, 4, 3)``."""
    pull = (WEIGHTS * (1.0 + gamma @ gamma.swapaxes(-1, -2))) @ gamma
    return np.sum(gamma * pull, axis=-1, keepdims=True) * gamma - pull


def scipy(gamma, tolerance):
    """Follow each start with DOP853."""
    ends = [solve_ivp(velocity_of_one, (0.0, DURATION), start.ravel(), method='DOP853',
                      rtol=tolerance, atol=tolerance).y[:, -1] for start in gamma]
    return np.reshape(ends, (-1, 4, 3))


def numpy(gamma, steps):
    """Follow all starts at once with RK4."""
    h = DURATION / steps
    for _ in range(steps):
        k1 = velocity(gamma)
        k2 = velocity(gamma + 0.5 * h * k1)
        k3 = velocity(gamma + 0.5 * h * k2)
        k4 = velocity(gamma + h * k3)
        gamma = gamma + h / 6.0 * (k1 + 2.0 * (k2 + k3) + k4)
        gamma /= np.linalg.norm(gamma, axis=-1, keepdims=True)
    return gamma


def tetra(gamma, tolerance, threads=1):
    """Follow all starts with the package's own kernel."""
    return flow.run(gamma, WEIGHTS, Cosine(), DURATION, tolerance, threads)


def prepare(style, threads, core=None):
    """
    Return a function that follows trajectories for some time [s], and says how many a second.

    The setting that is accurate enough is looked for before.

    :param core: which one to stay on, of those that there are; None for no matter
    """
    method, fineness = {'scipy': (scipy, TOLERANCES), 'numpy': (numpy, STEPS),
                        'tetra': (partial(tetra, threads=threads), TOLERANCES)}[style]
    if core is not None and hasattr(os, 'sched_setaffinity'):
        # The linear algebra behind numpy has threads of its own.
        cores = sorted(os.sched_getaffinity(0))
        os.sched_setaffinity(0, {cores[core % len(cores)]})
    sample = starts(SAMPLE)
    exact = scipy(sample, 1e-13)

    def error(setting):
        return float(np.linalg.norm(method(sample, setting) - exact, axis=-1).max())

    setting = next(s for s in fineness if error(s) <= ERROR)
    batch = {'scipy': 1, 'numpy': 1000, 'tetra': 32768}[style]
    many = starts(max(batch, 1000))
    method(many[:batch], setting)  # compiled, and the caches warm
    final_error = error(setting)

    def measure(seconds):
        done, begun, worked = 0, time.perf_counter(), time.process_time()
        while (elapsed := time.perf_counter() - begun) < seconds:
            first = done % len(many)
            method(many[first:first + batch], setting)
            done += batch
        # On one core the processor's time counts, of which others on this machine take nothing.
        worked = time.process_time() - worked
        return {'trajectories/s': done / elapsed, 'trajectories/core s': done / worked,
                'final error': final_error, 'setting': setting}

    return measure
