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
A whole bag from a torn one, and what is missing in it; no ROS in here.

A bag is torn if the process that wrote it was killed, or the machine was switched off: MCAP then
ends in the middle of a chunk, without an index; SQLite has a transaction to roll back; metadata
are missing or not up to date. What is there is copied into a new bag; the torn one stays as it is.
"""

from collections import Counter
from collections.abc import Iterable, Iterator
from dataclasses import dataclass, field
from io import BytesIO
from pathlib import Path
import shutil
import sqlite3
import struct
from tempfile import TemporaryDirectory
from typing import Any

from mcap.exceptions import McapError
from mcap.records import Channel, Message, Schema
from mcap.stream_reader import StreamReader
from rosbags.interfaces import Qos
from rosbags.rosbag2 import Reader
from rosbags.rosbag2.metadata import parse_qos
from rosbags.typesys import get_types_from_idl, get_types_from_msg, get_typestore, Stores
from tetra_ros2.config.configuration import check_new
from tetra_ros2.config.parameters import ConfigurationError
from tetra_ros2.recording.bag import Bag, UNFINISHED
import yaml

_STORAGES = {'.mcap': 'mcap', '.db3': 'sqlite3'}
_BATCH = 1000
_UNKNOWN_HASH = 'RIHS01_' + 64 * '0'
_CHUNK_OPCODE, _CHUNK_HEAD = 6, 9 + 28  # opcode, length; times, size and sum


@dataclass(frozen=True)
class Topic:
    """A topic as the torn bag tells of it."""

    name: str
    type_name: str
    definition: str
    profiles: str


@dataclass
class Found:
    """
    What was found in a torn bag.

    :param messages: how many, by topic
    :param first: time of the first message of each topic [ns]
    :param last: time of the last message of each topic [ns]
    :param lost: what could not be read, texts for a person
    """

    messages: Counter[str] = field(default_factory=Counter)
    first: dict[str, int] = field(default_factory=dict)
    last: dict[str, int] = field(default_factory=dict)
    lost: list[str] = field(default_factory=list)


def is_whole(path: Path) -> bool:
    """Return whether a bag was finished, and can be read by everybody."""
    if any(f.stat().st_size for pattern in ('*-journal', '*-wal') for f in path.glob(pattern)):
        return False
    try:
        with Reader(path):
            return UNFINISHED not in (path / 'metadata.yaml').read_text()
    except Exception:  # a file that is damaged makes the reader fail in any way there is
        return False


def files(path: Path) -> list[Path]:
    """
    Return the files of a recording that hold messages, in the order in which they were written.

    :raises ConfigurationError: if there are none
    """
    if not path.is_dir():
        raise ConfigurationError(
            'is not a rosbag2 directory' if path.exists() else 'there is no such directory',
            source=path)
    found = [f for f in path.iterdir() if f.suffix in _STORAGES and f.is_file()]
    if not found:
        raise ConfigurationError(
            'is no recording, there is neither an .mcap nor a .db3 file in it', source=path)
    if len({f.suffix for f in found}) > 1:
        raise ConfigurationError('holds files of two storage formats', source=path)
    # ros2 bag numbers the parts of a long recording: bag_2 is before bag_10.
    return sorted(found, key=lambda f: (len(f.name), f.name))


def recover(path: Path, output: Path) -> Found:
    """
    Copy what can be read of a bag into a new one.

    :param path: a rosbag2 directory, torn or not; nothing in it is changed
    :param output: directory to make
    :raises ConfigurationError: if ``path`` is no recording, nothing can be read of it, or
        ``output`` exists or cannot be written
    """
    parts = files(path)
    check_new(output)
    found = Found()
    storage = _STORAGES[parts[0].suffix]
    read = {'mcap': _read_mcap, 'sqlite3': _read_sqlite}[storage]
    if all(part.stat().st_size == 0 for part in parts):
        raise ConfigurationError('is empty, there is nothing to recover', source=path)
    try:
        bag = Bag(output, storage)
    except OSError as error:
        raise ConfigurationError(
            f'cannot be written: {error.strerror}', source=output) from None
    try:
        with TemporaryDirectory(dir=output.parent, prefix='.tetra_recover_') as scratch:
            _copy(_announced(_all(read, parts, Path(scratch), found), bag), bag, found)
        bag.close()
    except (OSError, sqlite3.Error) as error:
        bag.abort()
        shutil.rmtree(output)
        raise ConfigurationError(
            f'cannot be written: {getattr(error, "strerror", None) or error}',
            source=output) from None
    except BaseException:
        bag.abort()
        shutil.rmtree(output)
        raise
    if not found.messages:
        shutil.rmtree(output)
        raise ConfigurationError('there is no message in it that can be read', source=path)
    found.lost += _expected(path, found)
    return found


def _all(read: Any, parts: Iterable[Path], scratch: Path,
         found: Found) -> Iterator[tuple[Topic, int, bytes]]:
    for part in parts:
        yield from read(part, scratch, found.lost)


def _announced(messages: Iterable[tuple[Topic, int, bytes]],
               bag: Bag) -> Iterator[tuple[str, int, int, bytes]]:
    """Announce each topic when its first message comes."""
    numbers: dict[Topic, int] = {}
    for topic, at, data in messages:
        if topic not in numbers:
            numbers[topic] = bag.add(topic.name, topic.type_name, topic.definition,
                                     _hash(topic), _profiles(topic))
        yield topic.name, numbers[topic], at, data


def _copy(messages: Iterable[tuple[str, int, int, bytes]], bag: Bag, found: Found) -> None:
    rows: list[tuple[int, int, bytes]] = []
    for name, number, at, data in messages:
        found.messages[name] += 1
        found.first.setdefault(name, at)
        found.last[name] = at
        rows.append((number, at, data))
        if len(rows) >= _BATCH:
            bag.write(rows)
            rows = []
    bag.write(rows)


def _read_mcap(part: Path, _scratch: Path, lost: list[str]) -> Iterator[tuple[Topic, int, bytes]]:
    size = part.stat().st_size
    schemas: dict[int, Schema] = {}
    topics: dict[int, Topic] = {}
    with part.open('rb') as stream:
        reader = StreamReader(stream, record_size_limit=None)
        good = 0
        try:
            for record in reader.records:
                good = stream.tell()
                yield from _message(record, schemas, topics)
            return
        # The file ends in the middle of a record, or what is there is not one.
        except (McapError, struct.error, ValueError, OverflowError, MemoryError) as error:
            problem = str(error).splitlines()[0] if str(error) else type(error).__name__
        if good == size:  # only the index is missing, and a new one is made
            return
        stream.seek(good)
        saved = 0
        for record in _rest_of_chunk(stream):
            for message in _message(record, schemas, topics):
                saved += 1
                yield message
    lost.append(
        f'{part.name}: the last {size - good} of {size} bytes are not a whole record ({problem})'
        + (f'; {saved} messages were found in them' if saved else ''))


def _message(record: Any, schemas: dict[int, Schema],
             topics: dict[int, Topic]) -> Iterator[tuple[Topic, int, bytes]]:
    if isinstance(record, Schema):
        schemas[record.id] = record
    elif isinstance(record, Channel):
        if schema := schemas.get(record.schema_id):
            topics[record.id] = Topic(
                record.topic, schema.name, _definition(schema.encoding, schema.data.decode()),
                record.metadata.get('offered_qos_profiles', ''))
    elif isinstance(record, Message) and record.channel_id in topics:
        yield topics[record.channel_id], record.log_time, record.data


def _rest_of_chunk(stream: Any) -> Iterator[Any]:
    """Give the whole records of a chunk whose end is missing, if it is not compressed."""
    head = stream.read(_CHUNK_HEAD + 4)
    if len(head) < _CHUNK_HEAD + 4 or head[0] != _CHUNK_OPCODE:
        return
    length, = struct.unpack_from('<I', head, _CHUNK_HEAD)
    if length:  # the name of a compression
        return
    reader = StreamReader(BytesIO(stream.read()[8:]), skip_magic=True, record_size_limit=None)
    try:
        yield from reader.records
    except (McapError, struct.error, ValueError, OverflowError, MemoryError):
        return


def _read_sqlite(part: Path, scratch: Path,
                 lost: list[str]) -> Iterator[tuple[Topic, int, bytes]]:
    # To open it is to roll back what was not committed, which changes it: that is for a copy.
    copy = scratch / part.name
    for file in part.parent.glob(f'{part.name}*'):
        shutil.copyfile(file, scratch / file.name)
    last = None
    try:
        database = sqlite3.connect(copy)
        try:
            definitions = {kind: _definition(encoding, text) for kind, encoding, text in
                           _rows(database, 'SELECT topic_type, encoding, '
                                           'encoded_message_definition FROM message_definitions')}
            topics = {number: Topic(name, kind, definitions.get(kind, ''), profiles)
                      for number, name, kind, profiles in database.execute(
                          'SELECT id, name, type, offered_qos_profiles FROM topics')}
            for number, at, data in database.execute(
                    'SELECT topic_id, timestamp, data FROM messages ORDER BY id'):
                last = at
                if number in topics:
                    yield topics[number], at, data
        finally:
            database.close()
    except sqlite3.Error as error:
        lost.append(f'{part.name}: {error}' + (
            '' if last is None else ', after the last message that was read'))
    finally:
        for file in scratch.glob(f'{part.name}*'):
            file.unlink()


def _rows(database: sqlite3.Connection, query: str) -> list[Any]:
    """Return rows of a table that old recordings do not have."""
    try:
        return database.execute(query).fetchall()
    except sqlite3.OperationalError:
        return []


def _definition(encoding: str, text: str) -> str:
    """Return a definition as rosbags tells its language apart."""
    idl = encoding == 'ros2idl' and not text.startswith('=' * 80)
    return f'{"=" * 80}\nIDL: {text}' if idl else text


def _hash(topic: Topic) -> str:
    """Return the hash of a topic's type, all zeros if it cannot be had from its definition."""
    idl = topic.definition.startswith('=' * 80 + '\nIDL: ')
    try:
        if topic.type_name in (known := get_typestore(Stores.ROS2_JAZZY)).types:
            return known.hash_rihs01(topic.type_name)
        store = get_typestore(Stores.EMPTY)
        store.register(get_types_from_idl(topic.definition) if idl else
                       get_types_from_msg(topic.definition, topic.type_name))
        return store.hash_rihs01(topic.type_name)
    except Exception:  # a definition from anywhere makes the parsers fail in any way there is
        return _UNKNOWN_HASH


def _profiles(topic: Topic) -> list[Qos]:
    """Return the quality of service that was offered, as far as the torn bag tells."""
    try:
        return parse_qos(topic.profiles)
    except Exception:  # the same
        return []


def _expected(path: Path, found: Found) -> list[str]:
    """Return what the old metadata promise and is not there."""
    try:
        promised = yaml.safe_load((path / 'metadata.yaml').read_text())[
            'rosbag2_bagfile_information']['topics_with_message_count']
        counts = Counter({t['topic_metadata']['name']: t['message_count'] for t in promised})
    except (OSError, yaml.YAMLError, KeyError, TypeError):
        return []
    return [f'{name}: {count} messages fewer than metadata.yaml tells of'
            for name, count in sorted((counts - found.messages).items())]
