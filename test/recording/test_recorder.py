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

"""Recordings, read back with readers other than the one that wrote them."""

from collections import Counter, defaultdict
import sqlite3
import time

from geometry_msgs.msg import PoseArray
from harness import interrupt, run, values
from mcap.reader import make_reader
from mcap_ros2.decoder import DecoderFactory
from node_bench import Bench
import numpy as np
import pytest
from rclpy.serialization import deserialize_message
from rosbags.typesys import get_typestore, Stores
from rosgraph_msgs.msg import Clock
from std_msgs.msg import Float64, String
from tetra_ros2 import launcher
from tetra_ros2.config.parameters import ConfigurationError
from tetra_ros2.formation import measures, shapes
from tetra_ros2.launcher import Launcher
from tetra_ros2.recording.recorder import Recorder
import yaml

EXPECTED = {
    '/clock': 'rosgraph_msgs/msg/Clock',
    '/diagnostics': 'diagnostic_msgs/msg/DiagnosticArray',
    '/formation/attitudes': 'geometry_msgs/msg/PoseArray',
    '/formation/cosines': 'std_msgs/msg/Float64MultiArray',
    '/formation/error': 'std_msgs/msg/Float64',
    **{f'/agent_{i}/cmd_vel': 'geometry_msgs/msg/TwistStamped' for i in range(1, 5)},
    **{f'/agent_{i}/relative_attitude/agent_{j}': 'geometry_msgs/msg/Vector3Stamped'
       for i, j in ((1, 2), (1, 3), (1, 4), (2, 1), (2, 3), (3, 1), (3, 4), (4, 1), (4, 2))},
}


def read_mcap(path):
    """Return all messages of a recording by topic, as (log time, message object)."""
    file, = path.glob('*.mcap')
    messages = defaultdict(list)
    types = {}
    with file.open('rb') as stream:
        reader = make_reader(stream, decoder_factories=[DecoderFactory()])
        for schema, channel, message, decoded in reader.iter_decoded_messages():
            messages[channel.topic].append((message.log_time, decoded))
            types[channel.topic] = schema.name
    return messages, types


def metadata(path):
    return yaml.safe_load((path / 'metadata.yaml').read_text())['rosbag2_bagfile_information']


def error_of(state):
    gamma = np.array([[p.position.x, p.position.y, p.position.z] for p in state.poses])
    return float(measures.shape_error(gamma, shapes.TETRAHEDRON.angles))


def test_a_recording_of_a_run_holds_every_message(tmp_path):
    path = tmp_path / 'bag'
    with Launcher('rotating', record=path) as formation:
        formation.run_for(5.0)
        error = formation.error
        steps = formation.plant.stepper.steps
        recorder = formation.recorder
    messages, types = read_mcap(path)
    # The run is over before the first diagnostics are due; the test of a process has them.
    assert types.keys() | {'/diagnostics'} == EXPECTED.keys()
    assert types.items() <= EXPECTED.items()
    counts = Counter({topic: len(found) for topic, found in messages.items()})
    assert counts == +Counter(recorder.counts)
    for topic, found in messages.items():
        times = [time for time, _ in found]
        assert times == sorted(times), topic
        stamped = [m for _, m in found if hasattr(m, 'header')]
        stamps = [m.header.stamp.sec * 10**9 + m.header.stamp.nanosec for m in stamped]
        if topic != '/diagnostics':
            assert stamps == sorted(stamps), topic
            # Step k has the stamp k + 1 periods; each was published, so each must be there.
            assert set(range(10_000_000, (steps + 2) * 10_000_000, 10_000_000)) <= set(stamps) \
                or not stamped, topic
    assert error_of(messages['/formation/attitudes'][-1][1]) == pytest.approx(error, abs=1e-15)
    assert messages['/formation/error'][-1][1].data == error
    assert len(messages['/formation/error']) == len(messages['/formation/cosines']) == steps + 1


def test_metadata_tell_type_hashes_and_quality_of_service(tmp_path):
    path = tmp_path / 'bag'
    with Launcher('complete', record=path) as formation:
        formation.run_for(0.1)
    info = metadata(path)
    assert info['storage_identifier'] == 'mcap'
    topics = {t['topic_metadata']['name']: t for t in info['topics_with_message_count']}
    assert info['message_count'] == sum(t['message_count'] for t in topics.values()) > 0
    vector = topics['/agent_1/relative_attitude/agent_2']['topic_metadata']
    # The recorder takes the hash from DDS; here it is computed from the definition.
    assert vector['type_description_hash'] == get_typestore(Stores.ROS2_JAZZY).hash_rihs01(
        'geometry_msgs/msg/Vector3Stamped')
    assert vector['offered_qos_profiles'][0]['reliability'] == 'reliable'
    assert vector['offered_qos_profiles'][0]['durability'] == 'volatile'


def test_sqlite_holds_the_same(tmp_path):
    path = tmp_path / 'bag'
    with Launcher('complete', record=path, storage='sqlite3') as formation:
        formation.run_for(1.0)
        error = formation.error
        recorder = formation.recorder
    assert metadata(path)['storage_identifier'] == 'sqlite3'
    file, = path.glob('*.db3')
    with sqlite3.connect(file) as database:
        rows = database.execute(
            'SELECT name, messages.timestamp, data FROM messages '
            'JOIN topics ON topics.id = topic_id ORDER BY messages.id').fetchall()
    assert Counter(name for name, _, _ in rows) == +Counter(recorder.counts)
    times = [time for _, time, _ in rows]
    assert times == sorted(times)
    last = [data for name, _, data in rows if name == '/formation/attitudes'][-1]
    assert error_of(deserialize_message(last, PoseArray)) == pytest.approx(error, abs=1e-15)


def test_a_process_that_records_finds_late_topics_and_closes_the_bag_on_ctrl_c(
        tmp_path, processes, probe):
    path = tmp_path / 'bag'
    recorder = processes.tetra('recorder', '--output', path)
    probe.wait_for_health('/recorder', lambda s: 'no topic' not in s.message, 'the recorder')
    for i in range(1, 5):
        processes.tetra('agent', '--id', i, '--config', 'complete')
    processes.tetra('monitor', '--config', 'complete')
    processes.tetra('plant', '--config', 'complete', '--ros-args', '-p', 'real_time_factor:=1.0')
    probe.wait_for_health(
        '/recorder', lambda s: all(
            int(values(s).get(f'messages on {topic}', 0)) > 0 for topic in EXPECTED),
        'messages on every topic')
    status, output = interrupt(recorder)
    assert status == 0, output
    messages, types = read_mcap(path)
    assert types.items() >= EXPECTED.items()
    assert metadata(path)['message_count'] == sum(map(len, messages.values()))


def test_chosen_topics_by_name_and_by_regular_expression(tmp_path, processes, probe):
    path = tmp_path / 'bag'
    recorder = processes.tetra('recorder', '--output', path, '--storage', 'mcap',
                               '--regex', '/formation/(error|cosines)', 'agent_2/cmd_vel',
                               '/chatter')
    talker = probe.node.create_publisher(String, '/chatter', 10)
    probe.wait_for(talker.get_subscription_count, 'the recorder on /chatter')
    with Launcher('complete', parameters={'real_time_factor': 1.0}) as formation:
        talker.publish(String(data='hello'))
        formation.run_until(lambda: all(
            formation.monitor.count_subscribers(topic) >= 1
            for topic in ('formation/error', 'formation/cosines', 'agent_1/cmd_vel')), 30.0)
        formation.run_for(1.0)
    status, output = interrupt(recorder)
    assert status == 0, output
    messages, types = read_mcap(path)
    assert set(messages) <= {'/formation/error', '/formation/cosines', '/agent_2/cmd_vel',
                             '/chatter'}
    assert {'/formation/error', '/formation/cosines', '/chatter'} <= set(messages)
    assert messages['/chatter'][0][1].data == 'hello'
    assert types['/chatter'] == 'std_msgs/msg/String'


def recorded(bench, topic, count):
    """Wait until so many messages of a topic are recorded."""
    bench.wait_for(lambda: bench.node.counts.get(f'/{topic}', 0) == count, f'{count} of {topic}')


def in_file(path):
    """Return topic, log time and bytes of all messages, in the order in which they are there."""
    file, = path.glob('*.mcap')
    with file.open('rb') as stream:
        return [(channel.topic, message.log_time, message.data) for _, channel, message
                in make_reader(stream).iter_messages(log_time_order=False)]


def test_messages_are_recorded_in_the_order_and_at_the_time_they_came(tmp_path, probe):
    path = tmp_path / 'bag'
    with Bench(probe, Recorder, output=str(path), topics=['a', 'b']) as bench:
        publishers = [probe.node.create_publisher(Float64, topic, 1000) for topic in ('a', 'b')]
        bench.wait_for(lambda: len(bench.node.inputs) == 2, 'both subscriptions')
        publishers = [bench.publisher(Float64, topic) for topic in ('a', 'b')]
        sent = []
        for k in range(100):
            # A pattern that neither topic by topic nor turn by turn would have.
            topic = k * k // 3 % 2
            before = time.time_ns()
            publishers[topic].publish(Float64(data=float(k)))
            sent.append((before, time.time_ns()))
        bench.wait_for(lambda: sum(bench.node.counts.values()) == 100, 'all of them')
    found = in_file(path)
    assert [deserialize_message(data, Float64).data for _, _, data in found] == [*range(100)]
    assert all(before <= at for (before, _), (_, at, _) in zip(sent, found))
    assert found[0][1] <= sent[1][0] + 1e9


def test_what_was_sent_again_is_not_put_behind_what_follows_it(tmp_path, probe):
    path = tmp_path / 'bag'
    with Bench(probe, Recorder, output=str(path), topics=['a']) as bench:
        publisher = probe.node.create_publisher(Float64, 'a', 10)
        bench.wait_for(lambda: bench.node.inputs, 'the subscription')
        # DDS hands them out in order, but the second one came last, and of one it knows nothing.
        came = iter([(b'\0\1\0\0first...', 10, 0), (b'\0\1\0\0second..', 30, 0),
                     (b'\0\1\0\0third...', 20, 0), (b'\0\1\0\0fourth..', 0, 40)])

        def take(*_):
            message, received, source = next(came, (None, 0, 0))
            return message and (message, {'received_timestamp': received,
                                          'source_timestamp': source})

        bench.node._queues[:] = [(0, take)]
        recorded(bench, 'a', 4)
        del publisher
    assert [(at, data[4:].rstrip(b'.')) for _, at, data in in_file(path)] == [
        (10, b'first'), (30, b'second'), (30, b'third'), (40, b'fourth')]


def test_what_came_while_topics_were_read_waits_for_what_came_before_it(tmp_path, probe):
    path = tmp_path / 'bag'
    with Bench(probe, Recorder, output=str(path), topics=['a']) as bench:
        publisher = probe.node.create_publisher(Float64, 'a', 10)
        bench.wait_for(lambda: bench.node.inputs, 'the subscription')
        # The first topic gets its message when it has been read already, and the second is.
        times = []

        def first(*_):
            return (b'1', {'received_timestamp': times.pop()}) if times else None

        def second(*_):
            now = time.time_ns()
            if second.messages:
                times.append(now)
            return (second.messages and (
                second.messages.pop(), {'received_timestamp': now + 1})) or None

        second.messages = [b'2']
        bench.node._queues[:] = [(0, first), (0, second)]
        recorded(bench, 'a', 2)
        del publisher
    assert [data for _, _, data in in_file(path)] == [b'1', b'2']


@pytest.mark.parametrize('topics', [['chatter'], ['chatter', '/clock']])
def test_with_sim_time_messages_are_filed_under_the_time_of_the_clock(topics, tmp_path, probe):
    path = tmp_path / 'bag'
    with Bench(probe, Recorder, output=str(path), topics=topics, use_sim_time=True) as bench:
        publishers = [probe.node.create_publisher(t, n, 10)
                      for t, n in ((Clock, '/clock'), (String, 'chatter'))]
        bench.wait_for(lambda: len(bench.node.inputs) == 2, 'both subscriptions')
        bench.wait_for(lambda: all(s.get_publisher_count() for s in bench.node.inputs)
                       and all(p.get_subscription_count() for p in publishers), 'both ends')
        clock, chatter = publishers

        def tick(sec):
            message = Clock()
            message.clock.sec, message.clock.nanosec = sec, 7
            clock.publish(message)

        chatter.publish(String(data='no time yet'))
        tick(5)
        for word in 'one', 'two':
            chatter.publish(String(data=word))
        tick(6)
        chatter.publish(String(data='three'))
        recorded(bench, 'chatter', 3)
    assert [(at, deserialize_message(data, String).data) for topic, at, data in in_file(path)
            if topic == '/chatter'] == [
        (5_000_000_007, 'one'), (5_000_000_007, 'two'), (6_000_000_007, 'three')]
    clocks = [at for topic, at, _ in in_file(path) if topic == '/clock']
    assert clocks == ([5_000_000_007, 6_000_000_007] if '/clock' in topics else [])


def test_an_existing_path_is_never_written_to(tmp_path):
    path = tmp_path / 'bag'
    path.mkdir()
    (path / 'precious').write_text('data')
    with pytest.raises(ConfigurationError, match='exists already'):
        Launcher('complete', record=path)
    for arguments in (('recorder', '--output', path), ('launcher', '--record', path)):
        status, _, errors = run(*arguments)
        assert status == 2
        assert str(path) in errors
        assert 'exists already' in errors
        assert errors.count('\n') == 1
    assert [p.name for p in path.iterdir()] == ['precious']


def test_a_launcher_that_is_refused_records_nothing(tmp_path, monkeypatch):
    path = tmp_path / 'bag'
    found = []

    def links(self):
        # Somebody is found only when the recording has begun, as DDS takes its time.
        if self.recorder is not None:
            found.append(path.exists())
            return [], [], ['/clock']
        return [], [], []

    monkeypatch.setattr(launcher, 'FAREWELL_TIMEOUT', 0.2)
    monkeypatch.setattr(Launcher, '_links', links)
    with pytest.raises(ConfigurationError, match='somebody else'), \
            Launcher('complete', record=path):
        pass
    assert found[0]
    assert not path.exists()


def test_a_full_disk_is_said_in_one_line(tmp_path, processes, probe):
    path = tmp_path / 'bag'
    code = ('import resource, signal, sys; from tetra_ros2.cli import main; '
            'resource.setrlimit(resource.RLIMIT_FSIZE, (200_000, 200_000)); '
            'signal.signal(signal.SIGXFSZ, signal.SIG_IGN); sys.exit(main(sys.argv[1:]))')
    recorder = processes.python('-c', code, 'recorder', '--output', path)
    probe.wait_for_health('/recorder', lambda s: True, 'the recorder')
    with Launcher('complete') as formation:
        for _ in range(200):
            formation.run_for(1.0)
            status = probe.health('/recorder')
            if status is not None and 'not recording' in status.message:
                break
            probe.executor.spin_once(timeout_sec=0.0)
    probe.wait_for_health('/recorder', lambda s: 'not recording' in s.message, 'the report')
    status, output = interrupt(recorder)
    assert status == 1
    assert 'cannot be written any more' in output
    assert 'Traceback' not in output


def test_a_recorder_whose_writer_is_gone_goes_on_and_keeps_nothing(tmp_path):
    with Launcher('complete', record=tmp_path / 'bag') as formation:
        formation.run_for(1.0)
        recorder = formation.recorder
        recorder._writer._process.kill()
        recorder._writer._process.wait()
        recorder._heard.clear()  # all topics are new to it once more
        recorder.discover()
        assert recorder.exit_status == 1
        formation.run_for(10.0)
        assert not recorder.inputs
        assert not [*recorder._queues, *recorder._ahead]


def test_a_path_that_cannot_be_made_is_refused(tmp_path):
    (tmp_path / 'file').write_text('')
    status, _, errors = run('recorder', '--output', tmp_path / 'file' / 'bag')
    assert status == 2
    assert 'cannot be recorded into' in errors


def test_a_recorder_that_has_not_found_a_publisher_is_waited_for(tmp_path, monkeypatch):
    with Launcher('complete', record=tmp_path / 'bag') as formation:
        assert formation._links() == ([], [], [])
        subscription = formation.recorder.inputs[0]
        monkeypatch.setattr(subscription, 'get_publisher_count', lambda: 0)
        assert formation._links() == ([subscription.topic_name], [], [])


def test_interrupting_the_launcher_leaves_a_whole_bag(tmp_path, processes, probe):
    path = tmp_path / 'bag'
    process = processes.tetra('launcher', '--duration', '1e6', '--record', path)
    probe.wait_for_health('/recorder', lambda s: s.message == 'recording', 'the recording')
    probe.wait_for_health(
        '/recorder', lambda s: int(values(s)['messages']) > 100, 'it')
    status, output = interrupt(process)
    assert status == 130, output
    assert 'interrupted' in output
    messages, _ = read_mcap(path)
    assert len(messages['/formation/attitudes']) > 10
    assert metadata(path)['message_count'] == sum(map(len, messages.values()))
