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

"""How fast a recorded motion approaches its shape, read off the samples alone."""

import numpy as np
from numpy.typing import ArrayLike, NDArray
from tetra_ros2.formation import measures

WORST_FIT = 0.05
"""Part of the deviation, a fortieth of the way on, that may stay unexplained in the mean."""


LARGEST_GAP = 4.0
"""Between two samples, in terms of what is usual: further apart, nobody knows what happened."""


def decay_rate(gamma: ArrayLike, step: ArrayLike, limit: ArrayLike, *, largest: float = 1e-3,
               smallest: float = 1e-8) -> float:
    """
    Return the slowest rate at which the shape of a formation approaches its limit [1/s].

    This is dynamic mode decomposition: the linear map that best takes each deviation of the
    pairwise cosines to the one some time later, and of that map the largest eigenvalue. A
    straight line through the logarithm of the error gives the same where the slowest mode is
    real and alone. Under the rotating graph there are two slow pairs of complex modes.

    :param gamma: reduced attitudes, ``(k, n, 3)``
    :param step: the interval of time from each to the next [s]; or their times, ``(k,)``, if
        the intervals differ
    :param limit: a formation of the shape that is approached, ``(n, 3)``
    :param largest: deviation of a cosine from which on the motion is linear enough
    :param smallest: deviation of a cosine below which rounding disturbs
    :returns: NaN if the samples do not show an exponential approach, by a factor of ten
    """
    gamma = np.asarray(gamma, dtype=float)
    times = np.asarray(step, dtype=float)
    if not times.ndim:
        times = times * np.arange(len(gamma))
    deviation = measures.pairwise_cosines(gamma) - measures.pairwise_cosines(limit)
    modes = 2 * gamma.shape[1] - 3  # so many of the cosines are independent
    size = np.max(np.abs(deviation), axis=1)
    above = np.flatnonzero(size > largest)
    first = int(above[-1]) + 1 if len(above) else 0
    below = np.flatnonzero(size[first:] < smallest)
    last = first + (int(below[0]) if len(below) else len(size) - first)
    if last - first > 1:  # where many samples are missing, what comes before cannot be used
        gaps = np.diff(times[first:last])
        holes = np.flatnonzero(gaps > LARGEST_GAP * np.median(gaps))
        first += int(holes[-1]) + 1 if len(holes) else 0
    count = last - first
    if count < 4 * modes or size[last - 1] > 0.1 * size[first]:
        return float('nan')
    times, deviation = times[first:last], deviation[first:last]
    period = (times[-1] - times[0]) / (count - 1)
    even = times[0] + period * np.arange(count)
    if np.max(np.abs(times - even)) > 1e-6 * period:
        deviation = _interpolate(even, times, deviation)
    lag = max(1, count // 40)
    before, after = deviation[:-lag], deviation[lag:]
    scale = 1.0 / np.linalg.norm(before, axis=1, keepdims=True)
    u, s, vt = np.linalg.svd(scale * before, full_matrices=False)
    kept = min(modes, int(np.sum(s > 1e-4 * s[0])))
    u, s, vt = u[:, :kept], s[:kept], vt[:kept]
    # Rows are samples: after = before M, seen within the directions that the samples explore.
    seen = (scale * after) @ vt.T
    to_next = (u.T @ seen) / s[:, None]
    unexplained = np.linalg.norm(seen - (u * s) @ to_next, axis=1)
    slowest = float(np.max(np.abs(np.linalg.eigvals(to_next))))
    if slowest >= 1.0 or np.mean(unexplained) > WORST_FIT * np.mean(np.linalg.norm(seen, axis=1)):
        return float('nan')
    return float(-np.log(slowest) / (lag * period))


def _interpolate(at: NDArray[np.float64], times: NDArray[np.float64],
                 values: NDArray[np.float64]) -> NDArray[np.float64]:
    """
    Return values between samples, by the cubic through the four samples around each moment.

    Straight lines between the samples would not do: what they are off by looks to the
    decomposition like one more mode, and the rate found is up to a fifth too small.

    :param at: moments between the first and the last sample [s], ``(m,)``
    :param times: of the samples [s], ascending, ``(k,)`` with k >= 4
    :param values: ``(k, c)``
    :returns: ``(m, c)``
    """
    first = np.clip(np.searchsorted(times, at) - 2, 0, len(times) - 4)
    around = first[:, None] + np.arange(4)
    t = times[around]
    others = ~np.eye(4, dtype=bool)
    factors = (at[:, None, None] - t[:, None, :]) / np.where(
        others, t[:, :, None] - t[:, None, :], 1.0)
    weights = np.prod(np.where(others, factors, 1.0), axis=2)
    found: NDArray[np.float64] = np.sum(weights[..., None] * values[around], axis=1)
    return found
