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
