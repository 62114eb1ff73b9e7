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

"""
Every subscription, service and parameter of every kind of node is sent anything there is.

Which there are is asked of the running nodes, so that none can be forgotten. That a node does its
work all the same is tested in test_fuzz.py; here it has to live, to answer, and to raise nothing.
"""

from contextlib import suppress
from functools import partial
from importlib import import_module
from pathlib import Path
import pkgutil
import sys

from geometry_msgs.msg import PoseArray, TwistStamped, Vector3Stamped
from hypothesis import given, settings
from hypothesis import strategies as st
from node_bench import Bench
import pytest
from rcl_interfaces.msg import Parameter as ParameterMessage
from rcl_interfaces.msg import ParameterType, ParameterValue
from rcl_interfaces.srv import GetParameters, SetParameters
from rclpy.parameter import Parameter
from rclpy.serialization import serialize_message
from rosgraph_msgs.msg import Clock
from std_msgs.msg import Float64, Float64MultiArray
from strategies import any_bytes
import tetra_ros2
from tetra_ros2.config.parameters import check_parameters, is_ros_parameter, PARAMETERS
from tetra_ros2.nodes import poses
from tetra_ros2.nodes.agent import Agent
from tetra_ros2.nodes.body import Body
from tetra_ros2.nodes.monitor import Monitor
from tetra_ros2.nodes.plant import Plant
from tetra_ros2.nodes.sensors import Sensors
from tetra_ros2.recording.recorder import Recorder
from tetra_ros2.ros.executor import spin_some
from tetra_ros2.ros.node import FormationNode
from tetra_ros2.viewer.node import Viewer
from tetra_ros2.wire import names

EXAMPLES = 5
"""For each subscription and each service, and of all parameters together."""

NODES = {
    'agent': (Agent, (1,), {'use_sim_time': True}),
    'plant in lockstep': (Plant, (), {'use_sim_time': True}),
    'plant in real time': (Plant, (), {'mode': 'realtime', 'external_bodies': [4]}),
    'plant of wheels': (Plant, (), {'body': 'wheels'}),
    'monitor': (Monitor, (), {'use_sim_time': True}),
    'recorder': (Recorder, (), {'regex': '/anything'}),
    'sensors': (Sensors, (), {}),
    'sensors of an array': (Sensors, (), {'poses__source': 'array', 'poses__topic': 'poses'}),
    'body': (Body, (1,), {'driver': 'rate_setpoint'}),
    'viewer': (partial(Viewer, port=0), (), {}),
}
KINDS = {'Agent': 'agent', 'Plant': 'plant', 'Monitor': 'monitor', 'Recorder': 'recorder',
         'Sensors': 'sensors', 'Body': 'body'}

NUMBERS = {
    'boolean': st.booleans(), 'octet': st.binary(min_size=1, max_size=1), 'double': st.floats(),
    'float': st.floats(width=32), 'string': st.text(
        st.characters(codec='utf-8', exclude_characters='\0'), max_size=9),
    **{f'int{bits}': st.integers(-2**(bits - 1), 2**(bits - 1) - 1) for bits in (8, 16, 32, 64)},
    **{f'uint{bits}': st.integers(0, 2**bits - 1) for bits in (8, 16, 32, 64)}}


def fuzz(strategy, function, *arguments):
    """Call a function with the arguments and some examples of what a strategy makes."""
    @settings(max_examples=EXAMPLES)
    @given(strategy)
    def test(example):
        function(*arguments, example)

    test()


def messages(kind):
    """Return messages of a type, with anything in their fields."""
    return st.builds(kind, **{
        name: values_of(text) for name, text in kind.get_fields_and_field_types().items()})


def values_of(text):
    """Return values of a field, given its type as rosidl has it."""
    if text.startswith('sequence<'):
        return st.lists(values_of(text[len('sequence<'):-1].partition(',')[0]), max_size=3)
    if text.endswith(']'):
        inner, _, size = text[:-1].partition('[')
        return st.lists(values_of(inner), min_size=int(size), max_size=int(size))
    if '/' in text:
        return st.deferred(lambda: messages(class_of(text, 'msg')))
    return NUMBERS[text.partition('<')[0]]


def class_of(name, group):
    """Return the class of a type, ``package/Name`` or ``package/msg/Name``."""
    return getattr(import_module(f'{name.partition("/")[0]}.{group}'), name.rpartition('/')[2])


class Target:
    """A node of each kind, and what it has opened."""

    def __init__(self, bench, probe):
        self.bench, self.probe, self.node = bench, probe, bench.node
        name, namespace = self.node.get_name(), self.node.get_namespace()
        self.subscriptions = dict(
            self.node.get_subscriber_names_and_types_by_node(name, namespace))
        self.services = dict(self.node.get_service_names_and_types_by_node(name, namespace))
        self.parameters = set(self.node.list_parameters([], 0).names)
        self._clients = {}

    def turn(self):
        spin_some(self.bench.executor, self.bench._never, timeout=0.002)

    def noticed(self):
        """Return a number that grows with what the node has taken or refused."""
        node = self.node
        taken = sum(node.counts.values()) if isinstance(node, Recorder) else 0
        return taken + node.health.rejected.total() + node.health.exceptions \
            + getattr(node, '_states', 0)

    def ask(self, name, request):
        """Return what a service answers."""
        if name not in self._clients:
            kind = class_of(self.services[name][0], 'srv')
            self._clients[name] = self.probe.node.create_client(kind, name)
            self.bench.wait_for(self._clients[name].service_is_ready, f'service {name}')
        future = self._clients[name].call_async(request)
        return self.bench.wait_for(lambda: future.done() and future.result(), f'answer of {name}')

    def lives(self):
        """Assert that it answers, has an opinion of itself, and wants to go on."""
        own = f'{self.node.get_fully_qualified_name()}/get_parameters'
        response = self.ask(own, GetParameters.Request(names=['use_sim_time']))
        assert response.values[0].type == ParameterType.PARAMETER_BOOL
        self.node.assess()
        assert self.node.exit_status == 0


@pytest.fixture(params=NODES)
def target(request, probe, tmp_path, monkeypatch):
    monkeypatch.setattr(poses, 'LOOKS', 1)  # nobody publishes any
    node_type, arguments, parameters = NODES[request.param]
    if request.param == 'plant of wheels':
        pytest.importorskip('mujoco')
    if node_type is Recorder:
        # It listens to what there is.
        for kind, topic in ((PoseArray, names.ATTITUDES), (Float64, names.ERROR),
                            (Float64MultiArray, names.COSINES), (TwistStamped, names.cmd_vel(1)),
                            (Vector3Stamped, names.relative_attitude(1, 2)), (Clock, '/clock'),
                            (Float64, 'anything')):
            probe.node.create_publisher(kind, topic, 10)
        parameters = parameters | {'output': str(tmp_path / 'bag')}
    with Bench(probe, node_type, *arguments, **parameters) as bench:
        if node_type is Recorder:
            bench.wait_for(lambda: len(bench.node.inputs) >= 8, 'its topics')
        yield Target(bench, probe)


def test_there_is_no_other_kind_of_node():
    for module in pkgutil.walk_packages(tetra_ros2.__path__, 'tetra_ros2.'):
        source = module.module_finder.find_spec(module.name).origin
        if 'FormationNode' in Path(source).read_text():
            import_module(module.name)
    kinds, waiting = set(), [FormationNode]
    while waiting:
        below = waiting.pop().__subclasses__()
        kinds.update(below)
        waiting += below
    kinds = {kind for kind in kinds if kind.__module__.startswith('tetra_ros2.')}
    assert kinds == {getattr(node_type, 'func', node_type) for node_type, _, _ in NODES.values()}


def test_every_subscription_takes_anything(target):
    assert target.subscriptions, 'every node listens to something'
    sent = set()

    def send(topic, publisher, message):
        with suppress(RuntimeError):  # the middleware knows how large a message can be
            publisher.publish(message)
        sent.add(topic)
        target.turn()

    for topic, (type_name, *_) in target.subscriptions.items():
        kind = class_of(type_name, 'msg')
        inputs = [(i, i.get_publisher_count()) for i in target.node.inputs
                  if i.topic_name == topic]
        publisher = target.probe.node.create_publisher(kind, topic, 1000)
        target.bench.wait_for(publisher.get_subscription_count, topic)
        # The other end learns of it by itself, and what comes earlier with best effort is lost.
        target.bench.wait_for(
            lambda w=inputs: all(i.get_publisher_count() > n for i, n in w), topic)
        before = target.noticed()

        fuzz(st.one_of(messages(kind).map(serialize_message).flatmap(any_bytes),
                       messages(kind)), send, topic, publisher)
        # Of bodies only a page takes note, and of the time nobody keeps count.
        if topic not in ('/' + names.BODIES, names.CLOCK):
            target.bench.wait_for(lambda b=before: target.noticed() > b, f'any effect on {topic}')
        target.probe.node.destroy_publisher(publisher)
        target.lives()
        if topic == names.CLOCK:  # rclpy itself listens to it, and raises
            target.node.health.exceptions = 0
        assert not target.node.health.exceptions, target.node.health._last_exception
    assert sent == set(target.subscriptions)


def test_every_service_answers_anything(target):
    asked = set()

    def ask(name, request):
        target.ask(name, request)
        asked.add(name)
        health = target.node.health
        # So says rclpy itself, to a parameter of a type that there is not.
        if 'is not a valid Parameter.Type' in health._last_exception:
            health.exceptions, health._last_exception = 0, ''
        assert not health.exceptions, health._last_exception

    for name, (type_name, *_) in target.services.items():
        fuzz(messages(class_of(type_name, 'srv').Request), ask, name)
        target.lives()
    assert asked == set(target.services)


@pytest.mark.timeout(300)
def test_every_parameter_is_set_to_anything(target):
    node = target.node
    kind = KINDS.get(type(node).__name__)
    specs = {spec.name: spec for spec in PARAMETERS[kind]} if kind else {}
    assert set(specs) <= target.parameters
    assert all(is_ros_parameter(name) for name in target.parameters - set(specs))
    service = f'{node.get_fully_qualified_name()}/set_parameters'
    starts = {name: node.get_parameter(name) for name in sorted(target.parameters)}
    tried = set()

    def change(values):
        answer = target.ask(service, SetParameters.Request(parameters=[
            ParameterMessage(name=name, value=value) for name, value in values.items()]))
        assert len(answer.results) == len(values)
        tried.update(values)
        for result, name in zip(answer.results, values):
            if not result.successful:
                assert result.reason
            elif name in specs:
                assert specs[name].dynamic or node.get_parameter(name).value == starts[name].value
        now = {name: node.get_parameter(name).value for name in specs}
        if kind:
            check_parameters(kind, {name: v for name, v in now.items() if v is not None})
        node.set_parameters(list(starts.values()))

    types = st.integers(0, 9)
    anything = st.builds(lambda value, of: (setattr(value, 'type', of), value)[1],
                         messages(ParameterValue), types)
    plausible = st.one_of(st.floats(0.1, 10.0), st.integers(0, 5), st.booleans()).map(
        lambda value: Parameter('x', value=value).get_parameter_value())
    fuzz(st.fixed_dictionaries({
        name: st.one_of(anything, plausible, st.just(start.get_parameter_value()))
        for name, start in starts.items()}), change)
    target.lives()
    assert tried == target.parameters
    assert not node.health.exceptions, node.health._last_exception


@pytest.mark.parametrize('target', ['body', 'agent', 'plant in lockstep'], indirect=True)
def test_no_parameter_makes_a_node_import_what_somebody_wishes(target):
    module = 'sndhdr' if sys.version_info < (3, 13) else 'this'
    assert module not in sys.modules
    for name in ('driver', 'gain.kind', 'body'):
        if name in target.parameters:
            target.node.set_parameters([Parameter(name, value=f'{module}:what')])
    assert module not in sys.modules
