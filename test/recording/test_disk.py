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

"""A disk that is full or gone is said in one line; what was written is kept."""

import os
import re
import shutil
import subprocess

from harness import run
import pytest
from rosbags.rosbag2 import Reader
from tetra_ros2.launcher import Launcher
from tetra_ros2.recording import recover
from tetra_ros2.recording.bag import Bag

STORAGES = 'mcap', 'sqlite3'


@pytest.fixture
def small_disk(tmp_path):
    """Return a directory on a file system of 2 MB."""
    if os.geteuid() != 0:
        pytest.skip('only root can mount a file system')
    path = tmp_path / 'disk'
    path.mkdir()
    done = subprocess.run(['mount', '-t', 'tmpfs', '-o', 'size=2m', 'tmpfs', str(path)],
                          capture_output=True, text=True, check=False)
    if done.returncode:
        pytest.skip(f'no file system can be mounted here: {done.stderr.strip()}')
    yield path
    subprocess.run(['umount', '-l', str(path)], check=True)


def readable(path):
    """Return the times of the messages, after `tetra recover` where it is needed."""
    if not recover.is_whole(path):
        recovered = path.parent.parent / 'recovered'
        recover.recover(path, recovered)
        path = recovered
    with Reader(path) as bag:
        return [at for _, at, _ in bag.messages()]


@pytest.mark.parametrize('storage', STORAGES)
def test_a_launcher_whose_disk_is_full_goes_on_and_ends_with_status_1(small_disk, storage):
    status, output, errors = run(
        'launcher', '--duration', '25', '--quiet', '--record', small_disk / 'bag',
        '--storage', storage)
    assert status == 1
    error, = (line for line in errors.splitlines() if line.startswith('tetra: error'))
    assert re.search('could not be written to the end: .*(No space|full)', error)
    assert 'has died' not in errors
    assert 'Traceback' not in errors
    assert 'formed     yes' in output
    assert re.search('recording .*: cut off', output)
    times = readable(small_disk / 'bag')
    assert len(times) > 1000
    assert times == sorted(times)


@pytest.mark.parametrize('storage', STORAGES)
def test_a_recording_whose_directory_is_removed_says_so_and_the_formation_goes_on(
        tmp_path, storage):
    path = tmp_path / 'bag'
    with Launcher('complete', record=path, storage=storage,
                  parameters={'real_time_factor': 20.0}) as formation:
        formation.run_for(1.0)
        shutil.rmtree(path)
        steps = formation.plant.stepper.steps
        formation.run_until(lambda: formation.recorder.failure, 200.0)
        assert formation.recorder.failure
        assert 'died' not in formation.recorder.failure
        formation.run_for(1.0)
        assert formation.plant.stepper.steps > steps
    assert formation.recorder.exit_status == 1
    assert not path.exists()


@pytest.mark.parametrize('storage', STORAGES)
def test_a_bag_that_cannot_grow_is_completed_with_what_is_safe(small_disk, storage):
    bag = Bag(small_disk / 'bag', storage)
    topic = bag.add('/a', 'std_msgs/msg/Float64', 'float64 data', 'RIHS01_' + 64 * '0')
    written = flushed = 0
    with pytest.raises(Exception, match=r'No space|full'):
        while True:
            bag.write([(topic, written + k + 1, bytes(1000)) for k in range(100)])
            written += 100
            bag.flush()
            flushed = written
    try:
        bag.salvage()
    except Exception:  # there may be no room for that either
        bag.abort()
    times = readable(small_disk / 'bag')
    assert flushed <= len(times) <= written
    assert times == [*range(1, len(times) + 1)]
    assert flushed > 500
