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

"""The documentation builds without a warning: every link, every name in it is there."""

from pathlib import Path
import subprocess
import sys

import pytest

TOP = Path(__file__).resolve().parents[2]


def test_the_documentation_builds_without_a_warning(tmp_path):
    for module in ('sphinx', 'myst_parser', 'furo', 'sphinx_copybutton'):
        pytest.importorskip(module)
    done = subprocess.run(
        [sys.executable, '-m', 'sphinx', '-q', '-W', '--keep-going', '-d', tmp_path / 'doctrees',
         TOP / 'docs', tmp_path / 'html'], capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr
    assert 'Formation.simulate' in (tmp_path / 'html' / 'api.html').read_text()
