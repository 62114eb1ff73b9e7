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

"""The parser of the command line."""

import argparse
from collections.abc import Sequence
from functools import partial
from importlib import import_module
import os
import sys
from types import ModuleType
from typing import NoReturn

from tetra_ros2.commands import COMMANDS, EXAMPLES


class _Parser(argparse.ArgumentParser):
    """A parser whose messages have the form of all others of this package."""

    def error(self, message: str) -> NoReturn:
        """Say what is wrong in one line, and exit with status 2."""
        self.exit(2, f'tetra: error: {message}; see {self.prog} --help\n')


class _Version(argparse.Action):
    """Print which version this is and where it lies, and exit."""

    def __call__(self, parser: argparse.ArgumentParser, *_: object) -> NoReturn:
        from tetra_ros2.config import share  # reads a file, for which nothing else need wait
        print(f'tetra_ros2 {share.version()}, {share.share_directory()}; '
              f'Python {sys.version.split()[0]}')
        parser.exit()


def module(command: str) -> ModuleType:
    """Import the module of a command."""
    return import_module(f'tetra_ros2.commands.{command}')


def _examples(commands: Sequence[str]) -> str:
    return '\n'.join(('examples:', *(f'  {line}' for line in commands)))


def make_parser(command: str | None = None) -> argparse.ArgumentParser:
    """
    Return the parser of the command line.

    :param command: the command whose arguments it is to know; None for all of them
    """
    as_it_is = partial(argparse.RawDescriptionHelpFormatter, max_help_position=28)
    parser = _Parser(
        prog='tetra', description='Intrinsic formations of reduced attitudes over ROS 2.',
        epilog='"tetra X --help" tells more of X. ROS arguments go after --ros-args.\n\n'
               + _examples([lines[0] for lines in EXAMPLES.values()]),
        formatter_class=as_it_is)
    parser.add_argument(
        '--version', action=_Version, nargs=0, help='print version and place, and exit')
    commands = parser.add_subparsers(dest='command', metavar='X', required=True)
    for name, text in COMMANDS.items():
        sub = commands.add_parser(
            name, help=text, description=f'{text[0].upper()}{text[1:]}.',
            epilog=_examples(EXAMPLES[name]), formatter_class=as_it_is)
        if command in (None, name):
            module(name).add_arguments(sub)
    return parser


def parse(command: str, ours: Sequence[str]) -> argparse.Namespace:
    """Return the parsed arguments, or end with a line that says what is wrong with them."""
    completing = '_ARGCOMPLETE' in os.environ
    parser = make_parser(None if completing else command)
    if completing:  # the shell asks what may come next
        import argcomplete  # optional, and slow to load
        argcomplete.autocomplete(parser)
    if command and command not in COMMANDS:
        from difflib import get_close_matches  # only for whom something is misspelt
        close = get_close_matches(command, COMMANDS, n=1)
        parser.error(f'there is no command {command!r}'
                     + (f' (did you mean {close[0]!r}?)' if close else ''))
    return parser.parse_args(ours)
