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

"""The names of nodes, topics, services and frames; relative, so that a namespace moves all."""

from collections.abc import Mapping
import re
from typing import Any

PLANT = 'plant'
MONITOR = 'monitor'
RECORDER = 'recorder'
SENSORS = 'sensors'
VIEWER = 'viewer'

ATTITUDES = 'formation/attitudes'
COSINES = 'formation/cosines'
ERROR = 'formation/error'
MARKERS = 'formation/markers'
BODIES = 'formation/bodies'
DIAGNOSTICS = '/diagnostics'
CLOCK = '/clock'
TF = '/tf'

RESET = 'plant/reset'
RANDOMIZE = 'plant/randomize'
PAUSE = 'plant/pause'

WORLD = 'world'


def agent(i: int) -> str:
    """Return the name of the node of agent i."""
    return f'agent_{i}'


def body_frame(i: int) -> str:
    """Return the name of the body frame of agent i."""
    return f'agent_{i}'


def relative_attitude(i: int | str, j: int | str) -> str:
    """Return the topic on which agent i is told where agent j points, or a pattern of such."""
    return f'agent_{i}/relative_attitude/agent_{j}'


def cmd_vel(i: int | str) -> str:
    """Return the topic on which agent i commands its angular velocity, or a pattern of such."""
    return f'agent_{i}/cmd_vel'


def joint_states(i: int | str) -> str:
    """Return the topic, or a pattern of such, on which the plant tells the joints of body i."""
    return f'agent_{i}/joint_states'


def body(i: int) -> str:
    """Return the name of the node that drives the body of agent i."""
    return f'body_{i}'


def pose(i: int) -> str:
    """Return the topic on which the driver of a body tells its attitude."""
    return f'agent_{i}/pose'


def pose_topics(values: Mapping[str, Any], n: int) -> dict[int, str]:
    """
    Return the topic on which the pose of each body is told, by agent, from 1.

    :param values: checked parameters, with those of the poses
    :param n: the number of agents
    """
    everybody = range(1, n + 1)
    source, topic = values['poses.source'], values['poses.topic']
    if source != 'pose':  # all on one
        return dict.fromkeys(everybody, TF if source == 'tf' else topic)
    bodies = values['poses.names'] or [agent(i) for i in everybody]
    return {i: topic.format(i=i, name=bodies[i - 1]) for i in everybody}


def stop(node: str) -> str:
    """Return the service that stops the bodies of a node, and lets them go again."""
    return f'{node}/stop'


_TYPES = {
    r'agent_\d+/relative_attitude/agent_\d+': 'geometry_msgs/msg/Vector3Stamped',
    r'agent_\d+/cmd_vel': 'geometry_msgs/msg/TwistStamped',
    r'agent_\d+/joint_states': 'sensor_msgs/msg/JointState',
    ATTITUDES: 'geometry_msgs/msg/PoseArray',
    COSINES: 'std_msgs/msg/Float64MultiArray',
    ERROR: 'std_msgs/msg/Float64',
}

_SHARED_TYPES = {
    DIAGNOSTICS: 'diagnostic_msgs/msg/DiagnosticArray',
    CLOCK: 'rosgraph_msgs/msg/Clock',
}

FORMATION_TOPICS = tuple(_TYPES)
"""Regular expressions of all the topics of a formation, relative to its namespace."""


def message_type(topic: str, namespace: str = '/') -> str | None:
    """
    Return the type that a formation's topic has by contract, or None if it is not one of it.

    :param topic: full name
    :param namespace: of the formation
    """
    if topic in _SHARED_TYPES:
        return _SHARED_TYPES[topic]
    prefix = namespace.rstrip('/') + '/'
    if not topic.startswith(prefix):
        return None
    relative = topic[len(prefix):]
    return next((kind for name, kind in _TYPES.items() if re.fullmatch(name, relative)), None)
