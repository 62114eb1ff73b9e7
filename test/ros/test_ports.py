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

"""Ports in shared memory that lose their names, and are opened again."""

from contextlib import contextmanager, ExitStack, suppress
import fcntl
import mmap
import os
from pathlib import Path
import struct
import subprocess
import sys

from harness import DEADLINE, interrupt, own_words, Probe, run, until
import pytest
from rcl_interfaces.srv import GetParameters
from rclpy.context import Context
from rclpy.executors import SingleThreadedExecutor
from rclpy.node import Node
from tetra_ros2.ros import ports
from tetra_ros2.ros.executor import leave
from tetra_ros2.ros.shared_memory import DIRECTORY

pytestmark = pytest.mark.skipif(not DIRECTORY.is_dir(), reason='there is no /dev/shm')

NUMBER = 64000 + int(os.environ['ROS_DOMAIN_ID'])
NAME = f'fastrtps_port{NUMBER}'
"""A port that nobody has, and no other run of these tests."""


def ports_of(pid):
    """Return the names of the ports that a process listens on."""
    found = set()
    for file in Path(f'/proc/{pid}/fd').iterdir():
        with suppress(OSError):  # closed meanwhile
            link = os.readlink(file)
            if '/fastrtps_port' in link and link.endswith('_el'):
                found.add(Path(link).name.removesuffix('_el'))
    return found


def test_a_running_node_that_nobody_can_find_any_more_is_found_again(processes):
    agent = processes.tetra('agent', '--id', '1')
    until(lambda: len(ports_of(agent.pid)) == 2)
    with Probe() as probe:
        probe.wait_for(lambda: 'agent_1' in probe.node.get_node_names(), 'an agent')
    lost = ports_of(agent.pid)
    for name in lost:
        (DIRECTORY / name).unlink()
    with Probe() as probe:
        answer = probe.call(GetParameters, 'agent_1/get_parameters',
                            GetParameters.Request(names=['use_sim_time']))
    assert len(answer.values) == 1
    until(lambda: all((DIRECTORY / name).exists() for name in lost))
    status, output = interrupt(agent)
    assert status == 0
    assert all(name in output for name in lost)
    assert 'opened again' in output


def test_where_somebody_has_a_port_the_next_one_is_taken(processes):
    first = 7400 + 250 * int(os.environ['ROS_DOMAIN_ID']) + 11
    mine = set()
    with ExitStack() as stack:
        for number in range(first, first + 20, 2):
            lock = stack.enter_context((DIRECTORY / f'fastrtps_port{number}_el').open('w'))
            with suppress(BlockingIOError):
                fcntl.flock(lock, fcntl.LOCK_EX | fcntl.LOCK_NB)
                mine.add(f'fastrtps_port{number}')
        status, _, errors = run('recorder', '--output', DIRECTORY)
        assert status == 2
        assert errors.count('\n') == 1
        agent = processes.tetra('agent', '--id', '1')
        until(lambda: len(ports_of(agent.pid)) == 2)
        assert not ports_of(agent.pid) & mine
        with Probe() as probe:
            probe.call(GetParameters, 'agent_1/get_parameters', GetParameters.Request())
    status, output = interrupt(agent)
    assert status == 0
    assert any(f'Failed init_port {name}:' in output for name in mine)


def test_a_port_that_was_lost_is_opened_again_within_a_moment():
    context = Context()
    context.init()
    executor = SingleThreadedExecutor(context=context)
    executor.add_node(Node('lodger', context=context))
    try:
        assert ports.reopen_lost(new=True) == []
        mine = ports_of(os.getpid())
        for name in mine:
            (DIRECTORY / name).unlink()
        assert set(ports.reopen_lost()) == mine
        assert ports.reopen_lost() == [], 'Fast DDS is about to, or has'
        until(lambda: ports.reopen_lost() == [] and min(ports._found.values()) > 0)
        assert ports_of(os.getpid()) == mine
        assert all((DIRECTORY / name).exists() for name in mine)
    finally:
        leave(executor)
    for _ in range(200):
        ports.reopen_lost()
    assert not mine & ports._found.keys(), 'nobody listens there any more'


def head(number=NUMBER, listeners=1, healthy=1000, wait=333, capacity=512, waiting=1, flags=7):
    return struct.pack('<7I', number, listeners, healthy, wait, capacity, waiting, flags)


@contextmanager
def mapped(content, at=4 * 9 + 4 * 20, named=True, size=8192):
    """Give the memory of a port with this in it; its name is kept, or gone."""
    path = DIRECTORY / NAME
    path.unlink(missing_ok=True)
    with path.open('w+b') as file:
        file.truncate(size)
        with mmap.mmap(file.fileno(), size) as memory:
            memory[at:at + len(content)] = content
            if not named:
                path.unlink()
            try:
                yield memory[:], memory
            finally:
                path.unlink(missing_ok=True)


@pytest.fixture
def lock():
    """Listen on the port, as far as its lock tells."""
    path = DIRECTORY / f'{NAME}_el'
    with path.open('w') as file:
        fcntl.flock(file, fcntl.LOCK_EX)
        yield
    path.unlink()
    ports._found.pop(NAME, None)


@pytest.mark.usefixtures('lock')
def test_one_bit_is_cleared_of_a_lost_port():
    with mapped(head(), named=False) as (before, memory):
        assert ports.reopen_lost(new=True) == [NAME]
        changed = [k for k in range(8192) if memory[k] != before[k]]
        assert changed == [4 * 9 + 4 * 20 + 24]
        assert memory[changed[0]] == 6
        assert ports.reopen_lost() == [], 'Fast DDS knows by now'


@pytest.mark.usefixtures('lock')
def test_a_port_with_its_name_is_left_alone():
    with mapped(head()) as (before, memory):
        assert ports.reopen_lost(new=True) == []
        assert ports._found[NAME] == os.stat(DIRECTORY / NAME).st_ino
        assert memory[:] == before


@pytest.mark.usefixtures('lock')
def test_a_port_of_that_name_that_this_process_only_sends_to_does_not_count():
    with mapped(head(), named=False) as (_, lost), \
            mapped(head(listeners=0, waiting=0, flags=1)) as (before, other):
        assert ports.reopen_lost(new=True) == [NAME]
        assert lost[4 * 9 + 4 * 20 + 24] == 6
        assert other[:] == before


@pytest.mark.usefixtures('lock')
@pytest.mark.parametrize('content', [
    b'', head(number=NUMBER + 1000), head(healthy=900), head(healthy=0, wait=0), head(capacity=0),
    head(listeners=2000), head(waiting=2)], ids=[
        'empty', 'number', 'timeout', 'no timeout', 'capacity', 'listeners', 'who wait'])
def test_what_does_not_look_like_a_port_is_left_alone(content):
    with mapped(content, named=False) as (before, memory):
        assert ports.reopen_lost(new=True) == []
        assert memory[:] == before
    with mapped(content) as (before, memory):
        assert ports.reopen_lost(new=True) == []
        assert memory[:] == before


@pytest.mark.usefixtures('lock')
def test_the_figures_are_looked_for_where_they_can_be_only():
    with mapped(head(), at=4 * 9 + 4 * 20 + 4, named=False) as (before, memory):
        assert ports.reopen_lost(new=True) == []
        assert memory[:] == before


SPOILT = """
import subprocess, sys
from rclpy.context import Context
from rclpy.executors import SingleThreadedExecutor
from rclpy.node import Node
from tetra_ros2.ros import ports
from tetra_ros2.ros.executor import leave

context = Context()
context.init()
executor = SingleThreadedExecutor(context=context)
executor.add_node(Node('spoilt', context=context))
dead = subprocess.Popen(['true'])
dead.wait()
listened = set(ports._listened())
mappings = ports._mappings()
for name in listened:
    for mapping in mappings[name]:
        address, head = ports._head(name, mapping)
        with open('/proc/self/mem', 'r+b', buffering=0) as memory:
            if sys.argv[1] == 'flag':
                assert ports._declare_broken(address, head)
            else:
                memory.seek(address + ports._MUTEXES[int(sys.argv[1])])
                before = memory.read(ports._MUTEX.size)
                assert ports._MUTEX.unpack(before)[4] == 128, before
                memory.seek(-len(before), 1)
                memory.write(ports._MUTEX.pack(2, 0, dead.pid, 1, 128))
print(len(listened), ports._in_order(listened), flush=True)
leave(executor)
print('left')
"""


@pytest.mark.parametrize('what', ['flag', 0, 1])
def test_who_leaves_while_a_port_is_opened_again_does_end(what):
    """Fast DDS by itself ends never, or by a segmentation fault."""
    done = subprocess.run(
        [sys.executable, '-c', SPOILT, str(what)], capture_output=True, text=True, check=False,
        timeout=DEADLINE)
    assert (done.returncode, own_words(done.stdout)) == (0, '2 False\nleft\n'), done.stderr


def mutex(locked=2, owner=1, kind=128):
    return struct.pack('<5i', locked, 0, owner, 1, kind)


@pytest.fixture
def dead():
    """Return the number of a process that has ended, and that nobody has waited for."""
    with subprocess.Popen(['true']) as process:
        until(lambda: not ports._lives(process.pid))
        yield process.pid


@pytest.mark.usefixtures('lock')
@pytest.mark.parametrize('place', [0, 1])
def test_a_port_that_the_dead_have_locked_is_not_in_order(dead, place):
    def settles(*changes, number=NUMBER):
        content = bytearray(30000)
        content[:28] = head(number=number)
        for other in ports._MUTEXES:
            content[other:other + 20] = mutex(locked=0, owner=0)
        at = ports._MUTEXES[place]
        content[at:at + 20] = mutex(*changes)
        with mapped(bytes(content), size=32768):
            return ports.settle(patience=0.02)

    assert not settles(2, dead)
    assert not settles(1, dead)
    assert settles(0, dead), 'not locked'
    assert settles(2, os.getpid()), 'by one who lives'
    assert settles(2, dead, 0), 'no mutex of processes'
    assert settles(2, dead, number=NUMBER + 1000), 'another port'


@pytest.mark.usefixtures('lock')
def test_a_port_that_is_to_be_opened_again_is_not_in_order():
    with mapped(head()):
        assert ports.settle()
    with mapped(head(flags=6)):
        assert not ports.settle(patience=0.02)
    with mapped(head(flags=6)), mapped(head()):
        assert ports.settle(), 'the new one is there'


def test_another_system_has_no_such_ports(tmp_path, monkeypatch):
    monkeypatch.setattr(ports, '_PROCESS', tmp_path)
    assert ports.reopen_lost(new=True) == []
    assert ports.settle()
