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
Kill the processes of a formation that is recorded, and look what is on the disk.

A formation runs at the pace of the clock, in one process or in one for each node. At a random
moment one of its processes, or the recorder together with the process that writes, is killed with
SIGKILL. Then the bag, after ``tetra recover`` where it is torn, must hold every message that came
more than a second before: no fewer on any topic than the recorder had told in its diagnostics by
then, every state in between that somebody who listens had heard, and the last stamp of each topic
no older than a second against that. How long the two processes through which a message goes were
ready meanwhile and were given no processor is told beside it: nobody can write then.
"""

import argparse
from collections import Counter, defaultdict
from concurrent.futures import ThreadPoolExecutor
from contextlib import suppress
from dataclasses import dataclass
import os
from pathlib import Path
import random
import shutil
import signal
import statistics
import struct
import subprocess
import sys
import tempfile
import threading
import time

from benchmarks.domain import reserved
from diagnostic_msgs.msg import DiagnosticArray
from geometry_msgs.msg import PoseArray
from rclpy.context import Context
from rclpy.executors import SingleThreadedExecutor
from rclpy.node import Node
from rosbags.rosbag2 import Reader
from tetra_ros2.recording import recover
from tetra_ros2.ros import ports
from tetra_ros2.ros.executor import leave

PROMISE = 1.0
"""How old a message may be that is lost [s]."""

RATE = 100
"""Steps per second of the formation [Hz]."""

DEADLINE = 30.0
"""How long anything else may take [s]."""

STORAGES = ('mcap', 'sqlite3')
VICTIMS = {
    'launcher': ('launcher', 'writer', 'both'),
    'nodes': ('plant', 'agent', 'monitor', 'recorder', 'writer', 'both'),
}
"""What is killed, by layout; ``both``: who records and the process that writes."""

OUTLIVED = {'plant', 'agent', 'monitor'}
"""Victims that a recording has but to outlive."""

_STAMPED = {'geometry_msgs/msg/PoseArray', 'geometry_msgs/msg/TwistStamped',
            'geometry_msgs/msg/Vector3Stamped'}


@dataclass(frozen=True)
class Outcome:
    """
    What came of one kill.

    :param torn: whether it had to be recovered
    :param lost: how old the oldest message was that is not there [s], 0 if all are
    :param problem: what is wrong with the bag, a text, or None
    :param waited: how long who records and who writes were ready and got no processor [s]
    """

    torn: bool
    lost: float
    problem: str | None
    waited: float = 0.0


class Listener:
    """Somebody who hears the states of a formation, and when; in a thread of its own."""

    def __init__(self, domain):
        self.context = Context()
        self.context.init(domain_id=domain)
        node = Node('listener', context=self.context)
        ports.reopen_lost(new=True)
        node.create_subscription(PoseArray, 'formation/attitudes', self._hear, 1000, raw=True)
        node.create_subscription(DiagnosticArray, 'diagnostics', self._note, 1000)
        self._executor = SingleThreadedExecutor(context=self.context)
        self._executor.add_node(node)
        self._ending = False
        self._path = None
        # When they came is what DDS says, by the system's clock: this process may be busy.
        self.heard = []  # stamp [ns], when it came [ns]
        self.counts = []  # by topic, how many messages the recorder had, and when it said so [ns]
        self._thread = threading.Thread(target=self._listen)
        self._thread.start()

    def begin(self, path):
        """
        Forget what was heard.

        :param path: of the recording whose recorder counts from now on: what the one before said
            last may still be on its way
        """
        self._path = str(path)
        self.heard.clear()
        self.counts.clear()

    def _hear(self, message, info):
        self.heard.append((_stamp(message), info['received_timestamp']))

    def _note(self, message, info):
        for status in message.status:
            values = {item.key: item.value for item in status.values}
            if status.name == '/recorder' and values['path'] == self._path:
                self.counts.append((
                    {key.removeprefix('messages on '): int(value)
                     for key, value in values.items() if key.startswith('messages on ')},
                    info['received_timestamp']))

    def _listen(self):
        while not self._ending:
            self._executor.spin_once(timeout_sec=0.1)
            ports.reopen_lost()

    def close(self):
        """Listen no more."""
        self._ending = True
        self._thread.join()
        leave(self._executor)


class Waiting(threading.Thread):
    """
    How long processes are ready to run and get no processor, as long as it is entered.

    Linux tells that itself only once they got one, which may be after the kill.
    """

    def __init__(self, pids):
        super().__init__()
        self.seconds = dict.fromkeys(pids, 0.0)
        self._ending = threading.Event()

    def run(self):
        """Look again and again: who is ready, and has not run since the last look, waits."""
        before, at = {}, time.monotonic()
        while not self._ending.is_set():
            now = time.monotonic()
            for pid in self.seconds:
                ready, ran = _running(pid)
                if ready and ran == before.get(pid):
                    self.seconds[pid] += now - at
                before[pid] = ran
            at = now
            self._ending.wait(0.02)

    def __enter__(self):
        self.start()
        return self

    def __exit__(self, *_):
        self._ending.set()
        self.join()


def _running(pid):
    """Return whether a process is ready to run, and how long it has run [ns]."""
    process = Path(f'/proc/{pid}')
    with suppress(OSError):  # it is gone, or this Linux does not tell
        state = (process / 'stat').read_text().rpartition(')')[2].split()[0]
        return state == 'R', int((process / 'schedstat').read_text().split()[0])
    return False, 0


class Formation:
    """The processes of one formation in a domain of its own, and trials on them."""

    def __init__(self, domain, directory):
        self.environment = {
            **os.environ, 'ROS_DOMAIN_ID': str(domain),
            'ROS_AUTOMATIC_DISCOVERY_RANGE': 'LOCALHOST'}
        self.directory = directory
        self.listener = Listener(domain)
        self.processes = {}

    def start(self, name, *arguments):
        """Start ``tetra X`` under a name."""
        with (self.directory / f'{name}.log').open('a') as log:
            self.processes[name] = subprocess.Popen(
                [sys.executable, '-m', 'tetra_ros2', *map(str, arguments)], env=self.environment,
                stdout=log, stderr=log)

    def start_node(self, name):
        """Start one of the nodes of a formation unless it runs."""
        if name in self.processes and self.processes[name].poll() is None:
            return
        common = ('--config', 'complete')
        if name == 'plant':
            self.start(name, 'plant', *common, '--ros-args', '-p', 'real_time_factor:=1.0')
        elif name == 'monitor':
            self.start(name, 'monitor', *common)
        else:
            self.start(name, 'agent', '--id', name[-1], *common)

    def close(self):
        """End everything."""
        for process in self.processes.values():
            process.kill()
        for process in self.processes.values():
            process.wait()
        self.listener.close()

    def trial(self, layout, victim, storage, delay, path):
        """
        Record, kill, and look.

        :param delay: how long to record before [s]
        :param path: of the bag to make
        """
        self.listener.begin(path)
        if layout == 'launcher':
            recorder = 'launcher'
            self.start(recorder, 'launcher', '--duration', '1e6', '--quiet', '--record', path,
                       '--storage', storage, '--ros-args', '-p', 'real_time_factor:=1.0')
        else:
            recorder = 'recorder'
            for name in ('plant', 'monitor', *(f'agent_{i}' for i in range(1, 5))):
                self.start_node(name)
            self.start(recorder, 'recorder', '--output', path, '--storage', storage)
        _wait(lambda: self.listener.counts and len(self.listener.heard) > RATE // 4
              and min(self.listener.counts[-1][0].values()) > 1
              and '/formation/attitudes' in self.listener.counts[-1][0], 'the recording')
        writer = _writer_of(self.processes[recorder].pid)
        with Waiting([writer, self.processes[recorder].pid]) as waiting:
            time.sleep(delay)  # a moment at random is what this is about
        pids = {'writer': [writer], 'both': [writer, self.processes[recorder].pid]}.get(victim)
        if pids is None:
            name = 'agent_2' if victim == 'agent' else victim
            pids = [self.processes[name].pid]
        for pid in pids:
            os.kill(pid, signal.SIGKILL)
        killed = time.time_ns()
        if victim not in (recorder, 'both'):
            self.processes[recorder].send_signal(signal.SIGINT)
        self.processes[recorder].wait(timeout=DEADLINE)
        _wait(lambda: not Path(f'/proc/{writer}').exists(), 'the end of the process that writes')
        heard = [(stamp, at) for stamp, at in list(self.listener.heard) if at <= killed]
        told = [counts for counts, at in list(self.listener.counts)
                if at <= killed - PROMISE * 1e9]
        return _look(path, heard, told[-1] if told else {}, killed, sum(waiting.seconds.values()))


def _stamp(message):
    seconds, nanoseconds = struct.unpack_from('<iI', message, 4)
    return seconds * 10**9 + nanoseconds


def _wait(condition, what):
    deadline = time.monotonic() + DEADLINE
    while not condition():
        if time.monotonic() > deadline:
            raise TimeoutError(f'{what}: not within {DEADLINE:g} s')
        time.sleep(0.02)


def _writer_of(parent):
    """Return the process that writes for another."""
    for process in Path('/proc').glob('[0-9]*'):
        with suppress(OSError):
            if f'\nPPid:\t{parent}\n' in (process / 'status').read_text() and (
                    b'tetra_ros2.recording.writer' in (process / 'cmdline').read_bytes()):
                return int(process.name)
    raise RuntimeError(f'nobody writes for {parent}')


def _look(path, heard, told, killed, waited):
    """Read a bag, after recovering it if it is torn, and compare it with what was heard."""
    torn = not recover.is_whole(path)
    if torn:
        recovered = path.with_name(f'{path.name}_recovered')
        recover.recover(path, recovered)
        path = recovered
    stamps, counts = defaultdict(list), Counter()
    with Reader(path) as reader:
        for connection, _, data in reader.messages():
            counts[connection.topic] += 1
            if connection.msgtype in _STAMPED:
                stamps[connection.topic].append(_stamp(data))
    if fewer := Counter(told) - counts:
        return Outcome(torn, 0.0, f'messages are missing: {dict(fewer)}', waited)
    if '/formation/attitudes' not in stamps:
        return Outcome(torn, 0.0, 'there is no state in it', waited)
    states = set(stamps['/formation/attitudes'])
    holes = [(stamp, at) for stamp, at in heard
             if min(states) < stamp < max(states) and stamp not in states]
    if holes:
        stamp, at = min(holes)
        return Outcome(torn, 0.0, f'{len(holes)} states are missing in between, from '
                       f'{(stamp - min(states)) / 1e9:.2f} s after the first, '
                       f'{(killed - at) / 1e9:.2f} s before the kill', waited)
    lost, where = 0.0, ''
    for topic, found in stamps.items():
        last = max(found)
        missing = [at for stamp, at in heard if stamp > last]
        lost, where = max((lost, where), ((killed - min(missing, default=killed)) / 1e9, topic))
    problem = None if lost <= PROMISE else f'{lost:.2f} s are lost on {where}'
    return Outcome(torn, lost, problem, waited)


def run(kills, seed, jobs=1, storages=STORAGES, victims=None, progress=lambda *_: None,
        keep=None):
    """
    Kill each victim so many times in each format.

    :param jobs: how many formations at a time
    :param victims: ``{layout: victims}``
    :param keep: a directory for the bags with which something is wrong, or None
    :returns: ``{(layout, victim, storage): [Outcome]}``
    """
    chance = random.Random(seed)
    plan = [(layout, victim, storage, chance.uniform(1.2, 3.2))
            for _ in range(kills) for layout, names in (victims or VICTIMS).items()
            for victim in names for storage in storages]
    outcomes = defaultdict(list)
    with tempfile.TemporaryDirectory(prefix='tetra_power_cuts_') as directory:
        def work(job):
            home = Path(directory) / str(job)
            home.mkdir()
            layouts = {}
            with reserved() as domain:
                for number, (layout, *rest, delay) in list(enumerate(plan))[job::jobs]:
                    if layout not in layouts:
                        # One at a time: both are in the same domain.
                        for other in layouts.values():
                            other.close()
                        layouts = {layout: Formation(domain, home)}
                    path = home / f'bag_{number}'
                    try:
                        outcome = layouts[layout].trial(layout, *rest, delay, path)
                    except Exception as error:  # whatever it is, it is what came of this kill
                        outcome = Outcome(False, 0.0, f'{type(error).__name__}: {error}')
                        layouts.pop(layout).close()
                    outcomes[(layout, *rest)].append(outcome)
                    progress(number, layout, *rest, outcome)
                    for bag in home.glob(f'bag_{number}*'):
                        if outcome.problem is None or keep is None:
                            shutil.rmtree(bag)
                        else:
                            shutil.move(bag, keep)
                for formation in layouts.values():
                    formation.close()
        # By layout, so that the nodes of a formation are started once and not for each kill; and
        # those whose end a recording may not outlive come first.
        plan.sort(key=lambda trial: (trial[0], trial[1] in OUTLIVED))
        with ThreadPoolExecutor(jobs) as pool:
            list(pool.map(work, range(jobs)))
    return outcomes


def table(outcomes):
    """Return the outcomes as a table of Markdown."""
    lines = ['| formation | killed | format | kills | torn, recovered | readable '
             '| lost: median [s] | worst [s] | waited: worst [s] |',
             '|---|---|---|---:|---:|---:|---:|---:|---:|']
    for (layout, victim, storage), found in sorted(outcomes.items()):
        lost = [outcome.lost for outcome in found]
        lines.append(
            f'| {layout} | {victim} | {storage} | {len(found)} | {sum(o.torn for o in found)} '
            f'| {sum(o.problem is None for o in found)} | {statistics.median(lost):.2f} '
            f'| {max(lost):.2f} | {max(outcome.waited for outcome in found):.2f} |')
    return '\n'.join(lines)


def main():
    """Run it; return 1 if a bag was not readable or lacked what it promises."""
    parser = argparse.ArgumentParser(description=__doc__.strip().splitlines()[0])
    parser.add_argument('--kills', type=int, default=50, metavar='N',
                        help='of each process in each format (default: %(default)s)')
    parser.add_argument('--seed', type=int, default=1)
    parser.add_argument('--layouts', nargs='+', choices=VICTIMS, default=list(VICTIMS),
                        help='one process, or one for each node (default: both)')
    parser.add_argument('--jobs', type=int, default=2, metavar='N',
                        help='formations at a time (default: %(default)s)')
    parser.add_argument('--keep', type=Path, metavar='DIR',
                        help='a directory to make, for the bags with which something is wrong')
    arguments = parser.parse_args()
    if arguments.keep is not None:
        try:
            arguments.keep.mkdir(parents=True)
        except OSError as error:  # bags of another run may have the same names
            parser.error(f'--keep: {arguments.keep}: {error.strerror}')

    def progress(number, layout, victim, storage, outcome):
        print(f'{number}: {layout}, {victim}, {storage}: '
              f'{"torn" if outcome.torn else "whole"}, '
              f'{outcome.problem or f"{outcome.lost:.2f} s"}; waited {outcome.waited:.2f} s',
              file=sys.stderr, flush=True)

    outcomes = run(arguments.kills, arguments.seed, arguments.jobs, progress=progress,
                   keep=arguments.keep,
                   victims={layout: VICTIMS[layout] for layout in arguments.layouts})
    print(f'seed {arguments.seed}\n\n{table(outcomes)}')
    problems = [(*key, o.problem) for key, found in outcomes.items() for o in found if o.problem]
    for problem in problems:
        print(*problem, sep=': ')
    return 1 if problems else 0


if __name__ == '__main__':
    sys.exit(main())
