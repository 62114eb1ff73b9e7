# Copyright 2026 The tetra_ros2 authors
# SPDX-License-Identifier: Apache-2.0

"""A colcon workspace with this package, for all tests that want one."""

from pathlib import Path
import shutil
import subprocess
import sys

import pytest

TOP = Path(__file__).resolve().parents[2]


@pytest.fixture(scope='session')
def source(tmp_path_factory):
    """Return a copy of the sources, so that building leaves nothing in the tree."""
    copy = tmp_path_factory.mktemp('workspace') / 'src' / 'tetra_ros2'
    shutil.copytree(TOP, copy, ignore=shutil.ignore_patterns(
        '.*', '__pycache__', '*.egg-info', 'build', 'install', 'log'))
    return copy


@pytest.fixture(scope='session')
def workspace(source):
    """Return a colcon workspace in which the package has been built."""
    beside_python = Path(sys.executable).with_name('colcon')
    colcon = beside_python if beside_python.is_file() else shutil.which('colcon')
    if colcon is None:
        pytest.skip('colcon is not installed')
    top = source.parents[1]
    subprocess.run([colcon, 'build'], cwd=top, check=True, capture_output=True)
    return top
