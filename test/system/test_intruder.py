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

"""One message of an intruder costs that message: it ends no node, and keeps no true one out."""

from contextlib import contextmanager, nullcontext
from itertools import count
import math
from threading import Event, Thread

from builtin_interfaces.msg import Time
from geometry_msgs.msg import PoseArray, TwistStamped, Vector3Stamped
from hypothesis import given, HealthCheck, settings
from hypothesis import strategies as st
from node_bench import Bench
import pytest
from rcl_interfaces.srv import SetParameters
from rclpy.parameter import Parameter
from rosgraph_msgs.msg import Clock
from tetra_ros2.launcher import Launcher
from tetra_ros2.nodes.agent import Agent
from tetra_ros2.nodes.monitor import Monitor
from tetra_ros2.nodes.plant import Plant
from tetra_ros2.ros.executor import spin_some
from tetra_ros2.wire import cdr

LAST = (2**31 - 1) * 10**9 + 999_999_999
SEEN = 'agent_1/relative_attitude/agent_2'


def measurement(stamp, direction=(0.0, 1.0, 0.0)):
    return bytes(cdr.vector3_stamped('agent_1').encode(stamp, *direction))


def command(stamp, rate=(0.0, 5.0, 0.0)):
    return bytes(cdr.twist_stamped('agent_1').encode(stamp, 0.0, 0.0, 0.0, *rate))


def test_a_measurement_of_the_last_second_there_is_ends_no_agent(probe):
    probe.listen(TwistStamped, 'agent_1/cmd_vel')
    with Bench(probe, Agent, 1, topology__n=2, measurement_timeout=0.05, rate=100.0) as bench:
        publisher = bench.publisher(Vector3Stamped, SEEN)
        bench.wait_for(lambda: bench.node.count_subscribers('agent_1/cmd_vel'), 'the probe')
        bench.rejects(publisher, measurement(LAST), 'impossible stamp')
        publisher.publish(measurement(10**9))
        bench.wait_for(lambda: bench.node.answers == 1, 'an answer to the next one')
        bench.wait_for(lambda: bench.node.stops, 'its stop, when nothing comes any more')


@pytest.fixture(params=['realtime', 'lockstep'])
def formation(request):
    with Launcher('complete', mode=request.param, seed=3, parameters={
            'plant:real_time_factor': 1.0}) as running:
        assert running.run_until(lambda: running.error < 1e-3, timeout=30.0)
        yield running


@contextmanager
def over_and_over(say):
    """Call a function every few milliseconds meanwhile, in a thread of its own."""
    enough = Event()

    def speaker():
        while not enough.wait(0.003):
            say()

    thread = Thread(target=speaker)
    thread.start()
    try:
        yield
    finally:
        enough.set()
        thread.join()


def speak(formation, probe, kind, topic, message, times=1, rest=nullcontext):
    """
    Let somebody else say something on a topic of a formation that runs.

    :param rest: is entered, with a function that says it once more, while time passes after it
    """
    hearers = [s for node in formation.nodes for s in node.inputs if s.topic_name == f'/{topic}']
    assert hearers
    before = [s.get_publisher_count() for s in hearers]
    publisher = probe.node.create_publisher(kind, topic, 10)
    try:
        # Each end learns of the other by itself; a message in between would be lost.
        probe.wait_for(
            lambda: formation.run_for(0.01) and publisher.get_subscription_count() >= len(hearers)
            and all(s.get_publisher_count() > k for s, k in zip(hearers, before)), topic)
        for _ in range(times):
            publisher.publish(message())
            with rest(lambda: publisher.publish(message())):
                formation.run_for(0.05)
    finally:
        probe.node.destroy_publisher(publisher)
        probe.wait_for(lambda: formation.run_for(0.01) and before == [
            s.get_publisher_count() for s in hearers], 'its end')


@pytest.mark.parametrize('ahead', [0.02, 0.45, 5.0, 3600.0, 3e8])
def test_a_measurement_from_the_future_blinds_no_agent(formation, probe, ahead):
    agent = formation.agents[1]

    def forged():
        return measurement(formation.plant.stepper.stamp + round(1e9 * ahead))

    partial, stops = agent.partial_answers, agent.stops
    speak(formation, probe, Vector3Stamped, SEEN, forged, times=3)
    formation.run_for(0.5)
    assert agent.stops == stops, 'it was never blind'
    assert agent.partial_answers - partial <= 3 * 3
    assert formation.run_until(lambda: formation.error < 1e-3, timeout=5.0)


@pytest.mark.parametrize('ahead', [2e-9, 0.01, 0.45, 5.0])
def test_a_command_that_answers_no_measurement_yet_made_moves_nobody(formation, probe, ahead):
    def forged():
        # Far enough ahead to stay so until it arrives.
        return command(formation.plant.stepper.stamp + round(1e9 * ahead) + 200_000_000)

    for _ in range(5):
        before = formation.plant.health.rejected.total()
        # In real time the plant reads, once a step, the command that came last.
        speak(formation, probe, TwistStamped, 'agent_1/cmd_vel', forged, times=3,
              rest=over_and_over)
        if formation.plant.health.rejected.total() > before:
            break
        # The machine is so busy that all came too late, and were not ahead any more.
        assert formation.run_until(lambda: formation.error < 1e-3, timeout=30.0)
    else:
        pytest.fail('none was refused')
    assert any('future' in reason for reason in formation.plant.health.rejected)
    assert formation.error < 1e-3


def test_a_body_that_two_command_is_held_still_if_that_is_wished_for(probe):
    with Launcher('complete', mode='realtime', seed=3, parameters={
            'plant:on_publisher_conflict': 'hold'}) as formation:
        assert formation.run_until(lambda: formation.error < 1e-3, timeout=30.0)
        publisher = probe.node.create_publisher(TwistStamped, 'agent_1/cmd_vel', 10)
        probe.wait_for(lambda: formation.run_for(0.05) and formation.plant.held_agents() == 1,
                       'the plant to see it')
        at = formation.plant.bodies.attitudes[0]
        for _ in range(10):
            publisher.publish(command(formation.plant.stepper.stamp))
            formation.run_for(0.05)
        assert formation.plant.bodies.attitudes[0] == at
        level, message, _ = formation.plant.assess()
        assert 'held still, more than one publisher: agent_1' in message
        assert level != b'\0'
        probe.node.destroy_publisher(publisher)
        probe.wait_for(lambda: formation.run_for(0.05) and not formation.plant.held_agents(),
                       'the plant to see that it is gone')


def test_an_agent_that_two_tell_what_it_sees_holds_still_if_that_is_wished_for(probe):
    with Launcher('complete', mode='realtime', seed=3, parameters={
            'agent:on_publisher_conflict': 'hold'}) as formation:
        formation.run_for(0.2)
        publisher = probe.node.create_publisher(Vector3Stamped, SEEN, 10)
        agent = formation.agents[1]
        probe.wait_for(lambda: formation.run_for(0.05) and agent.stops > 2, 'its stops')
        answers = agent.answers
        formation.run_for(0.2)
        assert agent.answers == answers
        probe.node.destroy_publisher(publisher)
        probe.wait_for(lambda: formation.run_for(0.05) and agent.answers > answers, 'its return')


@pytest.mark.parametrize('at', ['a measurement', 'a timer'])
def test_what_a_callback_raises_is_counted_reported_and_survived(probe, monkeypatch, at):
    with Bench(probe, Agent, 1, topology__n=2) as bench:
        publisher = bench.publisher(Vector3Stamped, SEEN)
        stamps = count(1)

        def publish():
            publisher.publish(measurement(next(stamps) * 10**6))

        def reported():
            # Each report tells of what was survived since the one before.
            if at == 'a measurement':
                publish()
            return 'survived ZeroDivisionError' in bench.node.health.message

        with monkeypatch.context() as failing:
            method = {'a measurement': 'angular_velocity', 'a timer': 'forget'}[at]
            failing.setattr(bench.node._controller, method, lambda **_: 1 / 0)
            bench.wait_for(reported, 'the report')
            assert bench.node.health.exceptions > 0
            assert not bench.node.answers
        publish()
        bench.wait_for(lambda: bench.node.answers, 'the next answer')


def test_bytes_that_rclpy_itself_cannot_read_end_no_node(probe):
    with Bench(probe, Plant, mode='realtime', seed=1, use_sim_time=True) as bench:
        publisher = probe.node.create_publisher(Clock, '/clock', 10)
        bench.wait_for(lambda: publisher.get_subscription_count() > 0, 'the plant on /clock')
        for message in (b'', b'\0\1\0\0', b'\xff' * 3):
            publisher.publish(message)
        for k in range(1, 4):
            true = Clock(clock=Time(sec=k))
            bench.wait_for(lambda true=true, k=k: publisher.publish(true)
                           or bench.node.get_clock().now().nanoseconds == k * 10**9, 'the time')


def test_what_the_executor_raises_costs_no_node(probe):
    with Bench(probe, Plant, mode='realtime', seed=1) as bench:

        class Failing:
            """An executor that cannot take a request."""

            context, get_nodes = bench.context, bench.executor.get_nodes

            def spin_until_future_complete(self, *_args, **_kwargs):
                raise RuntimeError('failed to take a request')

        spin_some(Failing(), None)
        assert bench.node.health.exceptions == 1
        steps = bench.node.stepper.steps
        bench.wait_for(lambda: bench.node.stepper.steps > steps, 'the next step')


stamps = st.one_of(st.integers(0, LAST), st.sampled_from([0, 1, LAST, 2**31 * 10**9 - 1]))
numbers = st.one_of(st.floats(), st.sampled_from([0.0, 1.0, -1.0, math.nan, math.inf, 1e308]))
bytes_of = st.one_of(
    st.binary(max_size=300),
    st.builds(lambda s, x, y, z: measurement(s, (x, y, z)), stamps, numbers, numbers, numbers),
    st.builds(lambda s, x, y, z: command(s, (x, y, z)), stamps, numbers, numbers, numbers),
    st.builds(lambda s, xs: bytes(cdr.pose_array('world', 4).encode(s, *xs)), stamps,
              st.lists(numbers, min_size=28, max_size=28)))


@pytest.mark.parametrize(('node_type', 'arguments', 'kind', 'topic'), [
    (Agent, (1,), Vector3Stamped, SEEN), (Plant, (), TwistStamped, 'agent_1/cmd_vel'),
    (Monitor, (), PoseArray, 'formation/attitudes')])
def test_whatever_bytes_come_a_node_lives_and_its_state_is_finite(
        probe, node_type, arguments, kind, topic):
    with Bench(probe, node_type, *arguments) as bench:
        publisher = bench.publisher(kind, topic)

        @settings(max_examples=150, suppress_health_check=list(HealthCheck))
        @given(bytes_of)
        def fuzz(message):
            publisher.publish(message)
            bench.wait_for(lambda: True, 'a turn')

        fuzz()
        bench.wait_for(lambda: True, 'the rest')
        assert bench.node.health.exceptions == 0, 'each was understood, or refused for a reason'
        if node_type is Plant:
            numbers = [x for q in bench.node.bodies.attitudes for x in q]
            assert all(map(math.isfinite, numbers))


def test_whatever_parameter_is_set_a_node_lives(probe):
    with Bench(probe, Plant, mode='realtime', seed=1) as bench:
        client = probe.node.create_client(SetParameters, 'plant/set_parameters')
        bench.wait_for(client.service_is_ready, 'the service')

        @settings(max_examples=40, suppress_health_check=list(HealthCheck))
        @given(st.sampled_from(['rate', 'gain.a', 'gain.kind', 'mode', 'seed', 'no_such',
                                'on_publisher_conflict', 'command_timeout']),
               st.one_of(numbers, st.text(max_size=20), st.booleans(), st.integers(-10, 10)))
        def fuzz(name, value):
            message = Parameter(name, value=value).to_parameter_msg()
            future = client.call_async(SetParameters.Request(parameters=[message]))
            bench.wait_for(future.done, 'an answer')
            if name == 'rate' and not (isinstance(value, (int, float)) and value > 1.0):
                assert isinstance(value, bool) or not future.result().results[0].successful \
                    or 1e-3 <= value <= 1e5

        fuzz()
        bench.node.set_parameters([Parameter('rate', value=100.0)])
        steps = bench.node.stepper.steps
        bench.wait_for(lambda: bench.node.stepper.steps > steps, 'it steps on')
        assert bench.node.health.exceptions == 0
