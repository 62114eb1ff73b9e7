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
Faults at random on a running formation, one after the other: ``make chaos``.

Plant, agents, monitor and recorder each have a host of their own (:mod:`benchmarks.hosts`). A
fault is drawn from a seed, done, and undone. Then the formation has to form again. A fault is
survived if

- the error falls below the tolerance again, within :data:`PATIENCE`;
- every number in every message of the formation's own nodes was finite, and no node ended;
- a diagnostic status reported it within :data:`REPORT_TIME`, where it disturbed the formation;
- the recording can be read, where the recorder was hit.

Four formations are tried: both modes, both of the paper's graphs.
"""

import argparse
from collections import defaultdict
from collections.abc import Iterator
from contextlib import contextmanager, ExitStack, suppress
from dataclasses import asdict, dataclass
import json
import math
import os
from pathlib import Path
import random
import shutil
import signal
import statistics
import subprocess
import sys
import tempfile
import time
from typing import Any

from benchmarks.hosts import Hosts, unavailable

FORMATIONS = tuple((mode, graph) for mode in ('realtime', 'lockstep')
                   for graph in ('complete', 'rotating'))

GAIN, RATE, TOLERANCE = 4.0, 100.0, 5e-3
"""Fast enough for many faults in an hour; at this rate sampling leaves the spin 1e-3 rad off."""

SLOWEST = {'complete': GAIN * 8.0 / 3.0, 'rotating': GAIN * 1.521969}
"""Slowest decay of a small error [1/s]; ``tetra analyze`` gives it for a gain of 1."""

PATIENCE = 30.0
"""How long a formation may take to form again, once the fault is over [s]."""

REPORT_TIME = 2.0
"""How soon a fault has to be reported [s]."""

HOLD = 0.3
"""For how long the error has to stay below the tolerance [s]."""

NODES = ('plant', 'monitor', 'recorder', 'agent_1', 'agent_2', 'agent_3', 'agent_4')
WATCHER = 'watcher'
DISK = 48
"""Size of the disk that the recorder writes to [MB]."""

FAKETIME = '/usr/lib/x86_64-linux-gnu/faketime/libfaketimeMT.so.1'


@dataclass
class Outcome:
    """
    What came of a fault.

    :param kind: its kind
    :param what: what it was
    :param formation: mode and graph
    :param seed: from which it is drawn again
    :param survived: whether it was
    :param why: why not
    :param error: the largest error that it led to [rad]
    :param time: from its end until the formation had formed again [s]
    :param expected: what theory says of a decay from that error [s]
    :param reported: after how long it was reported [s], None if it was not
    """

    kind: str
    what: str
    formation: str
    seed: int
    survived: bool
    why: str
    error: float
    time: float
    expected: float
    reported: float | None


class Rig:
    """
    A formation on hosts of its own, and what can be done to it.

    :param mode: of the plant
    :param graph: the name of a configuration
    :param seed: of the network
    :param directory: for logs and recordings
    """

    nodes = NODES

    def __init__(self, mode: str, graph: str, seed: int, directory: Path) -> None:
        self.mode, self.graph, self.directory = mode, graph, directory
        self.hosts = Hosts([*NODES, WATCHER], seed)
        self._stack = ExitStack()
        self._processes: dict[str, subprocess.Popen[str]] = {}
        self._bags = 0
        self.bag: Path | None = None
        self.watcher: Any = None
        self.edges: list[tuple[int, int]] = []
        self.unreadable: list[str] = []

    def __enter__(self) -> 'Rig':
        from tetra_ros2.config import configuration
        topology = configuration.load(self.graph).formation().topology
        self.edges = [(i, j) for i, j, _ in topology.edges]
        with self._stack:
            self._stack.enter_context(self.hosts)
            self._disk = self.directory / 'disk'
            self._disk.mkdir()
            subprocess.run(['mount', '-t', 'tmpfs', '-o', f'size={DISK}m', 'tmpfs', self._disk],
                           check=True)
            self._stack.callback(subprocess.run, ['umount', '-l', self._disk], check=False)
            for name in NODES:
                self._clock(name).write_text('+0s\n')
                self.start(name)
            self.hosts.enter(WATCHER)
            # rclpy may be imported only where its threads are to be.
            os.environ.update(self._environment())
            from benchmarks.watcher import Watcher
            self.watcher = Watcher(self.edges, topology.n)
            self._stack.callback(self.watcher.close)
            self._stack = self._stack.pop_all()
        return self

    def __exit__(self, *error: object) -> None:
        self._stack.close()

    def _environment(self) -> dict[str, str]:
        return {'ROS_AUTOMATIC_DISCOVERY_RANGE': 'SUBNET', 'ROS_DOMAIN_ID': '7'}

    def _clock(self, name: str) -> Path:
        return self.directory / f'{name}.clock'

    def start(self, name: str) -> None:
        """Start a node on its host."""
        command = ['--config', self.graph]
        if name.startswith('agent'):
            command = ['agent', '--id', name[-1], *command]
        else:
            command = [name, *command]
        if name == 'recorder':
            self._bags += 1
            self.bag = self._disk / f'bag_{self._bags}'
            command += ['--output', str(self.bag)]
        parameters = {} if name == 'recorder' else {'gain.a': GAIN}
        if name == 'plant':
            parameters |= {'mode': self.mode, 'rate': RATE, 'real_time_factor': 1.0}
        if name == 'monitor':
            parameters |= {'tolerance': TOLERANCE}
        if parameters:
            command += ['--ros-args', *(word for key, value in parameters.items()
                                        for word in ('-p', f'{key}:={value}'))]
        env = {**self._environment(), 'PYTHONPATH': os.pathsep.join(filter(None, sys.path))}
        if Path(FAKETIME).exists():
            env |= {'LD_PRELOAD': FAKETIME, 'FAKETIME_TIMESTAMP_FILE': str(self._clock(name)),
                    'FAKETIME_CACHE_DURATION': '1', 'DONT_FAKE_MONOTONIC': '1',
                    'FAKETIME_DONT_RESET': '1'}
        with (self.directory / f'{name}.log').open('a') as log:
            self._processes[name] = self.hosts.start(
                name, sys.executable, '-m', 'tetra_ros2', *command, env=env, stdout=log)

    def kill(self, name: str) -> None:
        """Kill all processes of a node."""
        for number in self.hosts.processes(name):
            with suppress(ProcessLookupError):
                os.kill(number, signal.SIGKILL)
        self._processes[name].wait()
        self._look_at_bag(name)

    def reboot(self, name: str) -> None:
        """Take the power from the host of a node."""
        self.hosts.reboot(name)
        self._processes[name].wait()
        self._look_at_bag(name)

    def signal(self, name: str, number: int) -> None:
        """Send a signal to a node."""
        self._processes[name].send_signal(number)

    def ended(self) -> list[str]:
        """Return the nodes that have ended by themselves."""
        return [name for name, process in self._processes.items() if process.poll() is not None]

    def start_again_if_ended(self, name: str) -> None:
        """Start a node that has given up, for a good reason."""
        if self._processes[name].poll() is not None:
            self._look_at_bag(name)
            self.start(name)

    @contextmanager
    def clock_set(self, name: str, jump: float) -> Iterator[None]:
        """Let the system clock of a host be off by so much [s]."""
        self._clock(name).write_text(f'{jump:+g}s\n')
        try:
            yield
        finally:
            self._clock(name).write_text('+0s\n')

    @contextmanager
    def disk_full(self) -> Iterator[None]:
        """Let the recorder's disk be full."""
        filler = self._disk / 'filler'
        with filler.open('wb') as file, suppress(OSError):
            while True:
                file.write(bytes(1 << 16))
                file.flush()
        try:
            yield
        finally:
            filler.unlink()

    def _look_at_bag(self, name: str) -> None:
        """Read the recording of a recorder that has ended, repaired if need be, and remove it."""
        if name != 'recorder' or self.bag is None:
            return
        bag, self.bag = self.bag, None
        if not bag.is_dir():
            return  # it had not begun
        code = ('import sys\nfrom tetra_ros2.recording import reader\n'
                'print(len(reader.load(sys.argv[1]).stamps))')
        done = _python('-c', code, bag)
        if done.returncode:
            whole = bag.with_name(f'{bag.name}_whole')
            recovered = _python('-m', 'tetra_ros2', 'recover', bag, '--output', whole)
            done = _python('-c', code, whole)
            if done.returncode and recovered.returncode != 2:
                self.unreadable = (recovered.stderr + done.stderr).strip().splitlines()[-1:]
            shutil.rmtree(whole, ignore_errors=True)
        shutil.rmtree(bag, ignore_errors=True)


def _python(*arguments: object) -> 'subprocess.CompletedProcess[str]':
    return subprocess.run([sys.executable, *map(str, arguments)], capture_output=True, text=True,
                          check=False)


def one(rig: Rig, kind: str, seed: int) -> Outcome:
    """Do a fault, wait until the formation has formed again, and judge."""
    from benchmarks.faults import FAULTS
    watcher = rig.watcher
    chance = random.Random(seed)
    watcher.begin()
    rig.unreadable = []
    begun = time.monotonic()
    # Half of the faults come while the formation forms.
    if chance.random() < 0.5:
        watcher.restart(at_random=True)
        time.sleep(chance.uniform(0.0, 0.5))
    what = FAULTS[kind][1](rig, chance)
    over = time.monotonic()
    standing = not watcher.fresh
    watcher.wait(lambda: watcher.fresh, PATIENCE)
    watcher.wait(lambda: False, 0.2)  # what the fault did may show a moment later
    formed = watcher.wait(
        lambda: watcher.fresh and watcher.error < TOLERANCE, PATIENCE, hold=HOLD)
    took = max(0.0, time.monotonic() - over - HOLD)
    lasted = over - begun > 2.0 and kind in ('kill', 'stop', 'reboot', 'partition', 'disk full')
    disturbed = lasted or standing
    if disturbed and not watcher.reports:
        watcher.wait(lambda: bool(watcher.reports), REPORT_TIME)
    reported = watcher.reports[0][0] - begun if watcher.reports else None
    why = []
    if not formed:
        why.append(f'not formed again: error {watcher.error:.3g} rad'
                   + ('' if watcher.fresh else ', formation time stands still'))
    if watcher.not_finite:
        why.append(f'not finite: {", ".join(sorted(set(watcher.not_finite)))}')
    if rig.unreadable:
        why.append(f'recording: {rig.unreadable[0]}')
    if ended := rig.ended():
        why.append(f'ended: {", ".join(ended)}')
        for name in ended:
            rig.start(name)
    if disturbed and reported is None:
        why.append('not reported')
    error = watcher.worst
    expected = math.log(max(error, TOLERANCE) / TOLERANCE) / SLOWEST[rig.graph]
    return Outcome(kind, what, f'{rig.mode} {rig.graph}', seed, not why, '; '.join(why), error,
                   took, expected, reported)


def run(mode: str, graph: str, count: int, seed: int, out: Path, verbose: bool,
        only: list[str]) -> None:
    """Do so many faults on a formation, and write a line of JSON for each."""
    from benchmarks.faults import FAULTS
    directory = Path(tempfile.mkdtemp(prefix='tetra_chaos_'))
    chance = random.Random(f'{seed} {mode} {graph}')
    kinds = [kind for kind in FAULTS if not only or kind in only]
    weights = [FAULTS[kind][0] for kind in kinds]
    with Rig(mode, graph, seed, directory) as rig, out.open('a') as file:
        if not rig.watcher.wait(lambda: rig.watcher.fresh and rig.watcher.error < TOLERANCE,
                                60.0, hold=1.0):
            raise RuntimeError(f'{mode} {graph} did not form at the start; see {directory}')
        for k in range(count):
            kind = chance.choices(kinds, weights)[0]
            outcome = one(rig, kind, chance.randrange(2**32))
            file.write(json.dumps(asdict(outcome)) + '\n')
            file.flush()
            if verbose or not outcome.survived:
                print(f'{mode} {graph} {k + 1}: {kind}: {outcome.what}: '
                      f'{outcome.why or "survived"}; error {outcome.error:.2g} rad, '
                      f'{outcome.time:.2f} s, reported {outcome.reported}', flush=True)
    shutil.rmtree(directory, ignore_errors=True)


def table(outcomes: list[Outcome]) -> str:
    """Return the table of what came of the faults, in Markdown."""
    rows = ['| fault | done | survived | error, worst [rad] | forms again, median [s] | worst [s] '
            '| theory, median [s] | reported, worst [s] |',
            '| --- | ---: | ---: | ---: | ---: | ---: | ---: | ---: |']
    kinds = defaultdict(list)
    for outcome in outcomes:
        kinds[outcome.kind].append(outcome)
    for kind, group in [*sorted(kinds.items()), ('all', outcomes)]:
        times = [o.time for o in group]
        reported = [o.reported for o in group if o.reported is not None]
        rows.append(
            f'| {kind} | {len(group)} | {sum(o.survived for o in group)} '
            f'| {max(o.error for o in group):.2f} | {statistics.median(times):.2f} '
            f'| {max(times):.2f} | {statistics.median(o.expected for o in group):.2f} '
            f'| {max(reported, default=math.nan):.1f} |')
    return '\n'.join(rows)


def main() -> int:
    """Do faults on the four formations, two at a time; return 0 if all were survived."""
    parser = argparse.ArgumentParser(prog='python -m benchmarks.chaos', description=__doc__)
    parser.add_argument('--faults', type=int, default=1000, metavar='N',
                        help='how many in all (default: %(default)s)')
    parser.add_argument('--seed', type=int, default=1, metavar='N', help='(default: %(default)s)')
    parser.add_argument('--formation', nargs=2, metavar=('MODE', 'GRAPH'),
                        help='only this formation, in this process')
    parser.add_argument('--jobs', type=int, default=2, metavar='N',
                        help='how many formations at a time (default: %(default)s)')
    parser.add_argument('--out', type=Path, default=Path('chaos.jsonl'), metavar='FILE',
                        help='where the outcomes are kept (default: %(default)s)')
    parser.add_argument('--only', action='append', default=[], metavar='KIND',
                        help='only faults of this kind')
    parser.add_argument('--verbose', action='store_true', help='print every fault')
    arguments = parser.parse_args()
    if reason := unavailable():
        print(f'no chaos here: {reason}', file=sys.stderr)
        return 2
    if arguments.formation:
        run(*arguments.formation, arguments.faults, arguments.seed, arguments.out,
            arguments.verbose, arguments.only)
        return 0
    print(f'seed {arguments.seed}, {arguments.faults} faults', flush=True)
    arguments.out.unlink(missing_ok=True)
    waiting = list(FORMATIONS)
    share = -(-arguments.faults // len(waiting))
    running: list[subprocess.Popen[bytes]] = []
    failed = False
    while waiting or running:
        while waiting and len(running) < arguments.jobs:
            mode, graph = waiting.pop(0)
            running.append(subprocess.Popen([
                sys.executable, '-m', 'benchmarks.chaos', '--formation', mode, graph,
                '--faults', str(share), '--seed', str(arguments.seed), '--out', arguments.out,
                *(['--verbose'] if arguments.verbose else []),
                *(word for kind in arguments.only for word in ('--only', kind))]))
        ended = [process for process in running if process.poll() is not None]
        failed |= any(process.returncode for process in ended)
        running = [process for process in running if process not in ended]
        time.sleep(0.2)
    outcomes = [Outcome(**json.loads(line)) for line in arguments.out.read_text().splitlines()]
    if not outcomes:
        return 1
    print(table(outcomes))
    lost = [outcome for outcome in outcomes if not outcome.survived]
    print(f'{len(outcomes) - len(lost)} of {len(outcomes)} faults survived')
    return 1 if lost or failed else 0


if __name__ == '__main__':
    sys.exit(main())
