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

"""The segments of dead processes go, those of living ones are never touched."""

import fcntl
import os
from pathlib import Path
import struct
import subprocess
import sys
import threading
import time

from harness import run
import pytest
from tetra_ros2.ros import shared_memory

NODE = """
import rclpy, sys
rclpy.init()
node = rclpy.create_node('lodger')
publisher = node.create_publisher(__import__('std_msgs.msg').msg.String, 'lodging', 10)
print('here', flush=True)
sys.stdin.read()
"""


def segments():
    return {p.name for p in shared_memory.DIRECTORY.glob('fastrtps_*')
            if not p.name.startswith('fastrtps_port')}


def held_by(process):
    """Return the segments that a process has mapped, and their locks."""
    maps = Path(f'/proc/{process.pid}/maps').read_text()
    links = [os.readlink(f) for f in Path(f'/proc/{process.pid}/fd').iterdir()]
    return {name for name in segments() if f'/{name}\n' in maps
            or any(link.endswith(f'/{name}') for link in links)}


@pytest.fixture
def lodgers():
    started = []

    def start():
        process = subprocess.Popen([sys.executable, '-c', NODE], text=True,
                                   stdin=subprocess.PIPE, stdout=subprocess.PIPE)
        started.append(process)
        # Fast DDS logs on the standard output, too, where two make a port at a time.
        assert 'here\n' in iter(process.stdout.readline, '')
        return process

    yield start
    for process in started:
        process.kill()
        process.wait()
        process.stdin.close()
        process.stdout.close()


@pytest.mark.skipif(not shared_memory.DIRECTORY.is_dir(), reason='there is no /dev/shm')
def test_segments_of_the_dead_go_and_those_of_the_living_stay(lodgers):
    before = segments()
    dead, living = lodgers(), lodgers()
    # A participant maps its own segment and those of whom it sends to: a name is owned by the
    # process that has its lock open.
    of_dead = {n for n in held_by(dead) - before if n.endswith('_el')}
    of_living = {n for n in held_by(living) - before if n.endswith('_el')} - of_dead
    assert of_dead
    assert of_living
    dead.kill()
    dead.wait()
    deadline = time.monotonic() + 30.0
    while of_dead & segments():
        shared_memory.remove_dead(settled=0.5)
        assert time.monotonic() < deadline, of_dead & segments()
        time.sleep(0.1)
    assert not {n.removesuffix('_el') for n in of_dead} & segments()
    for _ in range(20):
        shared_memory.remove_dead(settled=0.0)
    assert of_living <= segments()
    assert {n.removesuffix('_el') for n in of_living} <= segments()
    living.communicate('', timeout=60)
    assert living.returncode == 0


def make(directory, name, size=1000):
    (directory / name).write_bytes(bytes(size))
    (directory / f'{name}_el').touch()


def test_only_what_is_dead_and_settled_and_a_segment_is_removed(tmp_path):
    dead, locked = ('fastrtps_' + c * 16 for c in 'ab')
    for name in dead, locked, 'fastrtps_port7410', 'fastrtps_short', 'precious':
        make(tmp_path, name)
    (tmp_path / 'elsewhere').write_text('precious')
    (tmp_path / ('fastrtps_' + 'c' * 16 + '_el')).symlink_to(tmp_path / 'elsewhere')
    assert shared_memory.remove_dead(tmp_path, settled=60.0) == 0
    with (tmp_path / f'{locked}_el').open() as lock:
        fcntl.flock(lock, fcntl.LOCK_EX)
        before = {p.name for p in tmp_path.iterdir()}
        assert shared_memory.remove_dead(tmp_path, settled=0.0) == 1000
    assert {p.name for p in tmp_path.iterdir()} == before - {dead, f'{dead}_el'}
    assert shared_memory.remove_dead(tmp_path / 'nowhere') == 0


def test_a_start_removes_what_is_dead_and_settled(tmp_path, monkeypatch):
    monkeypatch.setenv('FASTDDS_BUILTIN_TRANSPORTS', 'UDPv4')  # so that room is not looked for
    dead, living = ('fastrtps_' + c * 16 for c in 'ab')
    make(tmp_path, dead)
    make(tmp_path, living)
    with (tmp_path / f'{living}_el').open() as lock:
        fcntl.flock(lock, fcntl.LOCK_EX)
        shared_memory.prepare(tmp_path)
        assert (tmp_path / dead).exists(), 'it may be about to be locked'
        later = time.time() + 2.0 * shared_memory.SETTLED  # no file can be made older
        monkeypatch.setattr(shared_memory.time, 'time', lambda: later)
        shared_memory.prepare(tmp_path)
    assert {p.name for p in tmp_path.iterdir()} == {living, f'{living}_el'}


MADE, MAKING = struct.pack('<I', 2), struct.pack('<I', 1)


def test_ports_and_segments_that_were_not_made_to_the_end_are_removed(tmp_path):
    for name, content in (
            ('fastrtps_port7000', b''), ('fastrtps_port7001', MAKING + bytes(100)),
            ('fastrtps_port7002', MADE + bytes(100)), ('fastrtps_port7003_el', b''),
            ('fastrtps_' + 'a' * 16, b'0'), ('fastrtps_' + 'b' * 16, MADE), ('precious', b'')):
        (tmp_path / name).write_bytes(content)
    (tmp_path / 'fastrtps_port7004').symlink_to(tmp_path / 'precious')
    assert shared_memory.remove_torn_ports(tmp_path, patience=0.3) == 2
    shared_memory.remove_dead(tmp_path, settled=0.0)
    assert {p.name for p in tmp_path.iterdir()} == {
        'fastrtps_port7002', 'fastrtps_port7003_el', 'fastrtps_port7004',
        'fastrtps_' + 'b' * 16, 'precious'}


def test_a_port_that_is_being_made_is_waited_for_and_kept(tmp_path):
    port = tmp_path / 'fastrtps_port7000'
    port.touch()
    maker = threading.Timer(0.2, port.write_bytes, [MADE])
    maker.start()
    assert shared_memory.remove_torn_ports(tmp_path, patience=60.0) == 0
    maker.join()
    assert port.read_bytes() == MADE


@pytest.mark.skipif(not shared_memory.DIRECTORY.is_dir(), reason='there is no /dev/shm')
def test_a_node_starts_where_another_one_was_killed_while_it_made_its_port():
    # The first four that a process of this domain may take; without, it hangs for good.
    first = 7400 + 250 * int(os.environ['ROS_DOMAIN_ID']) + 10
    for port in range(first, first + 10):
        (shared_memory.DIRECTORY / f'fastrtps_port{port}').unlink(missing_ok=True)
        (shared_memory.DIRECTORY / f'fastrtps_port{port}').touch()
    status, output, errors = run('launcher', '--duration', '5', '--quiet')
    assert status == 0, errors
    assert 'formed' in output


@pytest.mark.skipif(os.geteuid() != 0, reason='only root can give a file to another user')
def test_what_another_user_left_is_not_touched(tmp_path):
    name = 'fastrtps_' + 'a' * 16
    make(tmp_path, name)
    os.chown(tmp_path / f'{name}_el', 12345, 12345)
    assert shared_memory.remove_dead(tmp_path, settled=0.0) == 0
    assert (tmp_path / name).exists()


def test_where_shared_memory_is_short_dds_does_without_and_says_so(
        tmp_path, monkeypatch, capsys):
    monkeypatch.setenv('FASTDDS_BUILTIN_TRANSPORTS', '')  # so that it is restored
    monkeypatch.delenv('FASTDDS_BUILTIN_TRANSPORTS')
    monkeypatch.setattr(shared_memory, 'NEEDED', 0)
    shared_memory.prepare(tmp_path)
    assert 'FASTDDS_BUILTIN_TRANSPORTS' not in os.environ
    monkeypatch.setattr(shared_memory, 'NEEDED', 1 << 60)
    shared_memory.prepare(tmp_path)
    assert os.environ['FASTDDS_BUILTIN_TRANSPORTS'] == 'UDPv4'
    assert capsys.readouterr().err.count('\n') == 1
    shared_memory.prepare(tmp_path)  # whoever has set it has decided
    assert not capsys.readouterr().err


@pytest.mark.skipif(os.geteuid() != 0, reason='only root can mount a file system')
def test_a_formation_forms_in_a_container_whose_shared_memory_is_full():
    # A mount of its own, in a namespace of its own: nobody else sees it.
    script = ('mount -t tmpfs -o size=1m tmpfs /dev/shm && exec '
              f'{sys.executable} -m tetra_ros2 launcher --duration 20 --quiet')
    done = subprocess.run(
        ['unshare', '--mount', 'sh', '-c', script], capture_output=True, text=True, check=False,
        timeout=120)
    if 'unshare' in done.stderr or 'mount' in done.stderr.split('tetra')[0]:
        pytest.skip(f'no mount namespace here: {done.stderr.strip()}')
    assert done.returncode == 0, done.stdout + done.stderr
    assert 'does without shared memory' in done.stderr
    assert 'formed     yes' in done.stdout
