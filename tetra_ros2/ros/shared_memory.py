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
The shared memory of Fast DDS: what the dead have left in it, and whether there is enough.

A participant of Fast DDS makes a segment of half a megabyte with a random name, then a file of
the same name and ``_el`` that it locks as long as it lives. The system takes the lock back when
the process is gone, however it went; the segment stays until somebody removes it. Where no room
is left for a new one, the process that touches it is killed with SIGBUS.

Ports are left alone: their names are numbers, the next process with the same number takes them
over, and to remove one while that happens would split it in two. But not a torn one: a process
that is killed while it makes a port leaves a file without content, and whoever wants that number
next would wait for the content, for good and without a word.
"""

import fcntl
import os
from pathlib import Path
import re
import struct
import sys
import time

DIRECTORY = Path('/dev/shm')
"""Where Linux keeps shared memory."""

SETTLED = 5.0
"""
How old a segment must be to be removed [s].

Between the making of a segment and its lock there is a moment in which it looks dead.
"""

TORN = 2.0
"""How long to wait for a port that is being made before it is taken to be torn [s]."""

NEEDED = 16 << 20
"""How much must be free for a formation to use shared memory [bytes]: some twenty processes."""

_LOCK = re.compile('(fastrtps_[0-9a-f]{16})_el')
_SEGMENT = re.compile('fastrtps_[0-9a-f]{16}')
_PORT = re.compile('fastrtps_port[0-9]+')
_STATE = struct.Struct('<I')  # what boost::interprocess has in front of the content
_MADE = 2
_TRANSPORTS = 'FASTDDS_BUILTIN_TRANSPORTS'


def remove_dead(directory: Path = DIRECTORY, settled: float = SETTLED) -> int:
    """
    Remove the segments of this user's processes that have died.

    :param directory: where they are
    :param settled: how old they must be [s]
    :returns: how many bytes that set free
    """
    freed = 0
    for name in _names(directory):
        try:
            if _LOCK.fullmatch(name):
                freed += _remove_if_dead(directory, name, settled)
            elif _SEGMENT.fullmatch(name) and not (directory / f'{name}_el').exists():
                _remove_if_torn(directory / name, settled)
        except OSError:  # somebody else was quicker, or it is not ours to remove
            continue
    return freed


def remove_torn_ports(directory: Path = DIRECTORY, patience: float = TORN) -> int:
    """
    Remove the ports that this user's processes were killed in the making of.

    A port is made within a millisecond. One that is not made yet may be about to be, so that it
    is waited for.

    :param directory: where they are
    :param patience: how long to wait [s]
    :returns: how many were removed
    """
    removed = 0
    for name in _names(directory):
        if not _PORT.fullmatch(name):
            continue
        port = directory / name
        try:
            while _is_torn(port):
                if _remove_if_torn(port, patience):
                    removed += 1
                    break
                time.sleep(0.01)
        except OSError:  # gone, or not ours
            continue
    return removed


def _names(directory: Path) -> list[str]:
    try:
        return os.listdir(directory)
    except OSError:  # another system than Linux, or not allowed
        return []


def _is_torn(file: Path) -> bool:
    """
    Return whether a file of this user was not made to the end.

    :raises OSError: if it is gone, or cannot be read
    """
    descriptor = os.open(file, os.O_RDONLY | os.O_NOFOLLOW | os.O_CLOEXEC)
    try:
        if os.fstat(descriptor).st_uid != os.geteuid():
            return False
        state = os.read(descriptor, _STATE.size)
        return len(state) < _STATE.size or _STATE.unpack(state) != (_MADE,)
    finally:
        os.close(descriptor)


def _remove_if_torn(file: Path, settled: float) -> bool:
    """Remove a file that was not made to the end, and will not be; return whether it was one."""
    status = file.lstat()
    if not _is_torn(file) or time.time() - status.st_ctime < settled:
        return False
    file.unlink()
    return True


def _remove_if_dead(directory: Path, lock_name: str, settled: float) -> int:
    """Remove a segment whose lock nobody holds; return its size [bytes]."""
    # Not created if it is gone by now, and no link followed: this is a directory for everybody.
    descriptor = os.open(directory / lock_name, os.O_RDWR | os.O_NOFOLLOW | os.O_CLOEXEC)
    try:
        status = os.fstat(descriptor)
        if status.st_uid != os.geteuid() or time.time() - status.st_ctime < settled:
            return 0
        fcntl.flock(descriptor, fcntl.LOCK_EX | fcntl.LOCK_NB)
        # The lock is held while the segment goes: nobody takes it for a living one meanwhile.
        segment = directory / lock_name.removesuffix('_el')
        size = 0
        if segment.exists():
            size = segment.lstat().st_size
            segment.unlink()
        (directory / lock_name).unlink()
        return size
    finally:
        os.close(descriptor)


def prepare(directory: Path = DIRECTORY) -> None:
    """
    Remove what dead processes left, and have DDS do without shared memory where it is short.

    To be called before the first ROS context is made. The environment variable
    ``FASTDDS_BUILTIN_TRANSPORTS`` decides instead, if it is set.
    """
    remove_dead(directory)
    remove_torn_ports(directory)
    if _TRANSPORTS in os.environ:
        return
    try:
        state = os.statvfs(directory)
    except OSError:
        return
    free = state.f_bavail * state.f_frsize
    if free < NEEDED:
        os.environ[_TRANSPORTS] = 'UDPv4'
        print(f'tetra: warning: {directory} has {free / 2**20:.1f} MB free, less than '
              f'{NEEDED >> 20} MB: DDS does without shared memory; more room: docker run '
              '--shm-size=256m', file=sys.stderr)
