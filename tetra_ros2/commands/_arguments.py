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

"""Arguments that several commands share, and their checks."""

import argparse
from pathlib import Path

from tetra_ros2.config.share import shipped


def add_config(parser: argparse.ArgumentParser, default: str | None = None) -> None:
    """Add ``--config``."""
    parser.add_argument(
        '--config', metavar='FILE', default=default,
        help='a ROS 2 parameter file, or the name of one that ships: '
             f'{", ".join(shipped())}')


def add_namespace(parser: argparse.ArgumentParser) -> None:
    """Add ``--namespace``."""
    parser.add_argument('--namespace', metavar='NS', default='', help='namespace of the node')


def add_node(parser: argparse.ArgumentParser) -> None:
    """Add what every node takes."""
    add_config(parser)
    add_namespace(parser)


def add_web(parser: argparse.ArgumentParser) -> None:
    """Add where the viewer's web server listens."""
    parser.add_argument(
        '--host', metavar='ADDRESS', default='127.0.0.1',
        help='address to listen on; 0.0.0.0 lets other machines in, with the token of the '
             'printed address (default: %(default)s)')
    parser.add_argument(
        '--port', type=int, default=8080, metavar='P',
        help='port to listen on; 0 for any that is free (default: %(default)s)')
    parser.add_argument(
        '--read-only', action='store_true', help='let browsers look, and change nothing')


def add_storage(parser: argparse.ArgumentParser, default: str | None = None) -> None:
    """Add ``--storage``."""
    parser.add_argument(
        '--storage', choices=('mcap', 'sqlite3'), default=default,
        help='storage format of the recording (default: mcap)')


def check_node(arguments: argparse.Namespace, *kinds: str) -> tuple[Path | None, list[str]]:
    """
    Check all that a node is given, before ROS is loaded.

    :param arguments: parsed arguments with ``config``, ``namespace`` and ``ros_arguments``
    :param kinds: the kinds of node whose parameters may be given
    :returns: the path of the configuration, or None; and the arguments as after ``--ros-args``,
        with the namespace
    :raises ConfigurationError: if something is not valid
    """
    # Loads numpy and PyYAML, for which `--help` need not wait.
    from tetra_ros2.config import configuration
    namespace = configuration.check_namespace(arguments.namespace)
    configuration.check_ros_arguments(arguments.ros_arguments, kinds)
    path = None
    if arguments.config is not None:
        path = configuration.load(arguments.config).path
    ros = list(arguments.ros_arguments)
    return path, [*ros, '-r', f'__ns:={namespace}'] if namespace else ros
