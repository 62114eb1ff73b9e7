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

"""How a result is judged: what agrees passes, what does not, or is missing, does not."""

import math

import pytest
from tetra_ros2.paper.errata import ERRATA, erratum
from tetra_ros2.paper.registry import (
    CLAIMS,
    equal,
    negative,
    same_spectrum,
    vanishes,
    worst_of,
)


@pytest.mark.parametrize(('measured', 'predicted', 'passed'), [
    ([1.0, -2.0 + 1j], [-2.0 + 1j, 1.0], True),
    ([1.0, 1.0, 2.0], [1.0, 2.0, 2.0], False),
    ([1.0, 2.0], [1.0, 2.0, 2.0], False),
    ([1.0, 2.0, 2.0], [1.0, 2.0], False),
    ([1.0, 2.0 + 1e-8], [1.0, 2.0], False)])
def test_spectra_agree_if_each_eigenvalue_has_its_own_partner(measured, predicted, passed):
    assert same_spectrum(measured, predicted).passed is passed


def test_what_is_not_a_number_never_passes():
    assert not equal(0.0, math.nan, 1.0).passed
    assert not vanishes([0.0, math.nan], 1.0).passed
    assert not negative([-1.0, math.nan]).passed


def test_the_worst_result_is_one_that_did_not_pass_however_small():
    failed, passed = equal(0.0, 1e-9, 1e-12), equal(0.0, 0.5, 1.0)
    assert worst_of([passed, failed]) is failed
    assert worst_of([equal(0.0, 0.1, 1.0), passed]) is passed


@pytest.mark.parametrize(('printed_off', 'corrected_off', 'holds'), [
    (0.5, [0.0, 0.9e-6], True), (1.1e-3, [0.0], True), (0.5, [0.0, -1.1e-6], False),
    (0.9e-3, [0.0], False), (0.5, [math.nan], False), (math.nan, [0.0], False)])
def test_an_erratum_holds_if_what_is_printed_is_off_and_what_is_put_in_its_place_is_not(
        printed_off, corrected_off, holds):
    erratum('erratum-of-this-test', '', '', '')(lambda system: (printed_off, corrected_off))
    del CLAIMS['erratum-of-this-test']
    assert ERRATA.pop('erratum-of-this-test').check(None).passed is holds
