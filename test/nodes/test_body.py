# Copyright 2026 The tetra_ros2 authors
# SPDX-License-Identifier: Apache-2.0

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
