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
sensor_msgs/JointState as bytes: with a few joints of constant names, a message a step.

What the joints can do stands in no such message; the plant tells it in its diagnostics.
"""

from collections.abc import Callable, Mapping, Sequence
import math
import struct
from typing import NamedTuple

from tetra_ros2.formation._types import JointLimits
from tetra_ros2.formation.checks import Rejected
from tetra_ros2.wire import cdr

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


class JointState(NamedTuple):
    """
    What a sensor_msgs/JointState says; a sequence may be empty, and else has a number a joint.

    :param stamp: its time [ns]
    :param names: of the joints
    :param positions: [rad]
    :param velocities: [rad/s]
    :param efforts: [N m]
    """

    stamp: int
    names: tuple[str, ...]
    positions: tuple[float, ...]
    velocities: tuple[float, ...]
    efforts: tuple[float, ...]


def decode(message: bytes) -> JointState:
    """
    Return what a joint state says.

    :param message: bytes from anywhere, of either byte order
    :raises Rejected: if they are not such a message, or one with more or less numbers than joints
    """
    stamp = cdr.time(message)
    order = '<' if message[1] else '>'
    body = bytes(message[4:])  # alignment counts from here
    at = 8

    def count() -> int:
        nonlocal at
        at += -at % 4
        value: int = struct.unpack_from(f'{order}I', body, at)[0]
        at += 4
        if value > len(body) - at:  # each element takes a byte, and more
            raise Rejected(Rejected.MALFORMED)
        return value

    def text() -> str:
        nonlocal at
        size = count()
        at += size
        return body[at - size:at].rstrip(b'\0').decode()

    def numbers() -> tuple[float, ...]:
        nonlocal at
        length = count()
        if not length:
            return ()
        at += -at % 8
        values: tuple[float, ...] = struct.unpack_from(f'{order}{length}d', body, at)
        at += 8 * length
        return values

    try:
        text()  # the frame
        names = tuple(text() for _ in range(count()))
        sequences = numbers(), numbers(), numbers()
    except (struct.error, UnicodeDecodeError):
        raise Rejected(Rejected.MALFORMED) from None
    if any(len(values) not in (0, len(names)) for values in sequences):
        raise Rejected(Rejected.MALFORMED)
    return JointState(stamp, names, *sequences)


_KEYS = {'low': 'lower limit of {} [rad]', 'high': 'upper limit of {} [rad]',
         'speed': 'speed limit of {} [rad/s]', 'torque': 'torque limit of {} [N m]'}
"""What the figures are called in the diagnostics of the plant."""


def limits_to_diagnostics(limits: Mapping[str, JointLimits]) -> dict[str, float]:
    """
    Return the figures in which the plant's diagnostics tell what the joints can do.

    :param limits: by the joints' names
    """
    return {key.format(name): value for name, given in limits.items()
            for field, key in _KEYS.items()
            if math.isfinite(value := getattr(given, field))}


def limits_from_diagnostics(values: Mapping[str, str], joints: Sequence[str]
                            ) -> dict[str, JointLimits]:
    """
    Return what the joints can do, as far as the plant's diagnostics tell.

    :param values: figures by their names, as texts, from anybody
    :param joints: names of the joints
    """
    found = {}
    for name in joints:
        given = {}
        for field, key in _KEYS.items():
            try:
                value = float(values[key.format(name)])
            except (KeyError, ValueError):
                continue
            if math.isfinite(value):
                given[field] = value
        if given:
            found[name] = JointLimits(**given)
    return found
