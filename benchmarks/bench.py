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
The formation against what there is to compare with, side by side.

What is measured and how stands in :mod:`benchmarks.rows`.
"""

from dataclasses import replace
from importlib.metadata import PackageNotFoundError, version
import json
import math
import os
from pathlib import Path
import platform
from statistics import median
import subprocess
import time

from benchmarks.measuring import Bench, may_have_priority, OTHERS, Scale, THOROUGH, TOP
from benchmarks.rows import all_rows
from rich.console import Console
from rich.table import Table
from tetra_ros2.config.parameters import ConfigurationError, nearest

QUIET = 0.1
"""How many cores other processes may use before it is worth a word."""


def add_arguments(parser):
    """Add the arguments of ``tetra bench``."""
    parser.add_argument(
        '--only', action='append', metavar='NAME',
        help='measure only this row; may be given more than once (--list names them)')
    parser.add_argument('--list', action='store_true', help='say which rows there are')
    parser.add_argument(
        '--thorough', action='store_true', help='as many turns as there are, whatever time it '
        'takes, and 1e6 rounds for the memory')
    parser.add_argument(
        '--seconds', type=float, metavar='S',
        help='length of a turn [s] (default: 0.25); all else is longer or shorter with it')
    parser.add_argument(
        '--repeats', type=int, metavar='N', help='how many turns at most')
    parser.add_argument('--json', metavar='FILE', help='write the results into this file')
    parser.add_argument(
        '--read', metavar='FILE', help='measure nothing, and print what --json wrote into FILE')
    parser.add_argument(
        '--markdown', action='store_true', help='print the table as Markdown, as in the README')
    parser.add_argument(
        '--report-only', action='store_true', help='exit with 0 even if a target is missed')


def run(arguments):
    """
    Measure, print a table, and write it as JSON if wanted.

    :returns: 0 if every target is met, 1 if one is missed
    :raises ConfigurationError: if it was called wrongly
    """
    rows = all_rows()
    if arguments.list:
        for row in rows:
            print(f'{row.name:<16} {row.work}')
        return 0
    if arguments.read:
        _print(_read(arguments.read), arguments.markdown)
        return 0
    names = [row.name for row in rows]
    for name in arguments.only or ():
        if name not in names:
            raise ConfigurationError(
                f'{name!r} is not valid{nearest(name, names)}, expected one of '
                f'{", ".join(names)}', key='--only')
    scale = _scale(arguments)
    if arguments.json and not Path(arguments.json).resolve().parent.is_dir():
        raise ConfigurationError(f'{arguments.json} is in no directory', key='--json')
    rows = [row for row in rows if not arguments.only or row.name in arguments.only]
    begun = time.time()
    results = Bench(scale).measure(rows)
    document = {'machine': _machine(), 'versions': _versions(), 'begun': begun,
                'seconds': time.time() - begun, 'priority': may_have_priority(), 'rows': results}
    if arguments.json:
        Path(arguments.json).write_text(json.dumps(_finite(document), indent=1) + '\n',
                                        encoding='utf-8')
    _print(document, arguments.markdown)
    missed = [result['name'] for result in results if not result['met']]
    return 1 if missed and not arguments.report_only else 0


def _scale(arguments):
    scale = THOROUGH if arguments.thorough else Scale()
    if (seconds := arguments.seconds) is not None:
        if not 0.0 < seconds < 1e5:
            raise ConfigurationError(
                f'{seconds!r} is not valid, expected a time greater than 0', key='--seconds')
        factor = seconds / scale.seconds
        scale = replace(scale, seconds=seconds, realtime=factor * scale.realtime,
                        steps=math.ceil(factor * scale.steps),
                        rounds=math.ceil(factor * scale.rounds))
    if (repeats := arguments.repeats) is not None:
        if not 1 <= repeats <= 1000:
            raise ConfigurationError(
                f'{repeats!r} is not valid, expected an integer from 1 to 1000', key='--repeats')
        scale = replace(scale, repeats=repeats)
    return scale


def _machine():
    def model():
        try:
            lines = Path('/proc/cpuinfo').read_text(encoding='utf-8').splitlines()
        except OSError:
            return platform.processor()
        return next((line.split(':')[1].strip() for line in lines
                     if line.startswith('model name')), platform.machine())
    return {'processor': model(), 'cores': os.cpu_count(), 'system': platform.platform(),
            'load': os.getloadavg()}


def _versions():
    versions = {'python': platform.python_version()}
    for package in ('tetra_ros2', 'rclpy', 'numpy', 'numba', 'scipy', 'rosbags'):
        try:
            versions[package] = version(package)
        except PackageNotFoundError:
            versions[package] = None
    revision = subprocess.run(['git', '-C', str(TOP), 'describe', '--always', '--dirty'],
                              capture_output=True, text=True, check=False)
    versions['revision'] = revision.stdout.strip() or None
    return versions


def _finite(value):
    if isinstance(value, dict):
        return {key: _finite(item) for key, item in value.items()}
    if isinstance(value, (list, tuple)):
        return [_finite(item) for item in value]
    return None if isinstance(value, float) and not math.isfinite(value) else value


def _read(file):
    try:
        document = json.loads(Path(file).read_text(encoding='utf-8'))
        _cells_of(document)
        if missing := {'machine', 'versions', 'priority', 'seconds'} - set(document):
            raise KeyError(missing)
    except OSError as error:
        raise ConfigurationError(f'cannot be read: {error.strerror}', source=file) from None
    except (KeyError, TypeError, ValueError):
        raise ConfigurationError('is not what --json writes', source=file) from None
    return document


TITLES = (('row', 'left'), ('work', 'left'), ('measured', 'right'), ('against', 'left'),
          ('there', 'right'), ('median', 'right'), ('middle half', 'right'), ('target', 'right'),
          ('', 'left'))
"""What the columns of the table are, and on which side they are aligned."""


def _print(document, markdown=False):
    machine, versions = document['machine'], document['versions']
    print(f'{machine["processor"]}, {machine["cores"]} cores, load {machine["load"][0]:.1f}; '
          f'{machine["system"]}')
    print(', '.join(f'{k} {v}' for k, v in versions.items() if v))
    (_print_markdown if markdown else _print_table)(_cells_of(document))
    if (others := _others(document['rows'])) > QUIET:
        print(f'other processes kept {others:.1f} cores busy meanwhile: absolute figures, and '
              'those in real time, are not what this machine can do')
        if ratios := _by_processor_time(document['rows']):
            print(f'by the time of the processor alone: {", ".join(ratios)}')
    if not document['priority'] and any(row['name'] == 'punctual' for row in document['rows']):
        print('`chrt --fifo 20` is not permitted here: real time was measured without priority')
    judged = [row for row in document['rows'] if row['target'] or not row['met']]
    missed = [row['name'] for row in judged if not row['met']]
    print(f'{len(judged) - len(missed)} of {len(judged)} targets met in '
          f'{document["seconds"]:.0f} s' + (f'; missed: {", ".join(missed)}' if missed else ''))


def _print_table(rows):
    console = Console()
    if not console.is_terminal:
        console = Console(width=160)
    table = Table()
    for title, justify in TITLES:
        table.add_column(title, justify=justify)
    for row in rows:
        table.add_row(*row)
    console.print(table)


def _print_markdown(rows):
    titles = [title for title, _ in TITLES]
    rules = ['---:' if justify == 'right' else '---' for _, justify in TITLES]
    print()
    for row in (titles, rules, *rows):
        print(f'| {" | ".join(row)} |')
    print()


def _cells_of(document):
    return [_cells(row) for row in document['rows']]


def _others(rows):
    """Return how many cores other processes used while the rows were measured, the median."""
    cores = [figures[OTHERS] for row in rows for runs in row['details'].values()
             for figures in runs if figures is not None]
    return median(cores) if cores else 0.0


def _by_processor_time(rows):
    """Return the medians of lockstep in one process, of which other processes take nothing."""
    found, field = [], 'rounds/core s'
    for row in rows:
        if row['name'] in ('objects', 'ceiling', 'watched'):
            ratios = [a[field] / b[field] for a, b in zip(*row['details'].values())
                      if a and b and field in a and field in b]
            if ratios:
                found.append(f'{row["name"]} {_short(median(ratios))} ({_short(min(ratios))} .. '
                             f'{_short(max(ratios))})')
    return found


def _cells(row):
    def middle(values):
        values = [v for v in values or () if v is not None]
        return f'{_short(median(values))} {row["unit"]}'.strip() if values else ''

    center, middle_half = row['median'], row['middle'] if len(row['values']) > 1 else ()
    verdict = 'met' if row['target'] else ''
    return (row['name'], row['work'], middle(row['measured']), row['against'],
            middle(row['reference']), '-' if center is None else _short(center),
            ' .. '.join(map(_short, middle_half)), row['target'],
            verdict if row['met'] else 'MISSED')


def _short(value):
    """Return a figure with as many digits as it is worth."""
    if value and abs(value) < 1e-3:
        return f'{value:.1e}'
    return f'{value:.0f}' if abs(value) >= 100 else f'{value:.3g}'
