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

import numpy as np
import pytest
from tetra_ros2.formation import topology
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
