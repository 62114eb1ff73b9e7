# Copyright 2026 The tetra_ros2 authors
# SPDX-License-Identifier: Apache-2.0

"""How fast a recorded motion approaches its shape, read off the samples alone."""

import numpy as np
from numpy.typing import ArrayLike

from tetra_ros2.formation import measures


def decay_rate(gamma: ArrayLike, step: float, limit: ArrayLike, *, largest: float = 1e-3,
               smallest: float = 1e-8) -> float:
    """
    Return the slowest rate at which the shape of a formation approaches its limit [1/s].

    This is dynamic mode decomposition: the linear map that best takes each deviation of the
    pairwise cosines to the one some time later, and of that map the largest eigenvalue. A
    straight line through the logarithm of the error gives the same where the slowest mode is
    real and alone. Under the rotating graph there are two slow pairs of complex modes.

    :param gamma: reduced attitudes at equal intervals of time, ``(k, n, 3)``
    :param step: that interval [s]
    :param limit: a formation of the shape that is approached, ``(n, 3)``
    :param largest: deviation of a cosine from which on the motion is linear enough
    :param smallest: deviation of a cosine below which rounding disturbs
    :returns: NaN if the samples do not show the approach
    """
    gamma = np.asarray(gamma, dtype=float)
    deviation = measures.pairwise_cosines(gamma) - measures.pairwise_cosines(limit)
    modes = 2 * gamma.shape[1] - 3  # so many of the cosines are independent
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
    to_next = (u.T @ (scale * after) @ vt.T) / s[:, None]
    slowest = np.max(np.abs(np.linalg.eigvals(to_next)))
    return float(-np.log(slowest) / (lag * step))
