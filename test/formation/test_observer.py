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
import numpy as np
import pytest
from strategies import tangents
from tetra_ros2.formation import rotation, sphere, topology
from tetra_ros2.formation.checks import Rejected
from tetra_ros2.formation.gain import Cosine
from tetra_ros2.formation.observer import Observer
from tetra_ros2.formation.summary import summarize
from tetra_ros2.formation.topology import Topology

REST = (0.0, 0.0, 0.0, 1.0)
UNKNOWN = Topology('custom', np.array([[0.0, 1.0], [0.0, 0.0]]))
SECOND = 1_000_000_000


def apart(*angles):
    """Return poses of axes at these angles in one plane."""
    return [x for angle in angles for x in (math.cos(angle), math.sin(angle), 0.0, *REST)]


def tetrahedron(turned):
    """Return poses of a regular tetrahedron that has turned about its first axis."""
    s, c = 2.0 * math.sqrt(2.0) / 3.0, -1.0 / 3.0
    poses = [0.0, 0.0, 1.0, *REST]
    for k in range(3):
        angle = turned + 2.0 * math.pi * k / 3.0
        poses += [s * math.cos(angle), s * math.sin(angle), c, *REST]
    return poses


def test_what_has_no_known_shape_has_formed_when_it_changes_slowly_for_its_law():
    observer = Observer(UNKNOWN, 0.01, fastest=5.0)
    assert observer.shape is None
    angle = 1.0
    observer.observe(SECOND, apart(0.0, angle))
    assert observer.formed_at is None, 'nobody knows yet how fast it changes'
    for k, (change, formed) in enumerate([(0.06, False), (0.04, True), (0.06, False)], 2):
        angle += change
        observer.observe(k * SECOND, apart(0.0, angle))
        assert observer.error == pytest.approx(change)
        assert (observer.formed_at is not None) == formed, 'the limit is 0.01 * 5 rad/s'
    observer.fastest = 10.0
    observer.observe(5 * SECOND, apart(0.0, angle + 0.06))
    assert observer.formed_at is not None, 'the limit is 0.01 * 10 rad/s'


def test_an_error_as_large_as_the_tolerance_is_not_below_it():
    observer = Observer(topology.complete(4), 1.0)
    observer.observe(SECOND, tetrahedron(0.0)[:21] + apart(0.0))
    observer.tolerance = observer.error
    observer.observe(2 * SECOND, tetrahedron(0.0)[:21] + apart(0.0))
    assert observer.formed_at is None
    observer.tolerance = math.nextafter(observer.error, 4.0)
    observer.observe(3 * SECOND, tetrahedron(0.0)[:21] + apart(0.0))
    assert observer.formed_at == 3 * SECOND


@pytest.mark.parametrize('rate', [3e-7, 1e-4, 0.5])
def test_a_slow_spin_is_a_spin(rate):
    observer = Observer(topology.rotating(), 1e-3)
    for k in (1, 2):
        observer.observe(k * SECOND, tetrahedron(k * rate))
    summary = summarize(observer, topology.rotating(), Cosine())
    assert summary.measured.rate == pytest.approx(rate, rel=1e-6)
    assert summary.measured.period == pytest.approx(2.0 * math.pi / rate, rel=1e-6)
    assert summary.measured.sense == 1


def test_rounding_is_no_spin():
    observer = Observer(topology.rotating(), 1e-3)
    for k in (1, 2):
        observer.observe(k * SECOND, tetrahedron(k * 1e-12))
    measured = summarize(observer, topology.rotating(), Cosine()).measured
    assert measured.period == math.inf
    assert measured.sense == 0


def poses(gamma):
    return [x for direction in gamma for x in [*direction, *REST]]


@given(st.integers(0, 3), tangents(), st.floats(0.05, 2.0), st.floats(0.05, 0.4),
       st.sampled_from([1.0 - 1e-6, 1.0 + 1e-6]))
def test_a_body_that_moved_farther_than_the_law_can_take_it_was_placed_anew(
        who, way, fastest, elapsed, share):
    point, step = way
    if not np.linalg.norm(step) > 1e-6:
        step = np.cross(point, np.eye(3)[np.argmin(np.abs(point))])
    allowed = 2.0 * fastest * elapsed + 0.02
    gamma = np.array([point] * 4)
    observer = Observer(topology.complete(4), 1e-3, fastest)
    observer.observe(SECOND, poses(gamma))
    gamma[who] = np.cos(share * allowed) * point + np.sin(share * allowed) * sphere.normalize(step)
    observer.observe(SECOND + round(elapsed * 1e9), poses(gamma))
    assert observer.restarts == int(share > 1.0)
    assert (observer.previous_stamp is None) == (share > 1.0)
    assert observer.started_at == (observer.stamp if share > 1.0 else SECOND)
    assert observer.first_stamp == SECOND


def test_after_a_while_a_body_may_be_anywhere():
    observer = Observer(topology.complete(4), 1e-3, 1.0)
    observer.observe(SECOND, tetrahedron(0.0))
    observer.observe(5 * SECOND, poses(-np.reshape(tetrahedron(0.0), (4, 7))[:, :3]))
    assert observer.restarts == 0


def test_a_sample_again_is_none_and_an_older_one_is_refused():
    observer = Observer(topology.complete(4), 1e-3)
    assert observer.observe(5, tetrahedron(0.0))
    assert not observer.observe(5, tetrahedron(1.0))
    with pytest.raises(Rejected, match=Rejected.OLD_STAMP):
        observer.observe(4, tetrahedron(0.0))
    with pytest.raises(Rejected, match=Rejected.NOT_UNIT):
        observer.observe(6, poses(1.01 * np.eye(3)[[0, 1, 2, 0]]))
    assert (observer.count, observer.stamp) == (1, 5)


def test_times_are_counted_from_the_first_sample_to_the_last_and_to_the_one_that_formed():
    observer = Observer(topology.complete(4), 1e-2, fastest=100.0)
    with pytest.raises(ValueError, match='nothing'):
        _ = observer.elapsed
    assert observer.time_to_form is None
    flat = apart(0.0, 1.0, 2.0, 3.0)
    observer.observe(10 * SECOND, flat)
    with pytest.raises(ValueError, match='less than two'):
        _ = observer.interval
    for k, sample in enumerate([flat, tetrahedron(0.0), flat, tetrahedron(0.0), tetrahedron(0.1)]):
        observer.observe((11 + k) * SECOND + k * k, sample)
    assert observer.elapsed == pytest.approx(5.0 + 16e-9, abs=1e-12)
    assert observer.interval == pytest.approx(1.0 + 7e-9, abs=1e-12)
    assert observer.time_to_form == pytest.approx(4.0 + 9e-9, abs=1e-12)


@given(st.lists(st.floats(-1.0, 1.0), min_size=3, max_size=3), st.floats(0.01, 0.5))
def test_what_is_seen_of_a_formation_is_what_it_is(rate, elapsed):
    axes = np.array([[1.0, 0.0, 0.0], [0.0, 0.6, 0.8], [0.48, 0.6, 0.64]])
    turns = rotation.exp(elapsed * np.array([[0.0] * 3, rate]))
    observer = Observer(topology.complete(3), 1e-3, 10.0)
    for k, turn in enumerate(turns):
        gamma = rotation.rotate(turn, axes)
        observer.observe(SECOND + round(k * elapsed * 1e9),
                         [x for point in gamma for x in [*point, *turn]])
    assert observer.angular_velocity == pytest.approx(np.array(rate), abs=1e-6)
    assert observer.reduced_attitudes == pytest.approx(rotation.rotate(turns[1], axes))
    assert observer.attitudes == pytest.approx(np.array([turns[1]] * 3))
    assert observer.cosines == pytest.approx([0.0, 0.48, 0.36 + 0.512])
