# Copyright 2026 The tetra_ros2 authors
# SPDX-License-Identifier: Apache-2.0

"""
A rosbag2 directory that is written by a process of its own.

To make a file of messages costs more of the processor than to receive them. So the recorder hands
them on as they are, many at a time, and this module, run as a program, has rosbags write them. If
it cannot keep up the recorder waits for it. It ends when the recorder does, however that ends: a
recorder that was killed leaves a whole bag too.
"""

from contextlib import suppress
import marshal
import os
from pathlib import Path
import signal
import subprocess
import sys

PIPE_SIZE = 1 << 20
"""How much may wait to be written before the recorder waits [bytes], where it can be chosen."""


class BagError(Exception):
    """A recording cannot be begun, or not go on; the text says why."""


class BagWriter:
    """
    The recorder's end: a bag that is open from now on.

    :param path: directory to make
    :param storage: ``mcap`` or ``sqlite3``
    :raises BagError: if the directory cannot be made
    """

    def __init__(self, path, storage):
        # In a session of its own, so that Ctrl-C on a terminal is the recorder's alone.
        self._process = subprocess.Popen(
            [sys.executable, '-m', __name__, str(path), storage], start_new_session=True,
            stdin=subprocess.PIPE, stdout=subprocess.PIPE,
            env={**os.environ, 'PYTHONPATH': os.pathsep.join(filter(None, sys.path))},
            **({'pipesize': PIPE_SIZE} if sys.platform == 'linux' else {}))
        try:
            self._answer()
        except BaseException:
            self.abort()
            raise

    def add_topic(self, name, type_name, type_hash, profiles):
        """
        Announce a topic; return its number for :meth:`write`, or None if its type is unknown.

        :param type_hash: text of the hash of its type
        :param profiles: for each publisher its quality of service: history, depth, reliability,
            durability, deadline [ns], lifespan [ns], liveliness, its lease [ns], whether the
            conventions of ROS for names are avoided; policies by their numbers
        :raises BagError: if the recording cannot go on
        """
        self._tell((name, type_name, type_hash, profiles))
        return self._answer()

    def write(self, messages):
        """
        Write messages, in their order; a time before the one ahead of it counts as that.

        :param messages: a list of tuples: number of the topic, time [ns], bytes
        :raises BagError: if the recording cannot go on
        """
        self._tell(messages)

    def close(self):
        """
        Complete the bag.

        :raises BagError: if that fails
        """
        with suppress(BrokenPipeError):  # it has something to say about that
            self._process.stdin.close()
        try:
            self._answer()
        finally:
            self._end()

    def abort(self):
        """Leave the bag as it is."""
        self._process.kill()
        self._end()

    def _end(self):
        self._process.wait()
        self._process.stdout.close()
        with suppress(BrokenPipeError):
            self._process.stdin.close()

    def _tell(self, what):
        try:
            marshal.dump(what, self._process.stdin)
            self._process.stdin.flush()
        except BrokenPipeError:
            self._answer()
            raise BagError('the process that writes is gone') from None

    def _answer(self):
        try:
            error, value = marshal.load(self._process.stdout)
        except EOFError:
            raise BagError('the process that writes has died') from None
        if error is not None:
            raise BagError(error)
        return value


def main(path, storage):
    """Write a bag from the standard input, and answer on the standard output."""
    # Whoever ends the recorder ends the input; a signal to all must not tear the bag.
    for number in (signal.SIGINT, signal.SIGTERM, signal.SIGHUP):
        signal.signal(number, signal.SIG_IGN)
    requests, answers = sys.stdin.buffer, sys.stdout.buffer

    def answer(error, value=None):
        try:
            marshal.dump((error, value), answers)
            answers.flush()
        except BrokenPipeError:
            sys.stdout = None  # nobody is left to hear it

    import apsw
    from rosbags.rosbag2 import StoragePlugin, Writer, WriterError
    plugin = {'mcap': StoragePlugin.MCAP, 'sqlite3': StoragePlugin.SQLITE3}[storage]
    try:
        writer = Writer(Path(path), version=9, storage_plugin=plugin)
        writer.open()
        answer(None)
        _serve(writer, requests, answer)
        writer.close()
    except (OSError, apsw.Error, WriterError) as error:
        answer(getattr(error, 'strerror', None) or str(error))
        return 1
    answer(None)
    return 0


def _serve(writer, requests, answer):
    """Do what the recorder asks for until it ends."""
    connections, latest = [], 0
    while True:
        try:
            request = marshal.load(requests)
        except EOFError:
            return
        if isinstance(request, tuple):
            connection = _add(writer, *request)
            if connection is None:
                answer(None)
            else:
                answer(None, len(connections))
                connections.append(connection)
        else:
            for number, time, message in request:
                # The system's clock may be set back; a bag's may not.
                latest = max(latest, time)
                writer.write(connections[number], latest, message)


def _add(writer, name, type_name, type_hash, profiles):
    from rosbags.typesys import get_typestore, Stores
    from rosbags.typesys.base import TypesysError
    try:
        definition, _ = get_typestore(Stores.ROS2_JAZZY).generate_msgdef(type_name, ros_version=2)
    except (KeyError, TypesysError):
        return None
    return writer.add_connection(name, type_name, msgdef=definition, rihs01=type_hash,
                                 offered_qos_profiles=[_profile(*p) for p in profiles])


def _profile(history, depth, reliability, durability, deadline, lifespan, liveliness, lease,
             avoid_conventions):
    """Return a quality of service profile as rosbags writes it into a bag."""
    from rosbags.interfaces import (
        Qos,
        QosDurability,
        QosHistory,
        QosLiveliness,
        QosReliability,
        QosTime,
    )

    def duration(nanoseconds):
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
