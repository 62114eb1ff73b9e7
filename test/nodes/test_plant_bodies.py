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

"""The plant with bodies that have mass: nodes over DDS, and what it tells of its joints."""

import math

import harness
import numpy as np
import pytest
from rclpy.task import Future
from sensor_msgs.msg import JointState
from std_srvs.srv import SetBool
from tetra_ros2.config.configuration import load
from tetra_ros2.formation import rotation
from tetra_ros2.formation.simulation import SampledLoop
from tetra_ros2.launcher import Launcher

pytest.importorskip('mujoco')

from tetra_ros2.physics.bodies import make_bodies  # noqa: E402
from tetra_ros2.physics.settings import Physics, RateLoop  # noqa: E402
from tetra_ros2.ros.executor import spin_some  # noqa: E402
from visualization_msgs.msg import Marker, MarkerArray  # noqa: E402


def spin(run):
    spin_some(run.executor, Future(executor=run.executor), timeout=0.01)


@pytest.mark.parametrize('body', ['wheels', 'gimbal'])
def test_in_lockstep_the_nodes_are_the_sampled_loop_with_physics_to_the_last_bit(body):
    given = {'plant:rate_loop.bandwidth': 30.0, 'plant:gyro.noise': 0.01, 'plant:gyro.bias': 0.01}
    with Launcher('rotating', seed=5, body=body, parameters=given) as run:
        start = run.plant._vehicles.draw(np.random.default_rng(5))
        run.run_for(0.5)
        steps, ended = run.plant.stepper.steps, run.plant.bodies.attitudes[:]
        formation = run.formation
    axes = formation.pointing_axes
    twin = SampledLoop(start, axes, formation.topology, formation.gain)
    twin.bodies = make_bodies(start, axes, Physics(
        body, loop=RateLoop(30.0, noise=0.01, bias=0.01), seed=5))
    twin.advance(0.01, steps)
    assert steps >= 50
    assert twin.bodies.attitudes == ended


@pytest.mark.parametrize('body', ['wheels', 'gimbal'])
def test_a_rotating_formation_with_mass_forms_and_spins_at_the_predicted_rate(body):
    with Launcher('rotating', seed=3, body=body, parameters={'plant:physics_rate': 500.0}) as run:
        run.run_for(14.0)
        summary = run.summary()
    assert summary.formed
    assert summary.measured.rate == pytest.approx(1.0 / math.sqrt(3.0), rel=3e-3)


def test_joints_and_what_is_at_a_limit_are_told(probe):
    probe.listen(JointState, 'agent_2/joint_states')
    given = {'plant:wheels.torque_limit': 0.005}
    with Launcher('complete', seed=1, body='wheels', parameters=given) as run:
        told = [run.plant.count_publishers(f'agent_{i}/joint_states') for i in range(1, 5)]
        assert told == [1, 1, 1, 1]
        received = probe.received['agent_2/joint_states']
        while not received:  # DDS has to find the probe
            run.run_for(0.02)
            probe.executor.spin_once(timeout_sec=0.02)
        run.plant.reset()  # the wheels saturate at the start, which is long past by now
        received.clear()
        run.run_for(0.2)
        probe.wait_for(lambda: any(map(any, (m.effort for m in received))), 'torques')
        message = received[-1]
        assert list(message.name) == ['wheel_x', 'wheel_y', 'wheel_z']
        assert message.header.frame_id == 'agent_2'
        assert len(message.position) == len(message.velocity) == len(message.effort) == 3
        assert max(map(abs, message.effort)) <= 0.005
        trouble, figures = run.plant._vehicles.assess()
        assert 'agent_2: torque' in trouble
        assert figures['saturated steps of agent_2'] > 10


@pytest.mark.parametrize('body', ['wheels', 'gimbal'])
def test_bodies_are_shown_as_they_look_where_they_point_and_looking_changes_nothing(body, probe):
    probe.listen(MarkerArray, 'formation/bodies')
    received = probe.received['formation/bodies']
    ends = []
    for watched in (True, False):
        with Launcher('complete', seed=1, body=body, parameters={
                'plant:real_time_factor': 1.0 if watched else 0.0}) as run:
            run.run_for(0.1)
            if watched:
                probe.wait_for(lambda run=run: spin(run) or received, 'markers')
            run.run_for(0.4)
            ends.append(run.plant.bodies.attitudes[:])
    assert ends[0] == ends[1]
    markers = received[-1].markers
    assert {m.ns for m in markers} == {'body_1', 'body_2', 'body_3', 'body_4'}
    arcs = {Marker.LINE_STRIP} if body == 'gimbal' else set()  # how far the joints can go
    assert {m.type for m in markers} == {Marker.CUBE, Marker.CYLINDER} | arcs
    box = next(m for m in markers if m.ns == 'body_2' and (m.id == 0) == (body == 'wheels')
               and m.type == Marker.CUBE)
    place = np.array([box.pose.position.x, box.pose.position.y, box.pose.position.z])
    assert np.linalg.norm(place) == pytest.approx(1.25, abs=0.15)


def test_the_emergency_stop_holds_all_bodies_until_it_is_released(probe):
    given = {'plant:real_time_factor': 1.0}
    with Launcher('rotating', seed=2, parameters=given) as run:
        run.run_for(0.5)
        run.plant.stepper.run_until(10**15)
        client = probe.node.create_client(SetBool, 'plant/stop')

        def call(data):
            probe.wait_for(lambda: spin(run) or client.service_is_ready(), 'the service')
            future = client.call_async(SetBool.Request(data=data))
            probe.wait_for(lambda: spin(run) or future.done(), 'an answer')
            assert future.result().success

        call(True)
        held = run.plant.bodies.attitudes[:]
        answers = run.agents[1].answers
        probe.wait_for(lambda: spin(run) or run.agents[1].answers > answers + 20, 'commands')
        assert run.plant.bodies.attitudes == held
        run.plant.health.report()
        assert 'emergency stop' in run.plant.health.message
        call(False)
        probe.wait_for(lambda: spin(run) or run.plant.bodies.attitudes != held, 'motion')


def test_random_starts_of_gimbals_are_within_their_limits():
    given = {'plant:gimbal.tilt_limits': [-0.5, 0.5]}
    with Launcher('complete', seed=8, body='gimbal', parameters=given) as run:
        elevation = np.array(run.plant.bodies.reduced)[:, 2]
        assert np.all(np.abs(elevation) <= math.sin(0.5) + 1e-12)
        run.plant.randomize()
        assert np.any(np.array(run.plant.bodies.reduced)[:, 2] != elevation)


UP = rotation.between(np.array([1.0, 0.0, 0.0]), np.array([0.0, 0.0, 1.0])).tolist()


@pytest.mark.parametrize(('parameters', 'message'), [
    ('{body: wheels, wheels: {inertia: 0.0}}', 'wheels.inertia: 0.0 is not valid'),
    ('{body: wheels, wheels: {body_inertia: [1.0, 1.0, 3.0]}}',
     'wheels.body_inertia: .*none above the sum'),
    ('{body: wheel}', "body: 'wheel' is not valid .did you mean 'wheels'"),
    ('{body: nowhere.xml}', r"body: 'nowhere.xml' is not valid, expected kinematic"),
    ('{body: gimbal, gimbal: {tilt_limits: [1.0, -1.0]}}', 'gimbal.tilt_limits: .*lower and an'),
    (f'{{body: gimbal, gimbal: {{tilt_limits: [-1.0, 1.0]}}, initial_attitudes: {UP * 4}}}',
     'initial_attitudes: agent 1 starts where the limits of the gimbal'),
    ('{body: wheels, physics_rate: 10.0}', 'rate_loop.bandwidth: 100 is not valid'),
    ('{external_bodies: [5], mode: realtime}', 'external_bodies: there is no agent 5 among 4'),
    ('{external_bodies: [4]}', 'external_bodies: .*not valid in lockstep'),
    ('{poses: {topic: /pose}}', 'poses.topic: .*expected a topic with'),
])
def test_bodies_that_cannot_be_are_refused_in_one_line(tmp_path, parameters, message):
    file = tmp_path / 'bodies.yaml'
    file.write_text(f'/**/plant:\n  ros__parameters: {parameters}\n')
    with pytest.raises(ValueError, match=message) as caught:
        Launcher(load(file).path)
    assert '\n' not in str(caught.value)


def test_a_wrong_body_ends_the_command_with_status_2_and_one_line():
    status, output, errors = harness.run('launcher', '--body', 'no.xml')
    assert status == 2
    assert output == ''
    assert errors.count('\n') == 1
    assert errors.startswith("tetra: error: body: 'no.xml' is not valid")
