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

"""The library as pip installs it, with numpy and nothing else: no ROS, no YAML, no SciPy."""

from pathlib import Path
import shutil
import subprocess
import sys

import numpy as np
import pytest

TOP = Path(__file__).resolve().parents[2]


@pytest.fixture(scope='module')
def python(tmp_path_factory):
    """Return a function that runs a script where there is the package and numpy alone."""
    site = tmp_path_factory.mktemp('site')
    source = tmp_path_factory.mktemp('source')
    # pip builds in the tree that it is given.
    shutil.copytree(TOP, source, dirs_exist_ok=True, ignore=shutil.ignore_patterns(
        '.*', '__pycache__', '*.egg-info', 'build', 'install', 'log', 'docs', 'test'))
    done = subprocess.run(
        [sys.executable, '-m', 'pip', 'install', '--quiet', '--no-deps',
         '--target', site, source], capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr
    for found in Path(np.__file__).parents[1].glob('numpy*'):
        (site / found.name).symlink_to(found)

    def run(script):
        # -I and -S: no PYTHONPATH, no current directory, no site-packages.
        done = subprocess.run(
            [sys.executable, '-I', '-S', '-c',
             f'import sys; sys.path.append({str(site)!r})\n{script}'],
            capture_output=True, text=True, check=False)
        assert done.returncode == 0, done.stderr
        return done.stdout
    return run


def test_five_lines_simulate_a_formation(python):
    output = python("""
from tetra_ros2.formation import Formation, complete, rotating, custom, Cosine
trajectory = Formation(rotating(), Cosine()).simulate(seed=7, duration=20.0, rate=100.0)
print(trajectory.errors[-1], (trajectory.spin() @ trajectory.spin()) ** 0.5)
""")
    error, rate = map(float, output.split())
    assert error == pytest.approx(2.94e-4, abs=1e-6)
    assert rate == pytest.approx(0.57711, abs=1e-5)


def test_five_lines_find_the_spinning_tetrahedron(python):
    output = python("""
from tetra_ros2.formation import Formation, complete, rotating, custom, Cosine
for e in Formation(rotating(), Cosine()).equilibria():
    if e.kind == 'tetrahedron':
        print(e.stability, e.spin_rate, *e.inertia)
""")
    stability, rate, *inertia = output.split()
    assert stability == 'stable'
    assert float(rate) == pytest.approx(np.sqrt(3.0) / 2.0 * (1.0 - 1.0 / 3.0), rel=1e-9)
    assert inertia == ['0', '0', '5']


def test_five_lines_give_the_limit_of_the_sample_time(python):
    output = python("""
from tetra_ros2.formation import Formation, complete, rotating, custom, Cosine
for topology in complete(), rotating():
    print(Formation(topology, Cosine()).analyze().max_sample_time)
""")
    assert [float(line) for line in output.split()] == pytest.approx([0.5625, 0.9761], abs=1e-4)


def test_all_that_is_exported_is_there_and_needs_numpy_alone(python):
    output = python("""
from tetra_ros2.formation import *
import tetra_ros2.formation as library
assert all(name in globals() for name in library.__all__)
assert set(library.__all__) <= set(dir(library))
topology = custom(3, [(1, 2), (2, 3), (3, 1)])
print(Formation(topology, Exponential()).analyze(rate=20.0, delay=0.1).spin_rate)
print(*sorted(m.split('.')[0] for m in sys.modules if '.' not in m and m in
              ('numpy', 'scipy', 'numba', 'yaml', 'rich', 'rclpy')))
""")
    rate, modules = output.splitlines()
    assert float(rate) > 0.0
    assert modules == 'numpy'


def test_the_package_says_that_it_is_typed(python):
    output = python("""
import tetra_ros2, pathlib
print((pathlib.Path(tetra_ros2.__file__).parent / 'py.typed').exists())
""")
    assert output.strip() == 'True'
