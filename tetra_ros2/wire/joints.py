# Copyright 2026 The tetra_ros2 authors
# SPDX-License-Identifier: Apache-2.0

"""sensor_msgs/JointState as bytes: with a few joints of constant names, a message a step."""

from collections.abc import Callable, Sequence
import struct

_ENCAPSULATION = b'\x00\x01\x00\x00'


def joint_state(frame_id: str, names: Sequence[str]) -> Callable[..., bytes]:
    """
    Return an encoder of joint states.

    :param frame_id: of the header
    :param names: of the joints
    :returns: a function of the stamp [ns] and then all positions, velocities and efforts
    """
    body = bytearray(8)  # the stamp; alignment counts from here

    def align(size: int) -> None:
        body.extend(bytes(-len(body) % size))

    def string(text: str) -> None:
        encoded = text.encode() + b'\0'
        align(4)
        body.extend(struct.pack('<I', len(encoded)) + encoded)

    string(frame_id)
    align(4)
    body.extend(struct.pack('<I', len(names)))
    for name in names:
        string(name)
    places = []
    for _ in range(3):
        align(4)
        body.extend(struct.pack('<I', len(names)))
        if names:
            align(8)
        places.append(len(body))
        body.extend(bytes(8 * len(names)))
    layout, end = '<', 0
    for place in places:
        layout += f'{place - end}s{len(names)}d'
        end = place + 8 * len(names)
    pack = struct.Struct(layout).pack
    first, second, third = (
        bytes(body[begin:place]) for begin, place in
        zip((0, *(p + 8 * len(names) for p in places)), places))
    count = len(names)

    def encode(stamp: int, *numbers: float) -> bytes:
        seconds, nanoseconds = divmod(stamp, 1_000_000_000)
        head = struct.pack('<iI', seconds, nanoseconds) + first[8:]
        return _ENCAPSULATION + pack(
            head, *numbers[:count], second, *numbers[count:2 * count], third,
            *numbers[2 * count:])

    return encode
