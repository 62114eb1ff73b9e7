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

"""The lower confidence bound of a chance, where it is known in closed form."""

import math

import pytest
from tetra_ros2.study.confidence import lower_bound


def tail(p, least, starts):
    """Return the chance of at least so many, exactly."""
    return sum(math.comb(starts, k) * p**k * (1.0 - p) ** (starts - k)
               for k in range(least, starts + 1))


@pytest.mark.parametrize('starts', [2, 5, 20])
def test_the_bound_is_where_so_many_or_more_have_the_chance_of_the_doubt(starts):
    for formed in range(1, starts + 1):
        for confidence in (0.9, 0.95, 0.99):
            bound = lower_bound(formed, starts, confidence)
            assert tail(bound, formed, starts) == pytest.approx(1.0 - confidence, rel=1e-6)
