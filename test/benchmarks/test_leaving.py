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

"""Leaving at once."""

from pathlib import Path
import subprocess
import sys

from harness import DEADLINE

TOP = Path(__file__).parents[2]


def test_those_that_leave_at_once_all_end():
    done = subprocess.run(
        [sys.executable, '-m', 'benchmarks.leaving', '--rounds', '2', '--processes', '3'],
        cwd=TOP, capture_output=True, text=True, timeout=DEADLINE, check=False)
    assert done.stdout == '0 of 6 processes did not end\n', done.stderr
