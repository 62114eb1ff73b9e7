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

"""``tetra study``: very many random starts."""

import argparse
from collections.abc import Callable, Iterator
from contextlib import contextmanager
import json
import math
from pathlib import Path
import sys
from typing import Any

from rich.console import Console
from rich.progress import (
    BarColumn,
    MofNCompleteColumn,
    Progress,
    TextColumn,
    TimeElapsedColumn,
    TimeRemainingColumn,
)
from tetra_ros2 import installation, signals
from tetra_ros2.config import configuration
from tetra_ros2.config.parameters import ConfigurationError, FORMATION
from tetra_ros2.formation.shapes import known_shape
from tetra_ros2.study import executors, montecarlo


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the arguments of ``tetra study``."""
    parser.add_argument(
        '--out', required=True, metavar='DIR', help='directory to make and write into')
    parser.add_argument(
        '--config', action='append', metavar='FILE',
        help='a ROS 2 parameter file, or the name of one that ships; may be given more than once '
             '(default: complete)')
    parser.add_argument(
        '--gain', action='append', metavar='KIND',
        help='a family of gains, in place of that in FILE; may be given more than once')
    parser.add_argument(
        '--starts', type=int, default=10000, metavar='N',
        help='uniform random starts for each config and gain (default: %(default)s)')
    parser.add_argument(
        '--seed', type=int, default=0, metavar='N', help='of the starts (default: %(default)s)')
    parser.add_argument(
        '--tolerance', type=float, default=1e-3, metavar='RAD',
        help='error below which a start has formed [rad] (default: %(default)s)')
    parser.add_argument(
        '--hold', type=float, default=1.0, metavar='S',
        help='for how long it must stay there [s] (default: %(default)s)')
    parser.add_argument(
        '--longest', type=float, default=500.0, metavar='S',
        help='formation time to give up after [s] (default: %(default)s)')
    parser.add_argument(
        '--worst', type=int, default=3, metavar='N',
        help='how many of the slowest to keep as configurations for the launcher '
             '(default: %(default)s)')
    parser.add_argument(
        '--format', choices=('parquet', 'csv'),
        help='of the results (default: parquet if pyarrow is installed, otherwise csv)')
    parser.add_argument(
        '--workers', type=int, metavar='N',
        help='processes on this machine (default: as many as it has processors)')
    parser.add_argument(
        '--scheduler', metavar='ADDRESS',
        help='run on this Dask cluster instead, such as tcp://10.0.0.1:8786')
    parser.add_argument('--resume', action='store_true', help='go on with the study in DIR')
    parser.add_argument('--json', action='store_true', help='print the summary as JSON')
    parser.add_argument('--quiet', action='store_true', help='show no progress')


def run(arguments: argparse.Namespace) -> int:
    """
    Run a study.

    :returns: 0 if every start formed, 1 if one did not, 130 if it was interrupted
    :raises ConfigurationError: if it was called wrongly; nothing was written then
    """
    plan = make_plan(arguments)
    directory = Path(arguments.out)
    form = _format(arguments)
    total = plan.chunks * len(plan.cases)
    try:
        with executors.make_executor(arguments.workers, arguments.scheduler) as (executor, width):
            montecarlo.prepare(directory, plan, form, arguments.resume)
            todo = montecarlo.missing(directory, plan)
            with _progress(total, total - len(todo), arguments.quiet) as advance:
                montecarlo.compute(executor, width, plan, directory, todo, advance)
    except KeyboardInterrupt:
        if (directory / 'parts').is_dir():
            left = len(montecarlo.missing(directory, plan))
            print(f'interrupted: {total - left} of {total} parts are kept in {directory}; '
                  'go on with --resume', file=sys.stderr)
        return signals.INTERRUPTED
    summary = montecarlo.conclude(directory, plan, form, arguments.worst)
    if arguments.json:
        print(json.dumps(summary, indent=2, allow_nan=False))
    else:
        _print(summary, directory)
    return 0 if all(case['formed'] == plan.starts for case in summary['cases']) else 1


def make_plan(arguments: argparse.Namespace) -> montecarlo.Plan:
    """
    Return the :class:`~tetra_ros2.study.montecarlo.Plan` that the arguments describe.

    :raises ConfigurationError: if one is not valid
    """
    for name, least in (('starts', 1), ('seed', 0), ('worst', 0), ('workers', 1)):
        value = getattr(arguments, name)
        if value is not None and not least <= value < 2**53:
            raise ConfigurationError(
                f'{value} is not valid, expected an integer from {least} up', key=f'--{name}')
    for name in ('tolerance', 'hold', 'longest'):
        value = getattr(arguments, name)
        if not 0.0 < value < 1e6:
            raise ConfigurationError(
                f'{value!r} is not valid, expected a number greater than 0', key=f'--{name}')
    cases: list[montecarlo.Case] = []
    for config in arguments.config or ['complete']:
        file = configuration.load(config)
        values = file.values('plant')
        for kind in arguments.gain or [values['gain.kind']]:
            parameters = {spec.name: values[spec.name] for spec in FORMATION}
            parameters['topology.points'] = file.values('monitor')['topology.points']
            parameters['gain.kind'] = kind
            parameters['rate'] = values['rate']
            parameters = {k: list(v) if isinstance(v, tuple) else v
                          for k, v in parameters.items()}
            case = montecarlo.Case(f'{file.path.stem}_{kind.replace(":", ".")}', parameters)
            if any(case.name == other.name for other in cases):
                raise ConfigurationError(f'{case.name} is there twice', key='--config')
            if known_shape(case.formation().topology) is None:
                raise ConfigurationError(
                    'no shape is known that its topology leads to, so none can be waited for',
                    source=file.path, key='topology')
            cases.append(case)
    return montecarlo.Plan(
        tuple(cases), arguments.starts, arguments.seed, arguments.tolerance, arguments.hold,
        arguments.longest, montecarlo.CHUNK)


def _format(arguments: argparse.Namespace) -> str:
    """Return the format of the results, after looking whether it can be written."""
    try:
        import pyarrow  # noqa: F401
    except ModuleNotFoundError:
        if arguments.format == 'parquet':
            raise ConfigurationError(
                f'parquet needs pyarrow: {installation.install_command("study")}; or say csv',
                key='--format') from None
        return 'csv'
    form: str = arguments.format or 'parquet'
    return form


@contextmanager
def _progress(total: int, done: int, quiet: bool) -> Iterator[Callable[[], None]]:
    """Yield a function to call when a part is done; on a terminal it moves a bar."""
    console = Console(stderr=True)
    if quiet or not console.is_terminal:
        yield lambda: None
        return
    with Progress(
            TextColumn('study'), BarColumn(), MofNCompleteColumn(), TimeElapsedColumn(),
            TextColumn('left'), TimeRemainingColumn(), console=console) as bar:
        task = bar.add_task('', total=total, completed=done)
        yield lambda: bar.advance(task)


def _print(summary: dict[str, Any], directory: Path) -> None:
    """Print a paragraph for each case: on eighty columns a table of this would be cut."""
    for case in summary['cases']:
        print(f'{case["name"]}\n'
              f'    formed {case["formed"]} of {case["starts"]}, a chance above '
              f'{100.0 * case["fraction_above_with_95_percent"]:.6f} % with 95 % confidence')
        counts, times = case['histogram']['counts'], case['time_to_form']
        if counts:
            bars = ''.join(' ▁▂▃▄▅▆▇█'[math.ceil(8 * c / max(counts))] for c in counts)
            print(f'    after a median of {times["0.5"]:.2f} s, 95 % {times["0.95"]:.2f} s, '
                  f'99.9 % {times["0.999"]:.2f} s, slowest {times["1"]:.2f} s\n'
                  f'    0 s |{bars}| {case["histogram"]["edges"][-1]:.2f} s')
    print(f'results, slowest starts and summary are in {directory}')
