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

"""The command line as a person meets it: what it prints, what it refuses, how it ends."""

import itertools
import json
import os
from pathlib import Path
import re
import shlex
import signal
import subprocess
import sys
import time

from geometry_msgs.msg import PoseArray, TwistStamped, Vector3Stamped
from harness import DEADLINE, interrupt, NOT_COVERED, run
import pytest
from tetra_ros2 import cli
from tetra_ros2.cli import CLOSED
from tetra_ros2.commands import COMMANDS, EXAMPLES, NODES
from tetra_ros2.commands._parser import make_parser

ABOVE = '/**:\n  ros__parameters:\n    '


def modules_after(*arguments):
    """Return the modules that ``tetra`` has loaded when it ends."""
    code = ('import sys\nfrom tetra_ros2.cli import main\n'
            'try:\n    main()\nexcept SystemExit:\n    pass\n'
            'print(*sys.modules, sep="\\n")')
    return set(subprocess.run([sys.executable, '-c', code, *arguments], capture_output=True,
                              text=True, check=True).stdout.split())


def test_help_needs_neither_ros_nor_numpy():
    for arguments in (['--help'], ['launcher', '--help'], ['agent', '--help']):
        assert not modules_after(*arguments) & {'rclpy', 'numpy', 'yaml', 'rich'}


@pytest.mark.parametrize('command', ['agent', 'plant', 'monitor', 'recorder', 'launcher'])
def test_every_command_helps(command):
    status, output, _ = run(command, '--help')
    assert status == 0
    assert '--namespace' in output


@pytest.mark.parametrize(('arguments', 'fragments'), [
    ([], ['required: X']),
    (['lancher'], ["no command 'lancher'", "did you mean 'launcher'"]),
    (['help'], ["no command 'help'", 'tetra --help']),
    (['agent'], ['--id']),
    (['agent', '--id', 'one'], ['--id', "'one'"]),
    (['agent', '--id', '9', '--config', 'complete'], ['--id', '9', '1 to 4']),
    (['agent', '--id', '0'], ['--id', '0', '1 to 4']),
    (['agent', '--id', '9'], ['--id', '9', '1 to 4']),
    (['plant', '--config', 'nothing.yaml'], ['nothing.yaml', 'no such file', 'complete']),
    (['plant', '--config', 'rotatin'], ['rotatin', "did you mean 'rotating'"]),
    (['plant', '--ros-args', '-p', 'rate:=0.0'], ['rate', '0.0', 'from 0.001']),
    (['plant', '--ros-args', '-p', 'mode:=fast'], ['mode', "'fast'", 'lockstep, realtime']),
    (['plant', '--ros-args', '-p', 'initial_attitudes:=[1.0, 0.0]'],
     ['initial_attitudes', '2 numbers', '16 for 4 agents']),
    (['plant', '--ros-args', '-p', 'rate:=['], ['--ros-args', 'rate:=[']),
    (['monitor', '--namespace', 'a b'], ['a b']),
    (['launcher', '--config', 'nothing'], ['nothing', 'no such file']),
    (['launcher', '--duration', '-1'], ['--duration', '-1.0']),
    (['launcher', '--duration', 'nan'], ['--duration', 'nan']),
    (['launcher', '--seed', '-5'], ['seed', '-5']),
    (['launcher', '--mode', 'slow'], ['--mode', "'slow'"]),
    (['launcher', '--namespace', 'a b'], ['--namespace', "'a b'"]),
    (['launcher', '--without', 'agent_7'], ['--without', "'agent_7'", 'agent_4']),
    (['launcher', '--ros-args', '-p', 'gain.kind:=cosin'], ["did you mean 'cosine'"]),
    (['launcher', '--ros-args', '-p', 'gain.a:=-1.0'], ['gain.a', '-1.0']),
    (['launcher', '--ros-args', '-p', 'gain.k:=2'], ['gain.k', 'no such parameter']),
    (['plant', '--ros-args', '-p', 'rat:=50.0'], ['-p rat', "did you mean 'rate'"]),
    (['plant', '--ros-args', '--params-file', 'nothing.yaml'], ['nothing.yaml', 'cannot be read']),
    (['plant', '--ros-args', '-p', 'mode:=realtime', '-p', 'command_timeout:=0.001'],
     ['command_timeout', 'two periods']),
    (['plant', '--ros-args', '-p', 'use_sim_time:=1'], ['use_sim_time']),
    (['plant', '--namespace', 'x' * 300], ['--namespace', '150 characters']),
    (['recorder', '--regex', '('], ['regex', "'('"]),
    (['recorder', '--storage', 'tape'], ['--storage', "'tape'"]),
])
def test_a_wrong_call_is_refused_in_one_line(arguments, fragments):
    status, output, errors = run(*arguments)
    assert status == 2, errors
    line, = (text for text in errors.splitlines() if text.startswith('tetra: error: '))
    assert all(fragment in line for fragment in fragments), line
    assert 'Traceback' not in errors
    assert not output


@pytest.mark.parametrize(('text', 'fragments'), [
    (ABOVE + 'topology: {kind: wheel}', ['topology.kind', "'wheel'", 'complete']),
    (ABOVE + 'topology: {kind: rotating, k: 5}', ['topology.k', '5', 'from 1 to 4']),
    (ABOVE + 'topology: {kind: rotating, p: 2}', ['topology.p', '2', 'from 0 to 1']),
    (ABOVE + 'gain: {kind: sine}', ['gain.kind', "'sine'"]),
    (ABOVE + 'gain: {a: -1.0}', ['gain.a', '-1.0']),
    (ABOVE + 'gain: {a: .nan}', ['gain.a', 'nan']),
    ('/**/plant:\n  ros__parameters: {rate: 0}', ['rate', '0']),
    (ABOVE + 'topology: {kind: custom, edges: ["1>2"]}', ['topology.edges[0]', "'1>2'"]),
    (ABOVE + 'topology: {kind: custom, edges: ["1 9"]}', ['topology.edges[0]', 'no agent 9']),
    (ABOVE + 'topologie: {kind: complete}', ['topologie.kind', "did you mean 'topology.kind'"]),
    (ABOVE + 'pointing_axis: [1.0, 0.0]', ['pointing_axis', '2 numbers', '12']),
    (ABOVE + 'pointing_axis: [0.0, 0.0, 0.0]', ['pointing_axis', 'not zero']),
    (ABOVE + 'gain: [', ['is not YAML', 'line 3']),
])
@pytest.mark.parametrize('command', [['launcher'], ['plant'], ['agent', '--id', '1']])
def test_a_wrong_file_is_refused_with_file_key_and_value(tmp_path, command, text, fragments):
    file = tmp_path / 'formation.yaml'
    file.write_text(text)
    status, output, errors = run(*command, '--config', file)
    assert status == 2
    assert errors.startswith(f'tetra: error: {file}: ')
    assert errors.count('\n') == 1, errors
    assert all(fragment in errors for fragment in fragments), errors
    assert not output


def test_an_agent_that_sees_nobody_is_allowed_and_said(tmp_path):
    file = tmp_path / 'formation.yaml'
    file.write_text(ABOVE + 'topology: {kind: custom, n: 3, edges: ["1 2", "2 1"]}\n    '
                    'gain: {kind: exponential, a: 3.0}')
    status, output, errors = run('launcher', '--config', file, '--duration', '40', '--json')
    assert 'agents that see nobody, and are not waited for: 3' in errors
    assert status == 0, errors
    assert json.loads(output)['formed'] is True


def test_the_summary_tells_a_person_what_happened():
    status, output, _ = run('launcher', '--config', 'rotating', '--duration', '15')
    assert status == 0
    for fragment in ('regular tetrahedron', 'predicted  0.577350 rad/s', 'clockwise about',
                     'agent_1', 'seed 7', '9 edges'):
        assert fragment in output, output


def test_the_summary_tells_a_program_what_happened():
    status, output, _ = run('launcher', '--config', 'complete', '--duration', '15', '--json',
                            '--seed', '3')
    assert status == 0
    summary = json.loads(output)
    assert summary['formed'] is True
    assert summary['error'] < 1e-6
    assert summary['plant'] == {'mode': 'lockstep', 'rate': 100.0, 'seed': 3, 'steps': 1500}
    assert summary['measured']['period'] is None, 'infinite, at rest'


def test_the_exit_status_is_1_if_it_does_not_form_in_time():
    status, output, _ = run('launcher', '--duration', '0.5')
    assert status == 1
    assert 'formed     no' in output


def test_a_parameter_on_the_command_line_comes_before_the_file():
    status, output, _ = run('launcher', '--config', 'rotating', '--duration', '1', '--json',
                            '--ros-args', '-p', 'topology.k:=3', '-p', 'rate:=50')
    summary = json.loads(output)
    assert summary['topology']['k'] == 3
    assert summary['plant']['rate'] == 50.0
    assert status == 1


def test_ctrl_c_ends_the_launcher_with_a_summary(processes, probe):
    launcher = processes.tetra('launcher', '--duration', '1e6')
    probe.listen_to_attitudes()
    probe.wait_for(lambda: probe.stamp() > 5e9, 'five seconds')
    status, output = interrupt(launcher)
    assert status == 130
    assert 'interrupted after' in output
    assert 'regular tetrahedron' in output
    assert 'Traceback' not in output


@pytest.mark.parametrize('command', [
    ['launcher'], ['agent', '--id', '1'], ['plant'], ['monitor'], ['recorder']])
def test_without_ros_every_node_says_what_to_install(tmp_path, command):
    """Without rclpy and messages every command says what to install."""
    top = Path(__file__).resolve().parents[2]
    for name in ('rclpy', 'geometry_msgs', 'std_msgs', 'diagnostic_msgs', 'builtin_interfaces'):
        (tmp_path / f'{name}.py').write_text(
            f"raise ModuleNotFoundError('No module named {name}', name='{name}')\n")
    environment = {**os.environ, 'PYTHONPATH': f'{tmp_path}:{top}'}
    done = subprocess.run(
        [sys.executable, '-m', 'tetra_ros2', *command], env=environment, text=True,
        capture_output=True, timeout=DEADLINE, check=False)
    assert done.returncode == 2
    assert ' is not installed: source a ROS 2 installation' in done.stderr
    assert f"pip install -e '{top}[ros]'" in done.stderr
    assert 'Traceback' not in done.stderr


def test_the_version_is_said_with_the_place():
    status, output, _ = run('--version')
    assert status == 0
    top = Path(__file__).resolve().parents[2]
    assert output.startswith('tetra_ros2 ')
    assert str(top) in output


@pytest.mark.parametrize('command', COMMANDS)
def test_help_ends_with_calls_that_the_parser_takes(command):
    for line in EXAMPLES[command]:
        words = shlex.split(line, comments=True)
        if words[0] == 'eval':  # the call is in the shell's own hands
            words = shlex.split(words[1].strip('$()'))
        words = list(itertools.takewhile(lambda word: word not in ('>', '--ros-args'), words))
        assert words[:2] == ['tetra', command]
        assert make_parser(command).parse_args(words[1:]).command == command
    status, output, errors = run(command, '--help')
    assert status == 0, errors
    assert EXAMPLES[command][0] in output


@pytest.mark.parametrize('domain', ['300', '-1', 'abc'])
@pytest.mark.parametrize('command', [['launcher'], ['agent', '--id', '1']])
def test_a_domain_that_there_is_not_is_refused_in_one_line(monkeypatch, domain, command):
    monkeypatch.setenv('ROS_DOMAIN_ID', domain)
    status, _, errors = run(*command)
    assert status == 2
    assert errors == f"tetra: error: ROS_DOMAIN_ID: '{domain}' is not valid, expected an " \
                     'integer from 0 to 232\n'


def test_a_reader_that_has_read_enough_is_no_error():
    done = subprocess.run(
        ['bash', '-c', f'{sys.executable} -m tetra_ros2 verify --list | head -1; '
                       'exit ${PIPESTATUS[0]}'],
        capture_output=True, text=True, check=False, timeout=DEADLINE)
    assert done.stdout
    assert not done.stderr
    assert done.returncode in (0, CLOSED)  # the first, if it had said all before it was closed


def test_what_a_library_writes_to_the_output_does_not_spoil_a_result(tmp_path, monkeypatch):
    """Fast DDS logs there, by way of C; here a module does."""
    (tmp_path / 'loud.py').write_text(
        'import os\nfrom tetra_ros2.formation import Cosine\n'
        "os.write(1, b'said in C\\n')\nclass Loud(Cosine):\n    pass\n")
    file = tmp_path / 'formation.yaml'
    file.write_text(ABOVE + 'gain: {kind: "loud:Loud"}')
    monkeypatch.setenv('PYTHONPATH', str(tmp_path), prepend=os.pathsep)
    status, output, errors = run('analyze', '--config', file, '--json')
    assert (status, errors) == (0, 'said in C\n')
    assert json.loads(output)['shape'] == 'regular tetrahedron'


@pytest.mark.parametrize(('wished', 'expected'), [(None, '1'), ('2', '2')])
def test_the_algebra_of_small_matrices_has_one_thread_unless_more_are_wished_for(
        tmp_path, monkeypatch, wished, expected):
    (tmp_path / 'told.py').write_text(
        'import os, sys\nfrom tetra_ros2.formation import Cosine\nclass Told(Cosine):\n    pass\n'
        "print(os.environ['OPENBLAS_NUM_THREADS'], len(os.listdir('/proc/self/task')),\n"
        '      file=sys.stderr)\n')
    file = tmp_path / 'formation.yaml'
    file.write_text(ABOVE + 'gain: {kind: "told:Told"}')
    monkeypatch.setenv('PYTHONPATH', str(tmp_path), prepend=os.pathsep)
    monkeypatch.delenv('OPENBLAS_NUM_THREADS', raising=False)
    if wished:
        monkeypatch.setenv('OPENBLAS_NUM_THREADS', wished)
    status, _, errors = run('analyze', '--config', file, '--json')
    threads = min(int(expected), os.cpu_count())  # the one that runs it, and what numpy starts
    assert (status, errors) == (0, f'{expected} {threads}\n')


def test_an_output_that_is_closed_is_no_error():
    done = subprocess.run(
        ['bash', '-c', f'exec {sys.executable} -m tetra_ros2 analyze >&-'],
        capture_output=True, text=True, check=False, timeout=DEADLINE)
    assert (done.returncode, done.stderr) == (0, '')


def test_ctrl_c_before_the_first_state_ends_the_launcher_without_a_traceback(processes, probe):
    """Somebody else's plant is there and never says anything."""
    for i, j in itertools.permutations(range(1, 5), 2):
        probe.node.create_publisher(Vector3Stamped, f'agent_{i}/relative_attitude/agent_{j}', 1)
    for i in range(1, 5):
        probe.node.create_subscription(TwistStamped, f'agent_{i}/cmd_vel', lambda _: None, 1)
    probe.node.create_publisher(PoseArray, 'formation/attitudes', 1)
    launcher = processes.tetra('launcher', '--without', 'plant')
    probe.wait_for(lambda: probe.node.count_subscribers('formation/attitudes'), 'the monitor')
    status, output = interrupt(launcher)
    assert status == 130, output
    assert 'Traceback' not in output


@NOT_COVERED
@pytest.mark.parametrize('moment', [0.1, 0.3, 0.6, 1.0, 2.0])
@pytest.mark.parametrize('command', [['agent', '--id', '1'], ['launcher', '--duration', '1e6']])
def test_a_signal_at_any_moment_of_the_start_leaves_no_traceback_of_ours(
        processes, command, moment):
    process = processes.tetra(*command)
    time.sleep(moment)  # what is tested is the moment, whatever may be going on in it
    status, output = interrupt(process)
    # Until the first lines have set the handlers, a signal is the interpreter's.
    lines = Path(cli.__file__).with_name('__main__.py').read_text().splitlines()
    first = next(k for k, line in enumerate(lines, 1) if line.startswith('from tetra_ros2'))
    files = [line for line in re.findall('File ".*', output)
             if not any(f'tetra_ros2/__main__.py", line {k},' in line for k in range(first))]
    assert 'tetra_ros2/' not in '\n'.join(files), output
    if 'Traceback' not in output:  # of Python itself, before it has read a line of this package
        assert status == (130 if command[0] == 'launcher' else 0) or status == -signal.SIGINT


def test_what_a_node_is_is_known_before_the_commands_are_loaded():
    text = Path(cli.__file__).with_name('__main__.py').read_text()
    assert f'\nNODES = {NODES}\n' in text


@pytest.mark.parametrize('number', [signal.SIGINT, signal.SIGTERM])
@pytest.mark.parametrize('command', [['agent', '--id', '1'], ['launcher', '--duration', '1e6']])
def test_any_number_of_signals_does_no_harm(processes, probe, command, number):
    process = processes.tetra(*command)
    probe.wait_for(lambda: 'agent_1' in probe.node.get_node_names(), 'the node')
    for _ in range(20):
        process.send_signal(number)
        time.sleep(0.01)  # as fast as anybody can
    output, _ = process.communicate(timeout=DEADLINE)
    assert process.returncode in ((130, 1) if command[0] == 'launcher' else (0,)), output
    assert 'Traceback' not in output


def test_ctrl_c_while_the_launcher_waits_ends_it_without_a_word_of_rclpy(processes):
    process = processes.tetra('launcher', '--without', 'plant')
    lines = iter(process.stdout.readline, '')
    seen = [next(line for line in lines if 'waiting for plant' in line)]
    process.send_signal(signal.SIGINT)
    seen += lines
    assert process.wait(60.0) == 130
    assert not [line for line in seen if 'FATAL' in line or 'Traceback' in line]
