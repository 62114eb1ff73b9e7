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

"""The bytes of the hot path are those of rclpy, in both directions; nothing crashes the codec."""

import math
import struct

from builtin_interfaces.msg import Time
from geometry_msgs.msg import Pose, PoseArray, TwistStamped, Vector3Stamped
from hypothesis import given
from hypothesis import strategies as st
import pytest
from rclpy.serialization import deserialize_message, serialize_message
from rosgraph_msgs.msg import Clock
from std_msgs.msg import Float64MultiArray
from tetra_ros2.formation.checks import Rejected
from tetra_ros2.wire import cdr

numbers = st.floats(allow_nan=True, allow_infinity=True, width=64)
stamps = st.integers(0, (2**31 - 1) * 10**9 - 1)
frames = st.text(st.characters(codec='utf-8', exclude_characters='\0'), max_size=40)


def message_of(kind, frame, stamp, values):
    """Return a message object, made without the codec."""
    message = kind()
    message.header.frame_id = frame
    message.header.stamp = Time(sec=stamp // 1_000_000_000, nanosec=stamp % 1_000_000_000)
    if kind is Vector3Stamped:
        message.vector.x, message.vector.y, message.vector.z = values
    elif kind is TwistStamped:
        linear, angular = message.twist.linear, message.twist.angular
        linear.x, linear.y, linear.z, angular.x, angular.y, angular.z = values
    else:
        for k in range(0, len(values), 7):
            pose = Pose()
            p, q = pose.position, pose.orientation
            p.x, p.y, p.z, q.x, q.y, q.z, q.w = values[k:k + 7]
            message.poses.append(pose)
    return message


def numbers_of(message):
    """Return the numbers of a message object, in order."""
    if isinstance(message, Vector3Stamped):
        vectors = [message.vector]
    elif isinstance(message, TwistStamped):
        vectors = [message.twist.linear, message.twist.angular]
    else:
        return tuple(x for pose in message.poses for x in (
            pose.position.x, pose.position.y, pose.position.z, pose.orientation.x,
            pose.orientation.y, pose.orientation.z, pose.orientation.w))
    return tuple(x for v in vectors for x in (v.x, v.y, v.z))


def same(a, b):
    """Return whether numbers are the same, bit for bit but for the payload of a NaN."""
    return len(a) == len(b) and all(
        (x == y and math.copysign(1.0, x) == math.copysign(1.0, y))
        or (math.isnan(x) and math.isnan(y)) for x, y in zip(a, b, strict=True))


@st.composite
def messages(draw):
    """Draw a type, a codec for it, a frame, a stamp and numbers."""
    frame = draw(frames)
    kind, codec, count = draw(st.sampled_from([
        (Vector3Stamped, cdr.vector3_stamped, 3), (TwistStamped, cdr.twist_stamped, 6),
        (PoseArray, cdr.pose_array, 7), (PoseArray, cdr.pose_array, 28)]))
    make = codec if kind is not PoseArray else lambda f: codec(f, count // 7)
    values = draw(st.lists(numbers, min_size=count, max_size=count))
    return kind, make, frame, draw(stamps), values


def big_endian(frame, stamp, values, length=None):
    """Return a message as a big-endian machine would write it."""
    text = frame.encode() + b'\0'
    body = struct.pack('>iII', stamp // 1_000_000_000, stamp % 1_000_000_000, len(text)) + text
    if length is not None:
        body += bytes(-len(body) % 4) + struct.pack('>I', length)
    body += bytes(-len(body) % 8)
    return b'\0\0\0\0' + body + struct.pack(f'>{len(values)}d', *values)


@given(messages())
def test_rclpy_reads_what_the_codec_writes(case):
    kind, make, frame, stamp, values = case
    message = deserialize_message(make(frame).encode(stamp, *values), kind)
    assert message.header.frame_id == frame
    assert message.header.stamp.sec * 1_000_000_000 + message.header.stamp.nanosec == stamp
    assert same(numbers_of(message), values)


@given(messages())
def test_the_codec_reads_what_rclpy_writes(case):
    kind, make, frame, stamp, values = case
    decoded = make(frame).decode(serialize_message(message_of(kind, frame, stamp, values)))
    assert decoded[0] == stamp
    assert same(decoded[1], values)


@given(messages())
def test_the_codec_writes_as_many_bytes_as_rclpy(case):
    kind, make, frame, stamp, values = case
    assert len(make(frame).encode(stamp, *values)) == len(
        serialize_message(message_of(kind, frame, stamp, values)))


@given(messages())
def test_the_codec_reads_the_other_byte_order(case):
    kind, make, frame, stamp, values = case
    raw = big_endian(frame, stamp, values, len(values) // 7 if kind is PoseArray else None)
    assert same(numbers_of(deserialize_message(raw, kind)), values), 'rclpy agrees that it is one'
    decoded = make(frame).decode(raw)
    assert decoded[0] == stamp
    assert same(decoded[1], values)


@given(messages(), st.data())
def test_truncated_messages_are_malformed_wherever_they_are_cut(case, data):
    kind, make, frame, stamp, values = case
    raw = serialize_message(message_of(kind, frame, stamp, values))
    cut = data.draw(st.integers(0, len(raw) - 1))
    with pytest.raises(Rejected) as rejection:
        make(frame).decode(raw[:cut])
    assert str(rejection.value) in (Rejected.MALFORMED, Rejected.WRONG_FRAME)


@given(messages(), st.binary(min_size=1, max_size=64))
def test_bytes_after_the_end_change_nothing(case, tail):
    kind, make, frame, stamp, values = case
    raw = serialize_message(message_of(kind, frame, stamp, values))
    decoded = make(frame).decode(raw + tail)
    assert decoded[0] == stamp
    assert same(decoded[1], values)


@given(st.binary(max_size=120))
def test_arbitrary_bytes_are_decoded_as_rclpy_would_or_rejected(raw):
    try:
        _, values = cdr.vector3_stamped('agent_1').decode(raw)
    except Rejected:
        return
    message = deserialize_message(raw, Vector3Stamped)
    assert same(numbers_of(message), values)
    assert message.header.frame_id == 'agent_1'


@given(messages(), st.data())
def test_a_flipped_byte_never_crashes_the_codec(case, data):
    kind, make, frame, stamp, values = case
    raw = bytearray(serialize_message(message_of(kind, frame, stamp, values)))
    at = data.draw(st.integers(0, len(raw) - 1))
    raw[at] ^= data.draw(st.integers(1, 255))
    try:
        _, decoded = make(frame).decode(bytes(raw))
    except Rejected:
        return
    assert len(decoded) == len(values)


@given(messages(), frames)
def test_a_message_of_another_frame_is_not_taken(case, other):
    kind, make, frame, stamp, values = case
    raw = serialize_message(message_of(kind, frame, stamp, values))
    if other != frame and frame:
        with pytest.raises(Rejected, match=Rejected.WRONG_FRAME):
            make(other).decode(raw)


def test_a_state_of_another_number_of_agents_is_malformed():
    raw = serialize_message(message_of(PoseArray, 'world', 1, [0.0] * 21))
    for n in (2, 4):
        with pytest.raises(Rejected, match=Rejected.MALFORMED):
            cdr.pose_array('world', n).decode(raw)


@given(st.lists(numbers, min_size=6, max_size=6))
def test_only_the_last_numbers_of_a_template_change(values):
    template = Float64MultiArray(data=[0.0] * 6)
    encode = cdr.trailing_numbers(serialize_message(template), 6)
    message = deserialize_message(encode(*values), Float64MultiArray)
    assert same(tuple(message.data), values)
    assert message.layout == template.layout


@given(stamps)
def test_the_time_of_a_clock_is_read_as_rclpy_writes_it(stamp):
    clock = Clock(clock=Time(sec=stamp // 1_000_000_000, nanosec=stamp % 1_000_000_000))
    message = serialize_message(clock)
    assert cdr.time(message) == stamp
    assert cdr.head(stamp) == message
    assert cdr.time(b'\0\0\0\0' + struct.pack('>iI', *divmod(stamp, 1_000_000_000))) == stamp


@given(st.binary(max_size=11))
def test_a_clock_that_is_too_short_is_malformed(message):
    with pytest.raises(Rejected, match=Rejected.MALFORMED):
        cdr.time(message)


@pytest.mark.parametrize(('seconds', 'nanoseconds'), [
    (0, 10**9), (5, 4_000_000_000), (2**31 - 1, 0), (-1, 0), (-2**31, 999_999_999)])
@pytest.mark.parametrize('tail', [b'', b'\0'], ids=['usual', 'longer'])
def test_a_stamp_that_no_clock_can_give_is_refused(seconds, nanoseconds, tail):
    codec = cdr.vector3_stamped('agent_1')
    raw = bytearray(codec.encode(0, 1.0, 0.0, 0.0))
    raw[4:12] = struct.pack('<iI', seconds, nanoseconds)
    with pytest.raises(Rejected, match=Rejected.IMPOSSIBLE_STAMP):
        codec.decode(bytes(raw) + tail)
    with pytest.raises(Rejected, match=Rejected.IMPOSSIBLE_STAMP):
        cdr.time(bytes(raw[:12]))


@given(st.sampled_from([cdr.vector3_stamped, cdr.twist_stamped]), stamps)
def test_a_message_without_a_frame_is_taken(make, stamp):
    raw = make('').encode(stamp, *range(6)[:3 if make is cdr.vector3_stamped else 6])
    assert make('agent_1').decode(raw)[0] == stamp
