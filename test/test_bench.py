# Copyright 2026 The tetra_ros2 authors
# SPDX-License-Identifier: Apache-2.0

"""The bench measures every row, says what it found, and fails if a target is missed."""

import json
import subprocess

import numpy as np
import pytest

from tetra_ros2 import cli
from tetra_ros2.tools import measurements
from tetra_ros2.tools.measurements import all_rows, Bench, Row, System

FIELDS = ('rounds/s', 'us/message', 'trajectories/s', 'trajectories/core s', 'drift', 'rate',
          'MB', 'growth [MB]', 's', 'lost', 'on time', 'fresh', 'oldest [steps]', 'rounds')


@pytest.fixture
def instant(monkeypatch):
    """Let every measurement take no time, and find 1 for every figure."""
    calls = []

    def measure(self, system):
        calls.append(system.name)
        return {**dict.fromkeys(FIELDS, 1.0), measurements.OTHERS: 0.0}

    monkeypatch.setattr(Bench, '_measure', measure)
    return calls


def bench(*arguments):
    return cli.main(['bench', *map(str, arguments)])


def test_every_row_is_measured_and_written(instant, tmp_path, capsys):
    file = tmp_path / 'bench.json'
    assert bench('--json', file, '--repeats', 3) == 1  # a ratio of 1 misses most targets
    document = json.loads(file.read_text())
    assert [row['name'] for row in document['rows']] == [row.name for row in all_rows()]
    for row in document['rows']:
        assert len(row['values']) == len(row['measured']) >= 1
        assert row['median'] in (0.0, 1.0)
    assert document['machine']['cores'] >= 1
    assert {'python', 'numpy', 'rclpy', 'revision'} <= set(document['versions'])
    output = capsys.readouterr().out
    for row in all_rows():
        assert row.name in output
    assert 'missed: objects' in output


def test_what_is_compared_runs_in_turns(instant):
    bench('--only', 'ceiling', '--repeats', 3)
    assert instant == ['tetra, one process', 'bytes, one process'] * 3


def test_what_rows_share_is_measured_once(instant):
    bench('--only', 'punctual', '--only', 'fresh', '--only', 'oldest', '--only', 'memory',
          '--only', 'growth')
    assert sorted(instant) == ['memory of a bare node', 'memory of an agent', 'tetra, real time']


def test_a_missed_target_gives_status_1_unless_only_a_report_is_wanted(instant):
    assert bench('--only', 'ceiling') == 0
    assert bench('--only', 'objects') == 1
    assert bench('--only', 'objects', '--report-only') == 0


def test_a_measurement_that_fails_misses_its_target(monkeypatch, capsys):
    def fail(self):
        raise subprocess.TimeoutExpired('worker', 1.0)

    row = Row('x', 'x', '', (System('x', fail),), 's', at_most=1.0)
    result, = Bench(measurements.Scale(repeats=2)).measure([row])
    assert not result['met']
    assert result['median'] is None
    assert 'x could not be measured' in capsys.readouterr().err


def test_the_median_counts():
    row = Row('x', '', '', (System('a', None), System('b', None)), 'f', at_least=2.0)
    a, b = row.systems
    result = row.conclude({a: [{'f': 4.0}, {'f': 2.0}, {'f': 9.0}],
                           b: [{'f': 1.0}, {'f': 2.0}, {'f': 3.0}]})
    assert result['values'] == [4.0, 1.0, 3.0]
    assert result['median'] == 3.0
    assert result['spread'] == [1.0, 4.0]
    assert result['met']


@pytest.mark.parametrize(('arguments', 'expected'), [
    (['--only', 'celing'], "did you mean 'ceiling'?"),
    (['--repeats', '0'], '--repeats: 0 is not valid'),
    (['--seconds', '-1'], '--seconds: -1.0 is not valid'),
    (['--json', '/nowhere/at/all.json'], '--json'),
])
def test_a_wrong_call_is_refused(arguments, expected, capsys):
    assert bench(*arguments) == 2
    error = capsys.readouterr().err
    assert expected in error
    assert error.count('\n') == 1


def test_without_the_source_tree_it_says_so(monkeypatch, tmp_path, capsys):
    monkeypatch.setattr(measurements, 'WORKER', tmp_path / 'worker.py')
    assert bench() == 2
    assert 'source tree' in capsys.readouterr().err


def test_the_rows_are_listed(capsys):
    assert bench('--list') == 0
    assert len(capsys.readouterr().out.splitlines()) == len(all_rows())


@pytest.mark.parametrize('row', ['ceiling', 'drift', 'help'])
def test_a_row_is_measured_in_processes_of_its_own(row, tmp_path):
    file = tmp_path / 'bench.json'
    assert bench('--only', row, '--seconds', 0.2, '--repeats', 1, '--report-only',
                 '--json', file) == 0
    result, = json.loads(file.read_text())['rows']
    assert result['median'] > 0.0
    assert None not in result['measured']


def test_real_time_is_measured_in_six_processes():
    figures = Bench(measurements.Scale(realtime=0.3)).realtime(rate=200)
    assert figures['steps'] > 20
    assert 0.0 < figures['fresh'] <= 1.0
    assert figures['oldest [steps]'] >= 1


@pytest.fixture
def judge(monkeypatch):
    """Return the function that says how punctual a run was."""
    monkeypatch.syspath_prepend(str(measurements.WORKER.parent))
    from worker import judge
    return judge


def test_a_late_step_a_skipped_step_and_an_old_command_are_noticed(judge):
    stamps = 1e9 + 1e6 * np.arange(1000)
    oldest = stamps - 1e6
    fresh = np.full(1000, 4)
    perfect = judge(np.stack([stamps, oldest, fresh], axis=1), 4, 1000.0)
    assert perfect['on time'] == perfect['fresh'] == 1.0
    assert perfect['oldest [steps]'] == 1
    stamps[100] += 0.3e6  # late
    oldest[500] = stamps[480]  # old
    fresh[500] = 3
    kept = np.arange(1000) != 700  # skipped, and the one behind it counts as late
    found = judge(np.stack([stamps, oldest, fresh], axis=1)[kept], 4, 1000.0)
    assert found['on time'] == pytest.approx(1.0 - 3 / 1000)
    assert found['oldest [steps]'] == 20
    assert found['fresh'] == pytest.approx(1.0 - 1 / (4 * 998))
