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

"""Bad messages on the wire: dropped, counted, reported, and never part of the state."""

import math
import time

from builtin_interfaces.msg import Time
from geometry_msgs.msg import PoseArray, TwistStamped, Vector3Stamped
from harness import nanoseconds, Probe
from node_bench import Bench
import numpy as np
import pytest
from rclpy.parameter import Parameter
from tetra_ros2.nodes.agent import Agent
from tetra_ros2.nodes.monitor import Monitor
from tetra_ros2.nodes.plant import Plant
from tetra_ros2.ros.executor import spin_some
from tetra_ros2.wire import cdr

NAN, INF = math.nan, math.inf
REPORT = 'diagnostics'


def measurement(vector, frame='agent_1', stamp=(5, 0)):
    message = Vector3Stamped()
    message.header.stamp = Time(sec=stamp[0], nanosec=stamp[1])
    message.header.frame_id = frame
    message.vector.x, message.vector.y, message.vector.z = map(float, vector)
    return message


def command(vector, frame='agent_1', stamp=None):
    message = TwistStamped()
    message.header.frame_id = frame
    if stamp is not None:
        message.header.stamp = stamp
    angular = message.twist.angular
    angular.x, angular.y, angular.z = map(float, vector)
    return message


def test_an_agent_drops_bad_measurements_and_answers_good_ones(probe):
    probe.listen(TwistStamped, 'agent_1/cmd_vel')
    from diagnostic_msgs.msg import DiagnosticArray
    probe.listen(DiagnosticArray, REPORT)
    with Bench(probe, Agent, 1, topology__n=2, measurement_timeout=math.inf,
               rate=0.01) as bench:
        publisher = bench.publisher(Vector3Stamped, 'agent_1/relative_attitude/agent_2')
        bench.wait_for(lambda: bench.node.count_subscribers('agent_1/cmd_vel'), 'the probe')
        publisher.publish(measurement([0.0, 1.0, 0.0]))
        bench.wait_for(lambda: probe.received['agent_1/cmd_vel'], 'an answer')
        for bad, reason in (
                (measurement([NAN, 0.0, 0.0]), 'not finite'),
                (measurement([0.0, INF, 0.0]), 'not finite'),
                (measurement([0.0, -INF, INF]), 'not finite'),
                (measurement([1.1, 0.0, 0.0]), 'not a unit vector'),
                (measurement([0.0, 0.0, 0.0]), 'not a unit vector'),
                (measurement([1e300, 1e300, 0.0]), 'not a unit vector'),
                (measurement([0.0, 1.0, 0.0], frame='agent_2'), 'wrong frame'),
                (measurement([0.0, 1.0, 0.0], frame='world'), 'wrong frame'),
                (measurement([0.0, 1.0, 0.0], frame='x' * 500), 'wrong frame'),
                (measurement([0.0, 1.0, 0.0], stamp=(4, 999_999_999)), 'old stamp')):
            bench.rejects(publisher, bad, reason)
        assert len(probe.received['agent_1/cmd_vel']) == 1, 'no answer to any of these'
        publisher.publish(measurement([0.0, 0.0, 1.0], stamp=(5, 1)))
        bench.wait_for(lambda: len(probe.received['agent_1/cmd_vel']) == 2, 'the second answer')
        answer = probe.received['agent_1/cmd_vel'][-1]
        w = answer.twist.angular
        # -f(pi/2) b x y = -(1, 0, 0) x (0, 0, 1) = (0, 1, 0)
        np.testing.assert_allclose([w.x, w.y, w.z], [0.0, 1.0, 0.0], atol=1e-15)
        assert nanoseconds(answer.header.stamp) == 5_000_000_001
        bench.is_reported()


def test_an_agent_answers_partial_news_and_stops_when_a_neighbour_falls_silent(probe):
    probe.listen(TwistStamped, 'agent_1/cmd_vel')
    with Bench(probe, Agent, 1, topology__n=3, measurement_timeout=0.6, rate=20.0) as bench:
        second, third = (bench.publisher(
            Vector3Stamped, f'agent_1/relative_attitude/agent_{j}') for j in (2, 3))
        bench.wait_for(lambda: bench.node.count_subscribers('agent_1/cmd_vel'), 'the probe')
        answers = probe.received['agent_1/cmd_vel']
        second.publish(measurement([0.0, 1.0, 0.0], stamp=(7, 0)))
        third.publish(measurement([0.0, 0.0, 1.0], stamp=(6, 0)))
        partial = bench.wait_for(lambda: answers and answers[-1], 'a partial answer')
        assert nanoseconds(partial.header.stamp) == 6_000_000_000, 'as old as its oldest part'
        stop = bench.wait_for(
            lambda: (w := answers[-1].twist.angular).x == w.y == w.z == 0.0 and answers[-1],
            'a stop')
        assert nanoseconds(stop.header.stamp) == 7_000_000_001
        status = bench.wait_for(
            lambda: bench.node.assess()[1].startswith('stopped') and bench.node.assess(), 'it')
        assert 'agent_2' in status[1]
        assert 'agent_3' in status[1]
        node = bench.node
        bench.wait_for(lambda: node.stops and len(answers) == (
            node.answers + node.partial_answers + node.stops), 'all commands counted')
        # Whoever speaks next is welcome, even with a clock that was started again.
        second.publish(measurement([0.0, 1.0, 0.0], stamp=(1, 0)))
        third.publish(measurement([0.0, 0.0, 1.0], stamp=(1, 0)))
        bench.wait_for(lambda: nanoseconds(answers[-1].header.stamp) == 1_000_000_000
                       and answers[-1].twist.angular.y != 0.0, 'an answer to the new clock')


@pytest.mark.parametrize('mode', ['lockstep', 'realtime'])
def test_the_plant_drops_bad_commands_and_its_state_does_not_move(probe, mode):
    from diagnostic_msgs.msg import DiagnosticArray
    probe.listen(DiagnosticArray, REPORT)
    probe.listen_to_attitudes()
    with Bench(probe, Plant, mode=mode, seed=1, command_timeout=math.inf) as bench:
        publisher = bench.publisher(TwistStamped, 'agent_1/cmd_vel')
        bench.wait_for(probe.stamp, 'a state')
        start = bench.node.bodies.attitudes[:]
        now = probe.received['formation/attitudes'][-1].header.stamp
        for bad, reason in (
                (command([NAN, 0.0, 0.0], stamp=now), 'not finite'),
                (command([0.0, INF, 0.0], stamp=now), 'not finite'),
                (command([1e300, 0.0, 0.0], stamp=now), 'faster than'),
                (command([1e200, 1e200, 1e200], stamp=now), 'faster than'),
                (command([0.0, 0.0, 1001.0], stamp=now), 'faster than'),
                (command([0.0, 1.0, 0.0], frame='agent_2', stamp=now), 'wrong frame'),
                (command([0.0, 1.0, 0.0], frame='base', stamp=now),
                 "wrong frame: 'base', expected 'agent_1'")):
            bench.rejects(publisher, bad, reason)
        if mode == 'lockstep':
            later = Time(sec=now.sec + 1000, nanosec=0)
            bench.rejects(publisher, command([0.0, 1.0, 0.0], stamp=later), 'stamp from the')
        assert bench.node.bodies.attitudes == start
        publisher.publish(command([0.0, 1.0, 0.0], stamp=now))
        if mode == 'realtime':
            bench.wait_for(lambda: bench.node.bodies.attitudes != start, 'motion')
            old = Time(sec=now.sec - 1, nanosec=0)
            bench.rejects(publisher, command([0.0, 9.0, 0.0], stamp=old), 'old stamp')
            assert bench.node.stepper._rates[0] == (0.0, 1.0, 0.0)
        assert np.all(np.isfinite(bench.node.bodies.attitudes))
        bench.is_reported()


def test_an_agent_whose_sensors_are_not_synchronous_answers_once_it_has_seen_all(probe):
    probe.listen(TwistStamped, 'agent_1/cmd_vel')
    with Bench(probe, Agent, 1, topology__n=4, measurement_timeout=30.0, rate=50.0) as bench:
        cameras = [bench.publisher(Vector3Stamped, f'agent_1/relative_attitude/agent_{j}')
                   for j in (2, 3, 4)]
        bench.wait_for(lambda: bench.node.count_subscribers('agent_1/cmd_vel'), 'the probe')
        for k, camera in enumerate(cameras):
            camera.publish(measurement([0.0, 1.0, 0.0], stamp=(5 + k, 0)))
            bench.wait_for(lambda k=k: bench.node.measurements == k + 1, 'the measurement')
            for _ in range(2):  # several ticks pass between two cameras
                bench.node._on_tick()
                assert bench.node._state[0] != b'\x02', 'there is nothing to be stopped for yet'
        answer = bench.wait_for(
            lambda: probe.received['agent_1/cmd_vel'] and probe.received['agent_1/cmd_vel'][-1],
            'an answer')
        assert nanoseconds(answer.header.stamp) == 5_000_000_000
        # -3 f(pi/2) b x y = -3 (1, 0, 0) x (0, 1, 0) = (0, 0, -3)
        w = answer.twist.angular
        np.testing.assert_allclose([w.x, w.y, w.z], [0.0, 0.0, -3.0], atol=1e-15)


def test_a_second_plant_is_reported_by_those_who_hear_it(probe):
    with Bench(probe, Monitor) as bench:
        publishers = [bench.publisher(PoseArray, 'formation/attitudes') for _ in range(2)]
        bench.wait_for(lambda: bench.node.inputs[0].get_publisher_count() == 2, 'both')
        assert bench.node.publisher_conflicts() == ['/formation/attitudes']
        status = None

        def told():
            nonlocal status
            status = probe.health('/monitor')
            return status and 'more than one publisher' in status.message

        from diagnostic_msgs.msg import DiagnosticArray
        probe.listen(DiagnosticArray, REPORT)
        bench.wait_for(told, 'the report')
        assert publishers


def test_a_parameter_cannot_be_deleted(probe):
    with Bench(probe, Agent, 1) as bench:
        result, = bench.node.set_parameters([Parameter('gain.a')])
        assert not result.successful
        assert 'cannot be deleted' in result.reason
        result, = bench.node.set_parameters([Parameter('gain.a', value=2.0)])
        assert result.successful
        assert bench.node._controller.gain.a == 2.0


def test_in_real_time_a_plant_pauses_once_when_its_duration_is_over(probe):
    with Bench(probe, Plant, mode='realtime', seed=1, duration=0.3) as bench:
        bench.wait_for(lambda: bench.node.stepper.paused, 'the end')
        bench.node.stepper.pause(False)
        result, = bench.node.set_parameters([Parameter('max_angular_velocity', value=50.0)])
        assert result.successful
        stamp = bench.node.stepper.stamp
        bench.wait_for(lambda: bench.node.stepper.stamp > stamp + 500_000_000, 'half a second')
        assert not bench.node.stepper.paused


def test_a_reset_in_real_time_publishes_the_initial_state_and_forgets_the_commands(probe):
    start = [0.0, 0.0, 0.0, 1.0] * 4
    with Bench(probe, Plant, mode='realtime', initial_attitudes=start,
               command_timeout=100.0) as bench:
        probe.listen_to_attitudes()
        publisher = bench.publisher(TwistStamped, 'agent_1/cmd_vel')
        stamp = bench.wait_for(
            lambda: probe.stamp() and probe.received['formation/attitudes'][-1].header.stamp,
            'a state')
        publisher.publish(command([0.0, 1.0, 0.0], stamp=stamp))
        bench.wait_for(lambda: probe.attitudes()[0][1] > 0.01, 'motion')
        before = bench.node.stepper.stamp  # states of before may still be on their way
        bench.node.reset()
        bench.wait_for(lambda: probe.stamp() > before + 50_000_000, 'states')
        assert np.all(probe.attitudes() == np.array(start).reshape(4, 4))


def test_a_command_that_waits_to_be_read_at_a_reset_is_forgotten_too(probe):
    start = [0.0, 0.0, 0.0, 1.0] * 4
    with Bench(probe, Plant, mode='realtime', initial_attitudes=start,
               command_timeout=100.0) as bench:
        plant = bench.node
        bench.wait_for(lambda: plant.stepper.steps, 'a step')
        waiting = [cdr.twist_stamped('agent_1').encode(plant.stepper.stamp, 0, 0, 0, 0, 1.0, 0)]
        plant._commands[0] = (
            lambda: (waiting.pop(), {}) if waiting else None, plant._commands[0][1])
        plant.reset()
        steps = plant.stepper.steps
        bench.wait_for(lambda: plant.stepper.steps > steps, 'a step')
        assert not waiting
        assert not plant.health.rejected
        assert np.all(np.array(plant.bodies.attitudes) == np.array(start).reshape(4, 4))


@pytest.mark.parametrize(('mode', 'called'), [('lockstep', 4), ('realtime', 0)])
def test_an_executor_is_called_for_commands_only_where_somebody_waits_for_them(
        probe, mode, called):
    with Bench(probe, Plant, mode=mode, seed=1) as bench:
        assert len(bench.node.inputs) == 4
        assert len({*bench.node.inputs} & {*bench.node.subscriptions}) == called


def test_the_plant_in_real_time_holds_an_agent_still_when_its_command_is_old(probe):
    with Bench(probe, Plant, mode='realtime', seed=1, command_timeout=0.2) as bench:
        probe.listen_to_attitudes()
        publisher = bench.publisher(TwistStamped, 'agent_2/cmd_vel')
        bench.wait_for(probe.stamp, 'a state')
        stamp = probe.received['formation/attitudes'][-1].header.stamp
        publisher.publish(command([0.0, 0.0, 1.0], frame='agent_2', stamp=stamp))
        bench.wait_for(lambda: bench.node.stepper._rates[1] != (0.0, 0.0, 0.0), 'the command')
        since = bench.node.stepper.stamp
        bench.wait_for(lambda: bench.node.stepper.stamp > since + 300_000_000, 'the time-out')
        still = bench.node.bodies.attitudes[1]
        bench.wait_for(lambda: bench.node.stepper.stamp > since + 500_000_000, 'more time')
        assert bench.node.bodies.attitudes[1] == still
        assert 'agent_2' in bench.node.assess()[1]


def test_the_plant_takes_best_effort_commands(probe):
    from rclpy.qos import qos_profile_sensor_data
    with Bench(probe, Plant, mode='realtime', seed=1, command_timeout=math.inf) as bench:
        probe.listen_to_attitudes()
        publisher = probe.node.create_publisher(
            TwistStamped, 'agent_1/cmd_vel', qos_profile_sensor_data)
        bench.wait_for(publisher.get_subscription_count, 'the subscription')
        start = bench.node.bodies.attitudes[0]
        bench.wait_for(probe.stamp, 'a state')

        def moved():
            stamp = probe.received['formation/attitudes'][-1].header.stamp
            publisher.publish(command([0.0, 1.0, 0.0], stamp=stamp))
            return bench.node.bodies.attitudes[0] != start

        bench.wait_for(moved, 'motion')


def test_the_monitor_drops_bad_states(probe):
    with Bench(probe, Monitor) as bench:
        publisher = bench.publisher(PoseArray, 'formation/attitudes')

        def state(stamp, *, n=4, frame='world', x=0.6):
            message = PoseArray()
            message.header.stamp = Time(sec=stamp)
            message.header.frame_id = frame
            from geometry_msgs.msg import Pose
            for _ in range(n):
                pose = Pose()
                pose.position.x, pose.position.y = x, 0.8
                message.poses.append(pose)
            return message

        publisher.publish(state(5))
        bench.wait_for(lambda: bench.node.observer.count == 1, 'the first')
        for bad, reason in ((state(4), 'old stamp'), (state(6, frame='map'), 'wrong frame'),
                            (state(6, n=3), 'malformed'), (state(6, x=NAN), 'not finite'),
                            (state(6, x=0.7), 'not a unit vector')):
            bench.rejects(publisher, bad, reason)
        assert bench.node.observer.stamp == 5_000_000_000
        deadline = time.monotonic() + 30.0
        while bench.node.observer.stamp != 1_000_000_000:
            # A plant that was started again, with a clock that was, is believed after a while.
            assert time.monotonic() < deadline
            publisher.publish(state(1))
            spin_some(bench.executor, bench._never, timeout=0.05)


def test_quality_of_service_follows_the_standard_override_parameters():
    with Probe() as probe, Bench(
            probe, Agent, 1, **{
                'qos_overrides./agent_1/cmd_vel.publisher.reliability': 'best_effort'}) as bench:
        info, = bench.wait_for(
            lambda: probe.node.get_publishers_info_by_topic('agent_1/cmd_vel'), 'the agent')
        assert info.qos_profile.reliability.name == 'BEST_EFFORT'
        info, = bench.wait_for(lambda: probe.node.get_subscriptions_info_by_topic(
            'agent_1/relative_attitude/agent_2'), 'the other topics')
        assert info.qos_profile.reliability.name == 'RELIABLE', 'overrides do not leak'
        # Those of all topics would double the time that a large formation takes to start.
        declared = {name for name in bench.node._parameters if name.startswith('qos_overrides')}
        assert declared == {f'qos_overrides./agent_1/cmd_vel.publisher.{policy}'
                            for policy in ('depth', 'history', 'reliability')}
