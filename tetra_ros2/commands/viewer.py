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

"""``tetra viewer``: the running formation, or a recording, in a browser."""

import argparse

from tetra_ros2.commands import _arguments


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the arguments of ``tetra viewer``."""
    _arguments.add_web(parser)
    parser.add_argument(
        '--bag', metavar='DIR', help='show this recording, with a time slider, and no ROS')
    parser.add_argument(
        '--html', metavar='FILE',
        help='with --bag: write it as one page that plays in any browser by itself, and end')
    _arguments.add_node(parser)


def run(arguments: argparse.Namespace) -> int:
    """Show it until it is signalled; return the exit status."""
    config, ros = _arguments.check_node(arguments)  # a viewer has no parameters of its own
    if arguments.bag is not None:
        from tetra_ros2.viewer import replay  # needs viser and rosbags
        return replay.run(arguments) if arguments.html is None else replay.write_page(arguments)
    if arguments.html is not None:
        from tetra_ros2.config.parameters import ConfigurationError  # loads PyYAML
        raise ConfigurationError(
            f'{arguments.html!r} is not valid without --bag: a page holds a recording',
            key='--html')
    from tetra_ros2.viewer import node  # needs viser and ROS
    return node.main(arguments.host, arguments.port, arguments.read_only, config, ros)
