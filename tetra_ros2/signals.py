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
What SIGINT and SIGTERM do, from the first line of a process to its last.

``ros2 launch`` sends SIGINT twice, once from the terminal to all and once by itself; ``timeout``
and people do it more often. A signal that finds a process while it loads, or while rclpy takes
itself apart, must leave neither a traceback nor a core.
"""

from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
import os
import signal
import sys
from types import FrameType
from typing import Any

SIGNALS = (signal.SIGINT, signal.SIGTERM)
"""What ends a process in good order."""

INTERRUPTED = 130
"""Exit status after Ctrl-C, as a shell has it."""

OWN_GROUP: dict[str, Any] = (
    {'process_group': 0} if sys.version_info >= (3, 11) else {'start_new_session': True})
"""
What has ``subprocess.Popen`` start a process that Ctrl-C on this one's terminal does not reach.

A session of its own would do, too. But Linux divides the processor among sessions first, and on a
busy machine a new one was seen to get none for two seconds.
"""

_interrupted = False


def _handle(handler: Callable[[int, FrameType | None], object] | signal.Handlers) -> None:
    with suppress(ValueError):  # not the main thread, so somebody else's process
        for number in SIGNALS:
            signal.signal(number, handler)


def quit_at_once(status: int) -> None:
    """
    Let a signal end the process without a word, as long as there is nothing to put in order.

    :param status: the exit status to end with
    """
    _handle(lambda *_: os._exit(status))


def interrupt_once() -> None:
    """Let the first signal raise KeyboardInterrupt, and all that follow do nothing."""
    def interrupt(*_: object) -> None:
        global _interrupted
        _interrupted = True
        ignore()
        raise KeyboardInterrupt
    _handle(interrupt)


def interrupted() -> bool:
    """Return whether a signal has raised KeyboardInterrupt."""
    return _interrupted


@contextmanager
def held_back() -> Iterator[Callable[[], None]]:
    """
    Keep signals back meanwhile; give a function that lets those that have come do what they do.

    What a signal raises inside a callback of rclpy, rclpy prints as a fatal error.
    """
    came: list[int] = []
    before: dict[int, Any] = {}
    with suppress(ValueError):  # not the main thread, which signals do not come to
        for number in SIGNALS:
            before[number] = signal.signal(number, lambda number, _: came.append(number))

    def restore() -> None:
        while before:
            signal.signal(*before.popitem())

    def release() -> None:
        if came:
            restore()  # first, as what it does may be to ignore those that follow
            signal.raise_signal(came.pop(0))
    try:
        yield release
    finally:
        restore()
    release()


def ignore() -> None:
    """
    Let signals do nothing from now on: the process is ending.

    Python keeps this through its own end; a function it would replace by the system's default.
    """
    _handle(signal.SIG_IGN)
