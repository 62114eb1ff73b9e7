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

"""The body frames as TF has them."""

from importlib.util import find_spec

import numpy as np
import pytest
from rclpy.serialization import deserialize_message, serialize_message
from tetra_ros2.ros.tf import make_transforms

GAMMA = np.eye(3)
ATTITUDES = np.array([[0.0, 0.0, 0.0, 1.0], [0.5, 0.5, 0.5, 0.5], [0.0, 0.6, 0.0, 0.8]])


def test_each_transform_takes_a_body_frame_to_the_world():
    transforms = make_transforms(3_000_000_001, ATTITUDES, GAMMA)
    assert [t.child_frame_id for t in transforms] == ['agent_1', 'agent_2', 'agent_3']
    for k, transform in enumerate(transforms):
        assert transform.header.frame_id == 'world'
        assert (transform.header.stamp.sec, transform.header.stamp.nanosec) == (3, 1)
        q, p = transform.transform.rotation, transform.transform.translation
        assert [q.x, q.y, q.z, q.w] == ATTITUDES[k].tolist()
        assert [p.x, p.y, p.z] == GAMMA[k].tolist()


def test_transforms_can_be_sent():
    for transform in make_transforms(1, ATTITUDES, GAMMA):
        assert deserialize_message(serialize_message(transform), type(transform)) == transform


@pytest.mark.skipif(find_spec('tf2_msgs') is not None, reason='tf2_msgs is installed')
def test_without_tf2_msgs_there_is_one_line_of_why_and_all_else_works(processes, probe):
    plant = processes.tetra('launcher', '--config', 'complete', '--duration', '5', '--ros-args',
                            '-p', 'publish_tf:=true')
    output, _ = plant.communicate(timeout=60)
    assert plant.returncode == 0, output
    assert output.count('no transforms on /tf: tf2_msgs is not installed') == 1
