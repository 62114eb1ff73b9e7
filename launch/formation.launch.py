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
One process for every node of a formation.

    ros2 launch tetra_ros2 formation.launch.py config:=rotating
"""

from importlib.util import find_spec
import os

from ament_index_python.packages import get_package_share_directory, PackageNotFoundError
from launch import LaunchDescription
from launch.actions import DeclareLaunchArgument, OpaqueFunction, Shutdown
from launch.substitutions import LaunchConfiguration
from launch_ros.actions import Node
from tetra_ros2 import installation
from tetra_ros2.config import bodies, configuration, parameters
from tetra_ros2.config.parameters import ConfigurationError
from tetra_ros2.config.share import share_directory


def start(context):
    """
    Return the nodes; how many agents there are stands in the configuration.

    All is checked before any node is returned, so that a wrong call starts none.
    """
    def argument(name):
        return LaunchConfiguration(name).perform(context)

    file = configuration.load(argument('config'))
    namespace = argument('namespace')  # as it is: one that an including file pushes comes before
    configuration.check_namespace(namespace)
    common = {
        'package': 'tetra_ros2',
        'namespace': namespace,
        'parameters': [str(file.path)],
        'output': 'screen',
    }
    changes = {name: argument(name) for name in ('mode', 'seed', 'body') if argument(name)}
    if 'seed' in changes:
        changes['seed'] = check_seed(changes['seed'])
    check_plant(file, changes)
    recorder = check_recording(argument('record'))
    rviz = check_rviz(argument('rviz'))

    plant = dict(common)
    if changes:
        # They come before what the file gives to a node of this name only if it is said.
        plant.update(name='plant', parameters=[str(file.path), changes])
    monitor = dict(common)
    if rviz:
        monitor.update(name='monitor', parameters=[str(file.path), {'publish_tf': True}])
    nodes = [
        Node(executable='plant', on_exit=Shutdown(reason='the plant has ended'), **plant),
        Node(executable='monitor', **monitor),
    ]
    nodes += [Node(executable='agent', arguments=['--id', str(i)], **common)
              for i in range(1, file.formation().topology.n + 1)]
    if recorder:
        nodes.append(Node(executable='recorder', arguments=recorder, **common))
    if rviz:
        # In the namespace of the formation: the names of topics in the file are relative.
        nodes.append(Node(package='rviz2', executable='rviz2', namespace=namespace,
                          arguments=rviz, output='screen'))
    return nodes


def check_seed(text):
    """Return a seed as a number."""
    try:
        seed = int(text)
        if not -1 <= seed < 2**63:
            raise ValueError
    except ValueError:
        raise ConfigurationError(
            f'{text!r} is not valid, expected an integer from -1 up', key='seed') from None
    return seed


def check_plant(file, changes):
    """Refuse a plant that would refuse itself, such as bodies that cannot be."""
    parameters.check_parameters('plant', changes)
    try:
        bodies.check_bodies({**file.values('plant'), **changes})
    except ModuleNotFoundError as error:
        raise ConfigurationError(
            f'{error.name} is not installed: {installation.missing(error.name)}',
            key='body') from None


def check_recording(path):
    """Return the recorder's arguments, none if there is nothing to record."""
    if not path:
        return []
    try:
        configuration.check_new(path)
    except ConfigurationError as error:
        raise ConfigurationError(str(error), key='record') from None
    if find_spec('rosbags') is None:
        raise ConfigurationError(
            f'rosbags is not installed: {installation.missing("rosbags")}', key='record')
    return ['--output', path]


def check_rviz(wanted):
    """Return RViz's arguments, none if it is not wanted."""
    if wanted != 'true':
        return []
    try:
        get_package_share_directory('rviz2')
    except PackageNotFoundError:
        distribution = os.environ.get('ROS_DISTRO', 'jazzy')
        raise ConfigurationError(
            f'rviz2 is not installed: sudo apt install ros-{distribution}-rviz2',
            key='rviz') from None
    return ['-d', str(share_directory() / 'config' / 'formation.rviz')]


def generate_launch_description():
    """Return the description that ``ros2 launch`` asks for."""
    return LaunchDescription([
        DeclareLaunchArgument(
            'config', default_value='complete',
            description='a parameter file, or the name of one that ships'),
        DeclareLaunchArgument(
            'namespace', default_value='', description='namespace of all nodes'),
        DeclareLaunchArgument(
            'mode', default_value='', choices=['', 'lockstep', 'realtime'],
            description='how time passes; empty: as in config'),
        DeclareLaunchArgument(
            'seed', default_value='', description='of the initial attitudes; empty: as in config'),
        DeclareLaunchArgument(
            'body', default_value='',
            description='what turns: kinematic, wheels, gimbal, or an MJCF file; empty: as in '
                        'config'),
        DeclareLaunchArgument(
            'record', default_value='', description='directory to record into; empty: do not'),
        DeclareLaunchArgument(
            'rviz', default_value='false', choices=['true', 'false'],
            description='whether to show the formation in RViz'),
        OpaqueFunction(function=start),
    ])
