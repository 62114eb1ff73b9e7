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

"""
The few messages of the hot path as bytes, without message objects in between.

rclpy publishes ``bytes`` as they are, and hands them out to ``raw`` subscriptions. All messages
here are a ``std_msgs/Header`` followed by numbers, so that one small codec does for them: common
data representation (CDR) as ROS 2 uses it, of either byte order. On the wire nothing changes.
"""

from collections.abc import Callable, Sequence
import struct

from tetra_ros2.formation.checks import Rejected

_LITTLE_ENDIAN = b'\x00\x01\x00\x00'
_ORDERS = {b'\x00\x00': '>', b'\x00\x01': '<'}
_NANOSECONDS = 1_000_000_000
_ENCAPSULATION, = struct.unpack('<I', _LITTLE_ENDIAN)
_LAST_SECOND = 2**31 - 1
"""Of what an int32 can say; who answers to it must be able to say something later."""

_HEAD = struct.Struct('<4siI')  # encapsulation, sec, nanosec


def head(stamp: int) -> bytes:
    """Return how a message of a time [ns] begins; rosgraph_msgs/Clock is no more than that."""
    return _HEAD.pack(_LITTLE_ENDIAN, *divmod(stamp, _NANOSECONDS))


def time(message: bytes) -> int:
    """
    Return the time [ns] at which a message begins, as rosgraph_msgs/Clock does.

    :param message: bytes from anywhere
    :raises Rejected: if they are too few
    """
    try:
        seconds, nanoseconds = struct.unpack_from(f'{_ORDERS[bytes(message[:2])]}iI', message, 4)
    except (KeyError, struct.error):
        raise Rejected(Rejected.MALFORMED) from None
    return _time_of(seconds, nanoseconds)


def _time_of(seconds: int, nanoseconds: int) -> int:
    """Return a time [ns], if a clock can give it and a little later can still be said."""
    if not (0 <= seconds < _LAST_SECOND and nanoseconds < _NANOSECONDS):
        raise Rejected(Rejected.IMPOSSIBLE_STAMP)
    return seconds * _NANOSECONDS + nanoseconds


class StampedNumbers:
    """
    A message type made of a header and float64 numbers, in one frame.

    :param frame_id: the frame that is written; it, or none at all, is accepted
    :param count: how many float64 follow the header
    :param length: value of the sequence length between the two, for types that have one
    """

    def __init__(self, frame_id: str, count: int, length: int | None = None) -> None:
        self.frame_id = frame_id
        self._count = count
        self._length = length
        self._frame = frame_id.encode() + b'\0'
        # The frame's length and text, the padding, the sequence length: the same in all messages.
        self._name = struct.pack(f'<I{len(self._frame)}s', len(self._frame), self._frame)
        between = self._name
        if length is not None:
            between += bytes(-len(between) % 4) + struct.pack('<I', length)
        self._between = between + bytes(-(_HEAD.size - 4 + len(between)) % 8)
        self._pack = struct.Struct(f'<4siI{len(self._between)}s{count}d').pack
        self._pack_rest = struct.Struct(f'<{_HEAD.size + len(self._between)}s{count}d').pack
        counted = '' if length is None else f'{len(between) - len(self._name) - 4}xI'
        # Seconds are read unsigned: those before 0 are then as large as those that are too large.
        self._whole = struct.Struct(
            f'<III{len(self._name)}s{counted}{len(self._between) - len(between)}x{count}d')

    def encode(self, stamp: int, *numbers: float) -> bytes:
        """
        Return the message as little-endian CDR.

        :param stamp: time since the epoch of whichever clock [ns], from 0
        :param numbers: as many float64 as the message has
        """
        return self._pack(_LITTLE_ENDIAN, stamp // _NANOSECONDS, stamp % _NANOSECONDS,
                          self._between, *numbers)

    def encoder(self, message_head: bytes) -> tuple[bytes, Callable[..., bytes]]:
        """
        Return what makes messages of one stamp: ``message = pack(prefix, *numbers)``.

        :param message_head: of their stamp, from :func:`head`
        :returns: prefix, pack
        """
        return message_head + self._between, self._pack_rest

    def decode(self, message: bytes) -> tuple[int, Sequence[float]]:
        """
        Return ``(stamp, numbers)``: time [ns] and a sequence of float64, finite or not.

        :param message: bytes from anywhere
        :raises Rejected: if they are not such a message, or it is of another frame
        """
        return self.decoder()(message)

    def decoder(self) -> Callable[[bytes], tuple[int, Sequence[float]]]:
        """Return :meth:`decode` as a function that has all at hand, for who calls it often."""
        size, unpack, name, length = self._whole.size, self._whole.unpack, self._name, self._length
        first = 4 if length is None else 5  # index of the first number that unpack gives
        decode_any = self._decode_any

        def decode(message: bytes) -> tuple[int, Sequence[float]]:
            # The padding is not looked at: its bytes are whatever the sender's memory held.
            if len(message) == size:
                fields = unpack(message)
                seconds, nanoseconds = fields[1], fields[2]
                if (fields[3] == name and seconds < _LAST_SECOND and nanoseconds < _NANOSECONDS
                        and fields[0] == _ENCAPSULATION
                        and (length is None or fields[4] == length)):
                    return seconds * _NANOSECONDS + nanoseconds, fields[first:]
            return decode_any(message)

        return decode

    def _layout(self, order: str, frame_size: int) -> struct.Struct:
        """Return the layout of what follows the encapsulation: stamp, frame, [length], numbers."""
        body = struct.Struct(f'{order}iII{frame_size}s').size  # alignment counts from here
        padding = ''
        if self._length is not None:
            padding, body = f'{-body % 4}xI', body + -body % 4 + 4
        return struct.Struct(f'{order}4xiII{frame_size}s{padding}{-body % 8}x{self._count}d')

    def _decode_any(self, message: bytes) -> tuple[int, Sequence[float]]:
        """Decode what does not have just the bytes that :meth:`encode` would have written."""
        try:
            order = _ORDERS[bytes(message[:2])]
            frame_size, = struct.unpack_from(f'{order}I', message, 12)
            frame = struct.unpack_from(f'{frame_size}s', message, 16)[0] \
                if frame_size <= len(message) else None
            if frame is None or not frame.endswith(b'\0'):
                raise Rejected(Rejected.MALFORMED)
            if frame != self._frame and frame != b'\0':
                found = frame[:-1][:60].decode(errors='replace')
                raise Rejected(f'{Rejected.WRONG_FRAME}: {found!r}, expected {self.frame_id!r}')
            seconds, nanoseconds, _, _, *numbers = self._layout(
                order, frame_size).unpack_from(message)
        except (KeyError, struct.error):
            raise Rejected(Rejected.MALFORMED) from None
        if self._length is not None and numbers.pop(0) != self._length:
            raise Rejected(Rejected.MALFORMED)
        return _time_of(seconds, nanoseconds), numbers


def vector3_stamped(frame_id: str) -> StampedNumbers:
    """Return the codec of geometry_msgs/Vector3Stamped: x y z."""
    return StampedNumbers(frame_id, 3)


def twist_stamped(frame_id: str) -> StampedNumbers:
    """Return the codec of geometry_msgs/TwistStamped: linear x y z, angular x y z."""
    return StampedNumbers(frame_id, 6)


def pose_array(frame_id: str, n: int) -> StampedNumbers:
    """Return the codec of geometry_msgs/PoseArray: n times position x y z, quaternion x y z w."""
    return StampedNumbers(frame_id, 7 * n, length=n)


def sequence_length(message: bytes) -> int:
    """
    Return how many elements the sequence after the header of a message has.

    :param message: bytes of a header and a sequence, such as geometry_msgs/PoseArray
    :raises Rejected: if they are too few
    """
    length: int
    try:
        order = _ORDERS[bytes(message[:2])]
        frame_size, = struct.unpack_from(f'{order}I', message, 12)
        length, = struct.unpack_from(f'{order}I', message, 16 + frame_size + -frame_size % 4)
    except (KeyError, struct.error):
        raise Rejected(Rejected.MALFORMED) from None
    return length


def trailing_numbers(template: bytes, count: int) -> Callable[..., bytes]:
    """
    Return an encoder of messages that differ in their last numbers only.

    :param template: such a message as rclpy serialises it
    :param count: how many float64 it ends with
    :returns: a function from that many numbers to bytes
    """
    constant = template[:-8 * count]
    pack = struct.Struct(f'<{len(constant)}s{count}d').pack
    return lambda *numbers: pack(constant, *numbers)
