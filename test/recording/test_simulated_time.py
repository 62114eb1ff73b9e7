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

"""What is forged on /clock costs nothing, and a clock that was started again is believed."""

from contextlib import suppress

from hypothesis import given, strategies
import pytest
from tetra_ros2.formation.checks import Rejected
from tetra_ros2.recording.simulated_time import SILENCE, SimulatedTime, WITNESSES

S = 1_000_000_000
STEP = S // 100
forged_times = strategies.integers(-2**31 * S, 2**32 * S)


def hear(clock, time, at):
    with suppress(Rejected):
        clock.hear(time, at)


@given(strategies.lists(forged_times, min_size=20, max_size=20), strategies.integers(1, 10**6))
def test_a_forged_time_between_any_two_true_ones_costs_no_more_than_a_stride(forged, first):
    clock = SimulatedTime()
    for k, lie in enumerate(forged):
        true = first * S + k * STEP
        hear(clock, true, k * STEP)
        assert true <= clock.now <= true + S
        hear(clock, lie, k * STEP + 1)
        if abs(lie - true) > 2 * S:
            assert clock.now <= true + S


def test_one_forged_time_changes_nothing_at_all():
    clock = SimulatedTime()
    clock.hear(5 * S, 0)
    with pytest.raises(Rejected):
        clock.hear((2**31 - 1) * S, 1)
    assert clock.now == 5 * S
    clock.hear(5 * S + STEP, 2)
    assert clock.now == 5 * S + STEP


@pytest.mark.parametrize('time', [0, -1, 2**31 * S])
def test_what_no_clock_can_say_is_refused_even_as_the_first(time):
    clock = SimulatedTime()
    with pytest.raises(Rejected):
        clock.hear(time, 1)
    assert clock.now == 0


@pytest.mark.parametrize('again', [STEP, 100 * S, 10**6 * S])
def test_a_clock_that_was_started_again_is_believed_after_a_silence(again):
    clock = SimulatedTime()
    clock.hear(1000 * S, 0)
    for k in range(WITNESSES):
        hear(clock, again + k * STEP, SILENCE + k)
    assert clock.now == again + (WITNESSES - 1) * STEP
    clock.hear(again + WITNESSES * STEP, SILENCE + WITNESSES)
    assert clock.now == again + WITNESSES * STEP


@pytest.mark.parametrize('lies', [[2000 * S] * 50, [2000 * S, 3 * S] * 50])
def test_neither_repeated_nor_contradicting_times_are_believed(lies):
    clock = SimulatedTime()
    clock.hear(1000 * S, 0)
    for k, lie in enumerate(lies):
        hear(clock, lie, 2 * SILENCE + k)
    assert clock.now == 1000 * S


def test_a_flood_beside_the_true_clock_is_not_believed():
    clock = SimulatedTime()
    for k in range(200):
        true = S + k * STEP
        clock.hear(true, k * STEP)
        for j in range(20):
            hear(clock, 10**9 * S + (20 * k + j) * STEP, k * STEP + j)
        assert clock.now == true


def test_a_forged_time_that_came_first_is_mended():
    clock = SimulatedTime()
    clock.hear(2**30 * S, 0)
    for k in range(1, 200):
        hear(clock, k * STEP, k * STEP)
    assert clock.now == 199 * STEP


def test_steps_longer_than_a_stride_are_followed_once_they_are_believed():
    clock = SimulatedTime()
    for k in range(1, 20):
        hear(clock, 100 * S * k, k * S)
    assert clock.now == 1900 * S


def test_time_does_not_go_back_by_less_than_a_jump():
    clock = SimulatedTime()
    clock.hear(5 * S, 0)
    clock.hear(5 * S - STEP, 1)
    assert clock.now == 5 * S
