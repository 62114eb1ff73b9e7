# Copyright 2026 The tetra_ros2 authors
# SPDX-License-Identifier: Apache-2.0

"""Where the commands print their results."""

from rich.console import Console

NARROW = 80
"""Columns of what goes into a file or a pipe, whatever terminal it was started in."""


class _Console(Console):
    """A console that leaves it to the command line what happens if nobody reads any more."""

    def on_broken_pipe(self) -> None:
        raise BrokenPipeError


def make_console() -> Console:
    """Return a console on standard output, as wide as the terminal if that is one."""
    console = _Console(highlight=False)
    return console if console.is_terminal else _Console(highlight=False, width=NARROW)
