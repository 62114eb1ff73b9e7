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

"""``tetra body``: the driver of one real body."""

import argparse
import json

from tetra_ros2.commands import _arguments


def add_arguments(parser: argparse.ArgumentParser) -> None:
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


def run(arguments: argparse.Namespace) -> int:
    """Drive a body until it is signalled; return the exit status."""
    config, ros = _arguments.check_node(arguments, 'body')
    if arguments.driver is not None:
        ros += ['-p', f'driver:={json.dumps(arguments.driver)}']
    if arguments.option:
        ros += ['-p', f'driver_options:={json.dumps(arguments.option)}']
    from tetra_ros2.nodes import body  # needs ROS
    return body.main(arguments.id, config, ros)
