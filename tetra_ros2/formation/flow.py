# Copyright 2026 The tetra_ros2 authors
# SPDX-License-Identifier: Apache-2.0

"""
The continuous closed loop eq:RF:ClosedSystem for very many starts, compiled with numba.

The method is that of order 8 by Dormand and Prince with its error estimates, DOP853 (Hairer,
Norsett, Wanner, Solving Ordinary Differential Equations I, II.5 and II.10); each step is brought
back to the spheres. Starts go through it in blocks, side by side in the lanes of the processor,
and the worst of a block decides how long its next step is. The kernel holds no lock of the
interpreter, so threads share the blocks.
"""

from collections import deque, namedtuple
from concurrent.futures import ThreadPoolExecutor
from functools import cache
import math

import numpy as np

from tetra_ros2.formation.gain import Gain

GainParameters = namedtuple('GainParameters', ('a', 'b'))

LANES = 8
"""Starts in a block: what the stages of so many take fits into the cache nearest to a core."""

TASK = 16 * LANES
"""Starts in a thread's task: some milliseconds."""

# For each stage, then for the step and its two error estimates: earlier stages and their factors.
STAGES = (
    (),
    ((0, 0.05260015195876773),),
    ((0, 0.0197250569845379), (1, 0.0591751709536137)),
    ((0, 0.02958758547680685), (2, 0.08876275643042054)),
    ((0, 0.2413651341592667), (2, -0.8845494793282861), (3, 0.924834003261792)),
    ((0, 0.037037037037037035), (3, 0.17082860872947386), (4, 0.12546768756682242)),
    ((0, 0.037109375), (3, 0.17025221101954405), (4, 0.06021653898045596), (5, -0.017578125)),
    ((0, 0.03709200011850479), (3, 0.17038392571223998), (4, 0.10726203044637328), (5,
     -0.015319437748624402), (6, 0.008273789163814023)),
    ((0, 0.6241109587160757), (3, -3.3608926294469414), (4, -0.868219346841726), (5,
     27.59209969944671), (6, 20.154067550477894), (7, -43.48988418106996)),
    ((0, 0.47766253643826434), (3, -2.4881146199716677), (4, -0.590290826836843), (5,
     21.230051448181193), (6, 15.279233632882423), (7, -33.28821096898486), (8,
     -0.020331201708508627)),
    ((0, -0.9371424300859873), (3, 5.186372428844064), (4, 1.0914373489967295), (5,
     -8.149787010746927), (6, -18.52006565999696), (7, 22.739487099350505), (8,
     2.4936055526796523), (9, -3.0467644718982196)),
    ((0, 2.273310147516538), (3, -10.53449546673725), (4, -2.0008720582248625), (5,
     -17.9589318631188), (6, 27.94888452941996), (7, -2.8589982771350235), (8,
     -8.87285693353063), (9, 12.360567175794303), (10, 0.6433927460157636)),
    ((0, 0.054293734116568765), (5, 4.450312892752409), (6, 1.8915178993145003), (7,
     -5.801203960010585), (8, 0.3111643669578199), (9, -0.1521609496625161), (10,
     0.20136540080403034), (11, 0.04471061572777259)),
    ((0, 0.01312004499419488), (5, -1.2251564463762044), (6, -0.4957589496572502),
     (7, 1.6643771824549864), (8, -0.35032884874997366), (9, 0.3341791187130175),
     (10, 0.08192320648511571), (11, -0.022355307863886294)),
    ((0, -0.18980075407240762), (5, 4.450312892752409), (6, 1.8915178993145003),
     (7, -5.801203960010585), (8, -0.4226823213237919), (9, -0.1521609496625161),
     (10, 0.20136540080403034), (11, 0.02265179219836082)),
)
STEP, FIFTH, THIRD = 12, 13, 14


def run(gamma, weights, gain, duration, tolerance, threads=1):
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
    arguments = weights, GainParameters(gain.a, gain.b), duration, tolerance
    end = np.empty((m, n, 3))

    def follow(first):
        starts = gamma[first:first + TASK]
        # The last block is filled up with copies of its last start.
        lanes = np.minimum(np.arange(-(-len(starts) // LANES) * LANES), len(starts) - 1)
        blocks = np.ascontiguousarray(
            starts[lanes].reshape(-1, LANES, n, 3).transpose(0, 2, 3, 1))
        kernel(blocks, *arguments)
        end[first:first + TASK] = blocks.transpose(0, 3, 1, 2).reshape(-1, n, 3)[:len(starts)]

    tasks = deque(range(0, m, TASK))

    def work():
        while True:
            try:
                first = tasks.popleft()
            except IndexError:
                return
            follow(first)

    kernel(np.empty((0, n, 3, LANES)), *arguments)  # it compiles here, once, in no other thread
    with ThreadPoolExecutor(max(threads - 1, 1)) as executor:
        # This thread has a core already: that it works too leaves the others to the rest.
        others = [executor.submit(work) for _ in range(threads - 1)]
        work()
        for other in others:
            other.result()
    return end


@cache
def _kernel(family, n):
    # Constant n and LANES let the compiler unroll one loop and use vectors for the other.
    from numba import njit
    # Sums may be taken in another order; what is infinite or not a number stays what it is.
    compiled = njit(error_model='numpy', nogil=True,
                    fastmath={'contract', 'reassoc', 'nsz', 'arcp'})
    if family.of_cosine is Gain.of_cosine:
        f = njit(family.f)

        @compiled
        def of_cosine(parameters, cosine):
            return f(parameters, math.acos(min(max(cosine, -1.0), 1.0)))
    else:
        of_cosine = njit(family.of_cosine)

    @compiled
    def velocity(gamma, weights, parameters, out):
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

    counts = np.array([len(stage) for stage in STAGES])
    sources = np.array([[*(r for r, _ in stage), *[0] * (12 - len(stage))] for stage in STAGES])
    factors = np.array([[*(c for _, c in stage), *[0.0] * (12 - len(stage))] for stage in STAGES])

    @compiled
    def combine(start, slopes, stage, h, out):
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

    @compiled
    def largest_error(fifth, third, h):
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

    @compiled
    def kernel(blocks, weights, parameters, duration, tolerance):
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
                # A step too short for the time to tell counts, whatever its error.
                if error <= 1.0 or h < 1e-13 * duration:
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
