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

"""``tetra sensors``: what everybody sees, from poses that come from elsewhere."""

import argparse

from tetra_ros2.commands import _arguments
from tetra_ros2.commands._arguments import add_node as add_arguments

__all__ = ['add_arguments', 'run']


def run(arguments: argparse.Namespace) -> int:
    """Run the sensors until they are signalled; return the exit status."""
    config, ros = _arguments.check_node(arguments, 'sensors')
    from tetra_ros2.nodes import sensors  # needs ROS
    return sensors.main(config, ros)
