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

"""Whatever comes over DDS, on any topic, service or parameter: nodes live on and do their work."""

import math

from geometry_msgs.msg import PoseArray, TwistStamped, Vector3Stamped
from harness import nanoseconds
from hypothesis import given, settings
from hypothesis import strategies as st
from node_bench import Bench
import numpy as np
import pytest
from rcl_interfaces.msg import Parameter as ParameterMessage
from rcl_interfaces.msg import ParameterValue
from rcl_interfaces.srv import (
    DescribeParameters,
    GetParameters,
    GetParameterTypes,
    ListParameters,
    SetParameters,
    SetParametersAtomically,
)
from rclpy.parameter import Parameter
from rosgraph_msgs.msg import Clock
from std_msgs.msg import Float64MultiArray
from std_srvs.srv import SetBool, Trigger
from strategies import any_bytes, STRANGE
from tetra_ros2.config.parameters import check_parameters, PARAMETERS
from tetra_ros2.nodes.agent import Agent
from tetra_ros2.nodes.monitor import Monitor
from tetra_ros2.nodes.plant import Plant
from tetra_ros2.ros.executor import spin_some
from tetra_ros2.wire import cdr

PERIOD = 10_000_000
REST = [0.0, 0.0, 0.0, 1.0]


def stamps(now):
    """Return stamps of every kind: near, far, and such as no clock can give."""
    return st.one_of(
        st.integers(-3 * PERIOD, 3 * PERIOD).map(lambda d: max(now + d, 0)),
        st.integers(0, 2**31 * 10**9 - 1),
        st.sampled_from([0, 1, 2**31 * 10**9 - 1, (2**31 - 1) * 10**9 - 1]))


def fuzzed(test):
    """Run a test of one argument, ``data`` of hypothesis, with a number of examples."""
    settings(max_examples=25)(given(st.data())(test))()


def dropped(node):
    """Return how many messages the node has refused so far."""
    return node.health.rejected.total() + node.health.exceptions


def test_an_agent_answers_whatever_it_was_sent_before(probe):
    probe.listen(TwistStamped, 'agent_1/cmd_vel')
    answers = probe.received['agent_1/cmd_vel']
    codec = cdr.vector3_stamped('agent_1')
    now = 10**15
    with Bench(probe, Agent, 1, topology__n=3) as bench:
        node = bench.node
        speakers = [bench.publisher(Vector3Stamped, f'agent_1/relative_attitude/agent_{j}')
                    for j in (2, 3)]
        bench.wait_for(lambda: node.count_subscribers('agent_1/cmd_vel'), 'the probe')

        def send(slot, message):
            before = node.measurements + dropped(node)
            speakers[slot].publish(message)
            bench.wait_for(
                lambda: node.measurements + dropped(node) > before, f'any effect of {message}')

        def true_round():
            nonlocal now
            now += PERIOD
            before = node.answers
            for slot, direction in enumerate([(0.0, 1.0, 0.0), (0.0, 0.0, 1.0)]):
                send(slot, codec.encode(now, *direction))
            return node.answers > before

        assert true_round()

        def talk(data):
            for _ in range(data.draw(st.integers(1, 5))):
                good = codec.encode(data.draw(stamps(now)), 0.0, 1.0, 0.0)
                send(data.draw(st.integers(0, 1)), data.draw(any_bytes(good)))
            # At worst they spoke of another time with one voice, as a plant does that was set.
            assert any(true_round() for _ in range(3))
            answer = bench.wait_for(
                lambda: [a.twist.angular for a in answers if nanoseconds(a.header.stamp) == now],
                'the answer')[-1]
            # -f(pi/2) b x ((0, 1, 0) + (0, 0, 1)) = (0, 1, -1)
            np.testing.assert_allclose(
                [answer.x, answer.y, answer.z], [0.0, 1.0, -1.0], atol=1e-15)
            for w in (a.twist.angular for a in answers):
                assert math.hypot(w.x, w.y, w.z) < 4.01, 'no faster than the law can be'
            answers.clear()

        fuzzed(talk)
        assert node.health.rejected
        assert not node.health.exceptions


@pytest.mark.parametrize('mode', ['lockstep', 'realtime'])
def test_the_plant_moves_as_it_is_told_whatever_it_was_sent_before(probe, mode):
    codecs = [cdr.twist_stamped(f'agent_{i}') for i in (1, 2)]
    fastest = 10.0
    with Bench(probe, Plant, mode=mode, topology__n=2, initial_attitudes=2 * REST, rate=200.0,
               max_angular_velocity=fastest) as bench:
        plant = bench.node
        speakers = [bench.publisher(TwistStamped, f'agent_{i}/cmd_vel') for i in (1, 2)]
        bench.wait_for(lambda: plant.stepper.stamp, 'the first measurements')

        def move():
            """Tell both bodies to turn, and wait until they have."""
            steps, before = plant.stepper.steps, plant.bodies.attitudes[:]

            def moved():
                for speaker, codec in zip(speakers, codecs):
                    speaker.publish(codec.encode(plant.stepper.stamp, 0, 0, 0, 0, 0, 1.0))
                after = plant.bodies.attitudes
                return plant.stepper.steps > steps and all(
                    a != b for a, b in zip(before, after))

            bench.wait_for(moved, 'motion')

        def talk(data):
            for _ in range(data.draw(st.integers(1, 5))):
                stamp = data.draw(stamps(plant.stepper.stamp))
                i = data.draw(st.integers(0, 1))
                good = codecs[i].encode(stamp, 0, 0, 0, 0, 0, 1.0)
                speakers[i].publish(data.draw(any_bytes(good)))
                spin_some(bench.executor, bench._never, timeout=0.003)
            move()
            for q in plant.bodies.attitudes:
                assert math.fsum(x * x for x in q) == pytest.approx(1.0, abs=1e-12)

        fuzzed(talk)
        assert plant.health.rejected
        assert not plant.health.exceptions


def test_the_monitor_sees_whatever_it_was_sent_before(probe):
    probe.listen(Float64MultiArray, 'formation/cosines')
    cosines = probe.received['formation/cosines']
    codec = cdr.pose_array('world', 2)
    now = 10**15
    with Bench(probe, Monitor, topology__n=2) as bench:
        node = bench.node
        speaker = bench.publisher(PoseArray, 'formation/attitudes')
        bench.wait_for(lambda: node.count_subscribers('formation/cosines'), 'the probe')

        def poses(angle):
            return [1.0, 0.0, 0.0, *REST, math.cos(angle), math.sin(angle), 0.0, *REST]

        def seen():
            """Show it a true state; return whether that is what it publishes."""
            nonlocal now
            now += PERIOD
            angle = now / 1e9 % 3.0
            before = node.observer.stamp, dropped(node)
            speaker.publish(codec.encode(now, *poses(angle)))
            bench.wait_for(
                lambda: (node.observer.stamp, dropped(node)) != before, 'any effect')
            if node.observer.stamp != now:
                return False
            return bench.wait_for(
                lambda: cosines and abs(cosines[-1].data[0] - math.cos(angle)) < 1e-12, 'it')

        assert seen()

        def talk(data):
            for _ in range(data.draw(st.integers(1, 5))):
                good = codec.encode(data.draw(stamps(now)), *poses(1.0))
                speaker.publish(data.draw(any_bytes(good)))
            assert any(seen() for _ in range(10))

        fuzzed(talk)
        assert all(-1.01 < cosine < 1.01 for message in cosines for cosine in message.data)


words = st.text(st.characters(codec='utf-8', exclude_characters='\0'), max_size=9)
parameter_values = st.builds(
    ParameterValue, type=st.integers(0, 255), bool_value=st.booleans(),
    integer_value=st.integers(-2**63, 2**63 - 1), double_value=st.floats(), string_value=words,
    double_array_value=st.lists(st.floats(), max_size=3),
    string_array_value=st.lists(words, max_size=3))
parameter_messages = st.builds(
    ParameterMessage, name=st.one_of(words, st.sampled_from(['gain.a', 'rate', 'use_sim_time'])),
    value=parameter_values)
some_names = st.lists(st.one_of(words, st.just('gain.a')), max_size=3)
lists_of_parameters = st.lists(parameter_messages, max_size=3)
PARAMETER_SERVICES = {
    'set_parameters': (SetParameters, {'parameters': lists_of_parameters}),
    'set_parameters_atomically': (SetParametersAtomically, {'parameters': lists_of_parameters}),
    'get_parameters': (GetParameters, {'names': some_names}),
    'get_parameter_types': (GetParameterTypes, {'names': some_names}),
    'describe_parameters': (DescribeParameters, {'names': some_names}),
    'list_parameters': (
        ListParameters, {'prefixes': some_names, 'depth': st.integers(0, 2**64 - 1)})}
PLANT_SERVICES = {
    'reset': (Trigger, {}), 'randomize': (Trigger, {}),
    'pause': (SetBool, {'data': st.booleans()}), 'stop': (SetBool, {'data': st.booleans()})}


@pytest.mark.parametrize(('node_type', 'arguments'), [
    (Agent, (1,)), (Plant, ()), (Monitor, ())], ids=['agent', 'plant', 'monitor'])
def test_a_service_answers_whatever_it_is_asked(probe, node_type, arguments):
    services = PARAMETER_SERVICES | (PLANT_SERVICES if node_type is Plant else {})
    with Bench(probe, node_type, *arguments, topology__n=4) as bench:
        clients = {}
        for name, (kind, _) in services.items():
            clients[name] = probe.node.create_client(kind, f'{bench.node.get_name()}/{name}')
            bench.wait_for(clients[name].service_is_ready, f'service {name}')

        def ask(name, **fields):
            future = clients[name].call_async(services[name][0].Request(**fields))
            return bench.wait_for(lambda: future.done() and future.result(), f'answer of {name}')

        def talk(data):
            name = data.draw(st.sampled_from(sorted(services)))
            ask(name, **{field: data.draw(what) for field, what in services[name][1].items()})
            assert ask('get_parameters', names=['topology.n']).values[0].integer_value == 4

        fuzzed(talk)


names_of_parameters = st.sampled_from(
    sorted({spec.name for specs in PARAMETERS.values() for spec in specs}))
numbers = st.one_of(st.floats(), st.sampled_from(STRANGE), st.floats(0.1, 10.0))
values_of_parameters = st.one_of(
    numbers, st.integers(-2**63, 2**63 - 1), st.booleans(), st.text(max_size=9), st.none(),
    st.lists(numbers, min_size=1, max_size=4), st.binary(max_size=5),
    st.lists(st.text(max_size=5), min_size=1, max_size=3), st.sampled_from(['cosine', 'hold']))


@pytest.mark.parametrize(('kind', 'node_type', 'arguments'), [
    ('agent', Agent, (1,)), ('plant', Plant, ()), ('monitor', Monitor, ())])
def test_parameters_are_right_whatever_they_are_set_to(probe, kind, node_type, arguments):
    specs = {spec.name: spec for spec in PARAMETERS[kind]}
    with Bench(probe, node_type, *arguments) as bench:
        node = bench.node
        start = {name: node.get_parameter(name).value for name in specs}

        def change(data):
            given = data.draw(st.dictionaries(
                st.one_of(st.sampled_from(sorted(specs)), names_of_parameters),
                values_of_parameters, min_size=1, max_size=3))
            wishes = []
            for name, value in given.items():
                try:
                    wishes.append(Parameter(name, value=value))
                except (TypeError, ValueError, AssertionError):
                    continue  # rclpy has no such parameter to send
            before = {name: node.get_parameter(name).value for name in specs}
            results = node.set_parameters(
                [wish for wish in wishes if node.has_parameter(wish.name)])
            after = {name: node.get_parameter(name).value for name in specs}
            check_parameters(kind, {k: v for k, v in after.items() if v is not None})
            for wish, result in zip(
                    [wish for wish in wishes if node.has_parameter(wish.name)], results):
                if not result.successful:
                    assert result.reason
                else:
                    assert specs[wish.name].dynamic or before[wish.name] == after[wish.name]
            for name, spec in specs.items():
                if not spec.dynamic:
                    assert after[name] == start[name]
            node.assess()

        fuzzed(change)
        assert not node.health.exceptions


def test_an_agent_on_simulated_time_follows_the_clock_whatever_it_was_sent_before(probe):
    speaker = probe.node.create_publisher(Clock, '/clock', 10)
    with Bench(probe, Agent, 1, use_sim_time=True) as bench:
        bench.wait_for(speaker.get_subscription_count, 'the subscription')
        now = 10**12

        def talk(data):
            nonlocal now
            for _ in range(data.draw(st.integers(1, 4))):
                # DDS passes on no more bytes than a message of this type can have.
                speaker.publish(data.draw(any_bytes(cdr.head(now)))[:12])
            now += PERIOD

            def followed():
                speaker.publish(cdr.head(now))
                return bench.node.get_clock().now().nanoseconds == now

            bench.wait_for(followed, 'the time')

        fuzzed(talk)
