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

"""Attitudes from elsewhere: stale, frozen and jumping ones are noticed, good ones are used."""

import contextlib
import math

from hypothesis import given
from hypothesis import strategies as st
import pytest
from tetra_ros2.formation import tracking
from tetra_ros2.formation.checks import Rejected
from tetra_ros2.formation.tracking import Tracker

MS = 1_000_000


def about_z(angle):
    return 0.0, 0.0, math.sin(0.5 * angle), math.cos(0.5 * angle)


def tracker():
    return Tracker(timeout=0.2, max_rate=5.0, frozen_angle=0.1)


def feed(track, times, angle=lambda t: t):
    for t in times:
        track.receive(round(t * 1e9), about_z(angle(t)), t)


@pytest.mark.parametrize(('attitude', 'reason'), [
    ((0.0, 0.0, 0.0), Rejected.MALFORMED), ((0.0, 0.0, 0.0, 1.0, 0.0), Rejected.MALFORMED),
    (None, Rejected.MALFORMED), ((0.0, 0.0, 'x', 1.0), Rejected.MALFORMED),
    ((0.0, 0.0, math.nan, 1.0), Rejected.NOT_FINITE),
    ((0.0, 0.0, math.inf, 1.0), Rejected.NOT_FINITE)])
def test_what_is_no_quaternion_is_no_attitude(attitude, reason):
    with pytest.raises(Rejected, match=reason):
        tracking.unit_quaternion(attitude)


@pytest.mark.parametrize('off', [-0.9e-3, 0.0, 0.9e-3])
def test_an_attitude_may_be_a_thousandth_off_unit_length(off):
    q = [0.1, -0.5, 0.5, 0.7]
    length = math.hypot(*q) / (1.0 + off)
    unit = tracking.unit_quaternion([x / length for x in q])
    assert math.hypot(*unit) == pytest.approx(1.0, abs=1e-15)
    assert unit == pytest.approx([x / math.hypot(*q) for x in q], abs=1e-15)
    for worse in (-1.1e-3, 1.1e-3):
        with pytest.raises(Rejected, match='unit quaternion'):
            tracking.unit_quaternion([x / math.hypot(*q) * (1.0 + worse) for x in q])


def test_who_was_never_heard_is_lost_from_the_start_and_may_begin_at_any_time():
    track = tracker()
    track.receive(-5, about_z(0.1), -1e9)
    assert track.state(-1e9) == tracking.TRACKED
    track.receive(-6, about_z(3.0), -1e9 + 0.3)
    assert track.state(-1e9 + 0.3) == tracking.TRACKED, 'lost, so that an older clock is welcome'


@pytest.mark.parametrize('rate', [(3.0, 0.0, 0.0), (0.0, -3.0, 0.0), (0.0, 0.0, 3.0),
                                  (2.0, -1.0, -2.0), (-1.0, 2.0, 2.0)], ids=str)
def test_a_body_is_frozen_once_it_was_told_to_turn_by_more_than_the_angle(rate):
    for angle, state in ((0.099, tracking.TRACKED), (0.101, tracking.FROZEN)):
        track = tracker()
        for k in range(41):
            track.receive(10**9 + k * 10 * MS, about_z(0.3), 1.0 + 0.01 * k)
            track.told(rate, angle / 3.0 / 41.0)
        assert track.state(1.4) == state


@pytest.mark.parametrize('elapsed', [0.01, 0.1])
@pytest.mark.parametrize('sign', [1.0, -1.0])
def test_a_jump_is_what_the_fastest_turn_and_a_little_slack_cannot_explain(elapsed, sign):
    most = 5.0 * elapsed + tracking.SLACK
    for angle, fine in ((0.999 * most, True), (1.001 * most, False)):
        track = tracker()
        track.receive(10**9, about_z(0.3), 1.0)
        later = 10**9 + round(elapsed * 1e9), [sign * x for x in about_z(0.3 + angle)], 1.0
        if fine:
            track.receive(*later)
        else:
            with pytest.raises(Rejected, match=tracking.JUMP):
                track.receive(*later)
        assert track.jumps == (not fine)


def test_nothing_is_known_before_the_first_pose():
    assert tracker().state(0.0) == tracking.WAITING


@given(st.lists(st.floats(-0.002, 0.002), min_size=30, max_size=30),
       st.lists(st.booleans(), min_size=30, max_size=30))
def test_a_moving_body_is_tracked_through_jitter_and_drop_outs(jitter, kept):
    track = tracker()
    for k, (late, keep) in enumerate(zip(jitter, kept)):
        t = 1.0 + k / 120.0
        if keep or k % 10 == 0:
            track.receive(round(t * 1e9), about_z(2.0 * t), t + late)
    assert track.jumps == 0
    assert track.received == sum(keep or k % 10 == 0 for k, keep in enumerate(kept))
    assert track.state(t) == tracking.TRACKED


def test_a_body_not_heard_of_is_lost_and_found_again():
    track = tracker()
    feed(track, [1.0, 1.01])
    assert track.state(1.2) == tracking.TRACKED
    assert track.state(1.22) == tracking.LOST
    feed(track, [3.0], lambda t: 2.5)  # wherever it may be by now
    assert track.state(3.0) == tracking.TRACKED


@given(st.floats(0.25, 5.0), st.floats(0.001, 0.02))
def test_a_frozen_body_is_noticed_in_time_and_not_before(rate, period):
    # Told at this rate, it is noticed after 0.1 / rate, and no sooner than after the time-out.
    track = tracker()
    feed(track, [1.0])
    t = 1.0
    while track.state(t) != tracking.FROZEN:
        t += period
        track.receive(round(t * 1e9), about_z(1.0), t)
        track.told((0.0, rate, 0.0), period)
    due = max(0.2, 0.1 / rate)
    assert due - 1e-9 < t - 1.0 <= due + 1.001 * period
    feed(track, [t + period], lambda t: 1.001)
    assert track.state(t + period) == tracking.TRACKED


def test_a_source_without_noise_may_repeat_itself():
    track = tracker()
    feed(track, [1.0])
    track.repeats = True
    track.receive(1_500_000_000, about_z(1.0), 1.5)
    track.told((0.0, 5.0, 0.0), 0.5)
    assert track.state(1.5) == tracking.TRACKED


def test_a_body_that_is_told_nothing_may_rest():
    track = tracker()
    for k in range(200):
        track.receive(1_000_000_000 + k * 8 * MS, about_z(1.0), 1.0 + 0.008 * k)
        track.told((0.0, 0.0, 0.0), 0.008)
    assert track.state(1.0 + 0.008 * 199) == tracking.TRACKED


def test_a_jump_is_refused_and_the_next_good_pose_is_taken():
    track = tracker()
    feed(track, [1.0, 1.01])
    with pytest.raises(Rejected, match=tracking.JUMP):
        track.receive(1_020_000_000, about_z(2.5), 1.02)
    feed(track, [1.03])
    assert track.jumps == 1
    assert track.attitude == about_z(1.03)


def test_a_jump_that_stays_is_believed_in_the_end_and_reported_until_then():
    track = tracker()
    feed(track, [1.0])
    states = []
    t = 1.0
    while not states or states[-1] != tracking.TRACKED or track.attitude == about_z(1.0):
        t += 0.01
        assert t < 1.5
        with contextlib.suppress(Rejected):
            track.receive(round(t * 1e9), about_z(2.9), t)
        states.append(track.state(t))
        if track.attitude == about_z(2.9):
            break
    assert 1.2 <= t <= 1.25
    assert track.state(t) == tracking.TRACKED


def test_poses_that_jump_about_are_never_believed():
    track = tracker()
    feed(track, [1.0])
    for k in range(1, 20):
        with pytest.raises(Rejected):
            track.receive(round(1e9 + k * 1e7), about_z(1.0 + 1.5 * (k % 2 + 1)), 1.0 + 0.01 * k)
    assert track.state(1.19) == tracking.TRACKED
    assert track.state(1.21) == tracking.JUMPING


@pytest.mark.parametrize(('pose', 'reason'), [
    ((0.0, 0.0, 0.0, 0.0), tracking.NOT_UNIT),
    ((0.0, 0.0, 0.1, 1.0), tracking.NOT_UNIT),
    ((math.nan, 0.0, 0.0, 1.0), Rejected.NOT_FINITE),
    ((0.0, 0.0, math.inf, 1.0), Rejected.NOT_FINITE),
])
def test_what_is_no_attitude_is_refused(pose, reason):
    track = tracker()
    with pytest.raises(Rejected, match=reason):
        track.receive(1, pose, 0.0)
    assert track.attitude is None


def test_an_old_pose_is_refused_but_not_after_a_silence():
    track = tracker()
    feed(track, [1.0, 1.1])
    with pytest.raises(Rejected, match=Rejected.OLD_STAMP):
        track.receive(1_050_000_000, about_z(1.05), 1.11)
    track.receive(5, about_z(0.2), 9.0)  # motion capture that was started anew
    assert track.state(9.0) == tracking.TRACKED
