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

"""``tetra figures``: the paper's two simulation figures, from runs of the real nodes."""

import argparse
from pathlib import Path
import tempfile

from tetra_ros2.config.parameters import ConfigurationError


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the arguments of ``tetra figures``."""
    parser.add_argument('--out', required=True, metavar='DIR', help='directory to write into')
    parser.add_argument(
        '--seed', type=int, default=7, metavar='N',
        help='of the initial attitudes (default: %(default)s)')
    parser.add_argument(
        '--rate', type=float, default=100.0, metavar='HZ',
        help='of the loop [Hz] (default: %(default)s)')


def run(arguments: argparse.Namespace) -> int:
    """
    Run the nodes, draw both figures, and say what was measured.

    :returns: 0
    :raises ConfigurationError: if it was called wrongly; nothing was written then
    """
    # It needs matplotlib, which is optional.
    from tetra_ros2.paper.figures import draw, measure
    if arguments.seed < 0:
        raise ConfigurationError(
            f'{arguments.seed} is not valid, expected an integer from 0 up', key='--seed')
    if not 1.0 <= arguments.rate <= 1e4:
        raise ConfigurationError(
            f'{arguments.rate!r} is not valid, expected a number from 1 to 10000', key='--rate')
    directory = Path(arguments.out)
    _require_writable(directory)
    measured = measure(arguments.rate, arguments.seed)
    draw(measured, directory)
    for result in measured:
        print(result)
    return 0


def _require_writable(directory: Path) -> None:
    """
    Make the directory.

    :raises ConfigurationError: if that, or a file in it, cannot be made
    """
    try:
        directory.mkdir(parents=True, exist_ok=True)
        with tempfile.TemporaryFile(dir=directory):
            pass
    except OSError as error:
        raise ConfigurationError(
            f'{directory} cannot be written: {error.strerror}', key='--out') from None
