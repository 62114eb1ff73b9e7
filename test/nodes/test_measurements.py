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

"""Who is told what: the state to all, and to each agent what it sees, and no more."""

from types import SimpleNamespace

import numpy as np
import pytest
from tetra_ros2.formation import rotation, topology
from tetra_ros2.formation.bodies import RigidBodies
from tetra_ros2.nodes.measurements import Measurements
from tetra_ros2.wire import cdr

EDGES = [(1, 2), (1, 4), (2, 3), (4, 1)]  # agent 3 is blind


class Node:
    """What it needs of a node, and a record of what was sent."""

    def __init__(self):
        self.sent = {}
        self.exclusive = []

    def offer(self, message_type, topic, profile, exclusive=False):
        if exclusive:
            self.exclusive.append(topic)
        return SimpleNamespace(
            handle=None, publish=lambda message: self.sent.setdefault(topic, []).append(message))


@pytest.fixture
def made():
    node = Node()
    bodies = RigidBodies(rotation.random(np.random.default_rng(3), (4,)), [(1.0, 0.0, 0.0)] * 4)
    return node, Measurements(node, topology.custom(4, EDGES)), bodies


def topics(edges):
    return {f'agent_{i}/relative_attitude/agent_{j}' for i, j in edges}


def test_everybody_is_told_what_it_sees_in_its_own_frame_and_all_are_told_the_state(made):
    node, measurements, bodies = made
    assert node.exclusive == ['formation/attitudes']
    assert measurements.observers == [0, 1, 3]
    assert measurements.others == [[1, 3], [2], None, [0]]
    measurements.publish(12345, bodies, bodies.seen_by)
    assert node.sent.keys() == topics(EDGES) | {'formation/attitudes'}
    for i, j in EDGES:
        message, = node.sent[f'agent_{i}/relative_attitude/agent_{j}']
        stamp, seen = cdr.vector3_stamped(f'agent_{i}').decode(message)
        assert stamp == 12345
        assert seen == bodies.seen_by(i - 1, [j - 1])[0]
    message, = node.sent['formation/attitudes']
    stamp, poses = cdr.pose_array('world', 4).decode(message)
    assert stamp == 12345
    poses = np.reshape(poses, (4, 7))
    assert np.array_equal(poses[:, :3], bodies.reduced)
    assert np.array_equal(poses[:, 3:], bodies.attitudes)


@pytest.mark.parametrize(('lost', 'told'), [
    ({1}, [(1, 4), (4, 1)]), ({0}, [(2, 3)]), ({2}, [(1, 2), (1, 4), (4, 1)]),
    ({0, 1, 2, 3}, [])])
def test_who_is_lost_sees_nothing_and_is_seen_by_nobody(made, lost, told):
    node, measurements, bodies = made
    measurements.publish(1, bodies, bodies.seen_by, lost)
    assert node.sent.keys() == topics(told) | {'formation/attitudes'}


@pytest.mark.parametrize(('agents', 'told'), [
    (0b0001, [(1, 2), (1, 4)]), (0b1010, [(2, 3), (4, 1)]), (0b0100, []), (-1, EDGES)])
def test_a_repetition_goes_to_those_who_are_named(made, agents, told):
    node, measurements, bodies = made
    measurements.tell(cdr.head(1), bodies.seen_by, agents=agents)
    assert node.sent.keys() == topics(told)
