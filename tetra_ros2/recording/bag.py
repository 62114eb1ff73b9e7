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
A rosbag2 directory that can be read however the process that writes it ends.

rosbags writes the files. Its storages keep what they have until a chunk of MCAP is a megabyte
long, and SQLite's single transaction until the end; these here put it on the disk when they are
told to. First it goes into the system's hands, where it outlives every process. That takes no
longer when the disk is busy: the disk itself is waited for in a thread of its own. A bag says in
its metadata that it is not finished until it is.
"""

from collections import defaultdict
from collections.abc import Callable
from concurrent.futures import Future, ThreadPoolExecutor
from copy import copy
import errno
from io import BytesIO, FileIO
import os
from pathlib import Path
import sqlite3
import struct
import time
from typing import Any, ClassVar

from rosbags.interfaces import Connection, Qos
from rosbags.rosbag2 import StoragePlugin, Writer
from rosbags.rosbag2.enums import CompressionMode
from rosbags.rosbag2.storage_mcap import McapWriter, PendingChunk
from rosbags.rosbag2.storage_sqlite3 import Sqlite3Writer

UNFINISHED = 'tetra_ros2_unfinished'
"""A key in the custom data of the metadata of a bag that is still being written, or was torn."""

DESCRIPTION_PERIOD = 30.0
"""How often the counts in the metadata are brought up to date [s]."""

_CHUNK_SIZE = 1 << 20
_LOG_SIZE = 1 << 20  # of SQLite's write-ahead log, after which it goes into the database
_MESSAGE = struct.Struct('<BQHIQQ')
_MESSAGE_OPCODE, _MESSAGE_HEAD = 5, 22
_CHUNK = struct.Struct('<BQQQQIIQ')  # its times, size, no check sum, no compression, size
_CHUNK_OPCODE, _OF_RECORD = 6, 9


class _File(FileIO):
    """A file that writes all that it is given, or raises an error; nothing waits in a buffer."""

    def write(self, data: Any) -> int:
        rest = memoryview(data)
        while rest:
            rest = rest[super().write(rest):]
        return len(data)

    def write_at(self, offset: int, data: bytes | memoryview) -> None:
        """Write all of this somewhere, without moving there."""
        rest = memoryview(data)
        while rest:
            count = os.pwrite(self.fileno(), rest, offset)
            rest, offset = rest[count:], offset + count


class _Disk:
    """
    Waits for the disk, in a thread: it may take longer than there is time between two messages.

    :param sync: puts on the disk what the system has been given so far
    """

    def __init__(self, sync: Callable[[], None]) -> None:
        self._sync = sync
        self._thread = ThreadPoolExecutor(1, 'disk')
        self._asked: list[Future[None]] = []

    def hurry(self) -> None:
        """Have all that was written so far put on the disk; raise what went wrong before."""
        self._collect()
        # One may be at work; the one that waits for its turn will find all that is there by then.
        if len(self._asked) < 2:
            self._asked.append(self._thread.submit(self._sync))

    def _collect(self) -> None:
        while self._asked and self._asked[0].done():
            self._asked.pop(0).result()

    def wait(self) -> None:
        """Wait until it is done; raise what went wrong."""
        while self._asked:
            self._asked.pop(0).result()

    def close(self) -> None:
        """Wait until it is done, however it ended, and forget it."""
        self._thread.shutdown()
        self._asked.clear()


class _Mcap(McapWriter):
    """
    An MCAP file that has all messages in it whenever it is told to.

    The chunk that is still open is in it as a whole chunk that grows; only its index is missing.
    If it were closed instead, the index of a long recording would fill the memory.
    """

    bio: _File  # type: ignore[assignment]  # one without a buffer

    def __init__(self, path: Path, compression: CompressionMode) -> None:
        super().__init__(path, compression)
        self.bio.close()
        self.bio = _File(self.path, 'r+')
        self.bio.seek(0, os.SEEK_END)
        self._begin = self.bio.tell()  # of the open chunk; where the file stands, but for errors
        self._given = 0  # how much of it is in the file
        self._disk = _Disk(lambda: os.fdatasync(self.bio.fileno()))

    def write_many(self, rows: list[tuple[int, int, bytes]]) -> None:
        """Write messages: number of the connection, time [ns], bytes."""
        for number, at, data in rows:
            chunk = self.chunk
            chunk.msgs[number].append((at, chunk.bio.tell()))
            chunk.bio.write(_MESSAGE.pack(
                _MESSAGE_OPCODE, _MESSAGE_HEAD + len(data), number, 0, at, at))
            chunk.bio.write(data)
            if chunk.bio.tell() > _CHUNK_SIZE:
                self.close_chunk()

    def close_chunk(self) -> None:
        """Write the chunk that is open into the file."""
        chunk = self.chunk
        counts = {number: len(messages) for number, messages in chunk.msgs.items()}
        # A chunk without messages, of channels alone, has no time; the format wants 0 there.
        times = [at for messages in chunk.msgs.values() for at, _ in messages] or [0]
        chunk.message_start_time, chunk.message_end_time = min(times), max(times)
        super().close_chunk()
        if counts:
            self.message_start_time = min(self.message_start_time, min(times))
            self.message_end_time = max(self.message_end_time, max(times))
        for number, count in counts.items():
            self.channel_stats[number] += count
        self._begin, self._given = self.bio.tell(), 0

    def flush(self) -> None:
        """Put all messages into the system's hands, and tell it to hurry."""
        if self.chunk.msgs:
            self._give()
        self._disk.hurry()

    def _give(self) -> None:
        """Put what is new of the open chunk into the file, and then the head that goes with it."""
        size = self.chunk.bio.tell()
        with self.chunk.bio.getbuffer() as content, content[self._given:] as news:
            self.bio.write_at(self._begin + _CHUNK.size + self._given, news)
        messages = self.chunk.msgs.values()
        self.bio.write_at(self._begin, _CHUNK.pack(
            _CHUNK_OPCODE, _CHUNK.size - _OF_RECORD + size, min(m[0][0] for m in messages),
            max(m[-1][0] for m in messages), size, 0, 0, size))
        self._given = size

    def rewind(self) -> dict[int, int]:
        """Take back what is not on the disk as a whole; return what is, by connection."""
        self._disk.close()
        self.bio.seek(self._begin)
        self.bio.truncate(self._begin + (_CHUNK.size + self._given if self._given else 0))
        kept = PendingChunk(2**63 - 1, 0, BytesIO(), defaultdict(list))
        kept.bio.write(self.chunk.bio.getvalue()[:self._given])
        counts = dict(self.channel_stats)
        for number, messages in self.chunk.msgs.items():
            if given := [message for message in messages if message[1] < self._given]:
                kept.msgs[number] = given
                counts[number] += len(given)
        self.chunk = kept
        return counts

    def close(self, version: int, metadata: str) -> None:
        """Complete the file."""
        if self.chunk.bio.tell():
            self.close_chunk()
        descriptor = os.dup(self.bio.fileno())
        try:
            self._disk.wait()
            super().close(version, metadata)
            os.fdatasync(descriptor)
        finally:
            os.close(descriptor)

    def abort(self) -> None:
        """Leave the file as it is."""
        self._disk.close()
        super().abort()


class _Sqlite(Sqlite3Writer):
    """
    An SQLite file that commits when it is told to.

    A commit appends to a write-ahead log, which takes no waiting for the disk. The thread that
    waits for it also moves the log into the database now and then, and SQLite sees to it that
    neither is torn whenever the power is cut. Where there can be no such log, as on some network
    drives, each commit waits for the disk.
    """

    def __init__(self, path: Path, compression: CompressionMode) -> None:
        super().__init__(path, compression)
        mode, = self.conn.execute('PRAGMA journal_mode = WAL').fetchone()
        self._disk: _Disk | None = None
        if mode == 'wal':
            self._log = Path(f'{self.path}-wal')
            self._mover = sqlite3.connect(self.path, check_same_thread=False)
            self._mover.execute('PRAGMA synchronous = FULL')
            for pragma in ('synchronous = OFF', 'wal_autocheckpoint = 0'):
                self.conn.execute(f'PRAGMA {pragma}')
            self._disk = _Disk(self._sync)
        # Between two commits the file is left alone: it can be read as it is when all has died.
        self.conn.execute('PRAGMA cache_spill = OFF')

    def _sync(self) -> None:
        # SQLite holds no lock on the log that closing it here could give up.
        with self._log.open('rb') as log:
            os.fdatasync(log.fileno())
            size = os.fstat(log.fileno()).st_size
        if size > _LOG_SIZE:
            self._mover.execute('PRAGMA wal_checkpoint(PASSIVE)').fetchall()

    def _leave_log(self) -> None:
        """Move all of the log into the database, and do without it from now on."""
        if self._disk is not None:
            self._disk.close()
            self._disk = None
            self._mover.close()
            self.conn.execute('PRAGMA synchronous = FULL')
            self.conn.execute('PRAGMA journal_mode = DELETE').fetchall()

    def write_many(self, rows: list[tuple[int, int, bytes]]) -> None:
        """Write messages: number of the connection, time [ns], bytes."""
        self.cursor.executemany(
            'INSERT INTO messages (topic_id, timestamp, data) VALUES (?, ?, ?)', rows)

    def flush(self) -> None:
        """Put all messages into the system's hands, and tell it to hurry."""
        self.conn.commit()
        if self._disk is not None:
            self._disk.hurry()

    def rewind(self) -> dict[int, int]:
        """Take back what is not on the disk as a whole; return what is, by connection."""
        if self._disk is not None:
            self._disk.close()
        self.conn.rollback()
        return dict(self.conn.execute('SELECT topic_id, count(*) FROM messages GROUP BY topic_id'))

    def close(self, version: int, metadata: str) -> None:
        """Complete the file."""
        self.conn.commit()
        if self._disk is not None:
            self._disk.wait()
        self._leave_log()
        super().close(version, metadata)

    def abort(self) -> None:
        """Leave the file as it is, but for what was not committed."""
        if self._disk is not None:
            self._disk.close()
            self._mover.close()
        super().abort()


class _Described:
    """Stands for the storage when only the metadata of a bag are to be written."""

    def __init__(self, path: Path) -> None:
        self.path = path

    def close(self, version: int, metadata: str) -> None:
        """Do nothing: the storage goes on."""


class _Writer(Writer):
    # rosbags does not call it a ClassVar, and means one.
    STORAGE_PLUGINS: ClassVar = {  # type: ignore[misc]
        StoragePlugin.MCAP: _Mcap, StoragePlugin.SQLITE3: _Sqlite}


class Bag:
    """
    A bag to write.

    :param path: directory to make
    :param storage: ``mcap`` or ``sqlite3``
    :raises OSError, sqlite3.Error, rosbags.rosbag2.WriterError: here and below, if the bag cannot
        be written
    """

    def __init__(self, path: Path, storage: str) -> None:
        self._writer = _Writer(
            path, version=9,
            storage_plugin={'mcap': StoragePlugin.MCAP, 'sqlite3': StoragePlugin.SQLITE3}[storage])
        self._writer.open()
        self._storage: Any = self._writer.storage
        self._counts: dict[int, int] = {}
        self._start, self._end = self._writer.min_timestamp, 0
        self._described = -DESCRIPTION_PERIOD
        self.dirty = False

    def add(self, topic: str, type_name: str, definition: str, type_hash: str,
            profiles: list[Qos] | tuple[Qos, ...] = ()) -> int:
        """Announce a topic; return its number for :meth:`write`."""
        connection: Connection = self._writer.add_connection(
            topic, type_name, msgdef=definition, rihs01=type_hash, offered_qos_profiles=profiles)
        self._counts[connection.id] = 0
        self._described = -DESCRIPTION_PERIOD
        self.dirty = True
        return connection.id

    def write(self, rows: list[tuple[int, int, bytes]]) -> None:
        """Write messages: number of the topic, time [ns], bytes."""
        self._storage.write_many(rows)
        counts = self._counts
        for number, at, _ in rows:
            counts[number] += 1
            if at > self._end:
                self._end = at
            if at < self._start:
                self._start = at
        self.dirty = True

    def flush(self) -> None:
        """Put on the disk what was written, so that it can be read whatever happens next."""
        if not self._storage.path.exists():
            # Else the system would go on to write into a file that nobody can find any more.
            raise FileNotFoundError(errno.ENOENT, 'it was removed', str(self._storage.path))
        self._storage.flush()
        self.dirty = False

    @property
    def outdated(self) -> bool:
        """Return whether :meth:`describe` is due."""
        return time.monotonic() - self._described >= DESCRIPTION_PERIOD

    def described(self) -> None:
        """Take note that :meth:`describe` is being seen to."""
        self._described = time.monotonic()

    def describe(self) -> None:
        """Write the metadata of a bag that is not finished; takes as long as many messages."""
        self.described()
        self._describe().close()

    def _describe(self) -> Writer:
        """Return what writes the metadata of a bag that is not finished."""
        description = copy(self._writer)
        description.connections = list(self._writer.connections)
        description.storage = _Described(self._storage.path)  # type: ignore[assignment]
        description.counts = dict(self._counts)
        description.min_timestamp = self._start if any(self._counts.values()) else 0
        description.max_timestamp = self._end
        description.custom_data = {UNFINISHED: 'true'}
        return description

    def close(self) -> None:
        """Complete the bag."""
        self.flush()
        self._writer.counts = dict(self._counts)
        self._writer.min_timestamp, self._writer.max_timestamp = self._start, self._end
        self._writer.close()

    def salvage(self) -> None:
        """Complete the bag with what is safe, where something could not be written."""
        self._counts = {**dict.fromkeys(self._counts, 0), **self._storage.rewind()}
        self._writer.counts = dict(self._counts)
        self._writer.min_timestamp, self._writer.max_timestamp = self._start, self._end
        self._writer.close()

    def abort(self) -> None:
        """Leave the bag as it is."""
        self._writer.abort()
