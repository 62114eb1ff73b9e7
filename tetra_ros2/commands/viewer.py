# Copyright 2026 The tetra_ros2 authors
# SPDX-License-Identifier: Apache-2.0

"""``tetra viewer``: the running formation, or a recording, in a browser."""

from tetra_ros2.commands import _arguments


def add_arguments(parser):
    """Add the arguments of ``tetra viewer``."""
    _arguments.add_web(parser)
    parser.add_argument(
        '--bag', metavar='DIR', help='show this recording, with a time slider, and no ROS')
    _arguments.add_node(parser)


def run(arguments):
    """Show it until it is signalled; return the exit status."""
    config, ros = _arguments.check_node(arguments)  # a viewer has no parameters of its own
    if arguments.bag is not None:
        from tetra_ros2.viewer import replay  # needs viser and rosbags
        return replay.run(arguments)
    from tetra_ros2.viewer import node  # needs viser and ROS
    return node.main(arguments.host, arguments.port, arguments.read_only, config, ros)
