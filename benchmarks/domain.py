# Copyright 2026 The tetra_ros2 authors
# SPDX-License-Identifier: Apache-2.0

"""A ROS domain that nobody else on this machine is in."""

from contextlib import contextmanager
import fcntl
from pathlib import Path
import tempfile


@contextmanager
def reserved():
    """Give the number of a ROS domain that no test, and no other of these, has meanwhile."""
    for domain in range(101, 0, -1):
        lock = (Path(tempfile.gettempdir()) / f'tetra_ros2_test_domain_{domain}').open('w')
        try:
            fcntl.flock(lock, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except OSError:
            lock.close()
            continue
        with lock:
            yield domain
        return
    raise RuntimeError('all ROS domains are taken')
