# Copyright 2026 The tetra_ros2 authors
# SPDX-License-Identifier: Apache-2.0

"""``tetra stop``: hold all bodies, simulated and real, until they are released."""

from tetra_ros2.commands import _arguments


def add_arguments(parser):
    """Add the arguments of ``tetra stop``."""
    parser.add_argument('--release', action='store_true', help='let them go again')
    _arguments.add_namespace(parser)


def run(arguments):
    """Stop all bodies, or release them; return the exit status."""
    from tetra_ros2.config import configuration  # loads numpy
    namespace = configuration.check_namespace(arguments.namespace)
    from tetra_ros2.nodes import stop  # needs ROS
    return stop.main(not arguments.release, namespace, arguments.ros_arguments)
