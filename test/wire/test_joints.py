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

"""Joint states as bytes are those of everybody else."""

import contextlib
import math
import struct

import bags
from hypothesis import given
from hypothesis import strategies as st
import pytest
from tetra_ros2.formation._types import JointLimits
from tetra_ros2.formation.checks import Rejected
from tetra_ros2.wire import joints

FLOATS = st.floats(allow_nan=False)
NAMES = st.lists(st.text(st.characters(codec='utf-8', exclude_characters='\0'), max_size=9),
                 max_size=5)


@given(NAMES, st.integers(0, 2**31 * 10**9 - 2 * 10**9), st.data())
def test_what_is_written_is_read_here_and_elsewhere(names, stamp, data):
    numbers = data.draw(st.lists(FLOATS, min_size=3 * len(names), max_size=3 * len(names)))
    written = joints.joint_state('agent_1', names)(stamp, *numbers)
    n = len(names)
    expected = (stamp, tuple(names), tuple(numbers[:n]), tuple(numbers[n:2 * n]),
                tuple(numbers[2 * n:]))
    assert joints.decode(written) == expected
    there = bags.STORE.deserialize_cdr(written, bags.JOINTS)
    assert (tuple(there.name), tuple(there.effort)) == (expected[1], expected[4])
    assert joints.decode(bags.joint_state(stamp, *expected[1:])) == expected


@given(st.binary(max_size=200))
def test_bytes_of_any_kind_are_read_or_refused(tail):
    good = bags.joint_state(5, ('a', 'b'), (1.0, 2.0), (), (3.0, 4.0))
    for message in (tail, good[:len(tail)], good[:20] + tail, good[:-1]):
        with contextlib.suppress(Rejected):
            joints.decode(message)


@pytest.mark.parametrize('sequences', [((1.0,), (), ()), ((), (1.0, 2.0, 3.0), ())])
def test_more_or_less_numbers_than_joints_are_refused(sequences):
    with pytest.raises(Rejected, match=Rejected.MALFORMED):
        joints.decode(bags.joint_state(5, ('a', 'b'), *sequences))


def test_a_length_that_cannot_be_is_refused_at_once():
    message = bags.joint_state(5, (), (), (), ())
    with pytest.raises(Rejected):
        joints.decode(message[:28] + struct.pack('<I', 2**32 - 1) + message[32:])


def test_limits_go_through_the_diagnostics_as_texts():
    limits = {'tilt': JointLimits(-0.5, 0.75, 10.0, 1.0), 'wheel_x': JointLimits(torque=0.1),
              'free': JointLimits()}
    told = {k: f'{v:.6g}' for k, v in joints.limits_to_diagnostics(limits).items()}
    assert told['upper limit of tilt [rad]'] == '0.75'
    assert all(math.isfinite(float(v)) for v in told.values())
    del limits['free']  # of which there is nothing to tell
    assert joints.limits_from_diagnostics(told, ('tilt', 'wheel_x', 'free')) == limits
    assert joints.limits_from_diagnostics({'torque limit of tilt [N m]': 'much'}, ('tilt',)) == {}
