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
The closed loop eq:RF:ClosedSystem in continuous time, by DOP853.

Each step is brought back to the spheres. :func:`attitudes` and :func:`reduced_attitudes` follow
one formation with numpy. :func:`run` is for very many starts and is compiled with numba: starts go
through it in blocks, side by side in the lanes of the processor, and the worst of a block decides
how long its next step is. Its kernel holds no lock of the interpreter, so that threads share the
blocks.
"""

from collections import deque
from collections.abc import Iterator
from concurrent.futures import ThreadPoolExecutor
from functools import cache
import math
from typing import Any

import numpy as np
from numpy.typing import ArrayLike
from tetra_ros2.formation import law, rotation
from tetra_ros2.formation._dop853 import (
    FIFTH_ERROR,
    SOLUTION,
    solve,
    STAGES,
    Step,
    steps,
    THIRD_ERROR,
)
from tetra_ros2.formation._types import Array
from tetra_ros2.formation.batch import compiler, parameters_of
from tetra_ros2.formation.gain import Gain

LANES = 8
"""Starts in a block: what the stages of so many take fits into the cache nearest to a core."""

TASK = 16 * LANES
"""Starts in a thread's task: some milliseconds."""

TABLE = (*STAGES, SOLUTION, FIFTH_ERROR, THIRD_ERROR)
STEP, FIFTH, THIRD = 12, 13, 14

TOLERANCE = 1e-10
"""On the estimated error of a step, for one formation."""


def _first_step(weights: Array, gain: Gain) -> float:
    """Return a length of a step [s] that no start is too fast for."""
    # The largest f is f(0) by the assumption, which a gain under study need not satisfy.
    largest = float(np.max(np.abs(gain.f(np.linspace(0.0, np.pi, 65)))))
    fastest = float(np.max(np.sum(np.abs(weights), axis=1))) * largest
    return 0.1 / fastest if fastest else 1.0


def attitudes(start: ArrayLike, axes: Array, weights: Array, gain: Gain, times: ArrayLike,
              tolerance: float = TOLERANCE) -> Array:
    """
    Return the attitudes of one formation, or of several side by side, in continuous time.

    :param start: unit quaternions x y z w, body to world, ``(..., n, 4)``
    :param axes: pointing axes in the body frames, unit vectors, ``(..., n, 3)``
    :param weights: ``(n, n)``
    :param gain: a :class:`~tetra_ros2.formation.gain.Gain`
    :param times: from 0 on, ascending [s], ``(k,)``
    :param tolerance: on the estimated error of each step, the mean over the coordinates
    :returns: unit quaternions, ``(k, ..., n, 4)``
    """
    def rate(q: Array) -> Array:
        turn = law.world_angular_velocity(rotation.rotate(q, axes), weights, gain)
        # A rate in the world acts from the left: dR/dt = w^ R.
        return 0.5 * rotation.multiply(
            np.concatenate([turn, np.zeros((*turn.shape[:-1], 1))], axis=-1), q)

    return solve(rate, np.asarray(start, dtype=float), np.asarray(times, dtype=float), tolerance,
                 _unit, _first_step(weights, gain))


def reduced_attitudes(start: ArrayLike, weights: Array, gain: Gain, times: ArrayLike,
                      tolerance: float = TOLERANCE) -> Array:
    """
    Return the reduced attitudes of one formation, or of several, in continuous time.

    :param start: unit vectors, ``(..., n, 3)``
    :returns: unit vectors, ``(k, ..., n, 3)``

    The other parameters are those of :func:`attitudes`.
    """
    return solve(lambda gamma: law.velocity(gamma, weights, gain),
                 np.asarray(start, dtype=float), np.asarray(times, dtype=float), tolerance,
                 _unit, _first_step(weights, gain))


def follow(start: ArrayLike, weights: Array, gain: Gain, tolerance: float) -> Iterator[Step]:
    """
    Yield the accepted steps, without end, of the reduced attitudes of one formation.

    The parameters are those of :func:`reduced_attitudes`.
    """
    return steps(lambda gamma: law.velocity(gamma, weights, gain),
                 np.asarray(start, dtype=float), tolerance, _unit, _first_step(weights, gain))


def _unit(x: Array) -> Array:
    result: Array = x / np.linalg.norm(x, axis=-1, keepdims=True)
    return result


def run(gamma: ArrayLike, weights: ArrayLike, gain: Gain, duration: float, tolerance: float,
        threads: int = 1) -> Array:
    """
    Return where the reduced attitudes are after some time.

    :param gamma: reduced attitudes at the start, ``(m, n, 3)``
    :param weights: ``(n, n)``
    :param gain: a :class:`~tetra_ros2.formation.gain.Gain`
    :param duration: [s]
    :param tolerance: on the estimated error of each step, the mean over a start's coordinates
    :param threads: how many of them share the starts
    :returns: reduced attitudes, unit vectors, ``(m, n, 3)``
    :raises ModuleNotFoundError: if numba is not installed
    """
    gamma = np.asarray(gamma, dtype=float)
    weights = np.array(weights, dtype=float)
    m, n, _ = gamma.shape
    kernel = _kernel(type(gain), n)
    arguments = weights, parameters_of(gain), duration, tolerance
    end = np.empty((m, n, 3))

    def follow_task(first: int) -> None:
        starts = gamma[first:first + TASK]
        # The last block is filled up with copies of its last start.
        lanes = np.minimum(np.arange(-(-len(starts) // LANES) * LANES), len(starts) - 1)
        blocks = np.ascontiguousarray(
            starts[lanes].reshape(-1, LANES, n, 3).transpose(0, 2, 3, 1))
        kernel(blocks, *arguments)
        end[first:first + TASK] = blocks.transpose(0, 3, 1, 2).reshape(-1, n, 3)[:len(starts)]

    tasks = deque(range(0, m, TASK))

    def work() -> None:
        while True:
            try:
                first = tasks.popleft()
            except IndexError:
                return
            follow_task(first)

    kernel(np.empty((0, n, 3, LANES)), *arguments)  # it compiles here, once, in no other thread
    with ThreadPoolExecutor(max(threads - 1, 1)) as executor:
        # This thread has a core already: that it works too leaves the others to the rest.
        others = [executor.submit(work) for _ in range(threads - 1)]
        work()
        for other in others:
            other.result()
    return end


@cache
def _kernel(family: type[Gain], n: int) -> Any:
    # Constant n and LANES let the compiler unroll one loop and use vectors for the other.
    # Sums may be taken in another order; what is infinite or not a number stays what it is.
    options = {'error_model': 'numpy', 'nogil': True,
               'fastmath': {'contract', 'reassoc', 'nsz', 'arcp'}}
    of_cosine: Any
    if family.of_cosine is Gain.of_cosine:
        f = compiler()(family.f)

        @compiler(**options)
        def of_cosine(parameters: Any, cosine: float) -> Any:
            return f(parameters, math.acos(min(max(cosine, -1.0), 1.0)))
    else:
        of_cosine = compiler()(family.of_cosine)

    @compiler(**options)
    def velocity(gamma: Array, weights: Array, parameters: Any, out: Array) -> None:
        for i in range(n):
            for a in range(3):
                for lane in range(LANES):
                    out[i, a, lane] = 0.0
        for i in range(n):
            for j in range(i + 1, n):
                there, back = weights[i, j], weights[j, i]
                if there == 0.0 and back == 0.0:
                    continue
                for lane in range(LANES):
                    x, y, z = gamma[i, 0, lane], gamma[i, 1, lane], gamma[i, 2, lane]
                    u, v, w = gamma[j, 0, lane], gamma[j, 1, lane], gamma[j, 2, lane]
                    cosine = x * u + y * v + z * w
                    f = of_cosine(parameters, cosine)
                    p, q = there * f, back * f
                    out[i, 0, lane] += p * (cosine * x - u)
                    out[i, 1, lane] += p * (cosine * y - v)
                    out[i, 2, lane] += p * (cosine * z - w)
                    out[j, 0, lane] += q * (cosine * u - x)
                    out[j, 1, lane] += q * (cosine * v - y)
                    out[j, 2, lane] += q * (cosine * w - z)

    counts = np.array([len(stage) for stage in TABLE])
    sources = np.array([[*(r for r, _ in stage), *[0] * (12 - len(stage))] for stage in TABLE])
    factors = np.array([[*(c for _, c in stage), *[0.0] * (12 - len(stage))] for stage in TABLE])

    @compiler(**options)
    def combine(start: Array, slopes: Array, stage: int, h: float, out: Array) -> None:
        for i in range(n):
            for a in range(3):
                for lane in range(LANES):
                    out[i, a, lane] = start[i, a, lane]
        for r in range(counts[stage]):
            slope, factor = slopes[sources[stage, r]], h * factors[stage, r]
            for i in range(n):
                for a in range(3):
                    for lane in range(LANES):
                        out[i, a, lane] += factor * slope[i, a, lane]

    @compiler(**options)
    def largest_error(fifth: Array, third: Array, h: float) -> float:
        largest = 0.0
        for lane in range(LANES):
            five = three = 0.0
            for i in range(n):
                for a in range(3):
                    five += fifth[i, a, lane] * fifth[i, a, lane]
                    three += third[i, a, lane] * third[i, a, lane]
            if five > 0.0:
                largest = max(largest, h * five / math.sqrt((five + 0.01 * three) * 3 * n))
        return largest

    @compiler(**options)
    def kernel(blocks: Array, weights: Array, parameters: Any, duration: float,
               tolerance: float) -> None:
        slopes, point = np.empty((12, n, 3, LANES)), np.empty((n, 3, LANES))
        fifth, third = np.empty((n, 3, LANES)), np.empty((n, 3, LANES))
        nothing = np.zeros((n, 3, LANES))
        for block in range(len(blocks)):
            gamma = blocks[block]
            velocity(gamma, weights, parameters, slopes[0])
            left, h = duration, duration
            for i in range(n):
                for a in range(3):
                    for lane in range(LANES):
                        h = min(h, 0.1 / max(abs(slopes[0, i, a, lane]), 1e-9))
            while left > 0.0:
                h = min(h, left)
                for stage in range(1, 12):
                    combine(gamma, slopes, stage, h, point)
                    velocity(point, weights, parameters, slopes[stage])
                combine(nothing, slopes, FIFTH, 1.0, fifth)
                combine(nothing, slopes, THIRD, 1.0, third)
                error = largest_error(fifth, third, h) / tolerance
                if error <= 1.0:
                    combine(gamma, slopes, STEP, h, point)
                    for i in range(n):
                        for lane in range(LANES):
                            x, y, z = point[i, 0, lane], point[i, 1, lane], point[i, 2, lane]
                            scale = 1.0 / math.sqrt(x * x + y * y + z * z)
                            gamma[i, 0, lane] = scale * x
                            gamma[i, 1, lane] = scale * y
                            gamma[i, 2, lane] = scale * z
                    velocity(gamma, weights, parameters, slopes[0])
                    left = left - h if h < left else 0.0
                h *= min(max(0.9 * max(error, 1e-12) ** -0.125, 0.2), 6.0)

    return kernel
