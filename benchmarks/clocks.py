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

"""A system clock of its own for a process, by libfaketime (Debian package of this name)."""

from pathlib import Path
import re

from tetra_ros2.ros import shared_memory

LIBRARY = Path('/usr/lib/x86_64-linux-gnu/faketime/libfaketimeMT.so.1')

_SHARED_MEMORY = re.compile(r'(?:sem\.faketime_sem|faketime_shm)_([0-9]+)')
"""Names of what libfaketime makes for each process."""


def environment(file: Path) -> dict[str, str]:
    """Return what lets a process read its system clock's offset in a file, once a second."""
    return {'LD_PRELOAD': str(LIBRARY), 'FAKETIME_TIMESTAMP_FILE': str(file),
            'FAKETIME_CACHE_DURATION': '1', 'FAKETIME_DONT_RESET': '1',
            'DONT_FAKE_MONOTONIC': '1'}


def set_clock(file: Path, offset: float) -> None:
    """Let the clock of whoever reads this file be off by so much [s]."""
    # Replaced, not written: in a file that is still empty libfaketime reads a time of its own,
    # and Python does not survive that.
    new = file.with_suffix('.new')
    new.write_text(f'{offset:+g}s\n')
    new.replace(file)


def remove_dead(directory: Path = shared_memory.DIRECTORY) -> None:
    """Remove the shared memory that libfaketime made for processes that were killed."""
    for file in directory.iterdir():
        if (found := _SHARED_MEMORY.fullmatch(file.name)) \
                and not Path('/proc', found[1]).exists():
            file.unlink(missing_ok=True)
