# Copyright 2026 The tetra_ros2 authors
# SPDX-License-Identifier: Apache-2.0

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
