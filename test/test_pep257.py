# Copyright 2026 The tetra_ros2 authors
# SPDX-License-Identifier: Apache-2.0

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
