# Copyright 2026 The tetra_ros2 authors
# SPDX-License-Identifier: Apache-2.0

"""
The continuous closed loop eq:RF:ClosedSystem for very many starts, compiled with numba.

It is the classical Runge-Kutta method of fourth order with each step brought back to the spheres.
The kernel holds no lock of the interpreter, so threads share the starts.
"""

from collections import namedtuple
from concurrent.futures import ThreadPoolExecutor
from functools import cache
import math

import numpy as np

GainParameters = namedtuple('GainParameters', ('a', 'b'))

CHUNK = 64
"""Starts per task of a thread: some milliseconds."""


def run(gamma, weights, gain, duration, steps, threads=1):
    """
    Return where the reduced attitudes are after some time.

    :param gamma: reduced attitudes at the start, ``(m, n, 3)``
    :param weights: ``(n, n)``
    :param gain: a :class:`~tetra_ros2.formation.gain.Gain`
    :param duration: [s]
    :param steps: into how many steps to divide it; the error is of fourth order in their length
    :param threads: how many of them share the starts
    :returns: reduced attitudes, unit vectors, ``(m, n, 3)``
    :raises ModuleNotFoundError: if numba is not installed
    """
    gamma = np.array(gamma, dtype=float)
    weights = np.array(weights, dtype=float)
    kernel = _kernel(type(gain), len(weights))
    parameters = GainParameters(gain.a, gain.b)

    def follow(first):
        kernel(gamma[first:first + CHUNK], weights, parameters, duration / steps, steps)

    if threads == 1:
        kernel(gamma, weights, parameters, duration / steps, steps)
    else:
        follow(0)  # it compiles once, and not in every thread
        with ThreadPoolExecutor(threads) as executor:
            list(executor.map(follow, range(CHUNK, len(gamma), CHUNK)))
    return gamma


@cache
def _kernel(family, n):
    # A constant n lets the compiler unroll the loops over agents.
    from numba import njit

    from tetra_ros2.formation.gain import Cosine
    if family is Cosine:
        @njit
        def of_cosine(parameters, cosine):
            return parameters.a * (1.0 + cosine)
    else:
        f = njit(family.f)

        @njit
        def of_cosine(parameters, cosine):
            return f(parameters, math.acos(min(max(cosine, -1.0), 1.0)))

    @njit(error_model='numpy')
    def velocity(gamma, weights, parameters, out):
        out[:] = 0.0
        for i in range(n):
            for j in range(i + 1, n):
                if weights[i, j] != 0.0 or weights[j, i] != 0.0:
                    cosine = (gamma[i, 0] * gamma[j, 0] + gamma[i, 1] * gamma[j, 1]
                              + gamma[i, 2] * gamma[j, 2])
                    f = of_cosine(parameters, cosine)
                    there, back = weights[i, j] * f, weights[j, i] * f
                    for a in range(3):
                        out[i, a] += there * (cosine * gamma[i, a] - gamma[j, a])
                        out[j, a] += back * (cosine * gamma[j, a] - gamma[i, a])

    @njit(nogil=True, error_model='numpy')
    def kernel(starts, weights, parameters, h, steps):
        k, total, there = np.empty((n, 3)), np.empty((n, 3)), np.empty((n, 3))
        for start in range(len(starts)):
            gamma = starts[start]
            for _ in range(steps):
                velocity(gamma, weights, parameters, k)
                for i in range(n):
                    for a in range(3):
                        total[i, a] = k[i, a]
                        there[i, a] = gamma[i, a] + 0.5 * h * k[i, a]
                velocity(there, weights, parameters, k)
                for i in range(n):
                    for a in range(3):
                        total[i, a] += 2.0 * k[i, a]
                        there[i, a] = gamma[i, a] + 0.5 * h * k[i, a]
                velocity(there, weights, parameters, k)
                for i in range(n):
                    for a in range(3):
                        total[i, a] += 2.0 * k[i, a]
                        there[i, a] = gamma[i, a] + h * k[i, a]
                velocity(there, weights, parameters, k)
                for i in range(n):
                    square = 0.0
                    for a in range(3):
                        gamma[i, a] += h / 6.0 * (total[i, a] + k[i, a])
                        square += gamma[i, a] * gamma[i, a]
                    scale = 1.0 / math.sqrt(square)
                    for a in range(3):
                        gamma[i, a] *= scale

    return kernel
