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
The rows of ``python -m benchmarks``, and what is concluded from what was measured.

The ratio of two systems is that of neighbours in time, and its median counts.
"""

from contextlib import contextmanager
from dataclasses import dataclass
from functools import partial
import math
import statistics

from benchmarks.measuring import Bench, FRESH, OLDEST, ON_TIME


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


def _middle_half(values):
    """Return between which two values the middle half of all is."""
    values = sorted(values)
    outside = len(values) // 4
    return [values[outside], values[-1 - outside]]
