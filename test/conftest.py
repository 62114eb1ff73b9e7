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

"""What all tests share: reproducible examples, and a ROS domain that nobody else is in."""

import os
from pathlib import Path

from benchmarks.domain import LARGEST, remove_ports, reserve
from hypothesis import settings
import pytest
from tetra_ros2.ros import shared_memory

# As the command line sets it, and before numpy is loaded: several files are tested at a time.
os.environ.setdefault('OPENBLAS_NUM_THREADS', '1')

settings.register_profile('tetra', derandomize=True, deadline=None, max_examples=30)
settings.load_profile('tetra')


OPTIONAL = {
    'apsw', 'browser', 'colcon_core', 'dask', 'distributed', 'dynamixel_sdk', 'ipykernel',
    'matplotlib', 'mcap', 'mcap_ros2', 'msgspec', 'mujoco', 'nbclient', 'nbformat', 'numba', 'PIL',
    'playwright', 'pyarrow', 'rosbags', 'scipy', 'trimesh', 'viser', 'websockets',
}
"""Modules without which the tests that want them are skipped, as rosdep brings not all of them."""


@pytest.hookimpl(hookwrapper=True)
def pytest_make_collect_report(collector):
    """Skip a file of tests that imports what is not installed, and is not needed to run."""
    outcome = yield
    report = outcome.get_result()
    error = report.call.excinfo and report.call.excinfo.value.__cause__
    if isinstance(error, ModuleNotFoundError) \
            and (error.name or '').partition('.')[0] in OPTIONAL:
        report.outcome = 'skipped'
        report.longrepr = (str(collector.path), 0, f'Skipped: {error.name} is not installed')


PUNCTUAL = (
    'nodes/test_body.py', 'system/test_intruder.py', 'system/test_clocks.py',
    'nodes/test_poses.py')
"""Files whose nodes are to keep time, and which wait more than they work."""

LONGEST = (
    'viewer/test_viewer.py', 'system/test_processes.py', 'system/test_hosts.py',
    'commands/test_cli.py', 'paper/test_verify.py', 'system/test_fuzz_all.py',
    'viewer/test_motion.py', 'recording/test_plot.py', 'system/test_launcher.py',
    'viewer/test_formations.py', 'benchmarks/test_bench.py')
"""The files that take longest of the others, the longest first."""


def pytest_collection_modifyitems(items):
    """
    Begin with what has to keep time, while nothing else takes much of the processor.

    Then come the longest files, so that of several workers none waits for another at the end. The
    mathematics, short and many, fills what is left.
    """
    top = Path(__file__).parent
    order = (*PUNCTUAL, *LONGEST)
    places = {top / name: k for k, name in enumerate(order)}

    def place(item):
        mathematics = top / 'formation' in item.path.parents
        return places.get(item.path, len(order) + mathematics)

    items.sort(key=place)


# At import, and not in a fixture: modules of the tests may make a ROS context when they load.
_DOMAIN, _DOMAIN_LOCK = reserve(range(1, LARGEST + 1))
os.environ['ROS_DOMAIN_ID'] = str(_DOMAIN)
os.environ['ROS_AUTOMATIC_DISCOVERY_RANGE'] = 'LOCALHOST'


def pytest_sessionfinish():
    """Leave no shared memory behind: killed processes do, and all of these are gone now."""
    shared_memory.remove_dead(settled=1.0)
    remove_ports(_DOMAIN)


@pytest.fixture
def probe():
    """Return a plain node of its own, to look at a formation from outside."""
    from harness import Probe
    with Probe() as node:
        yield node


@pytest.fixture
def processes():
    """Return a function that starts ``tetra X`` in a process, and end all of them afterwards."""
    from harness import Processes
    with Processes() as started:
        yield started
