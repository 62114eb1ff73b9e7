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
Several hosts on this machine, and a network between them that can fail.

Each host is a network namespace with one interface, and each interface is a TAP device. A process
of its own, the switch, holds the other ends and passes Ethernet frames on: it can lose them, hold
them back, or cut a host off. All chance in it comes from a seed. It needs root and
``/dev/net/tun``; :func:`unavailable` says in one line what is missing.
"""

from collections.abc import Iterator
import contextlib
import ctypes
import fcntl
import heapq
import json
import os
from pathlib import Path
import random
import select
import signal
import struct
import subprocess
import sys
import threading
import time
from types import TracebackType

TUNSETIFF = 0x400454CA
IFF_TAP, IFF_NO_PI = 0x0002, 0x1000
CLONE_NEWNET = 0x40000000
INTERFACE = 'eth0'
SUBNET = '10.98.0'
LARGEST_FRAME = 2048
MOST_WAITING = 200_000
"""Frames that the switch holds back at most; further ones are lost, as in any switch."""


def unavailable() -> str | None:
    """Say why there can be no hosts here, or return None."""
    if os.geteuid() != 0:
        return 'network namespaces need root'
    if not Path('/dev/net/tun').exists():
        return 'there is no /dev/net/tun'
    try:
        subprocess.run(['ip', 'netns', 'list'], check=True, capture_output=True)
    except (OSError, subprocess.CalledProcessError):
        return 'ip netns does not work here (Debian package iproute2)'
    return None


class Hosts:
    """
    Hosts, each with an address of its own; a context manager.

    :param names: their names
    :param seed: of what the network does by chance
    """

    def __init__(self, names: list[str], seed: int = 0) -> None:
        self._prefix = f'tetra{os.getpid()}'
        self.names = list(names)
        self._seed = seed
        self._switch: subprocess.Popen[str] | None = None
        self._running: list[tuple[str, subprocess.Popen[str]]] = []

    def __enter__(self) -> 'Hosts':
        try:
            for name in self.names:
                _ip('netns', 'add', self.namespace(name))
            self._switch = subprocess.Popen(
                [sys.executable, __file__, str(self._seed),
                 *(self.namespace(name) for name in self.names)],
                stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True)
            assert self._switch.stdout is not None
            if self._switch.stdout.readline().strip() != 'ready':
                raise RuntimeError('the switch did not start')
            for name in self.names:
                inside = ('-n', self.namespace(name))
                _ip(*inside, 'addr', 'add', f'{self.address(name)}/24', 'dev', INTERFACE)
                for device in ('lo', INTERFACE):
                    _ip(*inside, 'link', 'set', device, 'up')
                _ip(*inside, 'route', 'add', '239.0.0.0/8', 'dev', INTERFACE)
        except BaseException:
            self.close()
            raise
        return self

    def __exit__(self, kind: type[BaseException] | None, error: BaseException | None,
                 trace: TracebackType | None) -> None:
        self.close()

    def close(self) -> None:
        """End all processes on the hosts, and remove the hosts."""
        for name in self.names:
            self._end_processes(name)
        for _, process in self._running:
            process.communicate()
        if self._switch is not None:
            self._switch.kill()
            self._switch.communicate()
        for name in self.names:
            subprocess.run(['ip', 'netns', 'del', self.namespace(name)], capture_output=True,
                           check=False)

    def namespace(self, name: str) -> str:
        """Return the network namespace of a host."""
        return f'{self._prefix}-{name}'

    def enter(self, name: str) -> None:
        """Let this thread, and the threads and processes that it starts, be on a host."""
        _enter(f'/run/netns/{self.namespace(name)}')

    @contextlib.contextmanager
    def inside(self, name: str) -> Iterator[None]:
        """Let what this thread starts meanwhile be on a host, and come back."""
        here = f'/proc/{os.getpid()}/task/{threading.get_native_id()}/ns/net'
        home = os.open(here, os.O_RDONLY)
        try:
            self.enter(name)
            yield
        finally:
            _enter(f'/proc/self/fd/{home}')
            os.close(home)

    def processes(self, name: str) -> list[int]:
        """Return the numbers of all processes on a host."""
        done = subprocess.run(['ip', 'netns', 'pids', self.namespace(name)], capture_output=True,
                              text=True, check=False)
        return [int(word) for word in done.stdout.split()]

    def address(self, name: str) -> str:
        """Return the address of a host."""
        return f'{SUBNET}.{self.names.index(name) + 1}'

    def start(self, name: str, *command: object, env: dict[str, str] | None = None,
              **kwargs: object) -> 'subprocess.Popen[str]':
        """Start a process on a host; it is killed when the hosts are closed."""
        process = subprocess.Popen(
            ['ip', 'netns', 'exec', self.namespace(name), *map(str, command)],
            env={**os.environ, **(env or {})}, text=True,
            **{'stdout': subprocess.PIPE, 'stderr': subprocess.STDOUT, **kwargs})  # type: ignore
        self._running.append((name, process))
        return process

    def reboot(self, name: str) -> None:
        """End all processes of a host at once, as a power cut does, and clear its addresses."""
        self._end_processes(name)
        _ip('-n', self.namespace(name), 'link', 'set', INTERFACE, 'down')
        _ip('-n', self.namespace(name), 'link', 'set', INTERFACE, 'up')
        _ip('-n', self.namespace(name), 'route', 'replace', '239.0.0.0/8', 'dev', INTERFACE)

    def _end_processes(self, name: str) -> None:
        for number in self.processes(name):
            if number != os.getpid():  # which may have entered it
                with contextlib.suppress(ProcessLookupError):
                    os.kill(number, signal.SIGKILL)

    def network(self, *, loss: float = 0.0, delay: float = 0.0, jitter: float = 0.0) -> None:
        """
        Let the network be so from now on.

        :param loss: the probability that a frame is lost
        :param delay: how long every frame is held back [s]
        :param jitter: by how much longer at the most [s], uniformly
        """
        self._tell({'loss': loss, 'delay': delay, 'jitter': jitter})

    def cut(self, *names: str) -> None:
        """Cut these hosts off from all others, and heal all the rest."""
        self._tell({'cut': [self.names.index(name) for name in names]})

    def _tell(self, what: dict[str, object]) -> None:
        assert self._switch is not None
        assert self._switch.stdin is not None
        assert self._switch.stdout is not None
        self._switch.stdin.write(json.dumps(what) + '\n')
        self._switch.stdin.flush()
        if self._switch.stdout.readline().strip() != 'done':
            raise RuntimeError('the switch has died')


def _ip(*arguments: str) -> None:
    subprocess.run(['ip', *arguments], check=True, capture_output=True)


def _enter(namespace: str) -> None:
    """Let this thread be in the network namespace that a file stands for."""
    file = os.open(namespace, os.O_RDONLY)
    try:
        libc = ctypes.CDLL(None, use_errno=True)  # os.setns came with Python 3.12
        if libc.setns(file, CLONE_NEWNET):
            raise OSError(ctypes.get_errno(), f'cannot enter {namespace}')
    finally:
        os.close(file)


def _open_tap(namespace: str) -> int:
    """Make the interface of a host; return the other end of its cable."""
    _enter(f'/run/netns/{namespace}')
    tap = os.open('/dev/net/tun', os.O_RDWR | os.O_NONBLOCK)
    fcntl.ioctl(tap, TUNSETIFF, struct.pack('16sH22x', INTERFACE.encode(), IFF_TAP | IFF_NO_PI))
    return tap


class _Switch:
    """A switch with a port for each host."""

    def __init__(self, seed: int, namespaces: list[str]) -> None:
        self._chance = random.Random(seed)
        self._taps = [_open_tap(namespace) for namespace in namespaces]
        self._ports: dict[bytes, int] = {}  # by the hardware address behind it
        self._cut: set[int] = set()
        self._loss = self._delay = self._jitter = 0.0
        self._waiting: list[tuple[float, int, int, bytes]] = []
        self._count = 0

    def run(self) -> None:
        """Pass frames on until the standard input ends."""
        print('ready', flush=True)
        poll = select.poll()
        port_of = {tap: port for port, tap in enumerate(self._taps)}
        for tap in self._taps:
            poll.register(tap, select.POLLIN)
        poll.register(0, select.POLLIN)
        while True:
            timeout = None
            if self._waiting:
                timeout = max(0.0, 1000.0 * (self._waiting[0][0] - time.monotonic()))
            for file, _ in poll.poll(timeout):
                if file == 0:
                    line = sys.stdin.readline()
                    if not line:
                        return
                    self._obey(json.loads(line))
                else:
                    self._read(port_of[file], file)
            now = time.monotonic()
            while self._waiting and self._waiting[0][0] <= now:
                _, _, port, frame = heapq.heappop(self._waiting)
                self._send(port, frame)

    def _obey(self, what: dict[str, object]) -> None:
        if 'cut' in what:
            self._cut = set(what['cut'])  # type: ignore[call-overload]
        else:
            self._loss, self._delay, self._jitter = (
                float(what[key]) for key in ('loss', 'delay', 'jitter'))  # type: ignore
        print('done', flush=True)

    def _read(self, port: int, tap: int) -> None:
        for _ in range(64):  # then the others have their turn
            try:
                frame = os.read(tap, LARGEST_FRAME)
            except OSError:  # nothing more there, or the interface is down
                return
            self._ports[frame[6:12]] = port
            if port in self._cut:
                continue
            target = self._ports.get(frame[:6])
            others = [target] if target is not None else [
                other for other in range(len(self._taps)) if other != port]
            for other in others:
                if other in self._cut or (self._loss and self._chance.random() < self._loss):
                    continue
                if not self._delay and not self._jitter:
                    self._send(other, frame)
                elif len(self._waiting) < MOST_WAITING:
                    self._count += 1
                    due = time.monotonic() + self._delay + self._jitter * self._chance.random()
                    heapq.heappush(self._waiting, (due, self._count, other, frame))

    def _send(self, port: int, frame: bytes) -> None:
        if port in self._cut:
            return
        with contextlib.suppress(OSError):  # queue full or interface down: the frame is lost
            os.write(self._taps[port], frame)


if __name__ == '__main__':
    with contextlib.suppress(KeyboardInterrupt):
        _Switch(int(sys.argv[1]), sys.argv[2:]).run()
