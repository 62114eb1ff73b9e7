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
import select
import struct
import subprocess
import sys
import threading
import time

from harness import DEADLINE, run
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
        # Fast DDS prints, too, if a port is locked.
        assert any(line == 'here\n' for line in process.stdout)
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


def ports_of(process):
    """Return the ports that a process reads."""
    links = [os.readlink(f) for f in Path(f'/proc/{process.pid}/fd').iterdir()]
    return {Path(link).name.removesuffix('_el') for link in links
            if '/fastrtps_port' in link and link.endswith('_el')}


@pytest.mark.skipif(not shared_memory.DIRECTORY.is_dir(), reason='there is no /dev/shm')
def test_a_port_of_the_dead_that_somebody_sends_to_is_not_taken_again(lodgers):
    sender, dead = lodgers(), lodgers()
    ports = ports_of(dead)
    assert ports

    def sent_to():
        maps = Path(f'/proc/{sender.pid}/maps').read_text()
        return {port for port in ports if f'/{port}\n' in maps}

    until(sent_to)
    with shared_memory.dead_ports_held() as held:
        assert not ports & held, 'it lives'

    dead.kill()
    dead.wait()

    def another_keeps_off():
        with shared_memory.dead_ports_held() as held:
            kept = sent_to()
            return kept and kept <= held and not ports_of(lodgers()) & kept

    until(another_keeps_off)


def until(condition):
    deadline = time.monotonic() + DEADLINE
    while not condition():
        assert time.monotonic() < deadline
        time.sleep(0.01)


def test_a_port_that_nobody_sends_to_or_that_is_shared_or_gone_is_not_held(tmp_path, monkeypatch):
    for name in ('fastrtps_port7411', 'fastrtps_port7413'):
        (tmp_path / name).touch()
    (tmp_path / 'fastrtps_port7413_sl').touch()
    (tmp_path / 'fastrtps_port7417').touch()
    monkeypatch.setattr(shared_memory, '_mapped_ports', lambda _: {
        'fastrtps_port7411', 'fastrtps_port7413', 'fastrtps_port7415'})
    with shared_memory.dead_ports_held(tmp_path) as held:
        assert held == {'fastrtps_port7411'}
        with (tmp_path / 'fastrtps_port7411_el').open() as lock, pytest.raises(OSError):
            fcntl.flock(lock, fcntl.LOCK_EX | fcntl.LOCK_NB)
        with shared_memory.dead_ports_held(tmp_path) as again:
            assert again == held, 'two that start together both keep off'
        with (tmp_path / 'fastrtps_port7411_el').open() as lock, pytest.raises(OSError):
            fcntl.flock(lock, fcntl.LOCK_EX | fcntl.LOCK_NB)
    with (tmp_path / 'fastrtps_port7411_el').open() as lock:
        fcntl.flock(lock, fcntl.LOCK_EX | fcntl.LOCK_NB)


def test_a_lock_that_somebody_tries_for_a_moment_is_tried_again(tmp_path, monkeypatch):
    (tmp_path / 'fastrtps_port7411').touch()
    monkeypatch.setattr(shared_memory, '_mapped_ports', lambda _: {'fastrtps_port7411'})
    path = tmp_path / 'fastrtps_port7411_el'
    other = path.open('w')  # as Fast DDS does to see if somebody lives there
    fcntl.flock(other, fcntl.LOCK_EX)
    rounds = iter(range(100))

    def wait(*_):
        if next(rounds) == 1:
            path.unlink()
            other.close()

    monkeypatch.setattr(select, 'select', wait)
    with shared_memory.dead_ports_held(tmp_path) as held:
        assert held == {'fastrtps_port7411'}
        with path.open() as lock, pytest.raises(OSError):
            fcntl.flock(lock, fcntl.LOCK_EX | fcntl.LOCK_NB)


def test_a_lock_whose_file_somebody_removes_is_locked_again(tmp_path, monkeypatch):
    (tmp_path / 'fastrtps_port7411').touch()
    monkeypatch.setattr(shared_memory, '_mapped_ports', lambda _: {'fastrtps_port7411'})
    path = tmp_path / 'fastrtps_port7411_el'
    rounds = iter(range(100))
    monkeypatch.setattr(select, 'select', lambda *_: path.unlink() if next(rounds) == 0 else None)
    with shared_memory.dead_ports_held(tmp_path) as held:
        assert held == {'fastrtps_port7411'}
        with path.open() as lock, pytest.raises(OSError):
            fcntl.flock(lock, fcntl.LOCK_EX | fcntl.LOCK_NB)


def test_a_port_that_is_gone_is_waited_for_and_locked_when_it_is_made_again(tmp_path, monkeypatch):
    monkeypatch.setattr(shared_memory, '_mapped_ports', lambda _: {'fastrtps_port7411'})
    rounds = iter(range(100))
    monkeypatch.setattr(select, 'select', lambda *_: (tmp_path / 'fastrtps_port7411').touch()
                        if next(rounds) == 40 else None)
    with shared_memory.dead_ports_held(tmp_path) as held:
        assert held == {'fastrtps_port7411'}
    assert next(rounds) < 50


def test_what_is_printed_while_a_port_is_held_is_no_output_of_the_program(
        tmp_path, monkeypatch, capfd):
    (tmp_path / 'fastrtps_port7411').touch()
    for name, held in (('nothing', set()), ('fastrtps_port7411', {'fastrtps_port7411'})):
        monkeypatch.setattr(shared_memory, '_mapped_ports', lambda _, name=name: {name})
        with shared_memory.dead_ports_held(tmp_path) as ports:
            assert ports == held
            os.write(1, b'by a library\n')
        print('by the program', flush=True)
        told = ('', 'by a library\n') if held else ('by a library\n', '')
        output, errors = capfd.readouterr()
        assert (output, errors) == (f'{told[0]}by the program\n', told[1])


def test_a_port_is_held_where_the_program_has_no_output_or_nowhere_to_print_errors(tmp_path):
    (tmp_path / 'fastrtps_port7411').touch()
    code = ('import os, sys\nfrom pathlib import Path\nfrom tetra_ros2.ros import shared_memory\n'
            "shared_memory._mapped_ports = lambda _: {'fastrtps_port7411'}\n"
            'with shared_memory.dead_ports_held(Path(sys.argv[1])) as held:\n    pass\n'
            'os._exit(40 + len(held))')
    for redirection in ('>&-', '2>&-', '>&- 2>&-'):
        done = subprocess.run(['sh', '-c', f'exec "$@" {redirection}', 'sh', sys.executable, '-c',
                               code, tmp_path], timeout=DEADLINE, check=False)
        assert done.returncode == 41, redirection


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
