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

"""The bench measures every row, says what it found, and fails if a target is missed."""

from contextlib import contextmanager
import json
import subprocess

from benchmarks import measuring
from benchmarks.__main__ import main
from benchmarks.measuring import Bench
from benchmarks.punctuality import judge
from benchmarks.rows import all_rows, Row, System
import numpy as np
import pytest

FIELDS = ('rounds/s', 'us/message', 'trajectories/s', 'trajectories/core s', 'drift', 'rate',
          'MB', 'growth [MB]', 's', 'lost', 'on time', 'fresh', 'oldest [steps]', 'rounds')


@pytest.fixture
def instant(monkeypatch):
    """Let every measurement take no time, and find 1 for every figure."""
    calls = []

    @contextmanager
    def running(self, system, found):
        def measure():
            calls.append(system.name)
            return dict.fromkeys(FIELDS, 1.0)
        yield measure

    monkeypatch.setattr(Bench, '_running', running)
    return calls


def bench(*arguments):
    return main([*map(str, arguments)])


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
    # Once more before it counts, to be warm.
    assert instant == ['tetra, one process', 'bytes, one process'] * 4


def test_what_rows_share_is_measured_once(instant):
    bench('--only', 'punctual', '--only', 'fresh', '--only', 'oldest', '--only', 'memory',
          '--only', 'growth')
    assert sorted(instant) == ['memory of a bare node', 'memory of an agent', 'tetra, real time']


def test_a_missed_target_gives_status_1_unless_only_a_report_is_wanted(instant):
    assert bench('--only', 'ceiling') == 0
    assert bench('--only', 'objects') == 1
    assert bench('--only', 'objects', '--report-only') == 0


@contextmanager
def fails_to_start(bench):
    raise subprocess.TimeoutExpired('worker', 1.0)
    yield


@contextmanager
def fails_in_its_turn(bench):
    def measure():
        raise RuntimeError('no')
    yield measure


@contextmanager
def fails_at_the_end(bench):
    yield lambda: {'s': 0.5}
    raise RuntimeError('no')


@pytest.mark.parametrize('start', [fails_to_start, fails_in_its_turn, fails_at_the_end])
def test_a_measurement_that_fails_misses_its_target(start, capsys):
    row = Row('x', 'x', '', (System('x', start),), 's', at_most=1.0)
    result, = Bench(measuring.Scale(repeats=2)).measure([row])
    assert not result['met']
    assert 'x could not be measured' in capsys.readouterr().err


def test_of_lost_messages_the_worst_turn_counts():
    row, = (row for row in all_rows() if row.name == 'lost')
    system, = row.systems
    assert not row.conclude({system: [{'lost': 0}, {'lost': 0}, {'lost': 3}]})['met']
    assert row.conclude({system: [{'lost': 0}] * 3})['met']


@pytest.mark.parametrize(('limit', 'found', 'tried'), [
    (2200, 2000, [2500, 2500]), (700, 500, [2000, 2000, 1500, 1500, 1000, 1000, 500]),
    (10, 0, None), (1e9, 6000, [2500, 3000, 4000, 5000, 6000])])
def test_the_highest_rate_is_looked_for_upwards_or_downwards(limit, found, tried):
    def run(rate):
        good = rate <= limit
        return {'rate': rate, 'on time': 1.0 if good else 0.5, 'fresh': 1.0, 'oldest [steps]': 1}

    rate, rungs = measuring.highest_rate(2000, limit >= 2000, run)
    assert rate == found
    assert tried is None or [rung['rate'] for rung in rungs] == tried


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


def test_what_was_kept_can_be_read_and_printed_for_the_readme(instant, tmp_path, capsys):
    file = tmp_path / 'bench.json'
    bench('--only', 'ceiling', '--only', 'highest-fair', '--json', file)
    capsys.readouterr()
    instant.clear()
    assert bench('--read', file, '--markdown') == 0
    assert not instant, 'nothing is measured'
    rows = [line for line in capsys.readouterr().out.splitlines() if line.startswith('|')]
    assert [row.split(' | ')[0] for row in rows] == [
        '| row', '| ---', '| ceiling', '| highest-fair']
    assert rows[2].endswith('| >= 0.65 x | met |')
    assert rows[3].endswith('|  |  |'), 'no target, no verdict'


@pytest.mark.parametrize(('text', 'expected'), [
    (None, 'No such file'), ('{', 'is not what'), ('{"rows": [{}]}', 'is not what'),
    ('[]', 'is not what')])
def test_a_file_that_is_none_of_its_own_is_refused(text, expected, tmp_path, capsys):
    file = tmp_path / 'bench.json'
    if text is not None:
        file.write_text(text)
    assert bench('--read', file) == 2
    error = capsys.readouterr().err
    assert expected in error
    assert str(file) in error
    assert error.count('\n') == 1


def test_the_rows_are_listed(capsys):
    assert bench('--list') == 0
    assert len(capsys.readouterr().out.splitlines()) == len(all_rows())


@pytest.mark.parametrize(('row', 'seconds'), [
    ('ceiling', 0.2), ('objects', 0.2), ('watched', 0.2), ('processes', 0.2), ('drift', 0.002),
    ('growth', 0.01), ('help', 0.2),
    # Three processes that each compile what they run.
    pytest.param('machine', 0.05, marks=pytest.mark.slow)])
def test_a_row_is_measured_in_processes_of_its_own(row, seconds, tmp_path):
    file = tmp_path / 'bench.json'
    assert bench('--only', row, '--seconds', seconds, '--repeats', 1, '--report-only',
                 '--json', file) == 0
    result, = json.loads(file.read_text())['rows']
    assert result['median'] is not None
    assert None not in result['measured']


def test_real_time_is_measured_in_six_processes(monkeypatch):
    monkeypatch.setattr(measuring, 'LADDER', (250, 500))
    figures = Bench(measuring.Scale(realtime=0.3)).realtime('tetra', 250)
    assert figures['steps'] > 20
    assert 0.0 < figures['fresh'] <= 1.0
    assert figures['oldest [steps]'] >= 1


def test_a_late_step_a_skipped_step_and_an_old_command_are_noticed():
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
