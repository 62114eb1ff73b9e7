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

"""Sensors apart from the plant: what they publish of the poses that they are told."""

from geometry_msgs.msg import PoseArray, PoseStamped, Vector3Stamped
from node_bench import Bench
import numpy as np
import pytest
from rclpy.serialization import serialize_message
from tetra_ros2.formation import rotation
from tetra_ros2.nodes import poses
from tetra_ros2.nodes.sensors import Sensors
from tetra_ros2.ros import diagnostics
from tetra_ros2.wire import cdr


@pytest.fixture
def bench(probe, monkeypatch):
    monkeypatch.setattr(poses, 'LOOKS', 1)
    monkeypatch.setattr(poses, 'PAUSE', 0.0)
    # The timer is not to fire by itself: the test does.
    with Bench(probe, Sensors, rate=0.01, topology__n=3, poses__timeout=60.0,
               poses__frozen_angle=0.5) as made:
        yield made


def tell(node, i, attitude, nanosec=1):
    """Let the pose of a body arrive."""
    message = PoseStamped()
    message.header.frame_id, message.header.stamp.nanosec = 'lab', nanosec
    q = message.pose.orientation
    q.x, q.y, q.z, q.w = map(float, attitude)
    node.poses._receiver(i - 1)(serialize_message(message))


def test_everybody_sees_those_whose_poses_are_known_and_the_others_see_nothing(probe, bench):
    node = bench.node
    attitudes = rotation.random(np.random.default_rng(1), (3,))
    topics = {(i, j): f'agent_{i}/relative_attitude/agent_{j}'
              for i in (1, 2, 3) for j in (1, 2, 3) if i != j}
    for topic in topics.values():
        probe.listen(Vector3Stamped, topic)
    probe.listen(PoseArray, 'formation/attitudes')
    for topic in [*topics.values(), 'formation/attitudes']:
        bench.wait_for(lambda topic=topic: node.count_subscribers(topic), topic)
    node._on_timer()
    assert node.published == 0, 'nothing is known'
    assert node.assess()[0] == diagnostics.WARN
    assert node.assess()[1].startswith('waiting for poses: agent_1')

    for i in (1, 3):
        tell(node, i, attitudes[i - 1])
    heard = [topics[1, 3], topics[3, 1], 'formation/attitudes']
    bench.wait_for(lambda: node._on_timer() or all(
        probe.received[topic] for topic in heard), 'measurements')
    assert not any(probe.received[topic] for edge, topic in topics.items() if 2 in edge)
    gamma = rotation.rotate(attitudes, [1.0, 0.0, 0.0])
    seen = probe.received[topics[1, 3]][0]
    assert seen.header.frame_id == 'agent_1'
    expected = rotation.rotate(rotation.inverse(attitudes[0]), gamma[2])
    assert [seen.vector.x, seen.vector.y, seen.vector.z] == pytest.approx(expected, abs=1e-12)
    assert node.assess()[:2] == (diagnostics.WARN, 'waiting for poses: agent_2: not seen yet')

    tell(node, 2, attitudes[1])
    bench.wait_for(lambda: node._on_timer() or all(
        probe.received[topic] for topic in topics.values()), 'all measurements')
    level, message, values = node.assess()
    assert (level, message) == (diagnostics.OK, 'measuring')
    assert values['measurement rate [Hz]'] > 0.0
    bench.wait_for(lambda: np.allclose(probe.attitudes(), attitudes, atol=1e-12), 'the state')


def test_a_body_that_was_told_to_turn_and_shows_no_change_for_long_is_measured_no_more(bench):
    node, clock = bench.node, [1000.0]
    node.poses._now = lambda: clock[0]
    for stamp in (1, 2):
        for i in (1, 2, 3):
            tell(node, i, rotation.IDENTITY, stamp)
        clock[0] += 50.0
    node._receiver(2)(cdr.twist_stamped('agent_2').encode(1, 0.0, 0.0, 0.0, 0.0, 0.0, 40.0))
    node._told_at -= 1.0  # a second has passed
    clock[0] -= 45.0
    node._on_timer()
    assert node.assess()[0] == diagnostics.OK, 'the pose has been the same for 55 s'
    clock[0] += 10.0
    assert node.assess()[:2] == (diagnostics.ERROR, 'not measured: agent_2: frozen')
    tell(node, 2, rotation.exp(np.array([0.0, 0.0, 1e-3])), 3)
    assert node.assess()[0] == diagnostics.OK


def test_a_command_in_the_frame_of_another_body_is_dropped(bench):
    node = bench.node
    node._receiver(2)(cdr.twist_stamped('agent_1').encode(1, 0.0, 0.0, 0.0, 0.0, 0.0, 1.0))
    assert dict(node.health.rejected) == {
        "wrong frame: 'agent_1', expected 'agent_2' (agent_2)": 1}
    assert node._rates == [(0.0, 0.0, 0.0)] * 3
