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
Every example runs, and shows what it says.

Those on plain rclpy, ``own_agent.py`` and ``own_plant.py``, run in ``test/system``.
"""

from pathlib import Path
import subprocess
import sys

import nbclient
import nbformat
import pytest

EXAMPLES = Path(__file__).parents[2] / 'examples'


def lines_of(name):
    """Run a script and return what it prints, line by line."""
    done = subprocess.run([sys.executable, EXAMPLES / name], capture_output=True, text=True,
                          check=False)
    assert done.returncode == 0, done.stderr
    return done.stdout.splitlines()


def test_a_custom_digraph_under_a_gain_of_ones_own_does_what_is_predicted():
    lines = lines_of('simulate.py')
    assert lines[0].split(']', 1)[1] == lines[1].split(']', 1)[1]
    numbers = [float(line.split()[2]) for line in lines[2:6]]
    assert numbers[0] == pytest.approx(numbers[1], rel=1e-5)
    assert numbers[2] == pytest.approx(numbers[3], rel=1e-5)
    assert numbers[0] > 0.05


def test_the_spinning_tetrahedron_is_found_and_attracts_alone():
    lines = lines_of('equilibria.py')
    stable = [line for line in lines if ' stable ' in line]
    assert [line.split()[0] for line in stable] == ['tetrahedron'] * 2
    assert 'spins at 0.5774 rad/s' in stable[1]
    found, predicted = (line.split()[-2] for line in lines[-4:-2])
    assert float(found) == pytest.approx(float(predicted), rel=1e-11)


def test_a_sweep_of_the_sample_time_shows_the_limit_and_the_spin():
    lines = lines_of('sample_time.py')
    assert '0.9761 s' in lines[0]
    assert lines[-1].endswith('not stable')
    for line in lines[2:-1]:
        predicted, simulated = map(float, line.split()[-3:-1])
        assert simulated == pytest.approx(predicted, abs=2e-5)


def test_the_notebook_runs_from_top_to_bottom():
    notebook = nbformat.read(EXAMPLES / 'tutorial.ipynb', as_version=4)
    for cell in notebook.cells:  # what is committed is small, and never out of date
        assert not cell.get('outputs')
        assert cell.get('execution_count') is None
    nbclient.NotebookClient(notebook, timeout=100, kernel_name='python3').execute()
    shown = ''.join(output.get('text', '') for cell in notebook.cells
                    for output in cell.get('outputs', ()))
    assert 'sample time below 0.9761 s' in shown
    assert 'tetrahedron      stable    0.5774 rad/s' in shown


def test_every_example_is_run_by_a_test():
    tests = ''.join(path.read_text() for path in Path(__file__).parents[1].rglob('test_*.py'))
    for path in EXAMPLES.iterdir():
        if path.suffix in ('.py', '.ipynb'):
            assert f"'{path.name}'" in tests or f"'{path.stem}:" in tests  # or one of its classes
