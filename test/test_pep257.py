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

"""What ``ament_pep257`` says of the tree, where there is ament."""

from pathlib import Path

import pytest

TOP = Path(__file__).resolve().parents[1]


@pytest.mark.linter
@pytest.mark.pep257
def test_ament_pep257_finds_no_fault(monkeypatch):
    linter = pytest.importorskip('ament_pep257.main', reason='it comes with ROS 2')
    monkeypatch.chdir(TOP)
    assert linter.main(argv=['setup.py', 'tetra_ros2', 'benchmarks', 'examples', 'launch',
                             'test']) == 0
