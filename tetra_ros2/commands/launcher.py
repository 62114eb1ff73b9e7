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

"""``tetra launcher``: plant, agents and monitor in one process, and a summary."""

import argparse

from tetra_ros2.commands import _arguments


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the arguments of ``tetra launcher``."""
    _arguments.add_config(parser, default='complete')
    parser.add_argument(
        '--duration', type=float, metavar='S',
        help='formation time to run [s] (default: 30; with --view until Ctrl-C)')
    parser.add_argument(
        '--mode', choices=('lockstep', 'realtime'), help='how time passes (default: as in FILE)')
    parser.add_argument(
        '--body', metavar='BODY', help='what turns: kinematic, wheels, gimbal, or an MJCF file '
        '(default: as in FILE)')
    parser.add_argument(
        '--seed', type=int, metavar='N', help='of the initial attitudes (default: as in FILE)')
    parser.add_argument(
        '--record', metavar='DIR', help='record into this directory, which must not exist')
    _arguments.add_storage(parser, default='mcap')
    parser.add_argument(
        '--without', action='append', default=[], metavar='NODE',
        help="leave out plant or agent_I, for somebody else's in its place")
    parser.add_argument(
        '--view', action='store_true',
        help='show it in a browser, at the pace of real time, until Ctrl-C')
    _arguments.add_web(parser)
    parser.add_argument('--json', action='store_true', help='print the summary as JSON')
    parser.add_argument('--quiet', action='store_true', help='show no progress')
    _arguments.add_namespace(parser)


def run(arguments: argparse.Namespace) -> int:
    """Run a formation for a time; return the exit status."""
    config, _ = _arguments.check_node(arguments, 'agent', 'plant', 'monitor', 'recorder')
    assert config is not None  # it has a default
    from tetra_ros2 import report  # needs ROS
    return report.main(arguments, config, arguments.ros_arguments)
