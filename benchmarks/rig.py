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

"""A formation with every node on a host of its own, and what ``make chaos`` can do to it."""

from collections.abc import Iterator
from contextlib import contextmanager, ExitStack, suppress
import os
from pathlib import Path
import shutil
import signal
import subprocess
import sys
import time
from typing import Any

from benchmarks import clocks
from benchmarks.hosts import Hosts
from tetra_ros2.config import configuration

GAIN, RATE, TOLERANCE = 4.0, 50.0, 1e-2
"""Fast enough for many faults in an hour; at this rate sampling leaves the spin 2e-3 rad off."""

AGENTS = ('agent_1', 'agent_2', 'agent_3', 'agent_4')
NODES = ('plant', 'monitor', 'recorder', 'viewer', *AGENTS)
WATCHER = 'watcher'

DISK = 96
"""Size of the disk that the recorder writes to [MB]; a recording takes some 0.3 MB/s."""

SILENCE = 2.5
"""Every node reports twice a second; who has not for so long [s] is silent."""

RECORDED = 2.0
"""A recording that has told of states for longer than this [s] has to hold some."""

END_TIME = 60.0
"""How long the recorder may take to end in good order [s]."""

_READ = ('import sys\nfrom tetra_ros2.recording import reader\n'
         'print(len(reader.load(sys.argv[1]).stamps))')


class Rig:
    """
    A formation on hosts of its own; a context manager.

    :param mode: of the plant
    :param graph: the name of a configuration
    :param seed: of the network
    :param directory: for logs and recordings
    """

    nodes = NODES

    def __init__(self, mode: str, graph: str, seed: int, directory: Path) -> None:
        self.mode, self.graph, self.directory = mode, graph, directory
        self.formation = configuration.load(graph).formation()
        self.edges = [(i, j) for i, j, _ in self.formation.topology.edges]
        self.hosts = Hosts([*NODES, WATCHER], seed)
        self._stack = ExitStack()
        self._processes: dict[str, subprocess.Popen[str]] = {}
        self._bags = 0
        self._ended_bags: list[tuple[Path, bool]] = []  # and whether there must be a state in it
        self._bag: Path | None = None
        self.watcher: Any = None

    def __enter__(self) -> 'Rig':
        with self._stack:
            self._stack.enter_context(self.hosts)
            self._disk = self.directory / 'disk'
            self._disk.mkdir()
            subprocess.run(['mount', '-t', 'tmpfs', '-o', f'size={DISK}m', 'tmpfs', self._disk],
                           check=True)
            self._stack.callback(subprocess.run, ['umount', '-l', self._disk], check=False)
            for name in NODES:
                clocks.set_clock(self._clock(name), 0.0)
                self.start(name)
            self.hosts.enter(WATCHER)
            # rclpy may be imported only where its threads are to be.
            os.environ.update(self._environment())
            from benchmarks.watcher import Watcher
            self.watcher = Watcher(self.edges, self.formation.n)
            self._stack.callback(self.watcher.close)
            self._stack = self._stack.pop_all()
        return self

    def __exit__(self, *error: object) -> None:
        self._stack.close()
        clocks.remove_dead()

    def _environment(self) -> dict[str, str]:
        return {'ROS_AUTOMATIC_DISCOVERY_RANGE': 'SUBNET', 'ROS_DOMAIN_ID': '7'}

    def _clock(self, name: str) -> Path:
        return self.directory / f'{name}.clock'

    def start(self, name: str) -> None:
        """Start a node on its host."""
        command = ['agent', '--id', name[-1]] if name in AGENTS else [name]
        if name != 'viewer':
            command += ['--config', self.graph]
        if name == 'recorder':
            self._bags += 1
            self._bag = self._disk / f'bag_{self._bags}'
            command += ['--output', str(self._bag)]
        parameters = {} if name in ('recorder', 'viewer') else {'gain.a': GAIN}
        if name == 'plant':
            parameters |= {'mode': self.mode, 'rate': RATE, 'real_time_factor': 1.0}
        if name == 'monitor':
            parameters |= {'tolerance': TOLERANCE}
        if parameters:
            command += ['--ros-args', *(word for key, value in parameters.items()
                                        for word in ('-p', f'{key}:={value}'))]
        env = {**self._environment(), 'PYTHONPATH': os.pathsep.join(filter(None, sys.path))}
        if clocks.LIBRARY.exists():
            env |= clocks.environment(self._clock(name))
        with (self.directory / f'{name}.log').open('a') as log:
            self._processes[name] = self.hosts.start(
                name, sys.executable, '-m', 'tetra_ros2', *command, env=env, stdout=log)

    def kill(self, name: str) -> None:
        """Kill all processes of a node."""
        for number in self.hosts.processes(name):
            with suppress(ProcessLookupError):
                os.kill(number, signal.SIGKILL)
        self._processes[name].wait()
        self._keep_bag(name)

    def reboot(self, name: str) -> None:
        """Take the power from the host of a node."""
        self.hosts.reboot(name)
        self._processes[name].wait()
        self._keep_bag(name)

    def signal(self, name: str, number: int) -> None:
        """Send a signal to a node."""
        self._processes[name].send_signal(number)

    def ended(self) -> list[str]:
        """Return the nodes that have ended by themselves."""
        return [name for name, process in self._processes.items() if process.poll() is not None]

    def end_recorder(self) -> int:
        """
        End the recorder as Ctrl-C does, and start another.

        :returns: the exit status
        :raises TimeoutError: if it does not end
        """
        process = self._processes['recorder']
        process.send_signal(signal.SIGINT)
        try:
            status = process.wait(END_TIME)
        except subprocess.TimeoutExpired:
            raise TimeoutError('the recorder does not end') from None
        self._keep_bag('recorder')
        self.start('recorder')
        return status

    @contextmanager
    def clock_set(self, name: str, jump: float) -> Iterator[None]:
        """Let the system clock of a host be off by so much [s]."""
        clocks.set_clock(self._clock(name), jump)
        try:
            yield
        finally:
            clocks.set_clock(self._clock(name), 0.0)

    @contextmanager
    def disk_full(self) -> Iterator[None]:
        """Let the recorder's disk be full."""
        filler = self._disk / 'filler'
        with filler.open('wb', buffering=0) as file:
            for size in (1 << 16, 1):
                with suppress(OSError):
                    while True:
                        file.write(bytes(size))
        try:
            yield
        finally:
            filler.unlink()

    def _keep_bag(self, name: str) -> None:
        """Keep the recording of a recorder that has ended, to be looked at when there is time."""
        if name == 'recorder' and self._bag is not None:
            self._ended_bags.append((self._bag, self.watcher.recorded_for > RECORDED))
            self.watcher.forget_recording()
            self._bag = None

    def bag_is_large(self) -> bool:
        """Return whether the recording fills a third of the disk."""
        usage = shutil.disk_usage(self._disk)
        return usage.used > usage.total / 3

    def unreadable_bags(self) -> list[str]:
        """Read all recordings that have ended, repaired if need be, and say what is wrong."""
        problems = []
        for bag, begun in self._ended_bags:
            whole = bag.with_name(f'{bag.name}_whole')
            done = _python('-c', _READ, bag)
            errors = done.stderr
            if done.returncode:
                errors += _python('-m', 'tetra_ros2', 'recover', bag, '--output', whole).stderr
                done = _python('-c', _READ, whole)
                errors += done.stderr
            states = int(done.stdout) if not done.returncode else 0
            if begun and not states:
                problems.append((errors.strip().splitlines() or ['no state in it'])[-1])
                shutil.copytree(bag, self.directory / bag.name, dirs_exist_ok=True)
            for path in (bag, whole):
                shutil.rmtree(path, ignore_errors=True)
        self._ended_bags.clear()
        return problems

    def silent(self) -> list[str]:
        """Return the nodes that have not said in the last seconds how they are."""
        now = time.monotonic()
        return [name for name in NODES
                if now - self.watcher.heard_from.get(name, 0.0) > SILENCE]


def _python(*arguments: object) -> 'subprocess.CompletedProcess[str]':
    return subprocess.run([sys.executable, *map(str, arguments)], capture_output=True, text=True,
                          check=False)
