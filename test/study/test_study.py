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

"""The study: the same numbers whoever computes them, and nothing lost or half-written."""

import json
import os
from pathlib import Path
import re
import signal
import subprocess
import sys
import time

from harness import DEADLINE
import numpy as np
import pytest
from tetra_ros2.cli import main
from tetra_ros2.commands import study as command
from tetra_ros2.launcher import Launcher
from tetra_ros2.signals import INTERRUPTED, OWN_GROUP
from tetra_ros2.study import executors, montecarlo

ARGUMENTS = ['--gain', 'cosine', '--gain', 'exponential', '--starts', '60']
TOP = Path(montecarlo.__file__).parents[2]


@pytest.fixture(autouse=True)
def small_chunks(monkeypatch):
    """Cut the study into more chunks than workers."""
    monkeypatch.setattr(montecarlo, 'CHUNK', 20)


class Inline:
    """An executor that computes at once, in this process."""

    def submit(self, function, *arguments):
        from concurrent.futures import Future
        future = Future()
        future.set_result(function(*arguments))
        return future


@pytest.fixture
def inline(monkeypatch):
    """Compute in this process, two tasks at a time."""
    from contextlib import contextmanager

    @contextmanager
    def make_executor(workers, scheduler):
        yield Inline(), 2
    monkeypatch.setattr(executors, 'make_executor', make_executor)


def files(directory):
    return {str(path.relative_to(directory)): path.read_bytes()
            for path in sorted(Path(directory).rglob('*')) if path.is_file()}


def run(directory, *arguments):
    return main(['study', '--out', str(directory), '--quiet', *arguments])


def error_of(capsys, *arguments):
    assert main(['study', *map(str, arguments)]) == 2
    text = capsys.readouterr().err
    assert text.startswith('tetra: error: ')
    assert text.count('\n') == 1
    return text


def test_every_start_forms_and_the_files_say_so(tmp_path, inline, capsys):
    import pyarrow.parquet
    assert run(tmp_path / 'a', *ARGUMENTS, '--json') == 0
    summary = json.loads(capsys.readouterr().out)
    assert [case['formed'] for case in summary['cases']] == [60, 60]
    table = pyarrow.parquet.read_table(tmp_path / 'a' / 'results.parquet')
    assert table.num_rows == 120
    assert set(table['case'].to_pylist()) == {'complete_cosine', 'complete_exponential'}
    plan = json.loads(table.schema.metadata[b'tetra_ros2'])
    assert plan == summary['plan']
    times = np.array(table['time_to_form'][:60])
    assert summary['cases'][0]['time_to_form']['1'] == times.max()
    assert sum(summary['cases'][0]['histogram']['counts']) == 60
    assert not (tmp_path / 'a' / 'parts').exists()


def test_csv_and_parquet_hold_the_same(tmp_path, inline):
    import pyarrow.parquet
    run(tmp_path / 'a', *ARGUMENTS)
    run(tmp_path / 'b', *ARGUMENTS, '--format', 'csv')
    rows = (tmp_path / 'b' / 'results.csv').read_text().splitlines()[1:]
    columns = pyarrow.parquet.read_table(tmp_path / 'a' / 'results.parquet').to_pydict()
    for row, case, start, seconds, handed in zip(rows, *columns.values()):
        assert row == f'{case},{start},{seconds!r},{handed}'


def test_the_starts_that_did_not_form_in_time_are_the_worst(tmp_path, inline, capsys):
    assert run(tmp_path / 'a', '--starts', '60', '--longest', '2.6', '--hold', '0.1',
               '--json') == 1
    case = json.loads(capsys.readouterr().out)['cases'][0]
    assert 0 < case['formed'] < 60
    assert case['worst'][0]['time_to_form'] is None


def test_without_numba_the_numbers_are_the_same(tmp_path, inline, monkeypatch):
    run(tmp_path / 'a', '--starts', '60')
    monkeypatch.setitem(sys.modules, 'numba', None)
    run(tmp_path / 'b', '--starts', '60')
    assert files(tmp_path / 'a') == files(tmp_path / 'b')


def test_the_launcher_repeats_the_slowest_start(tmp_path, inline, capfd):
    run(tmp_path / 'a', '--config', 'rotating', '--starts', '60', '--json')
    worst = json.loads(capfd.readouterr().out)['cases'][0]['worst'][0]
    path = tmp_path / 'a' / 'worst' / 'rotating_cosine_1.yaml'
    with Launcher(str(path)) as formation:
        formation.run_for(worst['time_to_form'] + 1.0)
        assert formation.summary().time_to_form == pytest.approx(worst['time_to_form'], abs=1e-9)


def test_a_scheduler_that_does_not_answer_is_refused(tmp_path, capsys, monkeypatch):
    monkeypatch.setattr(executors, 'ANSWER_TIMEOUT', 0.5)
    text = error_of(capsys, '--out', tmp_path / 'a', '--scheduler', 'tcp://127.0.0.1:9')
    assert 'does not answer' in text
    assert not (tmp_path / 'a').exists()
    assert 'does not answer' in error_of(
        capsys, '--out', tmp_path / 'a', '--scheduler', 'nonsense://x')


def test_a_local_cluster_gives_the_same_files(tmp_path):
    from distributed import LocalCluster
    run(tmp_path / 'here', '--starts', '60', '--workers', '1')
    with LocalCluster(n_workers=1, threads_per_worker=2, processes=False,
                      dashboard_address=None) as cluster:
        assert run(tmp_path / 'there', '--starts', '60',
                   '--scheduler', cluster.scheduler_address) == 0
    assert files(tmp_path / 'here') == files(tmp_path / 'there')


STOPPING = """
import sys
from tetra_ros2.cli import main
from tetra_ros2.signals import INTERRUPTED, OWN_GROUP
from tetra_ros2.study import montecarlo

compute = montecarlo.compute

def compute_one_part(*arguments):
    def advance():
        print('kept', flush=True)
        sys.stdin.read()  # here it stays until a signal comes
    compute(*arguments[:-1], advance)

montecarlo.CHUNK = 20
montecarlo.compute = compute_one_part
if __name__ == '__main__':
    sys.exit(main())
"""


def test_a_study_goes_on_where_it_was_stopped(tmp_path, inline):
    whole, stopped = tmp_path / 'whole', tmp_path / 'stopped'

    def parts():
        return len(list(stopped.glob('parts/*.npz')))

    def stop(how, *resume):
        with subprocess.Popen(
                [sys.executable, '-c', STOPPING, 'study', '--starts', '60', '--workers', '1',
                 '--quiet', '--out', stopped, *resume], **OWN_GROUP, text=True,
                env={**os.environ, 'PYTHONPATH': str(TOP)}, stdin=subprocess.PIPE,
                stdout=subprocess.PIPE, stderr=subprocess.DEVNULL) as process:
            assert process.stdout.readline() == 'kept\n'
            os.killpg(process.pid, how)
            return process.wait(60.0)

    assert stop(signal.SIGKILL) == -signal.SIGKILL
    assert parts() == 1
    assert stop(signal.SIGINT, '--resume') == INTERRUPTED
    assert parts() == 2
    assert not (stopped / 'results.parquet').exists()
    assert run(stopped, '--starts', '60', '--resume') == 0
    assert run(whole, '--starts', '60') == 0
    assert files(stopped) == files(whole)


@pytest.mark.parametrize('moment', [0.2, 0.6, 1.0, 1.5, 2.0, 3.0])
def test_ctrl_c_at_any_moment_ends_all_processes_without_a_traceback(tmp_path, moment):
    with subprocess.Popen(
            [sys.executable, '-m', 'tetra_ros2', 'study', '--starts', '200000', '--workers', '3',
             '--out', tmp_path / 'a'], **OWN_GROUP, text=True,
            env={**os.environ, 'PYTHONPATH': str(TOP)},
            stdout=subprocess.PIPE, stderr=subprocess.STDOUT) as process:
        time.sleep(moment)  # what is tested is the moment, whatever may be going on in it
        os.killpg(process.pid, signal.SIGINT)
        # The end of the output is the end of every process that could write to it.
        output, _ = process.communicate(timeout=DEADLINE)
    assert 'tetra_ros2/' not in '\n'.join(re.findall('File ".*', output)), output
    if 'Traceback' not in output:  # of Python itself, before it has read a line of this package
        assert process.returncode in (INTERRUPTED, -signal.SIGINT), output


def test_workers_end_with_the_process_that_was_called(tmp_path):
    with subprocess.Popen(
            [sys.executable, '-c', STOPPING, 'study', '--starts', '60', '--workers', '1',
             '--quiet', '--out', tmp_path / 'a'], **OWN_GROUP, text=True,
            env={**os.environ, 'PYTHONPATH': str(TOP)}, stdin=subprocess.PIPE,
            stdout=subprocess.PIPE, stderr=subprocess.STDOUT) as process:
        assert process.stdout.readline() == 'kept\n'
        process.kill()
        output, _ = process.communicate(timeout=DEADLINE)  # until the last of them has ended
        assert 'Traceback' not in output


@pytest.mark.parametrize('formed', [60, 0])
def test_what_is_printed_has_eighty_columns(capsys, formed):
    name, starts = 'spinning_dodecahedron_exponential', 10**7
    command._print({'cases': [{
        'name': name, 'starts': starts, 'formed': formed,
        'fraction_above_with_95_percent': 0.9999997,
        'time_to_form': dict.fromkeys(('0.5', '0.95', '0.999', '1'), 123.45) if formed else {},
        'histogram': {'counts': [1] * 40 if formed else [], 'edges': [0.0, 500.0]}}]}, 'out')
    lines = capsys.readouterr().out.splitlines()
    assert lines[0] == name
    assert max(map(len, lines)) <= 80


def test_wrong_calls_leave_nothing_behind(tmp_path, capsys, inline):
    out = tmp_path / 'a'
    assert '--starts' in error_of(capsys, '--out', out, '--starts', '0')
    assert 'gain.kind' in error_of(capsys, '--out', out, '--gain', 'cosin')
    assert 'no such file' in error_of(capsys, '--out', out, '--config', 'nowhere.yaml')
    assert 'twice' in error_of(capsys, '--out', out, '--gain', 'cosine', '--gain', 'cosine')
    five = tmp_path / 'five.yaml'
    five.write_text('/**:\n  ros__parameters:\n    topology: {n: 5}\n')
    assert 'no shape is known' in error_of(capsys, '--out', out, '--config', five)
    assert 'there is no study' in error_of(capsys, '--out', out, '--resume')
    assert not out.exists()
    assert 'cannot be written' in error_of(capsys, '--out', '/proc/nowhere')


def test_another_study_is_not_overwritten_or_gone_on_with(tmp_path, capsys, inline):
    run(tmp_path / 'a', *ARGUMENTS)
    before = files(tmp_path / 'a')
    capsys.readouterr()
    assert 'exists already' in error_of(capsys, '--out', tmp_path / 'a', *ARGUMENTS)
    assert 'its seed differs' in error_of(
        capsys, '--out', tmp_path / 'a', *ARGUMENTS, '--seed', '1', '--resume')
    assert files(tmp_path / 'a') == before
