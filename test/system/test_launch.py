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

"""The launch file under the real ``ros2 launch``, where there is one."""

from contextlib import suppress
import os
from pathlib import Path
import re
import shutil
import signal
import subprocess
import sys
import time

from harness import DEADLINE, NOT_COVERED
import pytest
from tetra_ros2.signals import OWN_GROUP

pytest.importorskip('launch_ros', reason='ros2 launch comes with ROS 2, and is not among wheels')
from rcl_interfaces.srv import GetParameters  # noqa: E402
from sensor_msgs.msg import JointState  # noqa: E402
from tetra_ros2.physics import settings  # noqa: E402

EARLY = (0.1, 0.3, 0.6, 1.2, 2.4)
"""Moments after the start of the nodes [s], from modules that load to a formation that moves."""


class Launch:
    """One ``ros2 launch`` of a colcon workspace, with all that it prints."""

    def __init__(self, workspace, *arguments, prefix=()):
        environment = {k: v for k, v in os.environ.items() if k != 'PYTHONPATH'}
        environment.setdefault('AMENT_PREFIX_PATH', sys.prefix)
        environment.setdefault('ROS_DISTRO', 'jazzy')
        environment['ROS_LOG_DIR'] = str(workspace / 'ros_log')
        environment['PATH'] = f'{Path(sys.executable).parent}:{environment["PATH"]}'
        self.process = subprocess.Popen(
            ['bash', '-c', '. install/setup.bash && exec "$@"', 'bash', *prefix,
             'ros2', 'launch', *map(str, arguments)],
            cwd=workspace, env=environment, text=True, **OWN_GROUP,
            stdout=subprocess.PIPE, stderr=subprocess.STDOUT)
        self.output = ''

    def wait_for(self, text):
        """Read what it prints up to a line with this text."""
        while text not in self.output:
            line = self.process.stdout.readline()
            assert line, f'{text!r} was never printed:\n{self.output}'
            self.output += line

    def __enter__(self):
        return self

    def __exit__(self, *_):
        """End what is left, which is nothing unless the test has failed."""
        if self.process.poll() is None:
            os.killpg(self.process.pid, signal.SIGKILL)
        self.process.communicate()

    def interrupt(self):
        """Do what Ctrl-C in a terminal does: signal all processes at once."""
        os.killpg(self.process.pid, signal.SIGINT)

    def interrupt_nodes(self):
        """
        Signal all nodes once more, and not ``ros2 launch``.

        Each SIGINT raises KeyboardInterrupt in whatever that is doing. Where it is taking note of
        the end of a process, it forgets that, and waits for the process for good: 4 of some 30
        launches that got ten signals (https://github.com/ros2/launch/issues/207).
        """
        for pid in self.pids():
            with suppress(ProcessLookupError):
                os.kill(pid, signal.SIGINT)

    def pids(self):
        """Return the nodes' processes, of those whose start has been read."""
        return [int(pid) for pid in re.findall(r'process started with pid \[(\d+)\]', self.output)]

    def end(self):
        """Wait for the end, and return the exit status."""
        try:
            rest, _ = self.process.communicate(timeout=DEADLINE)
        except subprocess.TimeoutExpired as error:
            self.output += (error.output or b'').decode()
            left = subprocess.run(
                ['ps', '-eL', '-o', 'pgid,pid,tid,stat,wchan:24,args'],
                capture_output=True, text=True, check=False).stdout
            left = '\n'.join(line for line in left.splitlines()
                             if line.split()[0] in {'PGID', str(self.process.pid)})
            pytest.fail(f'it did not end; what is left:\n{left}\n{self.output}', pytrace=False)
        self.output += rest
        return self.process.returncode

    def assert_clean(self, early=False):
        """
        Assert that no process of it is left, and that none died of anything but order.

        :param early: whether Python itself may still have been starting, before it has read a
            line of this package; what it says of a signal then is not ours
        """
        if early:
            assert not re.search('File .*site-packages/tetra_ros2/', self.output), self.output
            died = set(re.findall(r'exit code (-?\d+)', self.output))
            assert died <= {'-2', '1', '255'}, self.output
        else:
            assert 'Traceback' not in self.output, self.output
            assert 'process has died' not in self.output, self.output
        deadline = time.monotonic() + 5.0
        for pid in self.pids():
            while not has_ended(pid):  # it has closed its output, and the rest takes a moment
                assert time.monotonic() < deadline, self.output
                time.sleep(0.01)


def has_ended(pid):
    """Return whether a process has; it may wait for whoever has it now to take note of that."""
    try:
        return Path(f'/proc/{pid}/stat').read_text().rpartition(')')[2].split()[0] in 'XZ'
    except (FileNotFoundError, ProcessLookupError):
        return True


def launch(workspace, *arguments, **kwargs):
    """Start the launch file that ships."""
    assert shutil.which('ros2', path=f'{Path(sys.executable).parent}:{os.environ["PATH"]}')
    return Launch(workspace, 'tetra_ros2', 'formation.launch.py', *arguments, **kwargs)


def parameters(probe, node, *names):
    """Return parameters of a node."""
    response = probe.call(GetParameters, f'{node}/get_parameters',
                          GetParameters.Request(names=list(names)))
    return [value.string_value or value.integer_value for value in response.values]


def wait_for_all_nodes(probe):
    """Wait until no process is in its first lines, where a signal is the interpreter's."""
    nodes = {'plant', 'monitor', 'agent_1', 'agent_2', 'agent_3', 'agent_4'}
    probe.wait_for(lambda: nodes <= set(probe.node.get_node_names()), 'all nodes')


def test_mode_and_seed_come_before_what_the_configuration_says(workspace, probe):
    with launch(workspace, 'config:=rotating', 'mode:=realtime', 'seed:=11') as started:
        assert parameters(probe, 'plant', 'mode', 'seed') == ['realtime', 11]
        wait_for_all_nodes(probe)
        started.interrupt()
        started.end()
        started.assert_clean()


@pytest.mark.parametrize('body', ['wheels', 'gimbal', 'file'])
def test_bodies_with_mass_turn_under_the_launch_file(workspace, probe, tmp_path, body):
    models = pytest.importorskip('tetra_ros2.physics.models', reason='MuJoCo is not installed')
    if body == 'file':
        body = tmp_path / 'own.xml'
        body.write_text(models.wheels_xml(settings.Wheels()))
    with launch(workspace, 'config:=rotating', 'seed:=11', f'body:={body}') as started:
        assert parameters(probe, 'plant', 'body', 'seed') == [str(body), 11]
        probe.listen(JointState, 'agent_2/joint_states')
        received = probe.received['agent_2/joint_states']
        probe.wait_for(lambda: received and any(received[-1].velocity), 'joints that move')
        wait_for_all_nodes(probe)
        started.interrupt()
        started.end()
        started.assert_clean()


def test_a_node_without_a_name_in_a_launch_file_of_ones_own_takes_changes(
        workspace, probe, tmp_path):
    file = tmp_path / 'own.launch.py'
    file.write_text(
        'from launch import LaunchDescription\nfrom launch_ros.actions import Node\n'
        'from tetra_ros2.config.share import shipped\n\n\n'
        'def generate_launch_description():\n'
        "    return LaunchDescription([Node(package='tetra_ros2', executable='plant',\n"
        "        parameters=[str(shipped()['rotating']), {'mode': 'realtime', 'seed': 5}])])\n")
    with Launch(workspace, file) as started:
        assert parameters(probe, 'plant', 'mode', 'seed') == ['realtime', 5]
        started.interrupt()
        started.end()
        started.assert_clean()


@pytest.mark.parametrize(('argument', 'fragments'), [
    ('mode:=fast', ['"mode"', '"fast"', 'realtime']),
    ('seed:=x', ['seed', "'x'", 'integer']),
    ('seed:=-2', ['seed', "'-2'", 'integer']),
    ('rviz:=maybe', ['"rviz"', '"maybe"', 'true']),
    ('rviz:=true', ['rviz2 is not installed', 'apt install']),
    ('config:=rotatin', ["did you mean 'rotating'"]),
    ('namespace:=a b', ['namespace', "'a b'"]),
    ('record:=.', ['record', 'exists already']),
    ('body:=wheel', ['body', "'wheel' is not valid", "did you mean 'wheels'"]),
    ('body:=nowhere.xml', ['body', "'nowhere.xml' is not valid", 'MJCF file']),
])
def test_a_wrong_argument_is_named_before_any_node_starts(workspace, argument, fragments):
    if argument == 'rviz:=true' and shutil.which('rviz2'):
        pytest.skip('rviz2 is installed')
    with launch(workspace, argument) as started:
        assert started.end() == 1
        assert all(fragment in started.output for fragment in fragments), started.output
        assert 'process started' not in started.output
        assert 'Traceback' not in started.output


def test_a_plant_that_dies_ends_the_launch(workspace, probe):
    with launch(workspace) as started:
        parameters(probe, 'plant', 'mode')
        started.wait_for('[plant-1]: process started')
        os.kill(started.pids()[-1], signal.SIGKILL)
        started.end()
        assert 'process[plant-1] was required' in started.output
        for pid in started.pids():
            assert not Path(f'/proc/{pid}').exists(), started.output


@pytest.mark.parametrize('moment', EARLY)
def test_ctrl_c_in_a_terminal_ends_all_nodes_cleanly(workspace, moment):
    with launch(workspace) as started:
        started.wait_for('[agent-6]: process started')
        time.sleep(moment)  # what is tested is the moment, whatever may be going on in it
        started.interrupt()
        started.end()
        started.assert_clean(early=True)


@pytest.mark.parametrize('moment', EARLY)
def test_timeout_ends_all_nodes_cleanly(workspace, moment):
    with launch(workspace, prefix=('timeout', '-s', 'INT', '60')) as started:
        started.wait_for('[agent-6]: process started')
        time.sleep(moment)
        started.process.send_signal(signal.SIGALRM)  # its 60 s are over
        assert started.end() == 124
        started.assert_clean(early=True)


@NOT_COVERED
def test_many_signals_while_it_ends_do_no_harm(workspace, probe):
    with launch(workspace) as started:
        probe.listen_to_attitudes()
        probe.wait_for(lambda: probe.stamp() > 1e9, 'a second')
        wait_for_all_nodes(probe)
        started.wait_for('[agent-6]: process started')
        started.interrupt()
        for _ in range(9):
            time.sleep(0.05)  # as fast as a person can
            started.interrupt_nodes()
        started.end()
        started.assert_clean()
