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

"""``tetra policy``: the SROS2 policy of a formation."""

import argparse
from pathlib import Path
import sys

from tetra_ros2.commands import _arguments
from tetra_ros2.config import configuration
from tetra_ros2.config.parameters import ConfigurationError
from tetra_ros2.wire import names
from tetra_ros2.wire.policy import document, rights


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the arguments of ``tetra policy``."""
    _arguments.add_config(parser, default='complete')
    parser.add_argument(
        '--output', metavar='FILE', help='file to write (default: to the standard output)')
    parser.add_argument(
        '--sensors', action='store_true',
        help='all bodies are real: the node sensors has the place of the plant')
    _arguments.add_namespace(parser)


def run(arguments: argparse.Namespace) -> int:
    """
    Write the policy.

    :returns: 0
    :raises ConfigurationError: if the configuration is not valid or the file cannot be written
    """
    # These load numpy and PyYAML, for which `--help` need not wait.
    namespace = configuration.check_namespace(arguments.namespace)
    if namespace and not namespace.startswith('/'):
        namespace = f'/{namespace}'
    file = configuration.load(arguments.config)
    plant = file.values('plant')
    lockstep, mass = plant['mode'] == 'lockstep', plant['body'] != 'kinematic'
    topology = file.formation().topology
    agents = range(1, topology.n + 1)
    external = [*agents] if arguments.sensors else plant['external_bodies']
    told = names.pose_topics(
        file.values(names.SENSORS) if arguments.sensors else plant, topology.n)
    nodes = rights(
        topology, namespace, lockstep=lockstep, mass=mass, sensors=arguments.sensors,
        tf=file.values('monitor')['publish_tf'], poses={told[i] for i in external},
        drivers=[i for i in agents
                 if file.values('body', f'{namespace}/{names.body(i)}')['driver']])
    text = document(nodes, namespace)
    if arguments.output is None:
        sys.stdout.write(text)
        return 0
    try:
        Path(arguments.output).write_text(text, encoding='utf-8')
    except OSError as error:
        raise ConfigurationError(
            f'cannot be written: {error.strerror}', source=arguments.output) from None
    return 0
