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
