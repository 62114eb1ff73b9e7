# Copyright 2026 The tetra_ros2 authors
# SPDX-License-Identifier: Apache-2.0

"""
The shared memory of Fast DDS: what the dead have left in it, and whether there is enough.

A participant of Fast DDS makes a segment of half a megabyte with a random name, then a file of
the same name and ``_el`` that it locks as long as it lives. The system takes the lock back when
the process is gone, however it went; the segment stays until somebody removes it. Where no room
is left for a new one, the process that touches it is killed with SIGBUS.

Ports are left alone: their names are numbers, the next process with the same number takes them
over, and to remove one while that happens would split it in two.
"""

import fcntl
import os
from pathlib import Path
import re
import sys
import time

DIRECTORY = Path('/dev/shm')
"""Where Linux keeps shared memory."""

SETTLED = 5.0
"""
How old a segment must be to be removed [s].

Between the making of a segment and its lock there is a moment in which it looks dead.
"""

NEEDED = 16 << 20
"""How much must be free for a formation to use shared memory [bytes]: some twenty processes."""

_LOCK = re.compile('(fastrtps_[0-9a-f]{16})_el')
_TRANSPORTS = 'FASTDDS_BUILTIN_TRANSPORTS'


def remove_dead(directory: Path = DIRECTORY, settled: float = SETTLED) -> int:
    """
    Remove the segments of this user's processes that have died.

    :param directory: where they are
    :param settled: how old they must be [s]
    :returns: how many bytes that set free
    """
    freed = 0
    try:
        found = [entry for entry in os.scandir(directory) if _LOCK.fullmatch(entry.name)]
    except OSError:  # another system than Linux, or not allowed
        return 0
    for entry in found:
        try:
            freed += _remove_if_dead(directory, entry.name, settled)
        except OSError:  # somebody else was quicker, or it is not ours to remove
            continue
    return freed


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
