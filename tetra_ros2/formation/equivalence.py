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
Which formations the law cannot tell apart.

The law commutes with all of O(3): what it makes of a formation that is turned or reflected is what
it makes of the formation, turned or reflected. It also commutes with every automorphism of the
graph, a permutation p of the agents with ``W(p(i), p(j)) = W(i, j)``. Two formations are
equivalent if such moves take one to the other.
"""

import numpy as np
from numpy.typing import ArrayLike
from tetra_ros2.formation.symmetry import isomorphisms, level_indices, Permutation


def automorphism(gamma: ArrayLike, other: ArrayLike, weights: ArrayLike,
                 tolerance: float = 1e-9) -> Permutation | None:
    """
    Return an automorphism of the weights that, with a rotation or reflection, joins formations.

    :param gamma: reduced attitudes, ``(n, 3)``
    :param other: reduced attitudes, ``(n, 3)``
    :param weights: ``(n, n)``
    :param tolerance: cosines closer than this are the same
    :returns: p, counted from 0, such that agent p[i] of ``other`` is where agent i of ``gamma``
        is; None if there is no such permutation
    """
    gamma, other = np.asarray(gamma, dtype=float), np.asarray(other, dtype=float)
    # The cosines determine a formation up to rotations and reflections.
    cosines = level_indices(np.stack([gamma @ gamma.T, other @ other.T]), tolerance)
    _, classes = np.unique(np.asarray(weights, dtype=float), return_inverse=True)
    base = (int(np.max(cosines)) + 1) * classes.reshape(np.shape(weights))
    return next(isomorphisms(base + cosines[0], base + cosines[1]), None)


def equivalent(gamma: ArrayLike, other: ArrayLike, weights: ArrayLike,
               tolerance: float = 1e-9) -> bool:
    """Return whether the law makes no difference between two formations; see above."""
    return automorphism(gamma, other, weights, tolerance) is not None
