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

"""``tetra recorder``: the recorder in a process of its own."""

import argparse
import json

from tetra_ros2.commands import _arguments


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the arguments of ``tetra recorder``."""
    parser.add_argument(
        'topics', nargs='*', metavar='TOPIC',
        help='topics to record (default: all topics of the formation in this namespace)')
    parser.add_argument('--regex', metavar='R', help='and those whose full names match this')
    parser.add_argument(
        '-o', '--output', metavar='DIR',
        help='directory to make and record into (default: tetra_ and the date)')
    _arguments.add_storage(parser)
    parser.add_argument(
        '--use-sim-time', action='store_true', default=None,
        help='file the messages under the time of /clock, as a plant in lockstep publishes it')
    _arguments.add_node(parser)


def run(arguments: argparse.Namespace) -> int:
    """Record until it is signalled; return the exit status."""
    config, ros = _arguments.check_node(arguments, 'recorder')
    for name in ('topics', 'regex', 'output', 'storage', 'use_sim_time'):
        if value := getattr(arguments, name):
            ros = [*ros, '-p', f'{name}:={json.dumps(value)}']
    from tetra_ros2.recording import recorder  # needs ROS and rosbags
    return recorder.main(config, ros)
