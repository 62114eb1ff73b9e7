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

"""Bodies under motion capture, alone and beside simulated ones, over DDS."""

from concurrent.futures import ThreadPoolExecutor
import math
from pathlib import Path
import time
from types import SimpleNamespace

from diagnostic_msgs.msg import DiagnosticArray
from geometry_msgs.msg import PoseArray, PoseStamped
import harness
from harness import Processes
import numpy as np
import pytest
from rclpy.node import Node
from rclpy.qos import qos_profile_sensor_data
from std_srvs.srv import SetBool
from tetra_ros2.config.parameters import check_parameters, ConfigurationError
from tetra_ros2.formation import tracking
from tetra_ros2.nodes import poses

MOCAP = Path(__file__).with_name('mocap.py')
TOPIC = '/vrpn_mocap/{name}/pose'
MEASUREMENT_TIMEOUT = 0.5e9
"""Of the agents, unless they are told another [ns]."""

THETA = math.acos(-1.0 / 3.0)


@pytest.fixture
def programs():
    with Processes() as started:
        yield started


def error(probe):
    if not probe.received['formation/attitudes']:
        return math.inf
    gamma = probe.reduced_attitudes()
    i, j = np.triu_indices(4, 1)
    angles = np.arccos(np.clip(np.sum(gamma[i] * gamma[j], axis=1), -1.0, 1.0))
    return float(np.max(np.abs(angles - THETA)))


def first_report(probe, name, text):
    """Return the stamp of the first diagnostics in which a node says so [ns]."""
    return next(harness.nanoseconds(array.header.stamp)
                for array in probe.received['diagnostics'] for status in array.status
                if status.name == name and text in status.message)


def last_new_pose(probe):
    """Return the stamp of the first of those poses of agent 4 that are all the same [ns]."""
    poses = probe.received[TOPIC.format(name='agent_4')]
    return next(harness.nanoseconds(message.header.stamp) for message in poses
                if message.pose == poses[-1].pose)


def freeze(probe, data):
    probe.call(SetBool, 'freeze', SetBool.Request(data=data))


def test_three_simulated_bodies_and_one_under_motion_capture_form_and_notice_that_it_freezes(
        probe, programs):
    programs.python(MOCAP, 'pose', 4)
    probe.listen_to_attitudes()
    programs.tetra('launcher', '--config', 'rotating', '--mode', 'realtime', '--duration', '300',
                   '--ros-args', '-p', 'external_bodies:=[4]', '-p', f'poses.topic:={TOPIC}',
                   '-p', 'seed:=3')
    probe.wait_for(lambda: error(probe) < 0.02, 'a tetrahedron')
    probe.listen(PoseStamped, TOPIC.format(name='agent_4'), qos_profile_sensor_data)
    probe.listen(DiagnosticArray, 'diagnostics')
    freeze(probe, True)
    probe.wait_for_health('/plant', lambda s: 'agent_4: frozen' in s.message, 'frozen')
    # By the stamps of those who sent them: how long this process was busy does not count.
    took = first_report(probe, '/plant', 'agent_4: frozen') - last_new_pose(probe)
    assert 0.19e9 < took < MEASUREMENT_TIMEOUT, took
    probe.wait_for_health('/agent_1', lambda s: 'nothing heard of agent_4' in s.message, 'stopped')
    freeze(probe, False)
    probe.wait_for_health('/plant', lambda s: s.message == 'running', 'running again')
    probe.wait_for(lambda: error(probe) < 0.02, 'a tetrahedron again')


@pytest.mark.parametrize(('kind', 'parameters'), [
    ('pose', [f'poses.topic:={TOPIC}']),
    ('array', ['poses.source:=array', 'poses.topic:=/poses']),
    ('tf', ['poses.source:=tf', 'poses.frame:=lab',
            'poses.names:=["body_1", "body_2", "body_3", "body_4"]']),
])
def test_four_bodies_under_motion_capture_need_no_plant(probe, programs, kind, parameters):
    if kind == 'tf':
        pytest.importorskip('tf2_msgs', reason='only a whole ROS 2 has it')
    programs.python(MOCAP, kind, 1, 2, 3, 4)
    probe.listen_to_attitudes()
    programs.tetra('sensors', '--ros-args', *(x for p in parameters for x in ('-p', p)))
    for i in range(1, 5):
        programs.tetra('agent', '--id', i)
    probe.wait_for(lambda: error(probe) < 0.02, 'a tetrahedron')
    probe.wait_for_health('/sensors', lambda s: s.message == 'measuring' and float(
        harness.values(s)['measurement rate [Hz]']) > 50.0, 'health')


def test_a_pose_topic_of_another_type_is_refused_before_anything_is_started(probe):
    probe.node.create_publisher(PoseArray, 'agent_2/pose', 1)
    with ThreadPoolExecutor() as pool:
        running = pool.submit(harness.run, 'sensors')
        probe.wait_for(running.done, 'the end')  # meanwhile it sees to it that it can be heard
    status, output, errors = running.result()
    assert (status, output) == (2, '')
    *before, last = errors.splitlines()
    assert last == ('tetra: error: poses.topic: /agent_2/pose is of type '
                    'geometry_msgs/msg/PoseArray, expected geometry_msgs/msg/PoseStamped')
    assert all('looking for poses' in line for line in before), before


def test_poses_of_another_type_that_come_later_are_told_of(probe, programs):
    programs.tetra('sensors')
    probe.wait_for_health('/sensors', lambda s: 'agent_2: ' in s.message, 'waiting')
    publisher = probe.node.create_publisher(PoseArray, 'agent_2/pose', 1)
    told = '/agent_2/pose is of type geometry_msgs/msg/PoseArray, expected'
    probe.wait_for_health('/sensors', lambda s: told in s.message, 'what it is')
    probe.node.destroy_publisher(publisher)
    probe.wait_for_health('/sensors', lambda s: told not in s.message, 'that it is gone')


def test_ctrl_c_ends_sensors_that_still_look_for_poses(programs):
    sensors = programs.tetra('sensors')
    said = 'looking for poses on /agent_1/pose, /agent_2/pose, /agent_3/pose, /agent_4/pose\n'
    assert any(line.endswith(said) for line in iter(sensors.stdout.readline, ''))
    begun = time.monotonic()
    status, output = harness.interrupt(sensors)
    assert status == 0
    assert 'Traceback' not in output
    left = (poses.LOOKS - poses.LOOKS_BEFORE_SAID) * poses.PAUSE
    assert time.monotonic() - begun < left - 1.0, 'it looked on'


# ---------------------------------------------------------------- without another process

class Listener(Node):
    """What Poses needs of a node."""

    def __init__(self, context):
        super().__init__('listener', context=context)
        self.rejected = []
        self.topics = []
        self.health = SimpleNamespace(
            reject=lambda reason, source: self.rejected.append((str(reason), source)),
            report=lambda: self.reports.append(self.time))
        self.reports = []
        self.time = 0.0

    def listen(self, kind, topic, callback, profile):
        self.topics.append((kind, topic, callback))


@pytest.fixture
def listener(probe):
    node = Listener(probe.context)
    yield node
    node.destroy_node()


def make(listener, monkeypatch, **given):
    monkeypatch.setattr(poses, 'LOOKS', 1)
    monkeypatch.setattr(poses, 'PAUSE', 0.0)
    values = check_parameters('sensors', {k.replace('__', '.'): v for k, v in given.items()})
    return poses.Poses(listener, values, range(1, 5), 4)


def stamped(kind, frame='lab', sec=1):
    message = kind()
    message.header.frame_id, message.header.stamp.sec = frame, sec
    return message


def test_names_and_numbers_make_the_topics(listener, monkeypatch):
    make(listener, monkeypatch, poses__topic='/{name}/pose', poses__names=('a', 'b', 'c', 'd'))
    assert [topic for _, topic, _ in listener.topics] == [f'/{x}/pose' for x in 'abcd']


def test_one_array_of_all_poses_will_do(listener, monkeypatch):
    made = make(listener, monkeypatch, poses__source='array', poses__topic='poses')
    (kind, topic, callback), = listener.topics
    assert (kind, topic) == (PoseArray, 'poses')
    message = stamped(PoseArray)
    message.poses = [PoseStamped().pose for _ in range(4)]
    message.poses[2].orientation.w = 0.5  # not a unit quaternion
    callback(_bytes(message))
    assert sorted(made.attitudes()) == [0, 1, 3]
    assert listener.rejected == [(tracking.NOT_UNIT, 'pose of agent_3')]
    callback(b'\0\1\0\0')
    message.poses = message.poses[:2]
    callback(_bytes(message))
    assert listener.rejected[1:] == [('malformed', 'poses')] * 2


def _bytes(message):
    from rclpy.serialization import serialize_message
    return serialize_message(message)


def test_poses_of_two_frames_are_not_mixed(listener, monkeypatch):
    made = make(listener, monkeypatch)
    for k, frame in enumerate(('lab', 'other')):
        listener.topics[k][2](_bytes(stamped(PoseStamped, frame)))
    assert list(made.attitudes()) == [0]
    assert listener.rejected == [('wrong frame', 'pose of agent_2')]


def test_a_body_that_is_lost_is_reported_when_it_is_and_not_again(listener, monkeypatch):
    made = make(listener, monkeypatch)
    made._now = lambda: listener.time
    for _, _, callback in listener.topics:
        callback(_bytes(stamped(PoseStamped)))
    for step in range(100):
        listener.time = 0.01 * step
        listener.topics[2][2](_bytes(stamped(PoseStamped, sec=2 + step)))
        assert (len(made.attitudes()) == 4) == (step <= 20)  # the others are lost after 0.2 s
    assert listener.reports == [pytest.approx(0.21)]
    _, values = made.assess()
    assert {name: value for name, value in values.items() if name.startswith('poses of')} == {
        'poses of agent_1': 1, 'poses of agent_2': 1, 'poses of agent_3': 101,
        'poses of agent_4': 1}


@pytest.mark.parametrize(('teller', 'frozen'), [('body_2', False), ('mocap', True)])
def test_a_driver_reads_encoders_and_may_repeat_itself(listener, monkeypatch, teller, frozen):
    made = make(listener, monkeypatch)
    made._now = lambda: listener.time
    monkeypatch.setattr(listener, 'get_publishers_info_by_topic', lambda topic: [
        SimpleNamespace(node_name=teller)] if topic == '/agent_2/pose' else [])
    for step in range(50):
        listener.time = 0.01 * step
        listener.topics[1][2](_bytes(stamped(PoseStamped, sec=1 + step)))
        made.told([(0.0, 1.0, 0.0)] * 4, 0.01)
        made.attitudes()
    assert (1 not in made.attitudes()) == frozen


def test_transforms_of_the_bodies_are_taken_and_others_left(listener, monkeypatch):
    made = make(listener, monkeypatch)
    made._frame = 'world'
    turned = SimpleNamespace(x=0.0, y=0.0, z=0.6, w=0.8)
    stamp = SimpleNamespace(sec=1, nanosec=0)
    made.on_transforms(SimpleNamespace(transforms=[
        SimpleNamespace(header=SimpleNamespace(frame_id=frame, stamp=stamp),
                        child_frame_id=child, transform=SimpleNamespace(rotation=turned))
        for frame, child in (('world', 'agent_2'), ('agent_2', 'camera'), ('map', 'agent_3'))]))
    assert made.attitudes() == {1: (0.0, 0.0, 0.6, 0.8)}
    assert listener.rejected == [('wrong frame', 'pose of agent_3')]


def test_without_tf2_msgs_it_is_said_what_to_install(listener, monkeypatch):
    try:
        import tf2_msgs  # noqa: F401
    except ImportError:
        with pytest.raises(ConfigurationError, match='apt install ros-jazzy-tf2-msgs'):
            make(listener, monkeypatch, poses__source='tf')
    else:
        make(listener, monkeypatch, poses__source='tf')
        assert listener.topics[0][1] == '/tf'
