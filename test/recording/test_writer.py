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

"""A bag is written by a process of its own, and is whole however the recorder ends."""

import os
import signal
import subprocess
import sys

from mcap.reader import make_reader
import pytest
from tetra_ros2.recording.writer import BagError, BagWriter

QOS = (1, 10, 1, 2, 0, 0, 1, 0, False)
MESSAGE = b'\0\1\0\0' + bytes(8)


@pytest.fixture
def writer(tmp_path):
    bag = BagWriter(tmp_path / 'bag', 'mcap')
    yield bag
    bag.abort()


def announce(writer, name='/error'):
    return writer.add_topic(name, 'std_msgs/msg/Float64', 'RIHS01_' + 64 * '0', [QOS])


def read(path):
    file, = path.glob('*.mcap')
    with file.open('rb') as stream:
        return [(channel.topic, message.log_time, message.data)
                for _, channel, message in make_reader(stream).iter_messages()]


def test_what_is_written_is_there_in_its_order(tmp_path, writer):
    first, second = announce(writer), announce(writer, '/other')
    assert (first, second) == (0, 1)
    other = b'\0\1\0\0' + bytes(range(8))
    writer.write([(first, 5, MESSAGE), (second, 6, other)])
    writer.write([(first, 7, MESSAGE)])
    writer.close()
    assert read(tmp_path / 'bag') == [
        ('/error', 5, MESSAGE), ('/other', 6, other), ('/error', 7, MESSAGE)]


def test_a_type_that_nobody_knows_has_no_number(writer):
    assert writer.add_topic('/x', 'no_msgs/msg/Nothing', 'RIHS01_' + 64 * '0', [QOS]) is None
    assert announce(writer) == 0


def test_more_than_the_pipe_holds_is_written_too(tmp_path, writer):
    topic = announce(writer)
    for k in range(60):
        writer.write([(topic, 1000 * k + i, MESSAGE + bytes(100)) for i in range(500)])
    writer.close()
    assert len(read(tmp_path / 'bag')) == 30_000


@pytest.mark.parametrize('number', [signal.SIGINT, signal.SIGTERM, signal.SIGHUP])
def test_a_signal_to_everybody_does_not_tear_the_bag(tmp_path, writer, number):
    topic = announce(writer)
    os.kill(writer._process.pid, number)
    writer.write([(topic, 1, MESSAGE)])
    writer.close()
    assert len(read(tmp_path / 'bag')) == 1


@pytest.mark.skipif(sys.version_info < (3, 11), reason='needs a newer Python')
def test_it_has_a_group_of_its_own_but_no_session(writer):
    """A session of its own got no processor for up to 2.4 s on a busy machine."""
    pid = writer._process.pid
    assert os.getpgid(pid) == pid
    assert os.getsid(pid) == os.getsid(0)


def test_a_writer_that_was_killed_is_an_error(writer):
    topic = announce(writer)
    writer._process.kill()
    writer._process.wait()
    with pytest.raises(BagError, match='died'):
        writer.write([(topic, 1, MESSAGE)])
    with pytest.raises(BagError, match='died'):
        announce(writer)
    with pytest.raises(BagError, match='died'):
        writer.close()


def test_a_recorder_that_is_killed_leaves_a_whole_bag(tmp_path):
    code = f"""
import os, signal
from tetra_ros2.recording.writer import BagWriter
writer = BagWriter({str(tmp_path / 'bag')!r}, 'mcap')
topic = writer.add_topic('/error', 'std_msgs/msg/Float64', 'RIHS01_' + 64 * '0', [{QOS!r}])
writer.write([(topic, k, {MESSAGE!r}) for k in range(1, 1001)])
os.kill(os.getpid(), signal.SIGKILL)
"""
    # The process that writes has the same output: it is at its end when that is.
    done = subprocess.run([sys.executable, '-c', code], capture_output=True, check=False)
    assert done.returncode == -signal.SIGKILL
    assert done.stderr == b''
    assert len(read(tmp_path / 'bag')) == 1000
    assert (tmp_path / 'bag' / 'metadata.yaml').is_file()


def test_a_path_that_is_there_already_is_an_error(tmp_path):
    with pytest.raises(BagError, match='exists'):
        BagWriter(tmp_path, 'mcap')


def test_it_finds_its_modules_where_the_recorder_does(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    monkeypatch.delenv('PYTHONPATH', raising=False)
    BagWriter(tmp_path / 'bag', 'sqlite3').close()
    assert list((tmp_path / 'bag').glob('*.db3'))
