# Copyright 2026 The tetra_ros2 authors
# SPDX-License-Identifier: Apache-2.0

"""
The rows of ``tetra bench``, and how each figure in them is measured.

Every figure comes from a fresh process, see ``benchmarks/worker.py``. What is compared runs in
turns, A B A B, so that what else the machine does falls on both; the ratio is that of neighbours
in time, and its median counts.
"""

from contextlib import contextmanager
from dataclasses import dataclass
from functools import partial
import json
import math
import os
from pathlib import Path
import resource
import signal
import statistics
import subprocess
import sys
import time

TOP = Path(__file__).resolve().parents[2]
WORKER = TOP / 'benchmarks' / 'worker.py'

TIMEOUT = 60.0
"""How much longer than its measurement a process may take [s]."""

OTHERS = "others' cores"
"""The field that says how many cores other people's processes used meanwhile."""

ON_TIME, FRESH, OLDEST = 0.99, 0.99, 10
"""What real time is to hold: shares of steps and of commands, and an age in steps."""

LADDER = (500, 1000, 2000, 3000, 4000, 5000, 6000)
"""The rates [Hz] that are tried, from 2 kHz upwards for as long as they hold."""

OBJECTS_LADDER = (2000, 1000, 500, 250, 100)
"""The same for the default executor, downwards until one holds."""


@dataclass(frozen=True)
class Scale:
    """
    How much to measure.

    :param seconds: of each measurement
    :param repeats: of each pair
    :param realtime: length of the run in real time [s]
    :param steps: of the plant, for its drift
    :param rounds: over which the memory of an agent is to stay
    :param budget: after which nothing more is repeated, though everything is measured once [s]
    """

    seconds: float = 1.5
    repeats: int = 5
    realtime: float = 10.0
    steps: int = 1_000_000
    rounds: int = 20_000
    budget: float = 270.0


THOROUGH = Scale(5.0, 9, 60.0, 10_000_000, 1_000_000, math.inf)


@dataclass(frozen=True)
class System:
    """
    Something that can be measured.

    :param name: for people
    :param measure: called with a :class:`Bench`, returns a mapping of figures
    :param most: how often to measure it, however many repeats are wanted
    """

    name: str
    measure: object
    most: int = 1000


@dataclass(frozen=True)
class Row:
    """
    One line of the table.

    :param name: as ``--only`` has it
    :param work: what is done
    :param against: what it is compared with
    :param systems: one :class:`System` for a figure by itself, two for a comparison
    :param field: which of the figures
    :param unit: of that figure
    :param at_least: what the median must reach
    :param at_most: what it must not exceed
    :param difference: whether to compare by difference instead of by ratio
    """

    name: str
    work: str
    against: str
    systems: tuple
    field: str
    unit: str = ''
    at_least: float | None = None
    at_most: float | None = None
    difference: bool = False

    @property
    def target(self):
        """Return in words what is wanted."""
        if self.at_least is not None:
            return f'>= {self._number(self.at_least)}'
        return '' if self.at_most is None else f'<= {self._number(self.at_most)}'

    def _number(self, value):
        return f'{value:g} x' if len(self.systems) == 2 and not self.difference \
            else f'{value:g} {self.unit}'.rstrip()

    def conclude(self, figures):
        """
        Return the row's result, plain values.

        :param figures: for each system a list of what it measured, or of None where it failed
        """
        sides = [[None if f is None else f.get(self.field) for f in figures[system]]
                 for system in self.systems]
        values = [self._combine(*pair) for pair in zip(*sides) if None not in pair]
        failed = not values or any(None in side for side in sides)
        result = {
            'name': self.name, 'work': self.work, 'against': self.against, 'unit': self.unit,
            'target': self.target, 'measured': sides[0],
            'reference': sides[1] if len(sides) == 2 else None, 'values': values,
            'median': statistics.median(values) if values else None,
            'spread': [min(values), max(values)] if values else None,
            'details': {s.name: figures[s] for s in self.systems},
        }
        result['met'] = not failed and self._is_met(result['median'])
        return result

    def _combine(self, measured, reference=None):
        if reference is None:
            return measured
        if self.difference:
            return measured - reference
        if not reference:
            return math.inf if measured else math.nan
        return measured / reference

    def _is_met(self, median):
        if self.at_least is not None:
            return median >= self.at_least
        return self.at_most is None or median <= self.at_most


def all_rows():
    """Return all rows, those that share a system next to each other."""
    one = {style: System(f'{style}, one process', partial(Bench.rounds, style=style))
           for style in ('tetra', 'objects', 'bytes')}
    many = {n: System(f'tetra, n = {n}', partial(Bench.rounds, n=n), most=3 if n < 32 else 2)
            for n in (4, 8, 16, 32)}
    six = {style: System(f'{style}, six processes', partial(Bench.six, style=style), most=3)
           for style in ('tetra', 'bytes')}
    watched = System('tetra with monitor and recorder', Bench.watched)
    real = System('tetra, real time', Bench.realtime, most=1)
    highest = System('tetra, highest rate', Bench.highest, most=1)
    objects = System('objects, highest rate', partial(Bench.highest, style='objects'), most=1)
    batch = {key: System(f'batch, {key}', partial(Bench.batch, style=style, threads=threads),
                         most=3)
             for key, style, threads in (('one core', 'tetra', 1), ('two cores', 'tetra', 2),
                                         ('SciPy', 'scipy', 1), ('numpy', 'numpy', 1))}
    memory = System('memory of an agent', Bench.agent_memory, most=1)
    bare = System('memory of a bare node', Bench.bare_memory, most=1)
    per_core = 'trajectories/core s'
    rounds, lockstep = 'rounds/s', 'lockstep rounds/s, n = 4, one process'
    return (
        Row('objects', lockstep, 'default executor, message objects, no mathematics',
            (one['tetra'], one['objects']), rounds, '1/s', at_least=10.0),
        Row('ceiling', lockstep, 'events executor, raw bytes, no mathematics',
            (one['tetra'], one['bytes']), rounds, '1/s', at_least=0.65),
        Row('watched', 'the same, monitor and recorder running', 'without them',
            (watched, one['tetra']), rounds, '1/s', at_least=0.5),
        Row('lost', 'messages that monitor or recorder missed', '', (watched,), 'lost',
            at_most=0),
        Row('processes', 'lockstep rounds/s, n = 4, six processes',
            'the same six without mathematics', (six['tetra'], six['bytes']), rounds, '1/s',
            at_least=0.7),
        Row('punctual', 'steps within 0.25 ms, real time, 2 kHz, six processes', 'schedule',
            (real,), 'on time', at_least=ON_TIME),
        Row('fresh', 'commands that answer the previous step, same run', '', (real,), 'fresh',
            at_least=FRESH),
        Row('oldest', 'oldest command applied, same run', '', (real,), 'oldest [steps]',
            'steps', at_most=OLDEST),
        Row('highest', 'highest rate that holds these three',
            'default executor, message objects', (highest, objects), 'rate', 'Hz'),
        *(Row(f'n{n}', f'processor time per message, n = {n}, one process', 'n = 4',
              (many[n], many[4]), 'us/message', 'us', at_most=1.5) for n in (8, 16, 32)),
        Row('scipy', 'trajectories/s to a final error of 1e-6, one core',
            'SciPy solve_ivp, DOP853', (batch['one core'], batch['SciPy']), per_core, '1/s',
             at_least=150.0),
        Row('numpy', 'the same', 'RK4, vectorised numpy', (batch['one core'], batch['numpy']),
            per_core, '1/s', at_least=10.0),
        Row('cores', 'the same on two cores', 'one core', (batch['two cores'],
            batch['one core']), 'trajectories/s', '1/s', at_least=1.8),
        Row('drift', "plant: largest entry of R'R - 1 after many steps", '0',
            (System('drift', Bench.drift, most=1),), 'drift', at_most=1e-12),
        Row('memory', 'memory of an agent process', 'a bare rclpy node', (memory, bare), 'MB',
            'MB', at_most=10.0, difference=True),
        Row('growth', 'growth of that in lockstep', '0', (memory,), 'growth [MB]', 'MB',
            at_most=1.0),
        Row('help', 'tetra --help', '', (System('help', Bench.help),), 's', 's', at_most=0.4),
        Row('start', 'launcher: from start to first command', '',
            (System('start', Bench.start, most=3),), 's', 's', at_most=2.0),
    )


class Bench:
    """
    The measurements; each method is one, in fresh processes.

    :param scale: a :class:`Scale`
    """

    def __init__(self, scale):
        self.scale = scale
        self._runs = 0
        self._environment = {
            **os.environ, 'ROS_AUTOMATIC_DISCOVERY_RANGE': 'LOCALHOST',
            'PYTHONPATH': os.pathsep.join(
                filter(None, (str(TOP), os.environ.get('PYTHONPATH'))))}

    def measure(self, rows):
        """Return the results of rows; those that share a system are measured in turns."""
        results = {}
        end = time.monotonic() + self.scale.budget
        groups = _groups(rows)
        figures = [{system: [] for row in group for system in row.systems} for group in groups]
        # What makes no pair comes first, so that what is left of the budget goes to repetition.
        for group in sorted(figures, key=lambda group: self._turns(group) > 1):
            begun, turns = time.monotonic(), self._turns(group)
            others = sum(self._turns(g) for g in figures if not any(g.values())) - turns
            share = (end - begun) * turns / (turns + others)
            for turn in range(turns):
                if turn and (time.monotonic() - begun) * (turn + 1) / turn > share:
                    break
                for system, found in group.items():
                    if turn < system.most:
                        found.append(self._measure(system))
        for group, found in zip(groups, figures):
            for row in group:
                results[row.name] = row.conclude(found)
        return [results[row.name] for row in rows]

    def _turns(self, systems):
        return min(self.scale.repeats, max(system.most for system in systems))

    def _measure(self, system):
        _show(f'{system.name} ...')
        begun, busy, own = time.monotonic(), _busy(), _children()
        try:
            figures = system.measure(self)
            others = (_busy() - busy) - (_children() - own)
            return {**figures, OTHERS: max(others / (time.monotonic() - begun), 0.0)}
        except (subprocess.SubprocessError, TimeoutError, RuntimeError, ValueError) as error:
            _show('')
            print(f'tetra: {system.name} could not be measured: {error}', file=sys.stderr)
            return None
        finally:
            _show('')

    def _namespace(self):
        # Of its own for each measurement: DDS takes a while to forget a process that has ended.
        self._runs += 1
        return f'bench_{os.getpid()}_{self._runs}'

    def _popen(self, command, **kwargs):
        return subprocess.Popen(
            [sys.executable, *map(str, command)], env=self._environment, text=True,
            stdout=subprocess.PIPE, stderr=subprocess.PIPE, **kwargs)

    def _worker(self, *arguments, seconds=0.0):
        """Return what ``benchmarks/worker.py`` measures."""
        process = self._popen((WORKER, *arguments))
        return self._result(process, TIMEOUT + 10.0 * seconds)

    def _result(self, process, timeout):
        try:
            output, errors = process.communicate(timeout=timeout)
        except BaseException:
            process.kill()
            process.communicate()
            raise
        if process.returncode or not output.strip():
            lines = errors.strip().splitlines() or ['it said nothing']
            raise RuntimeError(f'exit status {process.returncode}: {lines[-1]}')
        return json.loads(output.strip().splitlines()[-1])

    @contextmanager
    def _others(self, *commands):
        """Run processes meanwhile, and end them as Ctrl-C does."""
        processes = []
        try:
            for command in commands:
                # Nobody reads their output meanwhile, and a full pipe would stop them.
                processes.append(subprocess.Popen(
                    [sys.executable, *map(str, command)], env=self._environment,
                    stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL))
            yield processes
        finally:
            for process in processes:
                process.send_signal(signal.SIGINT)
            for process in processes:
                try:
                    process.wait(10.0)
                except subprocess.TimeoutExpired:
                    process.kill()
                    process.wait()

    def _five(self, style, namespace):
        """Return the commands of four agents and the monitor."""
        if style == 'tetra':
            common = ('--config', 'complete', '--namespace', namespace)
            return [*(('-m', 'tetra_ros2', 'agent', '--id', i, *common) for i in range(1, 5)),
                    ('-m', 'tetra_ros2', 'monitor', *common)]
        common = (style, '--namespace', namespace)
        return [*((WORKER, 'agent', *common, '--id', i) for i in range(1, 5)),
                (WORKER, 'monitor', 'bytes', '--namespace', namespace)]

    def rounds(self, style='tetra', n=4):
        """Lockstep in one process."""
        seconds = self.scale.seconds
        # A thousand topics go on finding each other for a while after the first round.
        return self._worker('rounds', style, '--n', n, '--seconds', seconds, '--warmup', n / 10,
                            '--namespace', self._namespace(), seconds=seconds)

    def watched(self):
        """Lockstep in one process, with monitor and recorder."""
        seconds = self.scale.seconds
        return self._worker('watched', '--seconds', seconds, '--namespace', self._namespace(),
                            seconds=seconds)

    def six(self, style):
        """Lockstep in six processes."""
        namespace = self._namespace()
        seconds = self.scale.seconds
        with self._others(*self._five(style, namespace)):
            return self._worker('rounds', style, '--alone', '--seconds', seconds,
                                '--namespace', namespace, seconds=seconds)

    def realtime(self, style='tetra', rate=2000, seconds=None):
        """Real time in six processes."""
        namespace = self._namespace()
        seconds = seconds or self.scale.realtime
        with self._others(*self._five(style, namespace)):
            return self._worker('realtime', style, '--rate', rate, '--seconds', seconds,
                                '--warmup', 1.0, '--namespace', namespace, seconds=seconds)

    def highest(self, style='tetra'):
        """Look for the highest rate that is held in real time."""
        seconds = min(2.0 * self.scale.seconds, 10.0)
        rungs, best = [], 0
        for rate in LADDER[2:] if style == 'tetra' else OBJECTS_LADDER:
            holds = self._climb(style, rate, seconds, rungs)
            if not holds and style == 'tetra' and len(rungs) == len({r['rate'] for r in rungs}):
                # Once, as a neighbour's burst is not the system's limit.
                holds = self._climb(style, rate, seconds, rungs)
            if holds:
                best = rate
            if holds != (style == 'tetra'):
                break
        return {'rate': best, 'rungs': rungs}

    def _climb(self, style, rate, seconds, rungs):
        rungs.append({'rate': rate, **self.realtime(style, rate, seconds)})
        return _holds(rungs[-1])

    def batch(self, style, threads):
        """Trajectories."""
        seconds = self.scale.seconds
        return self._worker('batch', style, '--threads', threads, '--seconds', seconds,
                            seconds=seconds)

    def drift(self):
        """Many steps of a rigid body."""
        steps = self.scale.steps
        return self._worker('drift', '--steps', steps, seconds=steps * 1e-5)

    def agent_memory(self):
        """Watch an agent's process in lockstep, six processes, and how it grows."""
        namespace = self._namespace()
        with self._others(*self._five('tetra', namespace)) as others:
            plant = self._popen((WORKER, 'rounds', 'tetra', '--alone', '--namespace', namespace,
                                 '--warmup', 1.0, '--seconds', 0.0,
                                 '--rounds', self.scale.rounds))
            plant.stdout.readline()  # when it begins to count
            sizes = [_resident(others[0].pid)]
            while plant.poll() is None:
                sizes.append(_resident(others[0].pid))
                time.sleep(0.2)
            result = self._result(plant, TIMEOUT)
        return {'MB': sizes[-1], 'growth [MB]': sizes[-1] - sizes[0],
                'rounds': result['rounds']}

    def bare_memory(self):
        """Look at a node that does nothing."""
        process = self._popen((WORKER, 'bare', '--namespace', self._namespace()))
        try:
            process.stdout.readline()
            time.sleep(1.0)
            return {'MB': _resident(process.pid)}
        finally:
            process.send_signal(signal.SIGINT)
            process.communicate()

    def help(self):
        """Time ``tetra --help``."""
        begun = time.monotonic()
        process = self._popen(('-m', 'tetra_ros2', '--help'))
        process.communicate(timeout=TIMEOUT)
        return {'s': time.monotonic() - begun}

    def start(self):
        """Time the launcher until its first command, as somebody else hears it."""
        namespace = self._namespace()
        watch = self._popen((WORKER, 'first_command', '--namespace', namespace))
        watch.stdout.readline()
        begun = time.monotonic()
        with self._others(('-m', 'tetra_ros2', 'launcher', '--namespace', namespace, '--quiet',
                           '--duration', '1e6')):
            return {'s': self._result(watch, TIMEOUT)['at'] - begun}


def _groups(rows):
    """Return rows in groups; rows of different groups have no system in common."""
    groups = []
    for row in rows:
        systems = {*row.systems}
        joined = [row]
        for group in [g for g in groups if any(systems & {*r.systems} for r in g)]:
            groups.remove(group)
            joined = [*group, *joined]
        groups.append(joined)
    return groups


def _holds(figures):
    """Return whether a run in real time was as it has to be."""
    return (figures['on time'] >= ON_TIME and figures['fresh'] >= FRESH
            and figures['oldest [steps]'] <= OLDEST)


def _busy():
    """Return for how long the cores of this machine have been busy, in sum [s]."""
    try:
        times = Path('/proc/stat').read_text(encoding='utf-8').split('\n', 1)[0].split()[1:9]
    except OSError:
        return math.nan
    idle = (3, 4)  # idle, and waiting for a disk
    return sum(int(t) for k, t in enumerate(times) if k not in idle) / os.sysconf('SC_CLK_TCK')


def _children():
    """Return the processor time of this process's children that have ended [s]."""
    usage = resource.getrusage(resource.RUSAGE_CHILDREN)
    return usage.ru_utime + usage.ru_stime


def _resident(pid):
    """Return the resident memory of a process [MB]."""
    for line in Path(f'/proc/{pid}/status').read_text().splitlines():
        if line.startswith('VmRSS:'):
            return int(line.split()[1]) / 1024
    return math.nan


def _show(text):
    """Say on a terminal what is going on."""
    if sys.stderr.isatty():
        print(f'\r\33[K{text}', end='', file=sys.stderr, flush=True)
