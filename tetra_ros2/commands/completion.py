# Copyright 2026 The tetra_ros2 authors
# SPDX-License-Identifier: Apache-2.0

"""``tetra completion``: what lets a shell complete the words of ``tetra``."""

import argparse

SHELLS = ('bash', 'zsh', 'fish')


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the arguments of ``tetra completion``."""
    parser.add_argument('shell', choices=SHELLS, help=f'one of {", ".join(SHELLS)}')


def run(arguments: argparse.Namespace) -> int:
    """Print it; return 0."""
    import argcomplete  # optional
    print(argcomplete.shellcode(['tetra'], shell=arguments.shell))
    return 0
