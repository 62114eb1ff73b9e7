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

from functools import partial
import itertools
import math

from hypothesis import example, given, settings
from hypothesis import strategies as st
import numpy as np
import pytest
from strategies import any_gain, assert_close, formations, tangents, unit_vectors
from tetra_ros2.formation import law
from tetra_ros2.formation.checks import Rejected
from tetra_ros2.formation.controller import Controller, NEVER
from tetra_ros2.formation.gain import Cosine

X, Y, Z = (1.0, 0.0, 0.0), (0.0, 1.0, 0.0), (0.0, 0.0, 1.0)
AXIS, WEIGHTS, GAIN = (0.6, 0.0, 0.8), (0.5, 1.0, -0.25), Cosine()
SLOTS = range(len(WEIGHTS))


def direction(number):
    """Return a unit vector of its own for every whole number."""
    azimuth, z = 2.0 * number, math.sin(3.0 * number + 1.0)
    r = math.sqrt(1.0 - z * z)
    return r * math.cos(azimuth), r * math.sin(azimuth), z


def law_at(seen):
    """Return the command that the law on arrays gives for what is seen of all neighbours."""
    return law.angular_velocity(
        np.array([AXIS]), np.array([seen]), np.array([WEIGHTS]), GAIN)[0]


def new_controller():
    return Controller(AXIS, WEIGHTS, GAIN)


def receive_round(controller, stamp, order=SLOTS, now=0.0):
    """Send the measurements of one stamp; return all the answers."""
    return [controller.receive(slot, stamp, direction(10 * stamp + slot), now) for slot in order]


def outcome(controller, slot, stamp, seen, now=0.0):
    """Return the answer to one message, or why it was rejected."""
    try:
        return controller.receive(slot, stamp, seen, now)
    except Rejected as reason:
        return str(reason)


messages = st.tuples(st.sampled_from(SLOTS), st.integers(0, 3))


@pytest.mark.parametrize('order', list(itertools.permutations(SLOTS)))
def test_a_round_is_answered_when_it_is_complete_whatever_its_order(order):
    *early, answer = receive_round(new_controller(), 7, order)
    assert early == [None, None]
    assert_close(answer, law_at([direction(70 + slot) for slot in SLOTS]), atol=1e-14)


@settings(max_examples=300)
@given(st.lists(messages, max_size=30))
@example([(0, 0), (1, 0), (2, 0)])
@example([(0, 1), (1, 1), (2, 2), (2, 1), (0, 2), (1, 2), (0, 1)])
def test_an_answer_comes_exactly_when_the_newest_stamp_is_there_from_everybody(sequence):
    controller = new_controller()
    accepted = []  # (slot, stamp, seen) since the beginning
    answered_at = 0  # how many of them the last answer used up
    for number, (slot, stamp) in enumerate(sequence):
        if any(other == slot and stamp < used for other, used, _ in accepted):
            continue  # a publisher does not turn time back
        seen = direction(number)
        got = outcome(controller, slot, stamp, seen)
        accepted.append((slot, stamp, seen))
        newest = max(used for _, used, _ in accepted)
        since = {other: what for other, used, what in accepted[answered_at:] if used == newest}
        if stamp == newest and len(since) == len(SLOTS):
            assert_close(got, law_at([since[other] for other in SLOTS]), atol=1e-14)
            assert controller.stamp == stamp
            answered_at = len(accepted)
        else:
            assert got is None


@given(st.lists(messages, max_size=20))
def test_whatever_came_before_a_round_of_a_newer_stamp_is_answered(sequence):
    controller = new_controller()
    for number, (slot, stamp) in enumerate(sequence):
        outcome(controller, slot, stamp, direction(number))
    *early, answer = receive_round(controller, 9)
    assert early == [None, None]
    assert_close(answer, law_at([direction(90 + slot) for slot in SLOTS]), atol=1e-14)


def test_a_round_that_is_sent_again_is_answered_again_with_the_same():
    controller = new_controller()
    first = receive_round(controller, 1)
    assert first[2] is not None
    assert receive_round(controller, 1) == first
    assert receive_round(controller, 1, (2, 0, 1)) == [None, None, first[2]]


def test_half_a_round_sent_twice_is_no_round():
    controller = new_controller()
    assert receive_round(controller, 1, (0, 1, 0, 1)) == [None] * 4


def test_the_first_stamp_may_be_zero():
    assert receive_round(new_controller(), 0)[2] is not None


def test_a_round_that_a_newer_one_overtook_is_never_answered():
    controller = new_controller()
    assert receive_round(controller, 1, (0, 1)) == [None, None]
    assert controller.receive(0, 2, X, 0.0) is None
    assert controller.receive(2, 1, X, 0.0) is None
    assert controller.stamp == 2


def test_a_message_older_than_the_one_in_use_is_rejected():
    controller = new_controller()
    receive_round(controller, 5)
    with pytest.raises(Rejected, match=Rejected.OLD_STAMP):
        controller.receive(0, 4, Y, 0.0)


PERIOD = 10_000_000
EPOCH = 1_700_000_000_000_000_000


def true_round(controller, k, only=SLOTS):
    """Let all neighbours speak as a plant has them do; return the answer, or None."""
    answer = None
    for slot in only:
        got = outcome(controller, slot, EPOCH + k * PERIOD, direction(k))
        answer = answer or got
    return answer


forged = st.one_of(
    st.integers(0, 2**31 * 10**9), st.integers(-50, 50).map(lambda k: EPOCH + k * PERIOD),
    st.integers(EPOCH - 10**9, EPOCH + 10**9))


@given(st.lists(st.tuples(st.integers(0, 20), st.sampled_from(SLOTS), forged), max_size=10))
def test_no_forged_stamp_on_one_topic_keeps_the_true_ones_out(lies):
    """At most the round in which it comes is lost; the next ones are all answered."""
    slot = lies[0][1] if lies else 0
    controller = new_controller()
    assert true_round(controller, 0) is not None
    for k in range(1, 22):
        for at, _, stamp in lies:
            if at == k - 1:
                outcome(controller, slot, stamp, direction(99))
        assert isinstance(true_round(controller, k), tuple)


@pytest.mark.parametrize('jump', [-3600, -60, -1, 1, 60, 3600])
def test_a_plant_whose_clock_is_set_is_believed_when_all_neighbours_agree(jump):
    controller = new_controller()
    for k in range(5):
        assert true_round(controller, k) is not None
    later = jump * 100
    answers = [true_round(controller, later + 5 + k) for k in range(3)]
    assert all(isinstance(answer, tuple) for answer in answers[1:])


@pytest.mark.parametrize('jump', [-3600, 3600])
@pytest.mark.parametrize('order', list(itertools.permutations(SLOTS)))
def test_the_round_in_which_another_time_is_believed_goes_on_with_who_is_behind(jump, order):
    controller = new_controller()
    for k in range(5):
        true_round(controller, k)
    *early, last = order
    base = EPOCH + jump * 10**9
    for slot in early:
        assert isinstance(outcome(controller, slot, base, X), str)
    assert outcome(controller, last, base + PERIOD, X) is None, 'all speak of another time'
    assert controller.stamp == base + PERIOD
    assert outcome(controller, early[0], base + PERIOD, X) is None
    assert isinstance(outcome(controller, early[1], base + PERIOD, X), tuple)


@pytest.mark.parametrize('jump', [-3600.0, 3600.0])
def test_who_sees_one_neighbour_believes_another_time_after_silence(jump):
    controller = Controller(AXIS, [1.0], Cosine())
    receive = partial(controller.receive, 0)
    for k in range(5):
        assert receive(EPOCH + k * PERIOD, Y, 0.01 * k) is not None
    with pytest.raises(Rejected):
        receive(EPOCH + round(1e9 * jump), Y, 0.05)
    controller.forget(before=0.5)
    assert receive(EPOCH + round(1e9 * jump), Y, 0.6) is not None


def test_who_sees_one_neighbour_goes_by_its_own_clock():
    now = EPOCH
    controller = Controller(AXIS, [1.0], Cosine(), lambda: now)
    assert controller.receive(0, now, Y, 0.0) is not None
    assert controller.receive(0, now + 400_000_000, Y, 0.0) is not None, 'a lie'
    now += PERIOD
    assert controller.receive(0, now, Y, 0.01) is not None, 'the truth'
    with pytest.raises(Rejected, match=Rejected.OLD_STAMP):
        controller.receive(0, now - PERIOD, Y, 0.01)


def test_a_plant_that_takes_long_steps_is_answered_at_once():
    controller = new_controller()
    for k in range(5):
        stamp = (k + 1) * 10**11
        *_, answer = [outcome(controller, slot, stamp, direction(k)) for slot in SLOTS]
        assert isinstance(answer, tuple)


@pytest.mark.parametrize('clock', [0, 1])
def test_a_leap_of_up_to_four_times_the_last_is_taken_and_a_longer_one_is_not(clock):
    step = 10**9
    for leap, taken in ((4 * step, True), (4 * step + 1, False)):
        # It has no clock, or one that says something else.
        controller = Controller(AXIS, WEIGHTS, GAIN, lambda: clock)
        for stamp in (EPOCH, EPOCH + step):
            receive_round(controller, stamp)
        got = outcome(controller, 0, EPOCH + step + leap, X)
        assert got == (None if taken else Rejected.FUTURE_STAMP)
        assert controller.stamp == EPOCH + step + (leap if taken else 0)


def test_a_stamp_may_be_ahead_by_so_much_of_those_in_use_or_of_the_clock():
    step, ahead = PERIOD, 500_000_000
    for clock, behind, taken in ((0, ahead, True), (0, ahead + 1, False),
                                 (EPOCH + 10**10 + 1, 10**10, True),
                                 (EPOCH + 10**10 + step + ahead, 10**10, False),
                                 (EPOCH + 10**10 + step - ahead, 10**10, False)):
        controller = Controller(AXIS, WEIGHTS, GAIN, lambda clock=clock: clock)
        controller.ahead = ahead
        for stamp in (EPOCH, EPOCH + step):
            receive_round(controller, stamp)
        got = outcome(controller, 0, EPOCH + step + behind, X)
        assert got == (None if taken else Rejected.FUTURE_STAMP), (clock, behind)


BAD = st.tuples(
    st.sampled_from(SLOTS), st.integers(0, 9),
    st.sampled_from([
        (math.nan, 0.0, 1.0), (math.inf, 0.0, 0.0), (0.0, 0.0, 0.0), (1.0, 0.1, 0.0),
        (0.0, 0.998, 0.0)]))
GOOD = st.builds(
    lambda slot, stamp, number: (slot, stamp, direction(number)),
    st.sampled_from(SLOTS), st.integers(0, 3), st.integers(0, 1000))


@given(st.lists(st.one_of(GOOD, BAD), max_size=25))
def test_messages_that_are_rejected_leave_no_trace(sequence):
    disturbed, undisturbed = new_controller(), new_controller()
    for slot, stamp, seen in sequence:
        got = outcome(disturbed, slot, stamp, seen, now=1.0)
        if isinstance(got, str):
            continue
        assert got == outcome(undisturbed, slot, stamp, seen, now=1.0)
        assert disturbed.oldest_stamp == undisturbed.oldest_stamp
        assert disturbed.stamp == undisturbed.stamp
        assert disturbed.heard_at == undisturbed.heard_at
    assert receive_round(disturbed, 4) == receive_round(undisturbed, 4)


@pytest.mark.parametrize('seen, reason', [
    ((math.nan, 0.0, 1.0), Rejected.NOT_FINITE),
    ((0.0, -math.inf, 0.0), Rejected.NOT_FINITE),
    ((1.0, 0.1, 0.0), Rejected.NOT_UNIT),
    ((0.0, 0.0, 0.0), Rejected.NOT_UNIT),
])
def test_what_is_no_direction_is_rejected_with_its_reason(seen, reason):
    with pytest.raises(Rejected, match=reason):
        new_controller().receive(0, 1, seen, 0.0)


@given(unit_vectors(), formations(3), any_gain())
def test_the_newest_of_each_is_used_when_no_round_comes_together(axis, seen, gain):
    controller = Controller(axis, WEIGHTS, gain)
    controller.receive(0, 1, Z, 0.0)
    for slot, stamp in ((0, 3), (1, 2), (2, 1)):
        assert controller.receive(slot, stamp, tuple(seen[slot]), 0.0) is None
    expected = law.angular_velocity(axis[None], seen[None], np.array([WEIGHTS]), gain)[0]
    assert_close(controller.angular_velocity(), expected, atol=1e-12)


def test_a_late_message_is_the_newest_of_its_neighbor_until_that_is_heard_again():
    controller = new_controller()
    receive_round(controller, 1)
    controller.receive(0, 3, X, 0.0)
    controller.receive(1, 3, Y, 0.0)
    assert controller.receive(2, 2, Z, 0.0) is None
    assert_close(controller.angular_velocity(), law_at([X, Y, Z]), atol=1e-14)


def test_it_tells_whom_it_has_not_seen_and_how_old_its_oldest_measurement_is():
    controller = new_controller()
    assert controller.unseen() == [0, 1, 2]
    controller.receive(0, 30, X, 1.0)
    controller.receive(1, 20, X, 2.0)
    assert controller.unseen() == [2]
    assert not controller.complete
    controller.receive(2, 40, X, 3.0)
    assert controller.complete
    assert controller.oldest_stamp == 20


def test_only_those_silent_for_too_long_are_forgotten():
    controller = new_controller()
    for slot, now in ((0, 1.0), (1, 2.0), (2, 3.0)):
        controller.receive(slot, 30 + slot, X, now)
    controller.forget(before=2.0)
    assert controller.unseen() == [0]
    assert controller.heard_at == [NEVER, 2.0, 3.0]
    assert controller.stamp == 32
    assert controller.receive(0, 1, X, 4.0) is None, 'an older clock is welcome from that one'
    assert controller.complete


def test_a_round_goes_on_if_there_was_nothing_to_forget():
    controller = new_controller()
    for slot in SLOTS[:-1]:
        assert controller.receive(slot, 5, direction(slot), 3.0) is None
        controller.forget(before=2.0)
    assert controller.receive(SLOTS[-1], 5, direction(SLOTS[-1]), 3.0) is not None


def test_after_forgetting_an_older_clock_is_welcome():
    controller = new_controller()
    receive_round(controller, 100)
    with pytest.raises(Rejected):
        receive_round(controller, 1)
    controller.forget()
    assert controller.heard_at == [NEVER] * 3
    assert receive_round(controller, 1) == receive_round(new_controller(), 1)


@pytest.mark.parametrize('stamp', [0, 1])
def test_after_forgetting_half_a_round_all_of_it_is_needed_again(stamp):
    controller = new_controller()
    receive_round(controller, 1, (0, 1))
    controller.forget()
    assert receive_round(controller, stamp, (2, 0)) == [None, None]
    assert controller.receive(1, stamp, X, 0.0) is not None


def test_the_gain_may_be_replaced_at_any_time():
    controller = new_controller()
    before = receive_round(controller, 1)[2]
    controller.gain = Cosine(a=2.0)
    assert_close(receive_round(controller, 2, (0, 1, 2))[2],
                 2.0 * law_at([direction(20 + slot) for slot in SLOTS]), atol=1e-14)
    assert_close(receive_round(new_controller(), 1)[2], before, atol=0.0)


def test_an_agent_that_sees_nobody_does_not_move():
    assert Controller(AXIS, (), GAIN).angular_velocity() == (0.0, 0.0, 0.0)


@pytest.mark.parametrize('seen', [AXIS, tuple(-x for x in AXIS)])
def test_a_neighbor_straight_ahead_or_behind_moves_nobody(seen):
    controller = Controller(AXIS, (1.0,), GAIN)
    assert_close(controller.receive(0, 1, seen, 0.0), (0.0, 0.0, 0.0), atol=1e-15)


@given(tangents(), any_gain(), st.sampled_from([1.0, -1.0]), st.integers(1, 15))
def test_close_to_an_axis_or_its_antipode_no_digit_is_lost(tangent, gain, side, digits):
    axis, direction = tangent
    seen = side * axis + 10.0**-digits * direction
    seen /= np.linalg.norm(seen)
    expected = law.angular_velocity(
        np.array([axis]), np.array([[seen]]), np.array([[1.0]]), gain)[0]
    command = Controller(axis, (1.0,), gain).receive(0, 1, tuple(seen.tolist()), 0.0)
    assert_close(command, expected, atol=1e-15 * gain.f(0.0))


@given(unit_vectors(), any_gain(), st.sampled_from([1.0, -1.0]), st.floats(-9e-4, 9e-4))
def test_a_measurement_that_is_not_quite_a_unit_vector_is_no_error(axis, gain, side, excess):
    seen = side * (1.0 + excess) * axis
    command = Controller(axis, (1.0,), gain).receive(0, 1, tuple(seen.tolist()), 0.0)
    assert_close(command, (0.0, 0.0, 0.0), atol=1e-15 * gain.f(0.0))
