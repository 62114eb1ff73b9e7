# Copyright 2026 The tetra_ros2 authors
# SPDX-License-Identifier: Apache-2.0

"""
One process for every node of a formation.

    ros2 launch tetra_ros2 formation.launch.py config:=rotating
"""

from launch.actions import DeclareLaunchArgument, OpaqueFunction
from launch.substitutions import LaunchConfiguration
from launch_ros.actions import Node

from launch import LaunchDescription
from tetra_ros2.config import configuration
from tetra_ros2.config.share import share_directory


def start(context):
    """Return the nodes; how many agents there are stands in the configuration."""
    def argument(name):
        return LaunchConfiguration(name).perform(context)

    file = configuration.load(argument('config'))
    common = {
        'package': 'tetra_ros2',
        'namespace': argument('namespace'),
        'parameters': [str(file.path)],
        'output': 'screen',
    }
    changes = {name: argument(name) for name in ('mode', 'seed') if argument(name)}
    if 'seed' in changes:
        changes['seed'] = int(changes['seed'])
    plant = {**common, 'parameters': [str(file.path), changes]} if changes else common
    nodes = [Node(executable='plant', **plant), Node(executable='monitor', **common)]
    nodes += [Node(executable='agent', arguments=['--id', str(i)], **common)
              for i in range(1, file.formation().topology.n + 1)]
    if argument('record'):
        nodes.append(Node(
            executable='recorder', arguments=['--output', argument('record')], **common))
    if argument('rviz').lower() in ('true', '1', 'yes'):
        # In the namespace of the formation: the names of topics in the file are relative.
        nodes.append(Node(
            package='rviz2', executable='rviz2', namespace=argument('namespace'),
            arguments=['-d', str(share_directory() / 'config' / 'formation.rviz')],
            output='screen'))
    return nodes


def generate_launch_description():
    """Return the description that ``ros2 launch`` asks for."""
    return LaunchDescription([
        DeclareLaunchArgument(
            'config', default_value='complete',
            description='a parameter file, or the name of one that ships'),
        DeclareLaunchArgument(
            'namespace', default_value='', description='namespace of all nodes'),
        DeclareLaunchArgument(
            'mode', default_value='', description='lockstep or realtime; empty: as in config'),
        DeclareLaunchArgument(
            'seed', default_value='', description='of the initial attitudes; empty: as in config'),
        DeclareLaunchArgument(
            'record', default_value='', description='directory to record into; empty: do not'),
        DeclareLaunchArgument(
            'rviz', default_value='false', description='true: show the formation in RViz'),
        OpaqueFunction(function=start),
    ])
