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

"""What so many successes in so many trials say about the chance of one."""

import math

import numpy as np


def lower_bound(formed: int, starts: int, confidence: float = 0.95) -> float:
    """
    Return below which fraction the chance to form is not, with a confidence (Clopper-Pearson).

    :param formed: how many did
    :param starts: of how many
    """
    if formed == 0:
        return 0.0
    if formed == starts:
        bound: float = (1.0 - confidence) ** (1.0 / starts)
        return bound
    terms = np.arange(formed, starts + 1)
    choose = np.array([math.lgamma(starts + 1) - math.lgamma(k + 1) - math.lgamma(starts - k + 1)
                       for k in terms])
    low, high = 0.0, formed / starts
    for _ in range(60):
        p = 0.5 * (low + high)
        tail = float(np.sum(np.exp(choose + terms * math.log(p) + (starts - terms)
                                   * math.log1p(-p))))
        low, high = (p, high) if tail < 1.0 - confidence else (low, p)
    return low
