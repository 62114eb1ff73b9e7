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

"""``tetra agent``: one agent in a process of its own."""

import argparse

from tetra_ros2.commands import _arguments


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the arguments of ``tetra agent``."""
    parser.add_argument('--id', type=int, required=True, metavar='I', help='which agent, from 1')
    _arguments.add_node(parser)


def run(arguments: argparse.Namespace) -> int:
    """Run an agent until it is signalled; return the exit status."""
    config, ros = _arguments.check_node(arguments, 'agent')
    from tetra_ros2.nodes import agent  # needs ROS
    return agent.main(arguments.id, config, ros)
