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

"""The pan-tilt gimbal: what its joints do is what the body was told, and no more than allowed."""

import math

from hypothesis import given
from hypothesis import strategies as st
import numpy as np
from tetra_ros2.formation import gimbal, rotation, sphere

ANGLE = st.floats(-3.0, 3.0)
RATE = st.floats(-5.0, 5.0)


@given(ANGLE, st.floats(-1.5, 1.5), RATE, RATE)
def test_the_joints_move_the_pointing_axis_as_the_body_was_told(pan, tilt, y, z):
    pan_rate, tilt_rate = gimbal.joint_rates(y, z, tilt)
    h = 1e-6
    before = rotation.rotate(np.array(gimbal.attitude(pan, tilt)), [1.0, 0.0, 0.0])
    after = rotation.rotate(
        np.array(gimbal.attitude(pan + h * pan_rate, tilt + h * tilt_rate)), [1.0, 0.0, 0.0])
    velocity = rotation.rotate(np.array(gimbal.attitude(pan, tilt)), [0.0, z, -y])
    assert np.max(np.abs((after - before) / h - velocity)) < 2e-3


@given(ANGLE, st.floats(-1.5, 1.5), RATE, RATE)
def test_the_rates_of_the_body_follow_from_those_of_the_joints(pan, tilt, pan_rate, tilt_rate):
    h = 1e-6
    before = np.array(gimbal.attitude(pan, tilt))
    after = np.array(gimbal.attitude(pan + h * pan_rate, tilt + h * tilt_rate))
    measured = rotation.log(rotation.multiply(rotation.inverse(before), after)) / h
    assert np.max(np.abs(measured - gimbal.body_rates(pan_rate, tilt_rate, tilt))) < 1e-4


@given(st.integers(0, 10**6))
def test_without_limits_every_direction_can_be_pointed_along(seed):
    direction = sphere.random(np.random.default_rng(seed))
    pan, tilt = gimbal.angles(direction.tolist())
    assert abs(pan) <= 0.5 * math.pi, 'the smallest that will do'
    assert abs(tilt) <= math.pi
    pointed = rotation.rotate(np.array(gimbal.attitude(pan, tilt)), [1.0, 0.0, 0.0])
    assert np.max(np.abs(pointed - direction)) < 1e-12


@given(st.integers(0, 10**6))
def test_limits_are_kept_or_the_direction_is_refused(seed):
    direction = sphere.random(np.random.default_rng(seed))
    pan_limits, tilt_limits = (-1.0, 4.0), (-0.5, 2.0)
    found = gimbal.angles(direction.tolist(), pan_limits, tilt_limits)
    grid = [(p, t) for p in np.linspace(*pan_limits, 101) for t in np.linspace(*tilt_limits, 51)]
    nearest = max(float(rotation.rotate(np.array(gimbal.attitude(*a)), [1.0, 0.0, 0.0])
                        @ direction) for a in grid[::7]) if found is None else 1.0
    if found is None:
        assert nearest < 1.0 - 1e-9
    else:
        assert -1.0 <= found[0] <= 4.0
        assert -0.5 <= found[1] <= 2.0
        pointed = rotation.rotate(np.array(gimbal.attitude(*found)), [1.0, 0.0, 0.0])
        assert np.max(np.abs(pointed - direction)) < 1e-12


def test_near_the_pan_axis_the_pan_joint_is_spared():
    pan_rate, _ = gimbal.joint_rates(0.0, 1.0, 0.5 * math.pi)
    assert abs(pan_rate) < 1e-9
    assert max(abs(gimbal.joint_rates(0.0, 1.0, t)[0]) for t in np.linspace(0, 3, 1000)) \
        <= 1.0 / gimbal.DAMPING
