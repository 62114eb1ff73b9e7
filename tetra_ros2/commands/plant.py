# Copyright 2026 The tetra_ros2 authors
# SPDX-License-Identifier: Apache-2.0

"""``tetra plant``: the plant in a process of its own."""

from tetra_ros2.commands import _arguments
from tetra_ros2.commands._arguments import add_node as add_arguments

__all__ = ['add_arguments', 'run']


def run(arguments):
    """Run the plant until it is signalled; return the exit status."""
    config, ros = _arguments.check_node(arguments, 'plant')
    from tetra_ros2.nodes import plant  # needs ROS
    return plant.main(config, ros)
