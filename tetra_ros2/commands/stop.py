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

"""``tetra stop``: hold all bodies, simulated and real, until they are released."""

import argparse

from tetra_ros2.commands import _arguments


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the arguments of ``tetra stop``."""
    parser.add_argument('--release', action='store_true', help='let them go again')
    _arguments.add_namespace(parser)


def run(arguments: argparse.Namespace) -> int:
    """Stop all bodies, or release them; return the exit status."""
    from tetra_ros2.config import configuration  # loads numpy
    namespace = configuration.check_namespace(arguments.namespace)
    from tetra_ros2.nodes import stop  # needs ROS
    return stop.main(not arguments.release, namespace, arguments.ros_arguments)
