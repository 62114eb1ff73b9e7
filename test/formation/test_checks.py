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

import math

from hypothesis import given
from hypothesis import strategies as st
import pytest
from strategies import unit_vectors
from tetra_ros2.formation.checks import Rejected, require_rate, require_unit, UNIT_TOLERANCE

NOT_FINITE = [
    tuple(bad if i == j else 0.5 for j in range(3))
    for i in range(3) for bad in (math.nan, math.inf, -math.inf)]


@given(unit_vectors(), st.floats(-0.999, 0.999))
def test_a_direction_that_is_a_unit_vector_within_the_tolerance_is_used(direction, share):
    require_unit(*(1.0 + share * UNIT_TOLERANCE) * direction)


@given(unit_vectors(), st.floats(1.001, 900.0), st.sampled_from([-1.0, 1.0]))
def test_a_direction_beyond_the_tolerance_is_rejected(direction, share, side):
    with pytest.raises(Rejected, match=Rejected.NOT_UNIT):
        require_unit(*(1.0 + side * share * UNIT_TOLERANCE) * direction)


@pytest.mark.parametrize(('off', 'accepted'), [
    (0.9e-3, True), (-0.9e-3, True), (1.1e-3, False), (-1.1e-3, False)])
def test_a_direction_may_be_a_thousandth_off_unit_length(off, accepted):
    direction = 0.48 * (1.0 + off), -0.6 * (1.0 + off), 0.64 * (1.0 + off)
    if accepted:
        require_unit(*direction)
    else:
        with pytest.raises(Rejected, match=Rejected.NOT_UNIT):
            require_unit(*direction)


def test_the_tolerance_itself_is_within_the_tolerance():
    for length in (1.0 - UNIT_TOLERANCE, 1.0 + UNIT_TOLERANCE):
        require_unit(0.0, 0.0, length)


@pytest.mark.parametrize('direction', [(0.0, 0.0, 0.0), (1e200, 0.0, 0.0), (1e-200, 0.0, 0.0)])
def test_a_direction_that_is_finite_but_far_from_unit_is_called_that(direction):
    with pytest.raises(Rejected, match=Rejected.NOT_UNIT):
        require_unit(*direction)


@pytest.mark.parametrize('vector', NOT_FINITE)
def test_what_is_not_finite_is_rejected_as_such(vector):
    with pytest.raises(Rejected, match=Rejected.NOT_FINITE):
        require_unit(*vector)
    with pytest.raises(Rejected, match=Rejected.NOT_FINITE):
        require_rate(*vector, 1e9)


@given(unit_vectors(), st.floats(1e-9, 1e9), st.floats(0.0, 0.999999))
def test_a_rate_up_to_the_limit_is_used(direction, limit, share):
    require_rate(*share * limit * direction, limit)


@given(unit_vectors(), st.floats(1e-9, 1e9), st.floats(1.000001, 1e6))
def test_a_rate_beyond_the_limit_is_rejected(direction, limit, factor):
    with pytest.raises(Rejected, match=Rejected.TOO_FAST):
        require_rate(*factor * limit * direction, limit)


def test_the_limit_itself_is_within_the_limit():
    require_rate(0.0, -2.5, 0.0, 2.5)


def test_a_rate_that_is_finite_but_enormous_is_called_too_fast():
    with pytest.raises(Rejected, match=Rejected.TOO_FAST):
        require_rate(1e200, 0.0, 0.0, 1e9)
