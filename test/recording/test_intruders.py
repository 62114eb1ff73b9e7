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

"""What somebody else puts onto the network is recorded as it is, and changes nothing else."""

from collections import Counter

from geometry_msgs.msg import PoseArray, TwistStamped
from harness import Probe
from hypothesis import given, HealthCheck, settings, strategies
from mcap.reader import make_reader
from node_bench import Bench
import pytest
from rclpy.parameter import Parameter
from rclpy.qos import QoSProfile, ReliabilityPolicy
from rosgraph_msgs.msg import Clock
from std_msgs.msg import Float64, String
from tetra_ros2.recording.recorder import Recorder
from tetra_ros2.ros import diagnostics
from tetra_ros2.wire import names


def in_file(path):
    """Return topic, type, time and bytes of all messages."""
    file, = path.glob('*.mcap')
    with file.open('rb') as stream:
        return [(channel.topic, schema.name, message.log_time, message.data) for schema, channel,
                message in make_reader(stream).iter_messages(log_time_order=False)]


def recorded(bench, topic, count):
    bench.wait_for(lambda: bench.node.counts.get(topic, 0) >= count, f'{count} of {topic}')


def both_ends(bench, *publishers):
    """Wait until the recorder listens to all of these, and all know it."""
    def joined():
        found = Counter({s.topic_name: s.get_publisher_count() for s in bench.node.inputs})
        return all(p.get_subscription_count() and found[p.topic_name] for p in publishers)
    bench.wait_for(joined, 'both ends')


def test_another_type_that_was_there_first_does_not_take_the_place_of_the_true_one(
        tmp_path, probe):
    path, topic = tmp_path / 'bag', names.ATTITUDES
    # In a participant of its own, as no participant may have two types on one topic.
    with Probe() as other, Bench(probe, Recorder, output=str(path)) as bench:
        intruder = other.node.create_publisher(String, topic, 10)
        bench.wait_for(lambda: f'/{topic}' in bench.node._refused, 'the refusal')
        level, message, values = bench.node.assess()
        assert level == diagnostics.WARN
        assert f'/{topic}' in message
        assert 'expected geometry_msgs/msg/PoseArray' in values[f'not recorded: /{topic}']
        plant = probe.node.create_publisher(PoseArray, topic, 10)
        both_ends(bench, plant)
        intruder.publish(String(data='I am the plant'))
        plant.publish(PoseArray())
        recorded(bench, f'/{topic}', 1)
        assert f'/{topic}' not in bench.node._refused
    assert [(t, kind) for t, kind, _, _ in in_file(path) if t == f'/{topic}'] == [
        (f'/{topic}', 'geometry_msgs/msg/PoseArray')]


def test_a_topic_of_two_types_and_no_contract_is_recorded_in_one_of_them(tmp_path, probe):
    path = tmp_path / 'bag'
    with Probe() as other, Bench(probe, Recorder, output=str(path), topics=['talk']) as bench:
        publishers = [p.node.create_publisher(kind, 'talk', 10)
                      for p, kind in ((probe, Float64), (other, String))]
        bench.wait_for(lambda: bench.node.inputs, 'the subscription')
        bench.wait_for(lambda: any(p.get_subscription_count() for p in publishers), 'its end')
        for publisher in publishers:
            publisher.publish(publisher.msg_type())
        recorded(bench, '/talk', 1)
    assert len({kind for _, kind, _, _ in in_file(path)}) == 1


@pytest.mark.parametrize('unreliable', [0, 1])
def test_all_publishers_of_a_topic_are_heard_whatever_they_offer(tmp_path, probe, unreliable):
    path = tmp_path / 'bag'
    policies = [ReliabilityPolicy.RELIABLE, ReliabilityPolicy.RELIABLE]
    policies[unreliable] = ReliabilityPolicy.BEST_EFFORT
    publishers = [probe.node.create_publisher(
        Float64, 'talk', QoSProfile(depth=10, reliability=policy)) for policy in policies]
    probe.wait_for(lambda: probe.node.count_publishers('talk') == 2, 'both publishers')
    with Bench(probe, Recorder, output=str(path), topics=['talk']) as bench:
        both_ends(bench, *publishers)
        subscription, = bench.node.inputs
        bench.wait_for(lambda: subscription.get_publisher_count() == 2, 'both')
        for k, publisher in enumerate(publishers):
            publisher.publish(Float64(data=float(k)))
        recorded(bench, '/talk', 2)


def test_one_forged_clock_does_not_put_the_rest_into_another_year(tmp_path, probe):
    path = tmp_path / 'bag'
    with Bench(probe, Recorder, output=str(path), use_sim_time=True) as bench:
        clock, agent = (probe.node.create_publisher(kind, topic, 10) for kind, topic in (
            (Clock, '/clock'), (TwistStamped, 'agent_1/cmd_vel')))
        both_ends(bench, clock, agent)

        def tick(seconds, nanoseconds=0):
            message = Clock()
            message.clock.sec, message.clock.nanosec = seconds, nanoseconds
            clock.publish(message)
            agent.publish(TwistStamped())

        for k in range(10):
            tick(7, k * 10_000_000)
        for seconds in (2**31 - 1, -5, 0):
            tick(seconds)
        for k in range(10, 20):
            tick(7, k * 10_000_000)
        recorded(bench, '/agent_1/cmd_vel', 23)
        recorded(bench, '/clock', 23)
        assert bench.node.health.rejected.total() == 3
    times = [at for _, _, at, _ in in_file(path)]
    assert min(times) == 7 * 10**9
    assert max(times) == 7 * 10**9 + 190_000_000


def test_two_clocks_are_reported(tmp_path, probe):
    with Bench(probe, Recorder, output=str(tmp_path / 'bag'), use_sim_time=True) as bench:
        clocks = [probe.node.create_publisher(Clock, '/clock', 10) for _ in range(2)]
        both_ends(bench, *clocks)
        bench.wait_for(lambda: 'more than one publisher on /clock' in bench.node.assess()[1],
                       'the report')


@settings(max_examples=1, suppress_health_check=[HealthCheck.function_scoped_fixture])
@given(messages=strategies.lists(
    strategies.tuples(
        strategies.sampled_from(['/clock', names.ATTITUDES, 'agent_1/cmd_vel']),
        strategies.one_of(strategies.binary(min_size=4, max_size=200),
                          strategies.binary(max_size=60).map(lambda b: b'\0\1\0\0' + b))),
    min_size=100, max_size=100))
def test_malformed_bytes_are_recorded_as_they_are(tmp_path_factory, probe, messages):
    path = tmp_path_factory.mktemp('fuzz') / 'bag'
    kinds = {'/clock': Clock, names.ATTITUDES: PoseArray, 'agent_1/cmd_vel': TwistStamped}
    with Bench(probe, Recorder, output=str(path), use_sim_time=True) as bench:
        publishers = {t: probe.node.create_publisher(k, t, 200) for t, k in kinds.items()}
        both_ends(bench, *publishers.values())
        clock = Clock()
        clock.clock.sec = 1
        publishers['/clock'].publish(clock)
        recorded(bench, '/clock', 1)
        for topic, data in messages:
            publishers[topic].publish(data)
        bench.wait_for(lambda: sum(bench.node.counts.values()) > len(messages), 'all of them')
        assert bench.node.exit_status == 0
        for publisher in publishers.values():
            probe.node.destroy_publisher(publisher)
    # DDS pads to four bytes what it sends.
    found = Counter((topic, bytes(data)[:4]) for topic, _, _, data in in_file(path))
    assert found.total() == len(messages) + 1
    sent = Counter(('/' + topic.lstrip('/'), data[:4]) for topic, data in messages)
    assert not {topic for topic, _ in sent - found}


TYPES = strategies.text(max_size=20) | strategies.sampled_from([
    'a/msg/b', 'os/msg/path', 'std_msgs/msg/__doc__', '/', '//', '', 'std_msgs/msg/Nothing',
    'std_msgs/srv/String'])


@settings(max_examples=50, suppress_health_check=[HealthCheck.function_scoped_fixture])
@given(topics=strategies.lists(strategies.tuples(
    strategies.text(max_size=20).map(lambda text: f'/formation/{text}'),
    strategies.lists(TYPES, min_size=1, max_size=3)), max_size=5))
def test_no_name_of_a_topic_and_no_type_ends_the_recording(shared_recorder, topics):
    node = shared_recorder.node
    heard = set(node._heard)
    node.get_topic_names_and_types = lambda: topics
    node.get_publishers_info_by_topic = lambda topic: [
        FakeInfo(kind) for name, kinds in topics if name == topic for kind in kinds]
    node.discover()
    assert node.exit_status == 0
    assert node._writer is not None
    assert node._heard == heard
    node.assess()


class FakeInfo:
    """What DDS tells of a publisher, as far as its type goes."""

    topic_type_hash = 'RIHS01_' + 64 * '0'
    qos_profile = QoSProfile(depth=1)

    def __init__(self, kind):
        self.topic_type = kind


@pytest.fixture
def shared_recorder(tmp_path, probe):
    with Bench(probe, Recorder, output=str(tmp_path / 'bag'),
               regex=r'/formation/[\s\S]*') as bench:
        yield bench


def test_what_the_middleware_raises_for_one_topic_does_not_stop_the_others(tmp_path, probe):
    path = tmp_path / 'bag'
    with Bench(probe, Recorder, output=str(path), topics=['a']) as bench:
        publisher = probe.node.create_publisher(Float64, 'a', 10)
        both_ends(bench, publisher)

        def broken():
            raise RuntimeError('cannot be taken')

        bench.node._queues.insert(0, (0, broken))
        publisher.publish(Float64(data=1.0))
        recorded(bench, '/a', 1)
        assert bench.node.health.rejected['RuntimeError (the middleware)'] > 0
    assert len(in_file(path)) == 1


def test_a_recording_keeps_to_the_time_that_it_began_with(tmp_path, probe):
    with Bench(probe, Recorder, output=str(tmp_path / 'bag')) as bench:
        result, = bench.node.set_parameters([Parameter('use_sim_time', value=True)])
        assert not result.successful
        assert 'keeps to the time' in result.reason
        assert not bench.node.get_parameter('use_sim_time').value


def test_a_clock_that_is_set_back_does_not_turn_the_bag_back(tmp_path, probe):
    path = tmp_path / 'bag'
    with Bench(probe, Recorder, output=str(path), topics=['a']) as bench:
        publisher = probe.node.create_publisher(Float64, 'a', 10)
        both_ends(bench, publisher)
        for at in (800, 300, 900):
            bench.node._write([(at, 0, b'\0\1\0\0' + bytes(8))])
    assert [at for _, _, at, _ in in_file(path)] == [800, 800, 900]
