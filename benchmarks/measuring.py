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
How each figure of ``python -m benchmarks`` is measured.

Every system runs in processes of its own, see ``benchmarks/worker.py``. Those that are compared
are there at the same time and take short turns, A B C A B C, while the others rest: whatever else
the machine does falls on all of them.
"""

from concurrent.futures import ThreadPoolExecutor
from contextlib import contextmanager, ExitStack
from dataclasses import dataclass
from functools import cache
import json
import math
import os
from pathlib import Path
import resource
import signal
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
