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
from strategies import any_gain, assert_close
from tetra_ros2.formation import batch, law, measures, rings, sphere, stability
from tetra_ros2.formation.gain import Cosine, Exponential

COUNTS = st.integers(2, 15)
SPIN = st.floats(-1.0, 1.0)


@given(COUNTS, SPIN, any_gain())
def test_the_shape_of_a_ring_turns_in_its_plane_as_predicted(n, spin, gain):
    points = rings.points(n)
    assert_close(np.linalg.norm(points, axis=1), 1.0, atol=1e-15)
    turning = [0.0, 0.0, rings.spin_rate(n, spin, gain)]
    assert_close(law.velocity(points, rings.weights(n, spin), gain), np.cross(turning, points),
                 atol=1e-13 * gain.f(0.0))


@given(COUNTS)
def test_neighbours_lie_as_far_apart_as_they_can(n):
    points = rings.points(n)
    assert_close(sphere.geodesic_distance(points, np.roll(points, -1, axis=0)),
                 rings.neighbor_angle(n), atol=1e-12)
    assert points[0].tolist() == [1.0, 0.0, 0.0], 'the first agent is at the end of the x axis'
    assert (rings.neighbor_angle(n) == math.pi) == (n % 2 == 0)
    if n % 2 == 0:
        assert len(np.unique(points, axis=0)) == 2


@given(COUNTS, SPIN, any_gain())
def test_the_slowest_rate_is_the_closed_form_and_nothing_grows(n, spin, gain):
    there = stability.transverse(rings.points(n), rings.weights(n, spin), gain)
    scale = float(np.max(np.abs(there.eigenvalues)))
    assert_close(-there.eigenvalues[0].real, rings.slowest_rate(n, gain),
                 atol=1e-7 * scale + 1e-300)


@pytest.mark.parametrize('n', range(2, 10))
@pytest.mark.parametrize('spin', [0.0, 0.6])
def test_random_starts_lead_to_the_shape_of_the_ring(n, spin):
    gain, weights = Exponential(), rings.weights(n, spin)
    start = sphere.random(np.random.default_rng(n), (8, n))
    formed, _ = batch.run(
        start, weights, gain, np.sort(measures.pairwise_angles(rings.points(n))), 0.02, 0.2,
        int(1000.0 * n), 1)
    assert np.all(formed != batch.NEVER)


def test_with_the_cosine_gain_an_even_ring_has_no_rate():
    assert rings.slowest_rate(6, Cosine()) == pytest.approx(0.0, abs=1e-15)
    assert rings.slowest_rate(6, Exponential()) > 0.02


@pytest.mark.parametrize('n, name', [
    (2, 'antipodal pair'), (3, 'triangle'), (5, '{5/2}'), (7, '{7/3}'), (8, 'clusters of 4')])
def test_the_shape_has_a_name(n, name):
    assert name in rings.name(n)
