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

"""The driver of a body as a node: a serial gimbal in a formation, unplugged, stopped, silent."""

import math
import re
import time

from diagnostic_msgs.msg import DiagnosticArray
from geometry_msgs.msg import PoseStamped, TwistStamped
import harness
from harness import interrupt, Processes
import numpy as np
import pytest
from std_srvs.srv import SetBool

pytest.importorskip('dynamixel_sdk')

from tetra_ros2.drivers.simulated_bus import SimulatedBus  # noqa: E402

THETA = math.acos(-1.0 / 3.0)


@pytest.fixture
def programs():
    with Processes() as started:
        yield started


@pytest.fixture
def bus(tmp_path):
    with SimulatedBus(tmp_path / 'gimbal', (0.3, -0.2)) as made:
        yield made


def error(probe):
    if not probe.received['formation/attitudes']:
        return math.inf
    gamma = probe.reduced_attitudes()
    i, j = np.triu_indices(4, 1)
    angles = np.arccos(np.clip(np.sum(gamma[i] * gamma[j], axis=1), -1.0, 1.0))
    return float(np.max(np.abs(angles - THETA)))


def start(programs, bus, *more):
    return programs.tetra('body', '--id', 4, '--driver', 'pan_tilt', '--option',
                          f'port={bus.path}', *more)


def test_a_serial_gimbal_forms_with_simulated_bodies_is_held_when_unplugged_and_comes_back(
        probe, programs, bus):
    body = start(programs, bus)
    probe.listen_to_attitudes()
    probe.listen(DiagnosticArray, 'diagnostics')
    programs.tetra('launcher', '--config', 'complete', '--mode', 'realtime', '--duration', '300',
                   '--ros-args', '-p', 'external_bodies:=[4]', '-p', 'seed:=3')
    probe.wait_for(lambda: error(probe) < 5e-3, 'a tetrahedron')
    bus.unplug()
    unplugged_at = time.monotonic()
    probe.wait_for_health('/body_4', lambda s: 'the body is lost' in s.message, 'loss')
    probe.wait_for_health('/plant', lambda s: 'agent_4: no recent pose' in s.message, 'lost pose')
    probe.wait_for(lambda: time.monotonic() - unplugged_at > 5.0, 'five seconds')
    held = probe.reduced_attitudes()
    seen = len(probe.received['formation/attitudes'])
    probe.wait_for(lambda: len(probe.received['formation/attitudes']) > seen + 50, 'states')
    assert np.array_equal(probe.reduced_attitudes(), held)  # who does not know where it is, rests
    bus.servos[1].position += 0.5  # somebody has moved it meanwhile
    bus.plug()
    probe.wait_for_health('/body_4', lambda s: s.message == 'turning as commanded', 'return')
    probe.wait_for(lambda: error(probe) < 5e-3, 'a tetrahedron again')
    status, _ = interrupt(body)
    assert status == 0
    probe.wait_for(lambda: bus.servos[1].velocity == bus.servos[2].velocity == 0.0, 'rest')


def test_a_gimbal_that_can_go_no_further_says_so_and_the_others_go_on(probe, programs, bus):
    start(programs, bus, '--option', 'pan_limits=[0.25, 0.35]', '--option',
          'tilt_limits=[-0.25, -0.15]')
    programs.tetra('launcher', '--config', 'rotating', '--mode', 'realtime', '--duration', '300',
                   '--ros-args', '-p', 'external_bodies:=[4]', '-p', 'seed:=3',
                   # On a busy machine poses come late now and then, and nobody's fault.
                   '-p', 'poses.timeout:=2.0')
    probe.wait_for_health('/body_4', lambda s: 'at a limit' in s.message, 'the limit')
    probe.wait_for_health('/agent_4', lambda s: s.message == 'answering', 'commands')
    # Longer than the time-out encoders say the same: that is a limit, and nothing frozen.
    probe.listen(PoseStamped, 'agent_4/pose')
    poses = probe.received['agent_4/pose']
    probe.wait_for(lambda: len(poses) > 300 and poses[-1].pose == poses[-300].pose, 'rest')
    reports = len(probe.received['diagnostics'])
    probe.wait_for(lambda: len(probe.received['diagnostics']) > reports + 20, 'reports')
    for name, right in (('/plant', 'running'), ('/agent_1', 'answering')):
        assert probe.health(name).message == right
    assert not any('frozen' in status.message for array in probe.received['diagnostics']
                   for status in array.status)


FAILING = """
import math
from pathlib import Path

class Gimbal:
    def __init__(self, notes):
        self.notes = Path(notes)

    def note(self, word):
        with self.notes.open('a') as file:
            file.write(f'{word} ')

    def apply(self, angular_velocity, dt):
        x, y, z = angular_velocity
        self.note('held' if y == 0.0 else 'turned')
        if y > 0.5:
            1.0 / 0.0

    def attitude(self):
        return (math.nan, 0.0, 0.0, 1.0) if 'turned' in self.notes.read_text() else (0, 0, 0, 1)

    def close(self):
        self.note('closed')
"""


def test_a_driver_of_ones_own_that_fails_is_held_reported_and_tried_again(
        probe, programs, tmp_path):
    (tmp_path / 'my_gimbal.py').write_text(FAILING)
    notes = tmp_path / 'notes'
    programs.python(
        '-c', 'import os, sys; os.chdir(sys.argv.pop(1)); sys.path.remove(""); '
        'from tetra_ros2.cli import main; sys.exit(main(sys.argv[1:]))', tmp_path, 'body',
        '--id', 4, '--driver', 'my_gimbal:Gimbal', '--option', f'notes={notes}')
    probe.listen(PoseStamped, 'agent_4/pose')
    poses = probe.received['agent_4/pose']
    probe.wait_for(lambda: poses, 'a pose')
    publisher = probe.node.create_publisher(TwistStamped, 'agent_4/cmd_vel', 1)
    probe.wait_for(lambda: publisher.get_subscription_count(), 'the body')
    sent = [0]

    def keep(rate):
        sent[0] += 1
        command(probe, publisher, sent[0], y=rate)

    probe.wait_for(lambda: keep(0.2) or 'turned' in notes.read_text(), 'motion')
    probe.listen(DiagnosticArray, 'diagnostics')
    probe.wait_for(lambda: keep(0.2) or ((status := probe.health('/body_4')) and
                   'not finite (attitude() of the driver)' in status.message), 'the report')
    probe.wait_for(lambda: keep(0.9) or ((status := probe.health('/body_4')) and re.search(
        r'lost: ZeroDivisionError: .*my_gimbal.py, line \d+', status.message)), 'the loss')
    assert 'turned held closed' in notes.read_text()
    probe.wait_for(lambda: keep(0.2) or probe.health('/body_4').level == b'\0' or
                   probe.health('/body_4').message.startswith('turning'), 'the body back')
    assert all(math.isfinite(p.pose.orientation.x) for p in poses)


def command(probe, publisher, stamp, x=0.0, y=0.0, z=0.0):
    message = TwistStamped()
    message.header.stamp.sec, message.header.frame_id = stamp, 'agent_4'
    message.twist.angular.x, message.twist.angular.y, message.twist.angular.z = x, y, z
    publisher.publish(message)


def test_silence_speed_and_the_emergency_stop_hold_the_body(probe, programs, bus):
    start(programs, bus, '--ros-args', '-p', 'max_angular_velocity:=2.0')
    probe.listen(PoseStamped, 'agent_4/pose')
    probe.listen(DiagnosticArray, 'diagnostics')
    publisher = probe.node.create_publisher(TwistStamped, 'agent_4/cmd_vel', 1)
    probe.wait_for(lambda: publisher.get_subscription_count(), 'the body')
    tilt = bus.servos[2]
    sent = [0]

    def keep(rate):
        sent[0] += 1
        command(probe, publisher, sent[0], y=rate)

    probe.wait_for(lambda: keep(0.5) or tilt.velocity > 0.0, 'motion')
    probe.wait_for(lambda: tilt.velocity == 0.0, 'holding in silence')
    probe.wait_for(lambda: keep(0.5) or tilt.velocity > 0.0, 'motion again')
    probe.wait_for(lambda: keep(5.0) or tilt.velocity == 0.0, 'holding at speed')
    probe.wait_for(lambda: keep(0.5) or tilt.velocity > 0.0, 'motion again')
    status, output, _ = harness.run('stop')
    assert (status, output) == (0, '/body_4/stop: stopped\n')
    for _ in range(20):
        keep(0.5)
        probe.executor.spin_once(timeout_sec=0.01)
    assert tilt.velocity == 0.0
    probe.wait_for_health('/body_4', lambda s: s.message == 'emergency stop', 'report')
    probe.call(SetBool, 'body_4/stop', SetBool.Request(data=False))
    probe.wait_for(lambda: keep(-0.5) or tilt.velocity < 0.0, 'motion when released')
    assert probe.received['agent_4/pose'][-1].header.frame_id == 'world'


def test_rate_set_points_are_published_for_a_bridge(probe, programs):
    programs.tetra('body', '--id', 2, '--driver', 'rate_setpoint', '--option',
                   'topic=mavros/setpoint_attitude/cmd_vel')
    probe.listen(TwistStamped, 'mavros/setpoint_attitude/cmd_vel')
    publisher = probe.node.create_publisher(TwistStamped, 'agent_2/cmd_vel', 1)
    probe.wait_for(lambda: publisher.get_subscription_count(), 'the body')
    message = TwistStamped()
    message.header.frame_id = 'agent_2'
    message.twist.angular.z = 0.25
    received = probe.received['mavros/setpoint_attitude/cmd_vel']

    def keep():
        message.header.stamp.sec += 1
        publisher.publish(message)
        return received and received[-1].twist.angular.z == 0.25

    probe.wait_for(keep, 'a set-point')
    assert received[-1].header.frame_id == 'base_link'
    probe.wait_for(lambda: received[-1].twist.angular.z == 0.0, 'zero in silence')


@pytest.mark.parametrize(('arguments', 'message'), [
    (('--driver', 'pan_tilt', '--option', 'port=/dev/no_such_port'),
     'driver: /dev/no_such_port: '),
    (('--driver', 'pan_tilt'), 'driver_options: PanTilt: .*port'),
    (('--driver', 'nothing'), 'driver: .nothing. is not valid, expected module:Class'),
    ((), 'driver: .. is not valid'),
])
def test_a_body_that_cannot_be_driven_is_refused_in_one_line(arguments, message):
    status, output, errors = harness.run('body', '--id', 1, *arguments)
    assert (status, output) == (2, '')
    assert errors.count('\n') == 1
    assert re.match(f'tetra: error: {message}', errors), errors


def test_with_nothing_to_stop_it_is_said():
    status, output, errors = harness.run('stop', '--namespace', 'nobody')
    assert (status, output) == (1, '')
    assert errors == 'tetra: error: there is nothing to stop: no plant and no body was found\n'
