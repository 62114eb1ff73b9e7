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

"""
The command line: ``tetra X``, ``ros2 run tetra_ros2 X`` and ``python -m tetra_ros2 X``.

Which commands there are stands in :mod:`tetra_ros2.commands`; only the one that is called is
imported, and nothing before it is settled what a signal does.
"""

from collections.abc import Iterator, Sequence
from contextlib import contextmanager, nullcontext, redirect_stdout
from io import TextIOWrapper
import os
import sys
from typing import TextIO

from tetra_ros2 import signals
from tetra_ros2.commands import NODES

CLOSED = 141
"""Exit status if nobody reads the output any more, as a shell has it."""


def _split(argv: Sequence[str]) -> tuple[list[str], list[str]]:
    """Return the arguments that are ours and those between ``--ros-args`` and ``--``."""
    ours: list[str] = []
    ros: list[str] = []
    target = None
    for argument in argv:
        if argument == '--ros-args':
            target = ros
        elif argument == '--' and target is ros:
            target = None
        else:
            (ours if target is None else target).append(argument)
    return ours, ros


@contextmanager
def _output_apart() -> Iterator[None]:
    """
    Let what libraries in C write to the standard output meanwhile go to the errors.

    Fast DDS logs its errors there, which would spoil a result that a program is to read.
    """
    output = _output_of_its_own()
    if output is None:
        yield
        return
    with output, redirect_stdout(output):
        try:
            yield
        finally:
            os.dup2(output.fileno(), 1)


def _output_of_its_own() -> TextIO | None:
    """Send what goes to file 1 to file 2; return what still goes where file 1 went, or None."""
    before = sys.stdout
    try:
        if not isinstance(before, TextIOWrapper) or before.fileno() != 1:  # it was replaced
            return None
        by_line = before.line_buffering or before.write_through  # the latter with -u
        output = open(os.dup(1), 'w', buffering=1 if by_line else -1,  # noqa: SIM115
                      encoding=before.encoding, errors=before.errors)
        os.dup2(2, 1)
    except OSError:  # one of them is closed
        return None
    return output


def main(argv: Sequence[str] | None = None) -> int:
    """
    Run the command line.

    :param argv: the arguments, without the program's name; None for those of this process, which
        then also has its signals settled
    :returns: the exit status: 0 if all is well, 1 if a formation did not form, 2 for a wrong call
    """
    ours, ros = _split(sys.argv[1:] if argv is None else argv)
    # The options before a command are flags, so the first other word is the command.
    command = next((word for word in ours if not word.startswith('-')), '')
    if argv is None:
        # numpy's OpenBLAS would start a thread for each further core, and these wait at full
        # speed for a while. The matrices of a formation are too small to be shared out.
        os.environ.setdefault('OPENBLAS_NUM_THREADS', '1')
        # A node takes the signals over when there is something to put in order.
        signals.quit_at_once(0 if command in NODES else signals.INTERRUPTED)
    try:
        return _run(command, ours, ros, argv is None)
    except KeyboardInterrupt:
        return signals.INTERRUPTED
    except BrokenPipeError:
        # Whoever read it, `head` for one, has read enough. Python would try again at its end.
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
        return CLOSED
    except Exception as error:
        if signals.interrupted():  # which can look like anything, in a library that was loading
            return signals.INTERRUPTED
        if isinstance(error, ModuleNotFoundError):
            from tetra_ros2 import installation  # only for whom something is missing
            if hint := installation.missing(error.name or ''):
                print(f'tetra: error: {error.name} is not installed: {hint}', file=sys.stderr)
                return 2
        raise


def _run(command: str, ours: Sequence[str], ros: Sequence[str], own: bool) -> int:
    """Run a command, and say in one line what was wrong with its call."""
    # All of these take their time to load; the last brings numpy, for which --help need not wait.
    from tetra_ros2.commands import _parser
    arguments = _parser.parse(command, ours)
    arguments.ros_arguments = ros
    if own and command not in NODES:
        signals.interrupt_once()
    from tetra_ros2.config.parameters import ConfigurationError
    try:
        with _output_apart() if own else nullcontext():
            status: int = _parser.module(command).run(arguments)
            if sys.stdout is not None:  # it is, where it was closed
                sys.stdout.flush()
        return status
    except ConfigurationError as error:
        print(f'tetra: error: {error}', file=sys.stderr)
        return 2
