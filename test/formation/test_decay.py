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

"""The rate at which a motion approaches its shape, read off motions whose rate is known."""

import math

from hypothesis import given
from hypothesis import strategies as st
import numpy as np
import pytest
from tetra_ros2.formation import Cosine, Formation, measures, rotating, shapes, sphere
from tetra_ros2.formation.decay import decay_rate

LIMIT = shapes.TETRAHEDRON.points
MODES = 5
RNG = np.random.default_rng(5)
WAYS = RNG.standard_normal((3, 4, 3))
"""Directions in which to leave the limit."""


def motion(times, *modes):
    """Return what approaches the limit as ``sum size * exp(-rate t)``, each its own way."""
    away = sum(size * np.exp(-rate * times)[:, None, None] * way
               for (size, rate), way in zip(modes, WAYS))
    return sphere.normalize(LIMIT + away)


def deviation(gamma):
    return np.max(np.abs(
        measures.pairwise_cosines(gamma) - measures.pairwise_cosines(LIMIT)), axis=-1)


@given(st.floats(0.05, 20.0), st.integers(60, 300))
def test_the_rate_of_a_single_mode_is_read_off(rate, count):
    times = np.linspace(0.0, 7.0 / rate, count)
    gamma = motion(times, (3e-4, rate))
    assert decay_rate(gamma, times[1], LIMIT) == pytest.approx(rate, rel=1e-3)
    assert decay_rate(gamma, 5.0 + times, LIMIT) == pytest.approx(rate, rel=1e-3)


@given(st.floats(0.1, 2.0), st.floats(1.5, 4.0))
def test_of_two_modes_it_is_the_slower_one(rate, faster):
    times = np.linspace(0.0, 7.0 / rate, 200)
    gamma = motion(times, (1e-4, rate), (2e-4, faster * rate))
    assert decay_rate(gamma, times, LIMIT) == pytest.approx(rate, rel=1e-2)


@pytest.mark.parametrize('seed', range(5))
def test_samples_need_not_be_even(seed):
    rng = np.random.default_rng(seed)
    times = 0.02 * (np.arange(400) + rng.uniform(-0.4, 0.4, 400))
    assert decay_rate(motion(times, (3e-4, 1.0)), times, LIMIT) == pytest.approx(1.0, rel=0.02)


@pytest.mark.parametrize('seed', range(4))
def test_it_is_the_same_whichever_of_the_samples_are_seen(seed):
    run = Formation(rotating(), Cosine(1.0)).simulate(seed=seed, duration=30.0, rate=100.0)
    times, gamma, limit = run.times[:1000], run.reduced_attitudes[:1000], run.reduced_attitudes[-1]
    picked = np.cumsum(np.random.default_rng(seed).choice([3, 3, 3, 4, 6, 12], size=300))
    picked = picked[picked < 1000]  # as a viewer on a busy machine takes them
    every = decay_rate(gamma, times, limit)
    some = decay_rate(gamma[picked], times[picked], limit)
    assert some == pytest.approx(every, rel=5e-3)


def test_what_is_too_far_away_or_lost_in_rounding_is_left_out():
    times = np.linspace(0.0, 30.0, 900)
    gamma = motion(times, (3e-4, 1.0))
    small = deviation(gamma) < 1e-8
    gamma[small] = sphere.normalize(LIMIT + 1e-9 * RNG.standard_normal((np.sum(small), 4, 3)))
    far = times < 2.0
    gamma[far] = sphere.normalize(LIMIT + 3e-2 * RNG.standard_normal((np.sum(far), 4, 3)))
    assert decay_rate(gamma, times, LIMIT) == pytest.approx(1.0, rel=0.02)


@pytest.mark.parametrize(('count', 'enough'), [(4 * MODES, True), (4 * MODES - 1, False)])
def test_it_takes_four_samples_for_each_mode(count, enough):
    times = np.linspace(0.0, 5.0, count)
    found = decay_rate(motion(times, (1e-4, 1.0)), times, LIMIT)
    assert math.isnan(found) is not enough


@pytest.mark.parametrize(('factor', 'seen'), [(0.09, True), (0.11, False)])
def test_it_takes_a_decay_by_a_factor_of_ten(factor, seen):
    times = np.linspace(0.0, 1.0, 200)
    found = decay_rate(motion(times, (1e-4, -math.log(factor))), times, LIMIT)
    assert math.isnan(found) is not seen


def test_before_a_hole_nobody_knows_what_happened():
    times = np.concatenate([np.linspace(0.0, 2.0, 100), np.linspace(3.0, 11.0, 400)])
    gamma = motion(times, (3e-4, 1.0))
    gamma[:100] = motion(times[:100], (3e-4, 0.2))
    assert decay_rate(gamma, times, LIMIT) == pytest.approx(1.0, rel=1e-2)


def test_what_grows_or_only_jitters_has_no_rate():
    times = np.linspace(0.0, 5.0, 200)
    assert math.isnan(decay_rate(motion(times, (1e-6, -1.0)), times, LIMIT))
    jitter = sphere.normalize(LIMIT + 1e-5 * RNG.standard_normal((200, 4, 3)))
    jitter[-1] = motion(times[-1:], (1e-4, 1.0))
    assert math.isnan(decay_rate(jitter, times, LIMIT))
