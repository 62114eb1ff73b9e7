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

"""Where the files that are not Python ended up: config, launch, package.xml."""

from pathlib import Path
import re


def share_directory() -> Path:
    """
    Return the directory that holds ``package.xml``, ``config`` and ``launch``.

    It is looked for upwards from this file. In a source tree (editable and symlink installs) it
    is the top of the tree; below any installation prefix (a virtual environment, a user's site,
    a colcon workspace, ``/opt/ros/jazzy``) it is ``share/tetra_ros2``.

    :raises FileNotFoundError: if the installation is not whole
    """
    for parent in Path(__file__).resolve().parents[2:]:
        for candidate in (parent, parent / 'share' / 'tetra_ros2'):
            if (candidate / 'package.xml').is_file() and (candidate / 'config').is_dir():
                return candidate
    raise FileNotFoundError(f'share/tetra_ros2 was not installed with {Path(__file__).parent}')


def shipped() -> dict[str, Path]:
    """Return the paths of the configurations that ship, by their bare names, in order."""
    return {file.stem: file for file in sorted((share_directory() / 'config').glob('*.yaml'))}


def version() -> str:
    """Return the version of this package, as its manifest has it."""
    manifest = (share_directory() / 'package.xml').read_text(encoding='utf-8')
    found = re.search('<version>(.*)</version>', manifest)
    return found[1] if found else 'of no known version'
