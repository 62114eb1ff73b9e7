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

"""What `make chaos` makes of what it saw; the faults themselves are too slow for here."""

from dataclasses import asdict
import json
import os
from pathlib import Path
import subprocess
import sys

from benchmarks import clocks
from benchmarks.chaos import group, Outcome, Share, table
from benchmarks.hosts import unavailable
import pytest


def outcome(k=1, kind='kill', what='agent_2, for 1.00 s', formation='realtime complete', **more):
    return Outcome(k, kind, what, formation, 7, True, '', 1.5, 2.0, **more)


def test_kinds_are_told_apart_by_whom_they_hit():
    assert group(outcome()) == 'kill: agent'
    assert group(outcome(kind='partition', what='agent_1 and plant, for 2.00 s')) \
        == 'partition: plant'
    assert group(outcome(kind='clock', what='of viewer by +3 s for 2.00 s')) \
        == 'clock: monitor, recorder, viewer'
    assert group(outcome(kind='forged', what='20 on agent_1/cmd_vel, stamp +0 s')) == 'forged'


def test_the_table_has_a_row_for_each_kind_and_one_for_all():
    fell = [outcome(decay=1.2, theory=1.0, owed=True, reported=1.4)] * 3
    rows = table([*fell, outcome(), outcome(kind='loss', what='10% for 1.00 s', decay=1.0,
                                            theory=1.0)]).splitlines()
    assert len({row.count('|') for row in rows}) == 1
    assert [row.split(' | ')[0] for row in rows[2:]] == ['| kill: agent', '| loss', '| all']
    assert '| 1.20 | 1.00 | 1.20 | 3 | 1.40 |' in rows[2]
    assert '| - | - | - | 0 | - |' in rows[3]


def test_a_run_that_was_stopped_goes_on_with_the_next_fault(tmp_path):
    out = tmp_path / 'chaos.jsonl'

    class Arguments:
        faults, seed, verbose, only = 12, 1, False, []

    Arguments.out = out
    share = Share('realtime', 'complete', Arguments)
    assert share._done() == 0
    out.write_text(''.join(json.dumps(asdict(o)) + '\n' for o in (
        outcome(1), outcome(2), outcome(9, formation='lockstep complete'))))
    assert share._done() == 2
    assert not share.whole
    with out.open('a') as file:
        file.write(json.dumps(asdict(outcome(3))) + '\n')
    assert share.whole


def test_a_clock_is_set_at_one_moment(tmp_path):
    file = tmp_path / 'clock'
    clocks.set_clock(file, 0.0)
    with file.open() as before:
        clocks.set_clock(file, -30.0)
        assert before.read() == '+0s\n'  # to whoever reads just then, not half of a new one
    assert file.read_text() == '-30s\n'


def test_the_clocks_of_who_was_killed_are_removed_and_nothing_else(tmp_path):
    with subprocess.Popen([sys.executable, '-c', '']) as dead:
        pass  # it has ended, and was waited for
    names = [f'{kind}_{number}' for kind in ('faketime_shm', 'sem.faketime_sem')
             for number in (dead.pid, os.getpid())] + ['fastrtps_port7411', 'faketime_shm_x']
    for name in names:
        (tmp_path / name).touch()
    clocks.remove_dead(tmp_path)
    assert {file.name for file in tmp_path.iterdir()} == {
        name for name in names if not name.endswith(f'_{dead.pid}')}


@pytest.mark.slow
@pytest.mark.timeout(600)
@pytest.mark.skipif(unavailable() is not None, reason=str(unavailable()))
def test_some_faults_are_survived(tmp_path):
    done = subprocess.run(
        [sys.executable, '-m', 'benchmarks.chaos', '--faults', '12', '--seed', '5', '--verbose',
         '--out', tmp_path / 'chaos.jsonl'], capture_output=True, text=True, check=False,
        cwd=Path(__file__).parents[2])
    assert done.returncode == 0, done.stdout + done.stderr
    assert 'seed 5: 12 of 12 faults survived' in done.stdout
