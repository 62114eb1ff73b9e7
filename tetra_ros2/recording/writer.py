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
A rosbag2 directory that is written by a process of its own.

To make a file of messages costs more of the processor than to receive them. So the recorder hands
them on as they are, many at a time, and this module, run as a program, has rosbags write them. If
it cannot keep up the recorder waits for it. It ends when the recorder does, however that ends: a
recorder that was killed leaves a whole bag too. If this process itself is killed, what came more
than a second before is on the disk, and :mod:`tetra_ros2.recording.recover` makes a bag of it.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from contextlib import suppress
from functools import cache
import marshal
import os
from pathlib import Path
import select
import signal
import struct
import subprocess
import sys
import time
from typing import Any, TYPE_CHECKING

from tetra_ros2.signals import OWN_GROUP

if TYPE_CHECKING:
    from io import RawIOBase

    from rosbags.interfaces import Qos
    from rosbags.typesys.store import Typestore
    from tetra_ros2.recording.bag import Bag

Messages = Sequence[tuple[int, int, bytes]]
"""Of each message the number of its topic, its time [ns] and its bytes."""

PIPE_SIZE = 1 << 20
"""How much may wait to be written before the recorder waits [bytes], where it can be chosen."""

FLUSH_PERIOD = 0.2
"""How long a message may wait before it is put on the disk [s]."""

_LENGTH = struct.Struct('<I')

_IN_TROUBLE = ...
"""The value of an answer that is the reason for another one, which is to follow."""


class BagError(Exception):
    """
    A recording cannot be begun, or not go on; the text says why.

    :param early: whether the process that writes is still at work, to save what it can
    """

    def __init__(self, text: str, early: bool = False) -> None:
        super().__init__(text)
        self.early = early


class BagWriter:
    """
    The recorder's end: a bag that is open from now on.

    :param path: directory to make
    :param storage: ``mcap`` or ``sqlite3``
    :raises BagError: if the directory cannot be made
    """

    def __init__(self, path: Path, storage: str) -> None:
        # So that Ctrl-C is the recorder's alone.
        self._process = subprocess.Popen(
            [sys.executable, '-m', __name__, str(path), storage], **OWN_GROUP,
            stdin=subprocess.PIPE, stdout=subprocess.PIPE,
            env={**os.environ, 'PYTHONPATH': os.pathsep.join(filter(None, sys.path))},
            pipesize=PIPE_SIZE if sys.platform == 'linux' else -1)
        requests, answers = self._process.stdin, self._process.stdout
        assert requests is not None
        assert answers is not None
        self._stdin, self._stdout = requests, answers
        try:
            self._answer()
        except BaseException:
            self.abort()
            raise

    def add_topic(self, name: str, type_name: str, type_hash: str,
                  profiles: list[tuple[Any, ...]]) -> int | None:
        """
        Announce a topic; return its number for :meth:`write`, or None if its type is unknown.

        :param type_hash: text of the hash of its type
        :param profiles: for each publisher its quality of service: history, depth, reliability,
            durability, deadline [ns], lifespan [ns], liveliness, its lease [ns], whether the
            conventions of ROS for names are avoided; policies by their numbers
        :raises BagError: if the recording cannot go on
        """
        self._tell((name, type_name, type_hash, profiles))
        number: int | None = self._answer()
        return number

    def write(self, messages: Messages) -> None:
        """
        Write messages, in their order; a time before the one ahead of it counts as that.

        :param messages: a list of tuples: number of the topic, time [ns], bytes
        :raises BagError: if the recording cannot go on
        """
        self._tell(messages)

    def close(self) -> None:
        """
        Complete the bag.

        :raises BagError: if that fails
        """
        with suppress(BrokenPipeError):  # it has something to say about that
            self._stdin.close()
        try:
            self._answer()
        finally:
            self._end()

    def abort(self) -> None:
        """Leave the bag as it is."""
        self._process.kill()
        self._end()

    def give_up(self, error: BagError) -> str:
        """
        Wait until the process that writes has saved what it can.

        :param error: what ended the recording
        :returns: a text that says what did, and what became of the bag
        """
        try:
            if error.early:
                self._answer()
        except BagError as last:
            return str(last)
        finally:
            self._end()
        return str(error)

    def _end(self) -> None:
        self._process.wait()
        self._stdout.close()
        with suppress(BrokenPipeError):
            self._stdin.close()

    def _tell(self, what: Any) -> None:
        # It speaks unasked only when it is in trouble.
        if select.select([self._stdout], [], [], 0.0)[0]:
            self._answer(early=True)
        message = marshal.dumps(what)
        try:
            self._stdin.write(_LENGTH.pack(len(message)) + message)
            self._stdin.flush()
        except BrokenPipeError:
            self._answer()
            raise BagError('the process that writes is gone') from None

    def _answer(self, early: bool = False) -> Any:
        """Return what the process that writes answers; by default it has nothing more to say."""
        try:
            error, value = marshal.load(self._stdout)
            while value is _IN_TROUBLE and not early:
                error, value = marshal.load(self._stdout)
        except EOFError:
            raise BagError('the process that writes has died') from None
        if error is not None:
            raise BagError(error, early=value is _IN_TROUBLE)
        return value


def main(path: str, storage: str) -> int:
    """Write a bag from the standard input, and answer on the standard output."""
    # Whoever ends the recorder ends the input; a signal to all must not tear the bag.
    # It is no terminal's foreground: SIGTTOU would stop it when it has something to say there.
    for number in (signal.SIGINT, signal.SIGTERM, signal.SIGHUP, signal.SIGTTOU):
        signal.signal(number, signal.SIG_IGN)
    answers = sys.stdout.buffer

    def answer(error: str | None, value: Any = None) -> None:
        try:
            marshal.dump((error, value), answers)
            answers.flush()
        except BrokenPipeError:
            sys.stdout = None  # nobody is left to hear it

    bag, clerk = None, _Clerk()
    try:
        # Where rosbags lacks something, the recorder is to say so, too.
        from tetra_ros2.recording.bag import Bag
        bag = Bag(Path(path), storage)
        _types()  # now, as soon messages come that would wait for it
        answer(None)
        _serve(bag, sys.stdin.buffer.raw, answer, clerk)  # type: ignore[union-attr]
        clerk.wait()
        bag.close()
    # A full disk is an OSError or one of SQLite's, and rosbags has errors of its own; whatever
    # ends the recording, the recorder is to know of it.
    except Exception as error:
        answer(_reason(error), _IN_TROUBLE)  # to save what can be saved takes a while
        clerk.wait()
        kept = bag is not None and _salvage(bag)
        answer(f'{_reason(error)}{"" if kept or bag is None else _TORN.format(path)}')
        return 1
    answer(None)
    return 0


class _Clerk:
    """
    Writes the metadata now and then, in a process of its own.

    It takes as long as a thousand messages, for 32 agents as long as fifty thousand. A thread
    would have Python to itself meanwhile, and on a busy machine messages would wait for seconds.
    """

    def __init__(self) -> None:
        self._process: int | None = None

    def see_to(self, bag: Bag) -> None:
        """Have the metadata written if that is due, and the last time is over."""
        if not bag.outdated or not self._is_idle():
            return
        bag.described()
        self._process = os.fork()
        if self._process:
            return
        try:
            os.nice(10)
            for pipe in (0, 1):  # whose other ends are to notice when the parent is killed
                os.close(pipe)
            bag.describe()
        finally:
            os._exit(0)  # whatever went wrong, it will go wrong for the messages too

    def _is_idle(self) -> bool:
        if self._process is not None and os.waitpid(self._process, os.WNOHANG)[0]:
            self._process = None
        return self._process is None

    def wait(self) -> None:
        """Wait until it is written, so that it does not come last."""
        if self._process is not None:
            os.waitpid(self._process, 0)
            self._process = None


_TORN = '; the recording is torn: tetra recover {}'


def _reason(error: Exception) -> str:
    """Return in one line what an error is about."""
    text = getattr(error, 'strerror', None) or str(error) or type(error).__name__
    return text.splitlines()[0].rstrip('.')


def _salvage(bag: Bag) -> bool:
    """Complete a bag that cannot be written any more; return whether that was possible."""
    try:
        bag.salvage()
    except Exception:  # it was in trouble already, and there is one more way to get at it
        with suppress(Exception):
            bag.abort()
        return False
    return True


def _serve(bag: Bag, requests: RawIOBase, answer: Callable[..., None], clerk: _Clerk) -> None:
    """Do what the recorder asks for until it ends, and put it on the disk in time."""
    topics: list[int] = []
    due: float | None = None
    while True:
        if bag.dirty:
            now = time.monotonic()
            if due is None:
                due = now + FLUSH_PERIOD
            # An input that never pauses must not put it off.
            if now >= due or not select.select([requests], [], [], due - now)[0]:
                bag.flush()
                clerk.see_to(bag)
                due = None
                continue
        request = _next(requests)
        if request is None:
            return
        if isinstance(request, tuple):
            topic = _add(bag, *request)
            if topic is None:
                answer(None)
            else:
                answer(None, len(topics))
                topics.append(topic)
        else:
            bag.write([(topics[number], at, message) for number, at, message in request])


def _next(requests: RawIOBase) -> Any:
    """Return the next request, or None if there is none to come."""
    head = _read(requests, _LENGTH.size)
    body = head and _read(requests, *_LENGTH.unpack(head))
    # The recorder may have been killed in the middle of a request.
    return marshal.loads(body) if body else None


def _read(stream: RawIOBase, count: int) -> bytearray | None:
    """Return so many bytes, or None if the stream ends before."""
    content, begun = bytearray(count), 0
    with memoryview(content) as view:
        while begun < count:
            got = stream.readinto(view[begun:])
            if not got:
                return None
            begun += got
    return content


def _add(bag: Bag, name: str, type_name: str, type_hash: str,
         profiles: list[tuple[Any, ...]]) -> int | None:
    definition = _definition(type_name)
    if definition is None:
        return None
    return bag.add(name, type_name, definition, type_hash, [_profile(*p) for p in profiles])


@cache
def _definition(type_name: str) -> str | None:
    """Return the definition of a type, or None if it is unknown."""
    from rosbags.typesys.base import TypesysError  # for the process that writes alone, see below
    try:
        return _types().generate_msgdef(type_name, ros_version=2)[0]
    except (KeyError, TypesysError):
        return None


@cache
def _types() -> Typestore:
    """Return all message types of ROS 2 Jazzy."""
    # The recorder needs nothing of these, only the process that writes.
    from rosbags.typesys import get_typestore, Stores
    return get_typestore(Stores.ROS2_JAZZY)


def _profile(history: int, depth: int, reliability: int, durability: int, deadline: int,
             lifespan: int, liveliness: int, lease: int, avoid_conventions: bool) -> Qos:
    """Return a quality of service profile as rosbags writes it into a bag."""
    from rosbags.interfaces import (  # as above
        Qos,
        QosDurability,
        QosHistory,
        QosLiveliness,
        QosReliability,
        QosTime,
    )

    def duration(nanoseconds: int) -> QosTime:
        return QosTime(*divmod(nanoseconds, 1_000_000_000))

    return Qos(
        history=QosHistory(history),
        depth=depth,
        reliability=QosReliability(reliability),
        durability=QosDurability(durability),
        deadline=duration(deadline),
        lifespan=duration(lifespan),
        liveliness=QosLiveliness(liveliness),
        liveliness_lease_duration=duration(lease),
        avoid_ros_namespace_conventions=avoid_conventions,
    )


if __name__ == '__main__':
    sys.exit(main(*sys.argv[1:]))
