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
The ports on which this process listens in shared memory, and what to do when others lose them.

A port of Fast DDS is a file in ``/dev/shm`` whose name is a number. Whoever sends opens the file
by that name. Fast DDS 2 can remove the name of a port in use. Who still sends to a process that
was killed makes a port of the dead one's number with every message, and removes it, and the mutex
that guards it, with the next. A process that starts meanwhile and takes the same number may be
left with a port that has no name any more. It hears nothing, for good, and nobody notices.

Fast DDS has a remedy of its own for ports that do not work. Whoever finds one clears a flag in it;
the process that listens sees that within a third of a second, and opens the port again by its
name. But it looks only whether processes stand still, not for names. That is done here.

It opens a port again, too, if somebody was killed who just then sent to it: the mutex of the port
is locked for good, and waiting for it ends after a second. A process that leaves meanwhile never
ends, or ends by a segmentation fault: Fast DDS tells the port that is taken away to close, not the
one that takes its place. So those who leave wait here until their ports are in order.
"""

from collections.abc import Iterator, Set
import errno
import os
from pathlib import Path
import platform
import re
import struct
import time
from typing import NamedTuple

from tetra_ros2.ros.shared_memory import DIRECTORY

_PROCESS = Path('/proc/self')
_LOCK = re.compile(f'{DIRECTORY}/(fastrtps_port[0-9]+)_el' r'(?: \(deleted\))?')
_MAPPING = re.compile(  # a line of /proc/self/maps: addresses, inode, name
    f'^([0-9a-f]+)-([0-9a-f]+) rw-s .* ([0-9]+) +{DIRECTORY}/(fastrtps_port[0-9]+)'
    r'(?: \(deleted\))?$', re.MULTILINE)

# What Fast DDS calls a PortNode, from the number on: number, how many listen, healthy_check_
# timeout_ms, port_wait_timeout_ms, capacity, how many wait, and three flags.
_HEAD = struct.Struct('<7I')
_BEFORE = 20  # bytes of it, which begins at a multiple of 8
_FLAGS = 24  # where the flags are, from the number on
_IS_OK, _IS_READ = 1, 4

# A mutex of the C library on 64 bits: whether it is locked, how often, by which thread, how many
# use it, and its kind.
_MUTEX = struct.Struct('<5i')
_SHARED = 128  # the kind of one that processes share
_MUTEX_SIZE = 48 if platform.machine() == 'aarch64' else 40
# From the number on, after an identifier of 8 bytes and semaphores for 512 who wait: that of the
# lists of who waits, and that of the port.
_MUTEXES = (_FLAGS + 4 + 8 + 512 * 40 + 16, _FLAGS + 4 + 8 + 512 * 40 + 16 + _MUTEX_SIZE)


class _Mapping(NamedTuple):
    """A port that this process has open, to listen or to send."""

    begin: int
    end: int
    inode: int


PATIENCE = 5.0
"""How long to wait for ports that are opened again [s]; Fast DDS takes two at most."""

_TAKEN_INTO_USE = 0.05
"""How long Fast DDS may take from opening a port again to listening on it [s]; microseconds."""

_TAKEN_AWAY = (errno.EIO, errno.EFAULT)
"""How reading memory fails that is not mapped any more."""

_MOST_LOOKS = 100
"""How often to look for one that is not listened on, as it is not while it is opened again."""

_found: dict[str, int] = {}
"""
The ports on which this process listens.

The inode of each that others can find, otherwise, below 0, how often that was looked at in vain.
"""


def reopen_lost(new: bool = False) -> list[str]:
    """
    Have Fast DDS open those ports again that others cannot find any more.

    It does so in a thread of its own, within a third of a second. Where all is well, and no port
    is new, this takes some microseconds.

    :param new: whether there may be ports that were not there at the last call
    :returns: the names of those that are opened again
    """
    global _found
    found: dict[str, int] = {}
    lost = []
    try:
        if (not new or set(_listened()) == _found.keys()) \
                and all(_inode(name) == inode for name, inode in _found.items()):
            return []
        mappings = _mappings()
        listened = set(_listened())
        for name in _found.keys() - listened:
            if (looks := max(0, -_found[name])) < _MOST_LOOKS:
                found[name] = -looks - 1
        for name in listened:
            there = _inode(name)
            heads = [(mapping, _head(name, mapping)) for mapping in mappings.get(name, ())]
            # One that is not recognised may be all right.
            if any(mapping.inode == there and (head is None or _hears(head[1]))
                   for mapping, head in heads):
                found[name] = there
                continue
            found[name] = -1
            for mapping, head in heads:
                if mapping.inode != there and head is not None and _hears(head[1]) \
                        and _declare_broken(*head):
                    lost.append(name)
    except OSError:  # closed meanwhile; or another system than Linux, or not allowed
        return lost
    _found = found
    return lost


def settle(patience: float = PATIENCE) -> bool:
    """
    Wait until the ports on which this process listens are in order, as whoever leaves has to.

    Where they are, this takes a few milliseconds.

    :param patience: how long to wait [s]
    :returns: whether they are
    """
    deadline = time.monotonic() + patience
    waited = False
    try:
        names = set(_listened())
        while not _in_order(names):
            if time.monotonic() > deadline:
                return False
            waited = True
            time.sleep(0.01)
            names.update(_listened())
    except OSError:  # another system than Linux, or not allowed
        return True
    if waited:
        time.sleep(_TAKEN_INTO_USE)
    return True


def _in_order(names: Set[str]) -> bool:
    """
    Return whether this process listens on these ports, and none is about to be opened again.

    One that is not recognised may be all right.

    :raises OSError: on another system than Linux, or where it is not allowed
    """
    if not names <= set(_listened()):  # one is opened again just now
        return False
    try:
        mappings = _mappings()
        for name in names:
            found = [(mapping, *head) for mapping in mappings.get(name, ())
                     if (head := _head(name, mapping)) is not None]
            if found and not any(_hears(head) and not _is_locked_by_dead(mapping, address)
                                 for mapping, address, head in found):
                return False
    except OSError as error:
        if error.errno not in _TAKEN_AWAY:
            raise
        return False
    return True


def _is_locked_by_dead(mapping: _Mapping, address: int) -> bool:
    """
    Return whether somebody has a mutex of a port who is not there any more.

    :param address: of the figures of its PortNode
    :raises OSError: if the port is not mapped any more
    """
    with (_PROCESS / 'mem').open('rb', buffering=0) as memory:
        for offset in _MUTEXES:
            at = address + offset
            content = os.pread(memory.fileno(), min(_MUTEX.size, max(0, mapping.end - at)), at)
            if len(content) == _MUTEX.size:
                locked, _, owner, _, kind = _MUTEX.unpack(content)
                if kind == _SHARED and locked and owner > 0 and not _lives(owner):
                    return True
    return False


def _lives(thread: int) -> bool:
    """Return whether a thread of any process is there, and has not ended."""
    try:
        status = Path(f'/proc/{thread}/stat').read_bytes()
    except OSError:
        return False
    return status[status.rindex(b')') + 2:][:1] not in b'ZX'


def _inode(name: str) -> int:
    """Return the inode to which the name of a port leads, 0 if to none."""
    try:
        return os.stat(DIRECTORY / name).st_ino
    except OSError:
        return 0


def _listened() -> Iterator[str]:
    """Give the names of the ports on which this process listens: it holds their locks."""
    for name in os.listdir(_PROCESS / 'fd'):
        try:
            link = os.readlink(_PROCESS / 'fd' / name)
        except OSError:  # closed meanwhile
            continue
        if match := _LOCK.fullmatch(link):
            yield match[1]


def _mappings() -> dict[str, list[_Mapping]]:
    """Return the ports that this process has open, by name; one name may have led to several."""
    mappings: dict[str, list[_Mapping]] = {}
    for begin, end, inode, name in _MAPPING.findall((_PROCESS / 'maps').read_text()):
        mappings.setdefault(name, []).append(_Mapping(int(begin, 16), int(end, 16), int(inode)))
    return mappings


def _head(name: str, mapping: _Mapping) -> tuple[int, tuple[int, ...]] | None:
    """
    Return the address and the figures of the PortNode in a port, or None.

    Nothing but its content tells where it is: its number is followed by what goes together.

    :raises OSError: if the port is not mapped any more
    """
    number = int(name.removeprefix('fastrtps_port'))
    # Not by way of a pointer: another thread may take the mapping away at any moment.
    with (_PROCESS / 'mem').open('rb', buffering=0) as memory:
        content = os.pread(memory.fileno(), mapping.end - mapping.begin, mapping.begin)
    key = struct.pack('<I', number)
    at = content.find(key)
    while at >= 0:
        if at >= _BEFORE and (at - _BEFORE) % 8 == 0 and at + _HEAD.size <= len(content):
            head = _HEAD.unpack_from(content, at)
            _, listeners, healthy, wait, capacity, waiting, _ = head
            if healthy and wait == healthy // 3 and capacity and waiting <= listeners < 1024:
                return mapping.begin + at, head
        at = content.find(key, at + 1)
    return None


def _hears(head: tuple[int, ...]) -> bool:
    """Return whether somebody listens on a port, and it is not about to be opened again."""
    _, listeners, _, _, _, _, flags = head
    return listeners > 0 and flags & (_IS_OK | _IS_READ) == _IS_OK | _IS_READ


def _declare_broken(address: int, head: tuple[int, ...]) -> bool:
    """
    Clear the flag of a port that says that it works; return whether it was still there.

    :raises OSError: if the port is not mapped any more
    """
    flags = bytes([head[-1] & 0xff & ~_IS_OK])
    with (_PROCESS / 'mem').open('r+b', buffering=0) as memory:
        # Fast DDS takes a port away only once it has seen that flag cleared: it is there now if
        # it is as it was.
        content = os.pread(memory.fileno(), _HEAD.size, address)
        if len(content) < _HEAD.size:
            return False
        now = _HEAD.unpack(content)
        if (now[0], *now[2:5], now[6]) != (head[0], *head[2:5], head[6]):
            return False
        os.pwrite(memory.fileno(), flags, address + _FLAGS)
    return True
