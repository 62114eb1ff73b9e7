# Copyright 2026 The tetra_ros2 authors
# SPDX-License-Identifier: Apache-2.0

"""``tetra agent``: one agent in a process of its own."""

from tetra_ros2.commands import _arguments


def add_arguments(parser):
    """Add the arguments of ``tetra agent``."""
    parser.add_argument('--id', type=int, required=True, metavar='I', help='which agent, from 1')
    _arguments.add_node(parser)


def run(arguments):
    """Run an agent until it is signalled; return the exit status."""
    config, ros = _arguments.check_node(arguments, 'agent')
    from tetra_ros2.nodes import agent  # needs ROS
    return agent.main(arguments.id, config, ros)
