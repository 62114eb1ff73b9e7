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

"""Of a torn recording, all that is in its files is in the new one, and the torn one is kept."""

from contextlib import closing, suppress
import functools
import os
import re
import shutil
import signal
import sqlite3
import subprocess
import sys
import threading

import bags
from harness import run
from hypothesis import given, HealthCheck, settings, strategies
from mcap.exceptions import EndOfFile
from mcap.records import Channel, Message
from mcap.stream_reader import StreamReader
import numpy as np
import pytest
from rosbags.rosbag2 import Reader
from tetra_ros2.config.parameters import ConfigurationError
from tetra_ros2.recording import reader, recover
from tetra_ros2.recording.bag import Bag

STORAGES = 'mcap', 'sqlite3'


def contents(path):
    with Reader(path) as bag:
        return [(c.topic, at, bytes(data)) for c, at, data in bag.messages()]


contents_once = functools.cache(contents)


def data_file(path):
    file, = (f for f in path.iterdir() if f.suffix in ('.mcap', '.db3'))
    return file


def snapshot(path):
    return {f.name: f.read_bytes() for f in path.iterdir()}


def tear(tmp_path, storage, count=500):
    """Leave a bag as a process does that is killed; return its path and what it had flushed."""
    path = tmp_path / 'bag'
    code = f"""
import os, signal
from pathlib import Path
from tetra_ros2.recording.bag import Bag
bag = Bag(Path({str(path)!r}), {storage!r})
topics = [bag.add(name, 'std_msgs/msg/Float64', 'float64 data', 'RIHS01_' + 64 * '0')
          for name in ('/a', '/b')]
def write(begin, end):
    bag.write([(topics[k % 2], k, b'\\0\\1\\0\\0' + k.to_bytes(8, 'little'))
               for k in range(begin, end)])
write(1, {count} + 1)
bag.flush()
bag.describe()
write({count} + 1, 2 * {count})
os.kill(os.getpid(), signal.SIGKILL)
"""
    done = subprocess.run([sys.executable, '-c', code], check=False)
    assert done.returncode == -signal.SIGKILL
    return path, [(('/a', '/b')[k % 2], k, b'\0\1\0\0' + k.to_bytes(8, 'little'))
                  for k in range(1, count + 1)]


@pytest.mark.parametrize('storage', STORAGES)
def test_what_was_flushed_before_a_kill_is_recovered_and_the_torn_one_is_kept(tmp_path, storage):
    path, flushed = tear(tmp_path, storage)
    before = snapshot(path)
    with pytest.raises(ConfigurationError, match=r'cut off.*tetra recover') as caught:
        reader.load(path)
    assert '\n' not in str(caught.value)
    assert not recover.is_whole(path)
    status, output, errors = run('recover', path)
    assert status == 0, errors
    assert snapshot(path) == before
    recovered = tmp_path / 'bag_recovered'
    assert contents(recovered) == flushed
    assert recover.is_whole(recovered)
    assert '500 messages of 2 topics' in output
    assert re.search(r'^/b +250 ', output, re.MULTILINE)
    assert not [p for p in tmp_path.iterdir() if p not in (path, recovered)]


@pytest.mark.parametrize('storage', STORAGES)
def test_a_torn_bag_without_metadata_is_recovered(tmp_path, storage):
    path, flushed = tear(tmp_path, storage)
    (path / 'metadata.yaml').unlink(missing_ok=True)  # it may not have come to be
    found = recover.recover(path, tmp_path / 'new')
    assert contents(tmp_path / 'new') == flushed
    assert found.messages == {'/a': 250, '/b': 250}
    assert found.last == {'/a': 500, '/b': 499}


def test_sqlite_that_was_torn_can_be_read_as_it_is_by_whoever_knows_sqlite(tmp_path):
    path, flushed = tear(tmp_path, 'sqlite3')
    with closing(sqlite3.connect(data_file(path))) as database:
        found = database.execute(
            'SELECT name, timestamp, data FROM messages JOIN topics ON topics.id = topic_id '
            'ORDER BY messages.id').fetchall()
    assert found == flushed


@pytest.mark.parametrize('storage', STORAGES)
def test_a_disk_that_does_not_answer_holds_up_nothing(tmp_path, storage, monkeypatch):
    """What was flushed is in the system's hands, and outlives the process; see kill above."""
    begun, patience, synced = threading.Event(), threading.Event(), []

    def hang(number):
        synced.append(number)
        begun.set()
        assert patience.wait(30.0)

    monkeypatch.setattr(os, 'fdatasync', hang)
    bag = Bag(tmp_path / 'bag', storage)
    topic = bag.add('/a', 'std_msgs/msg/Float64', 'float64 data', 'RIHS01_' + 64 * '0')
    for k in range(5):
        bag.write([(topic, k + 1, bytes(12))])
        bag.flush()
    shutil.copytree(tmp_path / 'bag', tmp_path / 'torn')
    assert begun.wait(30.0), 'it is a thread that waits for the disk'
    assert len(synced) == 1
    patience.set()
    bag.close()
    recover.recover(tmp_path / 'torn', tmp_path / 'new')
    assert len(contents(tmp_path / 'new')) == 5
    assert len(contents(tmp_path / 'bag')) == 5
    assert recover.is_whole(tmp_path / 'bag')


def test_an_hour_of_mcap_needs_no_more_memory_than_a_minute(tmp_path):
    bag = Bag(tmp_path / 'bag', 'mcap')
    topics = [bag.add(f'/{k}', 'std_msgs/msg/Float64', 'float64 data', 'RIHS01_' + 64 * '0')
              for k in range(20)]
    for k in range(18_000):  # five times a second
        bag.write([(topics[k % 20], k + 1, bytes(100))])
        bag.flush()
    assert len(bag._storage.chunks) < 4, 'what the index of each takes, it keeps to the end'
    times = [at for _, at, _ in contents_of_chunks(data_file(tmp_path / 'bag'))]
    assert times == [*range(1, 18_001)], 'everything is in the file, with no chunk but whole ones'
    bag.close()
    assert [at for _, at, _ in contents(tmp_path / 'bag')] == times


def contents_of_chunks(path):
    """Return what anybody finds in an MCAP file without an index."""
    channels, found = {}, []
    with path.open('rb') as stream, suppress(EndOfFile):
        for record in StreamReader(stream).records:
            if isinstance(record, Channel):
                channels[record.id] = record.topic
            elif isinstance(record, Message):
                found.append((channels[record.channel_id], record.log_time, record.data))
    return found


def test_the_log_of_sqlite_goes_into_the_database_now_and_then(tmp_path):
    bag = Bag(tmp_path / 'bag', 'sqlite3')
    topic = bag.add('/a', 'std_msgs/msg/Float64', 'float64 data', 'RIHS01_' + 64 * '0')
    for k in range(200):
        bag.write([(topic, 100 * k + i + 1, bytes(1000)) for i in range(100)])
        bag.flush()
        bag._storage._disk.wait()
    log, = (tmp_path / 'bag').glob('*-wal')
    assert log.stat().st_size < 4 << 20
    assert data_file(tmp_path / 'bag').stat().st_size > 15 << 20
    bag.close()
    assert not log.exists()
    assert len(contents(tmp_path / 'bag')) == 20_000


@pytest.mark.parametrize('storage', STORAGES)
def test_a_formation_is_recovered_with_types_and_quality_of_service(tmp_path, storage):
    attitudes, _ = bags.write(tmp_path / 'bag', 50, storage=storage)
    (tmp_path / 'bag' / 'metadata.yaml').unlink()
    recover.recover(tmp_path / 'bag', tmp_path / 'new')
    np.testing.assert_array_equal(reader.load(tmp_path / 'new').attitudes, attitudes)
    with Reader(tmp_path / 'new') as bag:
        assert {c.digest for c in bag.connections if c.msgtype == bags.POSES} == {
            bags.STORE.hash_rihs01(bags.POSES)}


@settings(suppress_health_check=[HealthCheck.function_scoped_fixture], max_examples=40)
@given(strategies.floats(0.0, 1.0))
def test_an_mcap_file_cut_anywhere_gives_all_the_messages_before_the_cut(tmp_path, part):
    whole = tmp_path / 'whole'
    if not whole.exists():
        bags.write(whole, 40)
    shutil.rmtree(tmp_path / 'torn', ignore_errors=True)
    shutil.rmtree(tmp_path / 'new', ignore_errors=True)
    shutil.copytree(whole, tmp_path / 'torn')
    file = data_file(tmp_path / 'torn')
    content = file.read_bytes()
    cut = round(part * len(content))
    file.write_bytes(content[:cut])
    expected = contents_once(whole)
    # A message is there as a whole if its bytes end before the cut; each is found only once.
    ends = [content.index(data) + len(data) for _, _, data in expected
            if content.count(data) == 1]
    try:
        recover.recover(tmp_path / 'torn', tmp_path / 'new')
    except ConfigurationError as error:
        assert re.search('nothing to recover|no message', str(error))
        assert not (tmp_path / 'new').exists()
        got = []
    else:
        got = contents(tmp_path / 'new')
    assert got == expected[:len(got)]
    assert len(got) >= sum(end <= cut for end in ends)


@settings(suppress_health_check=[HealthCheck.function_scoped_fixture], max_examples=60)
@given(strategies.sampled_from(STORAGES), strategies.floats(0.0, 1.0),
       strategies.binary(min_size=1, max_size=300))
def test_a_damaged_file_never_ends_in_anything_but_one_line(tmp_path, storage, part, noise):
    whole = tmp_path / storage
    if not whole.exists():
        bags.write(whole, 40, storage=storage)
    for name in 'torn', 'new':
        shutil.rmtree(tmp_path / name, ignore_errors=True)
    shutil.copytree(whole, tmp_path / 'torn')
    file = data_file(tmp_path / 'torn')
    content = bytearray(file.read_bytes())
    begin = round(part * (len(content) - 1))
    content[begin:begin + len(noise)] = noise
    file.write_bytes(content)
    before = snapshot(tmp_path / 'torn')
    with suppress(ConfigurationError):
        recover.recover(tmp_path / 'torn', tmp_path / 'new')
        contents(tmp_path / 'new')
    assert snapshot(tmp_path / 'torn') == before


def test_what_the_metadata_promise_and_is_not_there_is_said(tmp_path):
    bags.write(tmp_path / 'bag', 40)
    file = data_file(tmp_path / 'bag')
    content = file.read_bytes()
    file.write_bytes(content[:len(content) // 2])
    found = recover.recover(tmp_path / 'bag', tmp_path / 'new')
    assert any('not a whole record' in text for text in found.lost)
    assert any(text.startswith('/formation/attitudes: ') and 'fewer' in text
               for text in found.lost)


def test_a_whole_bag_is_left_alone(tmp_path):
    bags.write(tmp_path / 'bag', 5)
    status, output, _ = run('recover', tmp_path / 'bag')
    assert status == 0
    assert 'is whole' in output
    assert [p.name for p in tmp_path.iterdir()] == ['bag']


def test_what_is_no_recording_is_refused_in_one_line(tmp_path):
    (tmp_path / 'empty').mkdir()
    (tmp_path / 'file').write_text('x')
    (tmp_path / 'zero').mkdir()
    (tmp_path / 'zero' / 'zero.mcap').write_bytes(b'')
    (tmp_path / 'noise').mkdir()
    (tmp_path / 'noise' / 'noise.db3').write_bytes(b'noise' * 100)
    (tmp_path / 'mixed').mkdir()
    for suffix in 'mcap', 'db3':
        (tmp_path / 'mixed' / f'a.{suffix}').write_bytes(b'x')
    for name, reason in (('missing', 'no such directory'), ('file', 'not a rosbag2 directory'),
                         ('empty', 'is no recording'), ('zero', 'is empty'),
                         ('noise', 'no message in it'), ('mixed', 'two storage formats')):
        status, _, errors = run('recover', tmp_path / name)
        assert status == 2
        assert reason in errors
        assert errors.count('\n') == 1
        assert not (tmp_path / f'{name}_recovered').exists()


def test_an_existing_path_is_never_written_to(tmp_path):
    path, _ = tear(tmp_path, 'mcap')
    (tmp_path / 'bag_recovered').mkdir()
    status, _, errors = run('recover', path)
    assert status == 2
    assert 'exists already' in errors
    assert not list((tmp_path / 'bag_recovered').iterdir())


def test_parts_of_a_long_recording_are_joined_in_their_order(tmp_path):
    path = tmp_path / 'bag'
    path.mkdir()
    for part in (2, 10):
        bag = Bag(tmp_path / f'part{part}', 'mcap')
        topic = bag.add('/a', 'std_msgs/msg/Float64', 'float64 data', 'RIHS01_' + 64 * '0')
        bag.write([(topic, part, b'\0\1\0\0' + bytes(8))])
        bag.close()
        data_file(tmp_path / f'part{part}').rename(path / f'bag_{part}.mcap')
    recover.recover(path, tmp_path / 'new')
    assert [at for _, at, _ in contents(tmp_path / 'new')] == [2, 10]
