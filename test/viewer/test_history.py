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

"""The recent past that the viewer keeps: half a minute, and nothing from before a new start."""

from hypothesis import given
from hypothesis import strategies as st
import numpy as np
import pytest
from tetra_ros2.formation import rotation, shapes, sphere
from tetra_ros2.viewer.history import History, PERIOD, SAMPLES, WINDOW
from tetra_ros2.viewer.scene import LONGEST_ARC, TRAIL, trail_segments

AXIS = np.array([0.0, 0.6, 0.8])
SECOND = 10**9


def turned(angle):
    return rotation.rotate(rotation.exp(angle * AXIS), shapes.TETRAHEDRON.points)


def filled(times, rate=0.5):
    past = History()
    for t in times:
        past.add(round(t * 1e9), turned(rate * t))
    return past


@pytest.mark.parametrize('step', [0.004, 0.01, 0.07, 1.25, 40.0])
def test_it_goes_back_half_a_minute_however_far_apart_states_are(step):
    past = filled(5.0 + np.arange(0.0, 70.0 + step, step))
    times, gamma = past.samples()
    assert WINDOW == 30.0
    assert times[-1] - times[0] <= WINDOW + PERIOD + 1e-6
    assert times[-1] - times[0] >= WINDOW - step - PERIOD
    assert len(times) <= SAMPLES + 2
    assert np.all(np.diff(times) > 0.0)
    assert np.all(np.diff(times)[:-1] >= PERIOD - 1e-6), 'thinned'
    np.testing.assert_allclose(gamma[-1], past.gamma)


def test_a_trail_reaches_back_as_far_as_it_is_asked_to():
    past = filled(np.arange(0.0, 20.0, 0.01))
    trail = past.trail(3.0)
    assert len(trail) == pytest.approx(3.0 / PERIOD, abs=2)
    np.testing.assert_allclose(trail[-1], turned(0.5 * 19.99), atol=1e-9)
    np.testing.assert_allclose(trail[0], turned(0.5 * 16.99), atol=0.5 * 2 * PERIOD)


def test_a_state_of_another_run_begins_a_new_history():
    past = filled(np.arange(0.0, 5.0, 0.01))
    past.add(SECOND, turned(0.0))  # time went back
    assert len(past.samples()[0]) == 1
    past.add(2 * SECOND, shapes.OCTAHEDRON.points)  # other agents
    assert past.samples()[1].shape == (1, 6, 3)
    assert past.started_at == 2 * SECOND


@pytest.mark.parametrize('fastest', [None, 6.0])
def test_a_reset_that_lets_time_go_on_begins_a_new_history(fastest):
    past = filled(np.arange(0.0, 5.0, 0.01))
    past.fastest = fastest
    past.add(round(5.01e9), turned(5.0))
    assert past.samples()[0].tolist() == [0.0]
    assert past.trail(3.0).shape == (1, 4, 3)


@given(st.floats(0.001, 2.0), st.floats(0.01, 6.0))
def test_motion_that_the_law_allows_is_never_taken_for_a_reset(step, rate):
    past = History()
    past.fastest = rate
    for k in range(30):
        past.add(round(k * step * 1e9), turned(rate * k * step))
    assert past.started_at == 0


def test_a_restart_forgets_everything():
    past = filled(np.arange(0.0, 5.0, 0.01))
    past.restart()
    assert past.samples()[0].shape == (0,)
    past.add(7 * SECOND, turned(1.0))
    assert past.started_at == 7 * SECOND


def test_what_would_be_kept_is_what_is_kept():
    past, reference = History(), History()
    for k in range(5000):
        stamp, gamma = k * 10**7 // 3, turned(k / 600.0)
        reference.add(stamp, gamma)
        if past.wants(stamp) or k == 4999:
            past.add(stamp, gamma)
    np.testing.assert_array_equal(past.samples()[0], reference.samples()[0])


@given(st.integers(1, 200))
def test_a_trail_is_drawn_on_the_sphere_with_no_chord_in_it(count):
    trail = np.stack([turned(0.1 * k) for k in range(count)]).astype(np.float32)
    if count > 20:
        trail[: count // 2] = sphere.normalize(trail[: count // 2] + 2.0)  # then it was reset
    segments = trail_segments(trail)
    assert segments.shape == (4 * TRAIL, 2, 3)
    np.testing.assert_allclose(np.linalg.norm(segments, axis=-1), 1.0, atol=1e-5)
    assert np.max(np.linalg.norm(segments[:, 1] - segments[:, 0], axis=-1)) <= LONGEST_ARC
    np.testing.assert_allclose(segments[-4:, 1], trail[-1], atol=1e-5)
