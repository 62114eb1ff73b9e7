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
What can be installed beside the base, and how, from where this package lies.

The one table of the extras; ``setup.py`` reads it. Nothing but the standard library is imported.
"""

import os
from pathlib import Path
import shlex
import sys
import sysconfig

EXTRAS = {
    # For a machine without ROS 2. Whoever has it from apt must not install this.
    'ros': ['ros-jazzy-rclpy[fastrtps]', 'ros-jazzy-common-interfaces'],
    'record': ['mcap', 'rosbags>=0.11'],
    'plot': ['matplotlib', 'pillow', 'rosbags'],
    'view': ['rosbags', 'viser'],
    'analysis': ['matplotlib'],
    'design': ['scipy'],
    'study': ['numba', 'pyarrow'],
    'cluster': ['distributed'],
    'bench': ['numba', 'scipy'],
    'physics': ['mujoco'],
    'serial': ['dynamixel-sdk'],
    'completion': ['argcomplete'],
}
"""The packages of each extra, by the extra's name."""

_EXTRA_OF = {
    'matplotlib': 'plot', 'PIL': 'plot', 'rosbags': 'record', 'viser': 'view', 'numba': 'study',
    'pyarrow': 'study', 'distributed': 'cluster', 'dask': 'cluster', 'scipy': 'design',
    'mcap': 'record', 'mujoco': 'physics', 'dynamixel_sdk': 'serial',
    'argcomplete': 'completion',
}
"""The extra that brings a module that can be missing."""

_OF_ROS = ('rclpy', 'rpyutils', 'rosidl_runtime_py', 'ament_index_python', 'builtin_interfaces',
           'rcl_interfaces', 'std_srvs')
"""Modules that come with ROS 2, beside those whose names end with _msgs."""

_DEBIAN = {
    'argcomplete': 'python3-argcomplete', 'distributed': 'python3-distributed',
    'matplotlib': 'python3-matplotlib', 'numba': 'python3-numba', 'pillow': 'python3-pil',
    'scipy': 'python3-scipy',
}
"""Debian's and Ubuntu's names of those packages that they have."""


def missing(module: str) -> str | None:
    """
    Return how to get a module that is not there, or None if it is none of those we know.

    :param module: its full name, as in ``ModuleNotFoundError.name``
    """
    top = module.partition('.')[0]
    if top in _OF_ROS or top.endswith('_msgs'):
        return f'source a ROS 2 installation, or without one: {install_command("ros")}'
    extra = _EXTRA_OF.get(top)
    return extra and install_command(extra)


def install_command(*extras: str) -> str:
    """
    Return the command that adds extras to this very installation, for a shell.

    It names this package by the path of its sources, if they are there, and else the packages
    that are wanted: this package's name alone may be somebody else's on an index.

    :param extras: keys of :data:`EXTRAS`
    """
    wanted = list(dict.fromkeys(package for extra in extras for package in EXTRAS[extra]))
    if _is_managed_by_the_system():
        if all(package in _DEBIAN for package in wanted):
            return f'sudo apt install {" ".join(_DEBIAN[package] for package in wanted)}'
        # Debian and Ubuntu refuse pip; an environment on top sees what apt installed.
        return ('python3 -m venv --system-site-packages ~/tetra_venv && '
                f'~/tetra_venv/bin/pip install {shlex.join(wanted)}, then '
                '~/tetra_venv/bin/python -m tetra_ros2')
    top = Path(__file__).resolve().parents[1]
    if (top / 'setup.py').is_file():
        # Editable, or it would take the place of an editable installation without a word.
        wanted = ['-e', f'{top}[{",".join(extras)}]']
    return shlex.join([_python(), '-m', 'pip', 'install', *wanted])


def _is_managed_by_the_system() -> bool:
    """Return whether pip would refuse to install into this Python, see PEP 668."""
    if sys.prefix != sys.base_prefix:
        return False
    return (Path(sysconfig.get_path('stdlib')) / 'EXTERNALLY-MANAGED').is_file()


def _python() -> str:
    """Return the path of this Python, short where it lies below the working directory."""
    short = os.path.relpath(sys.executable)
    return sys.executable if short.startswith('..') else short
