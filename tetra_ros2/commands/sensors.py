# Copyright 2026 The tetra_ros2 authors
# SPDX-License-Identifier: Apache-2.0

"""``tetra sensors``: what everybody sees, from poses that come from elsewhere."""

from tetra_ros2.commands import _arguments
from tetra_ros2.commands._arguments import add_node as add_arguments

__all__ = ['add_arguments', 'run']


def run(arguments):
    """Run the sensors until they are signalled; return the exit status."""
    config, ros = _arguments.check_node(arguments, 'sensors')
    from tetra_ros2.nodes import sensors  # needs ROS
    return sensors.main(config, ros)
