# Copyright 2026 The tetra_ros2 authors
# SPDX-License-Identifier: Apache-2.0

"""``tetra body``: the driver of one real body."""

import json

from tetra_ros2.commands import _arguments


def add_arguments(parser):
    """Add the arguments of ``tetra body``."""
    parser.add_argument(
        '--id', type=int, required=True, metavar='I', help='whose body it is, from 1')
    parser.add_argument(
        '--driver', metavar='DRIVER',
        help='module:Class, or one that ships: pan_tilt, rate_setpoint (default: as in FILE)')
    parser.add_argument(
        '--option', action='append', default=[], metavar='NAME=VALUE',
        help='what the driver is made with; may be repeated')
    _arguments.add_node(parser)


def run(arguments):
    """Drive a body until it is signalled; return the exit status."""
    config, ros = _arguments.check_node(arguments, 'body')
    if arguments.driver is not None:
        ros += ['-p', f'driver:={json.dumps(arguments.driver)}']
    if arguments.option:
        ros += ['-p', f'driver_options:={json.dumps(arguments.option)}']
    from tetra_ros2.nodes import body  # needs ROS
    return body.main(arguments.id, config, ros)
