# Copyright 2026 The tetra_ros2 authors
# SPDX-License-Identifier: Apache-2.0

"""
The few messages of the hot path as bytes, without message objects in between.

rclpy publishes ``bytes`` as they are, and hands them out to ``raw`` subscriptions. All messages
here are a ``std_msgs/Header`` followed by numbers, so that one small codec does for them: common
data representation (CDR) as ROS 2 uses it, of either byte order. On the wire nothing changes.
"""

import struct

from tetra_ros2.formation.checks import Rejected

_LITTLE_ENDIAN = b'\x00\x01\x00\x00'
_ORDERS = {b'\x00\x00': '>', b'\x00\x01': '<'}
_NANOSECONDS = 1_000_000_000


class StampedNumbers:
    """
    A message type made of a header and float64 numbers, in one frame.

    :param frame_id: the only frame that is written and accepted
    :param count: how many float64 follow the header
    :param length: value of the sequence length between the two, for types that have one
    """

    def __init__(self, frame_id, count, length=None):
        self.frame_id = frame_id
        self._count = count
        self._length = length
        self._frame = frame_id.encode() + b'\0'
        layout = self._layout('<', len(self._frame))
        self._size = layout.size
        self._unpack = layout.unpack
        self._pack = layout.pack
        # Everything between the stamp and the numbers, as pack takes it and as unpack gives it.
        self._between = (len(self._frame), self._frame, *(() if length is None else (length,)))
        self._numbers = slice(3 + len(self._between), None)
        self._constants = slice(3, 3 + len(self._between))

    def _layout(self, order, frame_size):
        """Return the layout: encapsulation, sec, nanosec, frame, [length], numbers."""
        body = struct.Struct(f'{order}iII{frame_size}s').size  # alignment counts from here
        padding = ''
        if self._length is not None:
            padding, body = f'{-body % 4}xI', body + -body % 4 + 4
        return struct.Struct(f'{order}4siII{frame_size}s{padding}{-body % 8}x{self._count}d')

    def encode(self, stamp, *numbers):
        """
        Return the message as little-endian CDR.

        :param stamp: time since the epoch of whichever clock [ns], from 0
        :param numbers: as many float64 as the message has
        """
        seconds, nanoseconds = divmod(stamp, _NANOSECONDS)
        return self._pack(_LITTLE_ENDIAN, seconds, nanoseconds, *self._between, *numbers)

    def decode(self, message):
        """
        Return ``(stamp, numbers)``: time [ns] and a tuple of float64, finite or not.

        :param message: bytes from anywhere
        :raises Rejected: if they are not such a message, or it is of another frame
        """
        if len(message) == self._size:
            fields = self._unpack(message)
            if fields[0] == _LITTLE_ENDIAN and fields[self._constants] == self._between:
                return fields[1] * _NANOSECONDS + fields[2], fields[self._numbers]
        return self._decode_any(message)

    def _decode_any(self, message):
        """Decode what does not have just the bytes that :meth:`encode` would have written."""
        try:
            order = _ORDERS[bytes(message[:2])]
            frame_size, = struct.unpack_from(f'{order}I', message, 12)
            frame = struct.unpack_from(f'{frame_size}s', message, 16)[0] \
                if frame_size <= len(message) else None
            if frame is None or not frame.endswith(b'\0'):
                raise Rejected(Rejected.MALFORMED)
            if frame != self._frame:
                raise Rejected(Rejected.WRONG_FRAME)
            fields = self._layout(order, frame_size).unpack_from(message)
        except (KeyError, struct.error):
            raise Rejected(Rejected.MALFORMED) from None
        if fields[self._constants] != self._between:
            raise Rejected(Rejected.MALFORMED)
        return fields[1] * _NANOSECONDS + fields[2], fields[self._numbers]


def vector3_stamped(frame_id):
    """Return the codec of geometry_msgs/Vector3Stamped: x y z."""
    return StampedNumbers(frame_id, 3)


def twist_stamped(frame_id):
    """Return the codec of geometry_msgs/TwistStamped: linear x y z, angular x y z."""
    return StampedNumbers(frame_id, 6)


def pose_array(frame_id, n):
    """Return the codec of geometry_msgs/PoseArray: n times position x y z, quaternion x y z w."""
    return StampedNumbers(frame_id, 7 * n, length=n)


def trailing_numbers(template, count):
    """
    Return an encoder of messages that differ in their last numbers only.

    :param template: such a message as rclpy serialises it
    :param count: how many float64 it ends with
    :returns: a function from that many numbers to bytes
    """
    constant = template[:-8 * count]
    pack = struct.Struct(f'<{len(constant)}s{count}d').pack
    return lambda *numbers: pack(constant, *numbers)
