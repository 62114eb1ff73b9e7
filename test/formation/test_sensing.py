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

"""Sensors with noise, delay and loss; by themselves, and in the plant's hands."""

from hypothesis import given
from hypothesis import strategies as st
import numpy as np
import pytest
from tetra_ros2.formation import Formation, rotation, topology
from tetra_ros2.formation.bodies import RigidBodies
from tetra_ros2.formation.gain import Cosine
from tetra_ros2.formation.sensing import delay_in_steps, Sensors
from tetra_ros2.formation.simulation import SampledLoop
from tetra_ros2.launcher import Launcher

AXES = [(1.0, 0.0, 0.0)] * 4
OTHERS = [[1, 2, 3], [0, 2, 3], [0, 1, 3], None]


def bodies(seed=0):
    return RigidBodies(rotation.random(np.random.default_rng(seed), (4,)), AXES)


def test_perfect_sensors_see_what_is_there():
    there = bodies()
    sensors = Sensors(there.seen_by, OTHERS)
    sensors.sample(1)
    assert sensors.seen_by(1, OTHERS[1]) == there.seen_by(1, OTHERS[1])


def test_noise_has_the_deviation_that_was_asked_for_and_keeps_unit_length():
    there = bodies()
    sensors = Sensors(there.seen_by, OTHERS, noise=0.01, seed=1)
    exact = np.array(there.seen_by(0, OTHERS[0]))
    off = []
    for stamp in range(4000):
        sensors.sample(stamp)
        seen = np.array(sensors.seen_by(0, OTHERS[0]))
        assert np.linalg.norm(seen, axis=1) == pytest.approx(1.0, abs=1e-12)
        off.append(np.linalg.norm(seen - exact, axis=1))
    # Two components across the line of sight, each of that deviation.
    assert np.sqrt(np.mean(np.square(off)) / 2.0) == pytest.approx(0.01, rel=0.03)


def test_delay_hands_out_what_was_seen_before():
    there = bodies()
    sensors = Sensors(there.seen_by, OTHERS, delay=2)
    history = []
    for stamp in range(6):
        sensors.sample(stamp)
        history.append(there.seen_by(0, OTHERS[0]))
        assert sensors.seen_by(0, OTHERS[0]) == history[max(0, stamp - 2)]
        there.step(0.1, [(0.0, 0.3, 0.1)] * 4)


def test_a_lost_measurement_is_the_one_before_it():
    there = bodies()
    sensors = Sensors(there.seen_by, OTHERS, loss=0.3, seed=2)
    sensors.sample(0)
    lost = 0
    for stamp in range(1, 1001):
        before = sensors.seen_by(0, OTHERS[0])
        there.step(0.01, [(0.0, 0.3, 0.1), (0.1, 0.0, 0.0), (0.0, 0.0, 0.2), (0.3, 0.0, 0.0)])
        sensors.sample(stamp)
        for old, new, exact in zip(before, sensors.seen_by(0, OTHERS[0]),
                                   there.seen_by(0, OTHERS[0])):
            assert new in (old, exact)
            lost += new == old
    assert lost / 3000.0 == pytest.approx(0.3, abs=0.03)


def test_a_repetition_is_no_new_measurement():
    sensors = Sensors(bodies().seen_by, OTHERS, noise=0.1)
    sensors.sample(5)
    first = sensors.seen_by(0, OTHERS[0])
    sensors.sample(5)
    assert sensors.seen_by(0, OTHERS[0]) == first
    sensors.sample(6)
    assert sensors.seen_by(0, OTHERS[0]) != first


@pytest.mark.parametrize(('delay', 'steps'), [(0.0, 0), (0.01, 1), (0.03, 3), (0.0301, 4),
                                              (0.0300001, 4), (0.1 + 0.2, 30), (1.0, 100)])
def test_a_delay_is_rounded_up_to_whole_steps(delay, steps):
    assert delay_in_steps(delay, 0.01) == steps


def test_imperfect_plant_in_lockstep_equals_the_loop_without_a_network_to_the_last_bit():
    with Launcher('rotating', seed=5, parameters={
            'plant:measurement_noise': 0.01, 'plant:measurement_delay': 0.035,
            'plant:measurement_loss': 0.2}) as formation:
        formation.run_for(3.0)
        attitudes = formation.attitudes
    loop = SampledLoop(rotation.random(np.random.default_rng(5), (4,)), AXES,
                       topology.rotating(), Cosine(), noise=0.01, delay=4, loss=0.2, seed=5)
    loop.advance(0.01, 300)
    assert np.array_equal(attitudes, loop.bodies.attitudes)
    run = Formation(topology.rotating(), Cosine()).simulate(
        seed=5, duration=3.0, noise=0.01, delay=0.035, loss=0.2)
    assert np.array_equal(attitudes, run.attitudes[-1])


@given(st.integers(0, 1000), st.integers(1, 4000))
def test_a_delay_of_whole_periods_is_so_many_steps(steps, rate):
    period = 1.0 / rate
    assert delay_in_steps(steps * period, period) == steps
    assert delay_in_steps(steps / rate, period) == steps
    assert delay_in_steps((steps + 0.01) * period, period) == steps + 1
