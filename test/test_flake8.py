# Copyright 2026 The tetra_ros2 authors
# SPDX-License-Identifier: Apache-2.0

"""What ``ament_flake8`` says of the tree, where there is ament."""

from pathlib import Path

import pytest

TOP = Path(__file__).resolve().parents[1]


@pytest.mark.linter
@pytest.mark.flake8
def test_ament_flake8_finds_no_fault(monkeypatch):
    linter = pytest.importorskip('ament_flake8.main', reason='it comes with ROS 2')
    monkeypatch.chdir(TOP)
    status, errors = linter.main_with_errors(argv=[
        'setup.py', 'tetra_ros2', 'benchmarks', 'examples', 'launch', 'test'])
    assert status == 0, '\n'.join(errors)
