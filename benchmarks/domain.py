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

"""A ROS domain that nobody else on this machine is in."""

from collections.abc import Iterable, Iterator
from contextlib import contextmanager
import fcntl
from pathlib import Path
import tempfile
from typing import TextIO

from tetra_ros2.ros import shared_memory

LARGEST = 101
"""Beyond it the ports are among those of outgoing connections."""


def reserve(domains: Iterable[int]) -> tuple[int, TextIO]:
    """
    Return the first of these ROS domains that nobody has reserved, and the lock to close later.

    :raises RuntimeError: if there is none
    """
    for domain in domains:
        lock = (Path(tempfile.gettempdir()) / f'tetra_ros2_test_domain_{domain}').open('w')
        try:
            fcntl.flock(lock, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except OSError:
            lock.close()
            continue
        return domain, lock
    raise RuntimeError('all ROS domains are taken')


def remove_ports(domain: int) -> None:
    """Remove what killed processes left of a domain in shared memory; nobody else is in it."""
    first = 7400 + 250 * domain
    for port in range(first, first + 250):
        for name in (f'fastrtps_port{port}', f'fastrtps_port{port}_el',
                     f'sem.fastrtps_port{port}_mutex'):
            (shared_memory.DIRECTORY / name).unlink(missing_ok=True)


@contextmanager
def reserved() -> Iterator[int]:
    """Give the number of a ROS domain that no test, and no other of these, has meanwhile."""
    domain, lock = reserve(range(LARGEST, 0, -1))  # the tests count from below
    with lock:
        try:
            yield domain
        finally:
            remove_ports(domain)
