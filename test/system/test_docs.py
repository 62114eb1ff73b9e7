# Copyright 2026 The tetra_ros2 authors
# SPDX-License-Identifier: Apache-2.0

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
