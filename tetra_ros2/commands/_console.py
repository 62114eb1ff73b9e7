# Copyright 2026 The tetra_ros2 authors
# SPDX-License-Identifier: Apache-2.0

"""Where the commands print their results."""

from rich.console import Console

NARROW = 80
"""Columns of what goes into a file or a pipe, whatever terminal it was started in."""


def make_console() -> Console:
    """Return a console on standard output, as wide as the terminal if that is one."""
    console = Console(highlight=False)
    return console if console.is_terminal else Console(highlight=False, width=NARROW)
