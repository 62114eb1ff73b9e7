# Copyright 2026 The tetra_ros2 authors
# SPDX-License-Identifier: Apache-2.0

"""
The command line: ``tetra X``, ``ros2 run tetra_ros2 X`` and ``python -m tetra_ros2 X``.

Which commands there are stands in :mod:`tetra_ros2.commands`; only the one that is called is
imported.
"""

import argparse
from importlib import import_module
import os
import sys

from tetra_ros2.commands import COMMANDS

INTERRUPTED = 130
"""Exit status after Ctrl-C, as a shell has it."""

CLOSED = 141
"""Exit status if nobody reads the output any more, as a shell has it."""


class _Parser(argparse.ArgumentParser):
    """A parser whose messages have the form of all others of this package."""

    def error(self, message):
        """Say what is wrong in one line, and exit with status 2."""
        self.exit(2, f'tetra: error: {message}; see {self.prog} --help\n')


def _split(argv):
    """Return the arguments that are ours and those between ``--ros-args`` and ``--``."""
    ours, ros, target = [], [], None
    for argument in argv:
        if argument == '--ros-args':
            target = ros
        elif argument == '--' and target is ros:
            target = None
        else:
            (ours if target is None else target).append(argument)
    return ours, ros


def _module(command):
    """Import the module of a command."""
    return import_module(f'tetra_ros2.commands.{command}')


def make_parser(command=None):
    """
    Return the parser of the command line.

    :param command: the command whose arguments it is to know; None for all of them
    """
    parser = _Parser(
        prog='tetra', description='Intrinsic formations of reduced attitudes over ROS 2.',
        epilog='"tetra X --help" tells more of X. ROS arguments go after --ros-args.')
    commands = parser.add_subparsers(dest='command', metavar='X', required=True)
    for name, text in COMMANDS.items():
        sub = commands.add_parser(name, help=text, description=f'{text[0].upper()}{text[1:]}.')
        if command in (None, name):
            _module(name).add_arguments(sub)
    return parser


def main(argv=None):
    """
    Run the command line.

    :param argv: the arguments, without the program's name
    :returns: the exit status: 0 if all is well, 1 if a formation did not form, 2 for a wrong call
    """
    ours, ros = _split(sys.argv[1:] if argv is None else argv)
    # The options before a command are flags, so the first other word is the command.
    command = next((word for word in ours if not word.startswith('-')), '')
    arguments = make_parser(command).parse_args(ours)
    arguments.ros_arguments = ros
    try:
        return _run(arguments)
    except KeyboardInterrupt:
        return INTERRUPTED
    except BrokenPipeError:
        # Whoever read it, `head` for one, has read enough. Python would try again at its end.
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
        return CLOSED
    except ModuleNotFoundError as error:
        if hint := _INSTALL.get((error.name or '').partition('.')[0]):
            print(f'tetra: error: {error.name} is not installed: {hint}', file=sys.stderr)
            return 2
        raise


_INSTALL = {
    'matplotlib': "pictures need it: pip install 'tetra_ros2[plot]'",
    'dynamixel_sdk': "serial servos need it: pip install 'tetra_ros2[serial]'",
    'mujoco': "bodies with mass need it: pip install 'tetra_ros2[physics]'",
    'rclpy': "source a ROS 2 installation, or without one: pip install 'tetra_ros2[ros]'",
    'diagnostic_msgs': "source a ROS 2 installation; without one: pip install 'tetra_ros2[ros]'",
    'rosbags': 'recordings need it: pip install rosbags',
    'scipy': "linear programs need it: pip install 'tetra_ros2[design]'",
    'viser': "the viewer needs it: pip install 'tetra_ros2[view]'",
}


def _run(arguments):
    """Run a command, and say in one line what was wrong with its call."""
    # Loads numpy, for which `tetra --help` need not wait.
    from tetra_ros2.config.parameters import ConfigurationError
    try:
        status = _module(arguments.command).run(arguments)
        sys.stdout.flush()
        return status
    except ConfigurationError as error:
        print(f'tetra: error: {error}', file=sys.stderr)
        return 2


def agent():
    """Run ``tetra agent``."""
    return main(['agent', *sys.argv[1:]])


def plant():
    """Run ``tetra plant``."""
    return main(['plant', *sys.argv[1:]])


def monitor():
    """Run ``tetra monitor``."""
    return main(['monitor', *sys.argv[1:]])


def recorder():
    """Run ``tetra recorder``."""
    return main(['recorder', *sys.argv[1:]])


def launcher():
    """Run ``tetra launcher``."""
    return main(['launcher', *sys.argv[1:]])


def viewer():
    """Run ``tetra viewer``."""
    return main(['viewer', *sys.argv[1:]])


def sensors():
    """Run ``tetra sensors``."""
    return main(['sensors', *sys.argv[1:]])


def body():
    """Run ``tetra body``."""
    return main(['body', *sys.argv[1:]])
