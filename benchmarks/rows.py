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
The rows of ``python -m benchmarks``, and how each figure in them is measured.

Every system runs in processes of its own, see ``benchmarks/worker.py``. Those that are compared
are there at the same time and take short turns, A B C A B C, while the others rest: whatever else
the machine does falls on all of them. The ratio is that of neighbours in time, and its median
counts.
"""

from concurrent.futures import ThreadPoolExecutor
from contextlib import contextmanager, ExitStack
from dataclasses import dataclass
from functools import cache, partial
import json
import math
import os
from pathlib import Path
import resource
import signal
import statistics
import subprocess
import sys
import tempfile
from threading import Timer
import time

from benchmarks.domain import LARGEST, reserve

TOP = Path(__file__).resolve().parents[1]
WORKER = TOP / 'benchmarks' / 'worker.py'

TIMEOUT = 180.0
"""How much longer than its measurement a process may take, and how long to be ready [s]."""

FAILURES = OSError, RuntimeError, subprocess.SubprocessError, TimeoutError, ValueError
"""What a measurement may fail with; the others go on."""

OTHERS = "others' cores"
"""The field that says how many cores other people's processes used meanwhile."""

ON_TIME, FRESH, OLDEST = 0.99, 0.99, 10
"""What real time is to hold: shares of steps and of commands, and an age in steps."""

MOST_DOMAINS = 20
"""How many ROS domains it has in turns; they are taken from the tests meanwhile."""

LADDER = (50, 100, 250, 500, 1000, 1500, 2000, 2500, 3000, 4000, 5000, 6000)
"""The rates [Hz] that are tried, one after the other: up while they hold, else down."""

START_UP = 4.0
"""
How long processes in real time are left alone before they are measured [s].

In the first seconds Fast DDS may withhold all messages to a process for a third of a second, as it
looks whether shared memory is sound: https://github.com/eProsima/Fast-DDS/issues/6535.
"""

PRIORITY = ('chrt', '--fifo', '20')
"""How a process is given priority in real time: README.md tells its users to do the same."""


@dataclass(frozen=True)
class Scale:
    """
    How much to measure.

    :param seconds: of each turn
    :param repeats: how many turns
    :param realtime: length of the run in real time [s]
    :param steps: of the plant, for its drift
    :param rounds: over which the memory of an agent is to stay
    :param budget: after which nothing more is repeated, though everything is measured once [s]
    """

    seconds: float = 0.25
    repeats: int = 40
    realtime: float = 60.0
    steps: int = 10_000_000
    rounds: int = 10_000
    budget: float = 280.0


THOROUGH = Scale(0.25, 200, 60.0, 10_000_000, 1_000_000, math.inf)


@dataclass(frozen=True)
class System:
    """
    Something that can be measured.

    :param name: for people
    :param start: called with a :class:`Bench`, returns a context manager that has the system
        running and gives a function without arguments that measures it and returns a mapping of
        figures
    :param most: how often to measure it, however many repeats are wanted; None if it takes turns
    """

    name: str
    start: object
    most: int | None = None


def once(name, measure, most=1):
    """Return a :class:`System` that is started for each measurement, ``measure(bench)``."""
    @contextmanager
    def start(bench):
        yield partial(measure, bench)
    return System(name, start, most)


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
    :param judge: which of the values counts, the median where it is not given
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
    judge: object = statistics.median

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
            'median': self.judge(values) if values else None,
            'spread': [min(values), max(values)] if values else None,
            'middle': _middle_half(values) if values else None,
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
    many = {(style, n): System(f'{style}, n = {n}', partial(Bench.rounds, style=style, n=n))
            for style, n in (('tetra', 4), ('tetra', 8), ('tetra', 16), ('tetra', 32),
                             ('bytes', 4), ('bytes', 32))}
    six = {style: System(f'{style}, six processes', partial(Bench.six, style=style))
           for style in ('tetra', 'bytes')}
    watched = System('tetra with monitor and recorder', Bench.watched)
    real = once('tetra, real time', partial(Bench.realtime, style='tetra', first=2000))
    fair = once('tetra, real time, no priority',
                partial(Bench.realtime, style='tetra', first=1000, priority=False, seconds=0.0))
    plain = once('objects, real time',
                 partial(Bench.realtime, style='objects', first=250, seconds=0.0))
    batch = {'two cores': System('batch, two cores', partial(Bench.batch, threads=2)),
             **{key: System(f'batch, {key}', partial(Bench.batch, style=style, core=1))
                for key, style in (('one core', 'tetra'), ('SciPy', 'scipy'),
                                   ('numpy', 'numpy'))}}
    twice = System('batch, two processes', Bench.two_processes)
    memory = once('memory of an agent', Bench.agent_memory)
    bare = once('memory of a bare node', Bench.bare_memory)
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
            at_most=0, judge=max),
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
            'default executor, message objects', (real, plain), 'rate', 'Hz'),
        Row('highest-fair', 'the same without priority', 'with it', (fair, real), 'rate',
            'Hz'),
        *(Row(f'n{n}', f'processor time per message, n = {n}, one process', 'n = 4',
              (many['tetra', n], many['tetra', 4]), 'us/message', 'us', at_most=1.5)
          for n in (8, 16, 32)),
        Row('ceiling-n32', 'the same, n = 32, raw bytes, no mathematics', 'n = 4',
            (many['bytes', 32], many['bytes', 4]), 'us/message', 'us'),
        Row('scipy', 'trajectories/s to a final error of 1e-6, one core',
            'SciPy solve_ivp, DOP853', (batch['one core'], batch['SciPy']), per_core, '1/s',
            at_least=150.0),
        Row('numpy', 'the same', 'RK4, vectorised numpy', (batch['one core'], batch['numpy']),
            per_core, '1/s', at_least=10.0),
        Row('cores', 'the same on two cores', 'one core', (batch['two cores'],
            batch['one core']), 'trajectories/s', '1/s', at_least=1.8),
        Row('machine', 'two processes of one core each, what the machine has', 'one core',
            (twice, batch['one core']), 'trajectories/s', '1/s'),
        Row('drift', "plant: largest entry of R'R - 1 after many steps", '0',
            (once('drift', Bench.drift),), 'drift', at_most=1e-12),
        Row('memory', 'memory of an agent process', 'a bare rclpy node', (memory, bare), 'MB',
            'MB', at_most=10.0, difference=True),
        Row('growth', 'growth of its own memory in lockstep', '0', (memory,), 'growth [MB]',
            'MB', at_most=1.0),
        Row('help', 'tetra --help', '', (once('help', Bench.help, 5),), 's', 's', at_most=0.4),
        Row('start', 'launcher: from start to first command', '',
            (once('start', Bench.start, 3),), 's', 's', at_most=2.0),
    )


class Bench:
    """
    The measurements.

    :param scale: a :class:`Scale`
    """

    def __init__(self, scale):
        self.scale = scale
        self._runs = 0
        self._processes = []
        self._domains = []  # with the lock of each, which this process holds to its end
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
        # What is not repeated comes first, so that what is left of the budget goes to repetition.
        for group in sorted(figures, key=self._turns):
            turns = self._turns(group)
            others = sum(self._turns(g) for g in figures if not any(g.values())) - turns
            begun = time.monotonic()
            self._take_turns(group, turns, begun + (end - begun) * turns / (turns + others))
        for group, found in zip(groups, figures):
            for row in group:
                results[row.name] = row.conclude(found)
        return [results[row.name] for row in rows]

    def _turns(self, systems):
        return max(self.scale.repeats if system.most is None
                   else min(system.most, self.scale.repeats) for system in systems)

    def _take_turns(self, systems, turns, end):
        """Start systems, and measure them one after the other, again and again."""
        with ExitStack() as running:
            measures = {system: running.enter_context(self._running(system, found))
                        for system, found in systems.items()}
            # They start all at once; the first turn waits until they have, and warms them up.
            for system in systems:
                if system.most is None and measures[system] is not None:
                    self._measure(system, measures[system])
            begun = time.monotonic()
            for turn in range(turns):
                left = end - time.monotonic()
                if turn and left < (time.monotonic() - begun) / turn:
                    break
                for system, found in systems.items():
                    if measures[system] is not None and turn < (system.most or turns):
                        found.append(self._measure(system, measures[system]))

    @contextmanager
    def _running(self, system, found):
        """Have a system running; among what was found is a None if it does not start or end."""
        _show(f'{system.name} ...')
        with ExitStack() as stack:
            measure = None
            try:
                measure = stack.enter_context(system.start(self))
            except FAILURES as error:
                _tell(system, error)
                found.append(None)
            yield measure
            try:
                stack.close()
            except FAILURES as error:
                _tell(system, error)
                found.append(None)

    def _measure(self, system, measure):
        _show(f'{system.name} ...')
        begun, busy, own = time.monotonic(), _busy(), self._worked()
        try:
            figures = measure()
        except FAILURES as error:
            _tell(system, error)
            return None
        others = (_busy() - busy) - (self._worked() - own)
        _show('')
        return {**figures, OTHERS: max(others / (time.monotonic() - begun), 0.0)}

    def _place(self):
        """Return arguments and environment that keep a system to itself, beside all others."""
        self._runs += 1
        # DDS takes a while to forget a process that has ended: each run has another domain than
        # those before, and in the end the first one's again. The namespace is new as well.
        if len(self._domains) < MOST_DOMAINS:
            self._domains.append(reserve(range(LARGEST, 0, -1)))
        domain, _ = self._domains[self._runs % len(self._domains)]
        return (('--namespace', f'bench_{os.getpid()}_{self._runs}'),
                {**self._environment, 'ROS_DOMAIN_ID': str(domain)})

    @contextmanager
    def _process(self, command, environment, **kwargs):
        """Run Python with some arguments meanwhile, and end it as Ctrl-C does."""
        with tempfile.TemporaryFile('w+') as errors:
            process = subprocess.Popen(
                [*kwargs.pop('prefix', ()), sys.executable, *map(str, command)], env=environment,
                text=True, stderr=errors,
                **{'stdin': subprocess.DEVNULL, 'stdout': subprocess.DEVNULL, **kwargs})
            process.errors = errors
            self._processes.append(process)
            try:
                yield process
            finally:
                if process.stdin is not None:
                    process.stdin.close()
                else:
                    process.send_signal(signal.SIGINT)
                try:
                    process.wait(10.0)
                except subprocess.TimeoutExpired:
                    process.kill()
                    process.wait()
                self._processes.remove(process)

    @contextmanager
    def _worker(self, *arguments, environment=None, prefix=()):
        """
        Run ``benchmarks/worker.py`` meanwhile.

        It gives a function that hands it a line, if there is one to be handed, and returns its
        answer: a mapping, or None for an empty line.
        """
        command = (WORKER, *arguments)
        with self._process(command, environment or self._environment, prefix=prefix,
                           stdin=subprocess.PIPE, stdout=subprocess.PIPE) as process:
            def answer(line=None, timeout=TIMEOUT):
                watchdog = Timer(timeout, process.kill)
                watchdog.start()
                try:
                    if line is not None:
                        process.stdin.write(f'{line}\n')
                        process.stdin.flush()
                    reply = process.stdout.readline()
                finally:
                    watchdog.cancel()
                if not reply:
                    raise RuntimeError(_last_words(process))
                return json.loads(reply) if reply.strip() else None

            answer.process = process
            yield answer
        if process.returncode:
            raise RuntimeError(_last_words(process))

    @contextmanager
    def _contestant(self, *arguments, environment=None):
        """Run a worker that takes turns; it gives a function that measures for one turn."""
        with self._worker(*arguments, environment=environment) as answer:
            ready = []

            def measure():
                if not ready:
                    answer()
                    ready.append(True)
                return answer(self.scale.seconds, TIMEOUT + 10.0 * self.scale.seconds)

            yield measure

    @contextmanager
    def _five(self, style, namespace, environment, prefix=()):
        """Run four agents and the monitor meanwhile, in processes of their own."""
        if style == 'tetra':
            common = ('--config', 'complete', *namespace)
            agents = [('-m', 'tetra_ros2', 'agent', '--id', i, *common) for i in range(1, 5)]
            monitor = ('-m', 'tetra_ros2', 'monitor', *common)
        else:
            agents = [(WORKER, 'agent', style, *namespace, '--id', i) for i in range(1, 5)]
            monitor = (WORKER, 'monitor', 'bytes', *namespace)
        with ExitStack() as stack:
            processes = [stack.enter_context(self._process(agent, environment, prefix=prefix))
                         for agent in agents]
            # Nobody's time depends on the monitor's.
            stack.enter_context(self._process(monitor, environment))
            yield processes
            for process in processes:  # all at once; the stack waits for one after the other
                process.send_signal(signal.SIGINT)

    def rounds(self, style='tetra', n=4):
        """Lockstep in one process."""
        namespace, environment = self._place()
        return self._contestant('rounds', style, '--n', n, *namespace, environment=environment)

    def watched(self):
        """Lockstep in one process, with monitor and recorder."""
        namespace, environment = self._place()
        return self._contestant('watched', *namespace, environment=environment)

    @contextmanager
    def six(self, style):
        """Lockstep in six processes."""
        namespace, environment = self._place()
        with self._five(style, namespace, environment), self._contestant(
                'rounds', style, '--alone', *namespace, environment=environment) as measure:
            yield measure

    def realtime(self, style, first, priority=True, seconds=None):
        """
        Real time in six processes; plant and agents have priority, if that is permitted.

        :param first: the rate at which it is measured first, and from which on the highest rate
            is looked for that it holds [Hz]
        :param seconds: for how long at the first rate; 0 for no longer than at the others
        """
        namespace, environment = self._place()
        prefix = PRIORITY if priority and may_have_priority() else ()
        short = min(8.0 * self.scale.seconds, self.scale.realtime)
        with self._five(style, namespace, environment, prefix), self._worker(
                'realtime', style, *namespace, environment=environment, prefix=prefix) as answer:
            answer()  # that it is ready
            time.sleep(START_UP)

            def run(rate, seconds):
                return {'rate': rate, **answer(f'{seconds} {rate}', TIMEOUT + 10.0 * seconds)}

            seconds = self.scale.realtime if seconds is None else max(seconds, short)
            figures = run(first, seconds)
            rate, rungs = highest_rate(first, _holds(figures), lambda rate: run(rate, short))
        return {**figures, 'rate': rate, 'rungs': rungs}

    def batch(self, style='tetra', threads=1, core=None):
        """Trajectories; see ``benchmarks/trajectories.py``."""
        where = () if core is None else ('--core', core)
        return self._contestant('batch', style, '--threads', threads, *where)

    @contextmanager
    def two_processes(self):
        """Trajectories in two processes that know nothing of each other."""
        with self.batch(core=0) as first, self.batch(core=1) as second, \
                ThreadPoolExecutor(2) as threads:
            def measure():
                both = [f.result() for f in [threads.submit(first), threads.submit(second)]]
                return {'trajectories/s': sum(f['trajectories/s'] for f in both)}
            yield measure

    def drift(self):
        """Many steps of a rigid body."""
        steps = self.scale.steps
        with self._worker('drift', '--steps', steps) as answer:
            return answer(timeout=TIMEOUT + steps * 1e-5)

    def agent_memory(self):
        """Watch an agent's process in lockstep, six processes, and how it grows."""
        namespace, environment = self._place()
        with self._five('tetra', namespace, environment) as agents, self._contestant(
                'rounds', 'tetra', '--alone', *namespace, environment=environment) as measure:
            measure()
            pid, rounds = agents[0].pid, 0
            begin = _memory(pid)
            while rounds < self.scale.rounds:
                rounds += measure()['rounds']
            end = _memory(pid)
        # DDS maps rings of fixed size between processes, of which ever more has been in use.
        return {'MB': end['VmRSS'], 'growth [MB]': end['RssAnon'] - begin['RssAnon'],
                'growth of shared memory [MB]': end['RssShmem'] - begin['RssShmem'],
                'rounds': rounds}

    def bare_memory(self):
        """Look at a node that does nothing."""
        namespace, environment = self._place()
        with self._worker('bare', *namespace, environment=environment) as answer:
            answer()
            time.sleep(1.0)
            size = _memory(answer.process.pid)['VmRSS']
            answer.process.send_signal(signal.SIGINT)
        return {'MB': size}

    def help(self):  # noqa: A003
        """Time ``tetra --help``."""
        begun = time.monotonic()
        with self._process(('-m', 'tetra_ros2', '--help'), self._environment) as process:
            process.wait(TIMEOUT)
            return {'s': time.monotonic() - begun}

    def start(self):
        """Time the launcher until its first command, as somebody else hears it."""
        namespace, environment = self._place()
        launcher = ('-m', 'tetra_ros2', 'launcher', *namespace, '--quiet', '--duration', '1e6')
        with self._worker('first_command', *namespace, environment=environment) as answer:
            answer()
            begun = time.monotonic()
            with self._process(launcher, environment):
                return {'s': answer()['at'] - begun}

    def _worked(self):
        """Return the processor time of this process's children [s]."""
        ended = resource.getrusage(resource.RUSAGE_CHILDREN)
        return ended.ru_utime + ended.ru_stime + sum(
            _processor_time(process.pid) for process in self._processes)


@cache
def may_have_priority():
    """Return whether this machine lets us give a process priority in real time."""
    try:
        subprocess.run([*PRIORITY, 'true'], capture_output=True, check=True)
    except (OSError, subprocess.CalledProcessError):
        return False
    return True


def highest_rate(first, holds_first, run):
    """
    Look for the highest rate of LADDER that is held, up from a first one or down.

    :param holds_first: whether the first one was
    :param run: called with a rate [Hz], returns the figures of a run
    :returns: the rate, or 0, and the figures of all runs
    """
    rungs = []

    def holds(rate):
        # Twice, as a neighbour's burst is not the system's limit.
        for _ in range(2):
            rungs.append(run(rate))
            if _holds(rungs[-1]):
                return True
        return False

    k = LADDER.index(first)
    if holds_first or holds(first):
        while k + 1 < len(LADDER) and holds(LADDER[k + 1]):
            k += 1
    else:
        k -= 1
        while k >= 0 and not holds(LADDER[k]):
            k -= 1
    return LADDER[k] if k >= 0 else 0, rungs


def _middle_half(values):
    """Return between which two values the middle half of all is."""
    values = sorted(values)
    outside = len(values) // 4
    return [values[outside], values[-1 - outside]]


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


def _processor_time(pid):
    """Return the processor time of a process [s]."""
    try:
        fields = Path(f'/proc/{pid}/stat').read_text(encoding='utf-8').rpartition(')')[2].split()
    except OSError:
        return 0.0
    return (int(fields[11]) + int(fields[12])) / os.sysconf('SC_CLK_TCK')


def _last_words(process):
    """Return why a process has ended."""
    process.wait(10.0)
    process.errors.seek(0)
    lines = process.errors.read().strip().splitlines() or ['it said nothing']
    return f'exit status {process.returncode}: {lines[-1]}'


def _tell(system, error):
    """Say that something could not be measured."""
    _show('')
    print(f'tetra: {system.name} could not be measured: {error}', file=sys.stderr)


def _memory(pid):
    """Return the resident memory of a process by kind, as Linux names it [MB]."""
    lines = Path(f'/proc/{pid}/status').read_text(encoding='utf-8').splitlines()
    return {name: int(value.split()[0]) / 1024 for name, _, value in
            (line.partition(':') for line in lines) if 'RSS' in name or 'Rss' in name}


def _show(text):
    """Say on a terminal what is going on."""
    if sys.stderr.isatty():
        print(f'\r\33[K{text}', end='', file=sys.stderr, flush=True)
