# Copyright 2026 The tetra_ros2 authors
# SPDX-License-Identifier: Apache-2.0

"""Recordings, read back with readers other than the one that wrote them."""

from collections import Counter, defaultdict
import sqlite3

from geometry_msgs.msg import PoseArray
from harness import interrupt, run, values
from mcap.reader import make_reader
from mcap_ros2.decoder import DecoderFactory
import numpy as np
import pytest
from rclpy.serialization import deserialize_message
from rosbags.typesys import get_typestore, Stores
from std_msgs.msg import String
import yaml

from tetra_ros2 import launcher
from tetra_ros2.formation import measures, shapes
from tetra_ros2.launcher import Launcher
from tetra_ros2.parameters import ConfigurationError

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
        steps = formation.plant.time.steps
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
            return [], ['/clock']
        return [], []

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
        recorder._recorded.clear()  # all topics are new to it once more
        recorder.discover()
        assert recorder.exit_status == 1
        formation.run_for(10.0)
        recorder._on_timer()
        assert not recorder._batch


def test_a_path_that_cannot_be_made_is_refused(tmp_path):
    (tmp_path / 'file').write_text('')
    status, _, errors = run('recorder', '--output', tmp_path / 'file' / 'bag')
    assert status == 2
    assert 'cannot be recorded into' in errors


def test_a_recorder_that_has_not_found_a_publisher_is_waited_for(tmp_path, monkeypatch):
    with Launcher('complete', record=tmp_path / 'bag') as formation:
        assert formation._links() == ([], [])
        subscription = formation.recorder.inputs[0]
        monkeypatch.setattr(subscription, 'get_publisher_count', lambda: 0)
        assert formation._links() == ([subscription.topic_name], [])


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
