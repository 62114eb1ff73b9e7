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

"""Recordings made by hand, with nothing of the package under test but the message layouts."""

import struct

import numpy as np
from rosbags.rosbag2 import StoragePlugin, Writer
from rosbags.typesys import get_typestore, Stores
from tetra_ros2.formation import law, rotation, topology
from tetra_ros2.formation.gain import Cosine

STORE = get_typestore(Stores.ROS2_JAZZY)
JOINTS, DIAGNOSTICS = 'sensor_msgs/msg/JointState', 'diagnostic_msgs/msg/DiagnosticArray'
POSES, TWIST, VECTOR = (f'geometry_msgs/msg/{name}' for name in (
    'PoseArray', 'TwistStamped', 'Vector3Stamped'))


def header(stamp, frame, length=None):
    """Return encapsulation and header, aligned for the float64 that follow."""
    encoded = frame.encode() + b'\0'
    body = struct.pack('<iII', *divmod(stamp, 10**9), len(encoded)) + encoded
    if length is not None:
        body += b'\0' * (-len(body) % 4) + struct.pack('<I', length)
    return b'\0\1\0\0' + body + b'\0' * (-len(body) % 8)


def message(stamp, frame, numbers, length=None):
    return header(stamp, frame, length) + np.asarray(numbers, dtype='<f8').tobytes()


def joint_state(stamp, names, *sequences):
    """Return a sensor_msgs/JointState as bytes, by somebody else's serialisation."""
    types = STORE.types
    header = types['std_msgs/msg/Header'](
        types['builtin_interfaces/msg/Time'](*divmod(stamp, 10**9)), 'a frame')
    return bytes(STORE.serialize_cdr(types[JOINTS](
        header, list(names), *(np.array(s, dtype=float) for s in sequences)), JOINTS))


def diagnostics(name, figures):
    """Return the diagnostics of a node as bytes."""
    types = STORE.types
    values = [types['diagnostic_msgs/msg/KeyValue'](*item) for item in figures.items()]
    header = types['std_msgs/msg/Header'](types['builtin_interfaces/msg/Time'](1, 0), '')
    status = types['diagnostic_msgs/msg/DiagnosticStatus'](0, name, 'running', '', values)
    return bytes(STORE.serialize_cdr(types[DIAGNOSTICS](header, [status]), DIAGNOSTICS))


def states(count, graph, gain=None, h=0.01, seed=3):
    """Return attitudes ``(k, n, 4)`` and body rates ``(k, n, 3)`` of the sampled loop."""
    gain = gain or Cosine()
    attitudes = rotation.random(np.random.default_rng(seed), (graph.n,))
    axis = np.array([1.0, 0.0, 0.0])
    kept = []
    for _ in range(count):
        gamma = rotation.rotate(attitudes, axis)
        world = law.world_angular_velocity(gamma, graph.weights, gain)
        body = rotation.rotate(rotation.inverse(attitudes), world)
        kept.append((attitudes, body))
        attitudes = rotation.renormalize(rotation.multiply(attitudes, rotation.exp(h * body)))
    return np.stack([a for a, _ in kept]), np.stack([b for _, b in kept])


def write(path, count=400, graph=None, gain=None, namespace='', h=0.01, storage='mcap',
          commands=True, measurements=True, start=1.0, repeat=1, joints=None, figures=None):
    """
    Write a recording of a formation; return attitudes and body rates as :func:`states` does.

    :param repeat: how often to go through the states again, at later times
    :param joints: of every body: a function of the number of the state and the agent, from 1, that
        returns names, positions, velocities and efforts
    :param figures: of the plant's diagnostics, as texts
    """
    graph = graph or topology.complete(4)
    attitudes, rates = states(count, graph, gain, h)
    gamma = rotation.rotate(attitudes, [1.0, 0.0, 0.0])
    poses = np.concatenate([gamma, attitudes], axis=-1).reshape(count, -1)
    plugin = {'mcap': StoragePlugin.MCAP, 'sqlite3': StoragePlugin.SQLITE3}[storage]
    with Writer(path, version=9, storage_plugin=plugin) as bag:
        def connect(topic, kind):
            return bag.add_connection(f'{namespace}/{topic}', kind, typestore=STORE)

        state = connect('formation/attitudes', POSES)
        agents = range(1, graph.n + 1)
        answers = {i: connect(f'agent_{i}/cmd_vel', TWIST) for i in agents} if commands else {}
        seen = [(i, connect(f'agent_{i}/relative_attitude/agent_{j}', VECTOR))
                for i, j, _ in graph.edges] if measurements else []
        turning = {i: connect(f'agent_{i}/joint_states', JOINTS) for i in agents} if joints else {}
        if figures:
            bag.write(bag.add_connection('/diagnostics', DIAGNOSTICS, typestore=STORE),
                      round(start * 1e9), diagnostics(f'{namespace}/plant', figures))
        for k in range(count * repeat):
            stamp = round((start + k * h) * 1e9)
            now = k % count
            bag.write(state, stamp, message(stamp, 'world', poses[now], graph.n))
            for i, connection in seen:
                bag.write(connection, stamp, message(stamp, f'agent_{i}', [1.0, 0.0, 0.0]))
            for i, connection in turning.items():
                bag.write(connection, stamp, joint_state(stamp, *joints(now, i)))
            for i, connection in answers.items():
                bag.write(connection, stamp, message(
                    stamp, f'agent_{i}', [0.0, 0.0, 0.0, *rates[now, i - 1]]))
    return attitudes, rates
