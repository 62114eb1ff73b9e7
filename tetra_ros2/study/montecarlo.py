# Copyright 2026 The tetra_ros2 authors
# SPDX-License-Identifier: Apache-2.0

"""
``tetra study``: very many random starts, and what becomes of them.

The starts are cut into chunks of a fixed size, and each chunk has a random generator of its own:
the numbers do not depend on who computes which. A chunk that is done is a file in ``parts``, so
an interrupted study goes on from there; the whole is put together when the last one is there.
"""

from contextlib import contextmanager
from dataclasses import dataclass
import json
import math
import os
from pathlib import Path
import shutil
import sys

CHUNK = 5000
"""Starts per task: some seconds of work, so that an interrupt costs no more than that."""

ANSWER_TIMEOUT = 10.0
"""How long a scheduler may take to answer [s]."""

QUANTILES = (0.01, 0.05, 0.25, 0.5, 0.75, 0.95, 0.99, 0.999, 1.0)

INTERRUPTED = 130


def add_arguments(parser):
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


@dataclass(frozen=True)
class Case:
    """
    A topology and a gain.

    :param name: for people and for file names
    :param parameters: of the formation, and the plant's rate, plain values
    """

    name: str
    parameters: dict

    def formation(self):
        """Return the :class:`~tetra_ros2.formation.Formation`."""
        from tetra_ros2.config.configuration import formation_from_parameters
        from tetra_ros2.config.parameters import check_parameters
        given = {k: v for k, v in self.parameters.items() if k != 'rate'}
        return formation_from_parameters(check_parameters('monitor', given))


@dataclass(frozen=True)
class Plan:
    """
    All that the numbers of a study depend on.

    :param cases: what is studied
    :param starts: for each case
    :param seed: of the starts
    :param tolerance: error below which a start has formed [rad]
    :param hold: for how long it must stay there [s]
    :param longest: formation time to give up after [s]
    :param chunk: how many starts share a random generator, and are computed at once
    """

    cases: tuple
    starts: int
    seed: int
    tolerance: float
    hold: float
    longest: float
    chunk: int = CHUNK

    @property
    def chunks(self):
        """Return how many chunks there are of each case."""
        return -(-self.starts // self.chunk)

    def attitudes(self, chunk, n):
        """
        Return the initial attitudes of a chunk, uniform on SO(3)^n, ``(m, n, 4)``.

        :param chunk: which chunk, from 0
        :param n: number of agents
        """
        import numpy as np

        from tetra_ros2.formation import rotation
        count = min(self.chunk, self.starts - chunk * self.chunk)
        return rotation.random(np.random.default_rng([self.seed, chunk]), (count, n))

    def document(self):
        """Return it as plain values."""
        return {'cases': [{'name': case.name, 'parameters': case.parameters}
                          for case in self.cases],
                'starts': self.starts, 'seed': self.seed, 'tolerance': self.tolerance,
                'hold': self.hold, 'longest': self.longest, 'chunk': self.chunk}


def run(arguments):
    """
    Run a study.

    :returns: 0 if every start formed, 1 if one did not, 130 if it was interrupted
    :raises ConfigurationError: if it was called wrongly; nothing was written then
    """
    plan = make_plan(arguments)
    directory = Path(arguments.out)
    form = _format(arguments)
    with _executor(arguments) as (executor, width):
        _prepare(directory, plan, form, arguments.resume)
        todo = _missing(directory, plan)
        try:
            _compute(executor, width, plan, directory, todo, arguments.quiet)
        except KeyboardInterrupt:
            left = len(_missing(directory, plan))
            total = plan.chunks * len(plan.cases)
            print(f'interrupted: {total - left} of {total} parts are kept in {directory}; '
                  'go on with --resume', file=sys.stderr)
            return INTERRUPTED
    summary = _conclude(directory, plan, form, arguments.worst)
    if arguments.json:
        print(json.dumps(summary, indent=2, allow_nan=False))
    else:
        _print(summary, directory)
    return 0 if all(case['formed'] == plan.starts for case in summary['cases']) else 1


def make_plan(arguments):
    """
    Return the :class:`Plan` that the arguments describe.

    :raises ConfigurationError: if one is not valid
    """
    from tetra_ros2.config import configuration
    from tetra_ros2.config.parameters import ConfigurationError, FORMATION
    from tetra_ros2.formation.shapes import known_shape
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
    cases = []
    for config in arguments.config or ['complete']:
        file = configuration.load(config)
        values = file.values('plant')
        for kind in arguments.gain or [values['gain.kind']]:
            parameters = {spec.name: values[spec.name] for spec in FORMATION}
            parameters['gain.kind'] = kind
            parameters['rate'] = values['rate']
            parameters = {k: list(v) if isinstance(v, tuple) else v
                          for k, v in parameters.items()}
            case = Case(f'{file.path.stem}_{kind.replace(":", ".")}', parameters)
            if any(case.name == other.name for other in cases):
                raise ConfigurationError(f'{case.name} is there twice', key='--config')
            if known_shape(case.formation().topology) is None:
                raise ConfigurationError(
                    'no shape is known that its topology leads to, so none can be waited for',
                    source=file.path, key='topology')
            cases.append(case)
    return Plan(tuple(cases), arguments.starts, arguments.seed, arguments.tolerance,
                arguments.hold, arguments.longest, CHUNK)


def _format(arguments):
    """Return the format of the results, after looking whether it can be written."""
    from tetra_ros2.config.parameters import ConfigurationError
    try:
        import pyarrow  # noqa: F401
    except ModuleNotFoundError:
        if arguments.format == 'parquet':
            raise ConfigurationError(
                "parquet needs pyarrow: pip install 'tetra_ros2[study]', or say csv",
                key='--format') from None
        return 'csv'
    return arguments.format or 'parquet'


@contextmanager
def _executor(arguments):
    """Yield a standard executor and how many tasks to keep under way."""
    if arguments.scheduler is None:
        from concurrent.futures import ProcessPoolExecutor
        from multiprocessing import get_context
        workers = arguments.workers or os.cpu_count() or 1
        # Forking a process that has threads, such as those of a progress bar, can hang.
        executor = ProcessPoolExecutor(
            workers, mp_context=get_context('spawn'), initializer=_ignore_interrupts)
        try:
            yield executor, 2 * workers
        finally:
            executor.shutdown(cancel_futures=True)
        return
    from tetra_ros2.config.parameters import ConfigurationError
    try:
        from distributed import Client
    except ModuleNotFoundError:
        raise ConfigurationError(
            "a Dask cluster needs distributed: pip install 'tetra_ros2[cluster]'",
            key='--scheduler') from None
    try:
        client = Client(arguments.scheduler, timeout=ANSWER_TIMEOUT, set_as_default=False)
    except (OSError, ValueError) as error:
        reason = str(error).splitlines()[0] or type(error).__name__
        raise ConfigurationError(
            f'{arguments.scheduler} does not answer: {reason}', key='--scheduler') from None
    with client:
        threads = sum(client.nthreads().values())
        if not threads:
            raise ConfigurationError(
                f'{arguments.scheduler} has no workers', key='--scheduler')
        # Tasks are pure, but dask must not merge two that look alike into one future.
        executor = client.get_executor(pure=False)
        try:
            yield executor, 2 * threads
        finally:
            executor.shutdown(wait=False)


def _ignore_interrupts():
    """Leave Ctrl-C to the process that was called."""
    import signal
    signal.signal(signal.SIGINT, signal.SIG_IGN)


def run_chunk(plan, which, chunk):
    """
    Follow the starts of one chunk; this runs in a worker.

    :param plan: the :class:`Plan`
    :param which: which case, from 0
    :param chunk: which chunk, from 0
    :returns: the time to form [s], NaN where it did not, ``(m,)``; and the chirality, ``(m,)``
    """
    import numpy as np

    from tetra_ros2.formation import batch, measures, rotation
    from tetra_ros2.formation.shapes import known_shape
    case = plan.cases[which]
    formation = case.formation()
    topology, gain = formation.topology, formation.gain
    gamma = rotation.rotate(plan.attitudes(chunk, topology.n), formation.pointing_axes)
    h = round(1e9 / case.parameters['rate']) / 1e9  # the plant counts nanoseconds
    formed, gamma = batch.fastest(gain, topology.n)(
        gamma, topology.weights, gain, known_shape(topology).angles, plan.tolerance, h,
        math.ceil(plan.longest / h), math.ceil(plan.hold / h))
    times = np.where(formed == batch.NEVER, np.nan, formed * h)
    handed = measures.chirality(gamma) if topology.n == 4 else np.zeros(len(gamma))
    return times, handed.astype(np.int8)


def _prepare(directory, plan, form, resume):
    """
    Make the directory of a new study, or look whether the one there is the same.

    :raises ConfigurationError: if it cannot be written, or is another one's
    """
    from tetra_ros2.config.parameters import ConfigurationError
    description = directory / 'study.json'
    if resume:
        try:
            before = json.loads(description.read_text(encoding='utf-8'))['plan']
        except (OSError, ValueError, KeyError):
            raise ConfigurationError(
                f'there is no study in {directory}', key='--resume') from None
        now = json.loads(json.dumps(plan.document()))
        for key in now:
            if before.get(key) != now[key]:
                raise ConfigurationError(
                    f'the study in {directory} is another one: its {key} differs',
                    key='--resume')
    elif directory.exists():
        raise ConfigurationError(
            f'{directory} exists already; take another, or --resume', key='--out')
    try:
        (directory / 'parts').mkdir(parents=True, exist_ok=True)
        _write(description, _text({'plan': plan.document(), 'format': form}))
    except OSError as error:
        raise ConfigurationError(
            f'{directory} cannot be written: {error.strerror}', key='--out') from None


def _part(directory, which, chunk):
    return directory / 'parts' / f'{which}_{chunk}.npz'


def _missing(directory, plan):
    """Return the (case, chunk) that are not done, all cases of a chunk before the next chunk."""
    # In this order the time that is left can be told from the time that it took so far.
    return [(which, chunk) for chunk in range(plan.chunks) for which in range(len(plan.cases))
            if not _part(directory, which, chunk).is_file()]


def _compute(executor, width, plan, directory, todo, quiet):
    """Have all chunks computed, and keep each one as it comes."""
    from concurrent.futures import FIRST_COMPLETED, wait
    import io

    import numpy as np

    waiting, under_way = iter(todo), {}

    def submit():
        for which, chunk in waiting:
            future = executor.submit(run_chunk, plan, which, chunk)
            under_way[future] = which, chunk
            return

    total = plan.chunks * len(plan.cases)
    with _progress(total, total - len(todo), quiet) as advance:
        for _ in range(width):
            submit()
        while under_way:
            done, _ = wait(under_way, return_when=FIRST_COMPLETED)
            for future in done:
                which, chunk = under_way.pop(future)
                times, handed = future.result()
                content = io.BytesIO()
                np.savez(content, times=times, chirality=handed)
                _write(_part(directory, which, chunk), content.getvalue())
                advance()
                submit()


@contextmanager
def _progress(total, done, quiet):
    """Yield a function to call when a part is done; on a terminal it moves a bar."""
    from rich.console import Console
    from rich.progress import (
        BarColumn,
        MofNCompleteColumn,
        Progress,
        TextColumn,
        TimeElapsedColumn,
        TimeRemainingColumn,
    )
    console = Console(stderr=True)
    if quiet or not console.is_terminal:
        yield lambda: None
        return
    with Progress(
            TextColumn('study'), BarColumn(), MofNCompleteColumn(), TimeElapsedColumn(),
            TextColumn('left'), TimeRemainingColumn(), console=console) as bar:
        task = bar.add_task('', total=total, completed=done)
        yield lambda: bar.advance(task)


def _write(path, content):
    """Write a file as a whole or not at all."""
    temporary = path.with_name(f'.{path.name}.tmp')
    temporary.write_bytes(content)
    temporary.replace(path)


def _text(document):
    return (json.dumps(document, indent=2, allow_nan=False) + '\n').encode()


def _conclude(directory, plan, form, worst):
    """Put the parts together, write the results, and return the summary."""
    import numpy as np

    columns = {'case': [], 'start': [], 'time_to_form': [], 'chirality': []}
    summary = {'plan': plan.document(), 'format': form, 'cases': []}
    replays = {}
    for which, case in enumerate(plan.cases):
        parts = [np.load(_part(directory, which, chunk)) for chunk in range(plan.chunks)]
        times = np.concatenate([part['times'] for part in parts])
        columns['case'].append(np.full(plan.starts, which, dtype=np.int16))
        columns['start'].append(np.arange(plan.starts))
        columns['time_to_form'].append(times)
        columns['chirality'].append(np.concatenate([part['chirality'] for part in parts]))
        slowest = np.argsort(-np.where(np.isnan(times), np.inf, times), kind='stable')[:worst]
        for place, start in enumerate(slowest.tolist(), 1):
            name = f'worst/{case.name}_{place}.yaml'
            replays[name] = _replay(plan, case, start, times[start])
        summary['cases'].append(_summarize(case, times, slowest))
    columns = {name: np.concatenate(values) for name, values in columns.items()}
    names = [case.name for case in plan.cases]
    if form == 'parquet':
        _write(directory / 'results.parquet', _parquet(columns, names, plan))
    else:
        _write(directory / 'results.csv', _csv(columns, names))
    (directory / 'worst').mkdir(exist_ok=True)
    for name, text in replays.items():
        _write(directory / name, text.encode())
    _write(directory / 'study.json', _text(summary))
    shutil.rmtree(directory / 'parts')
    return summary


def _summarize(case, times, slowest):
    """Return what became of the starts of a case, as plain values."""
    import numpy as np

    from tetra_ros2.study.confidence import lower_bound
    formed = times[~np.isnan(times)]
    edges = np.linspace(0.0, formed.max(), 41) if len(formed) else np.zeros(0)
    counts = np.histogram(formed, edges)[0] if len(formed) else np.zeros(0, dtype=int)
    quantiles = np.quantile(formed, QUANTILES) if len(formed) else []
    return {
        'name': case.name,
        'starts': len(times),
        'formed': len(formed),
        'fraction': len(formed) / len(times),
        'fraction_above_with_95_percent': lower_bound(len(formed), len(times)),
        'time_to_form': {f'{q:g}': float(t) for q, t in zip(QUANTILES, quantiles)},
        'histogram': {'edges': edges.tolist(), 'counts': counts.tolist()},
        'worst': [{'start': int(start), 'time_to_form': None if math.isnan(times[start])
                   else float(times[start])} for start in slowest],
    }


def _replay(plan, case, start, time):
    """Return a configuration with which the launcher repeats a start."""
    import yaml
    chunk, place = divmod(start, plan.chunk)
    attitudes = plan.attitudes(chunk, case.formation().topology.n)[place]
    shared = {k: v for k, v in case.parameters.items() if k != 'rate'}
    if not shared['topology.edges']:
        del shared['topology.edges']  # ROS 2 cannot tell the type of an empty list
    document = {
        '/**': {'ros__parameters': shared},
        '/**/plant': {'ros__parameters': {
            'mode': 'lockstep', 'rate': case.parameters['rate'],
            'initial_attitudes': attitudes.ravel().tolist()}}}
    outcome = 'did not form' if math.isnan(time) else f'formed after {time:.2f} s'
    return (f'# Start {start} of {case.name}, seed {plan.seed}: it {outcome}.\n'
            + yaml.safe_dump(document, sort_keys=False))


def _parquet(columns, names, plan):
    """Return the results as the bytes of a Parquet file that knows its plan."""
    import io

    import pyarrow
    from pyarrow import parquet
    case = pyarrow.DictionaryArray.from_arrays(columns['case'], names)
    table = pyarrow.table({
        'case': case, **{k: v for k, v in columns.items() if k != 'case'}})
    table = table.replace_schema_metadata({'tetra_ros2': json.dumps(plan.document())})
    content = io.BytesIO()
    parquet.write_table(table, content)
    return content.getvalue()


def _csv(columns, names):
    """Return the results as the bytes of a CSV file; ``study.json`` beside it has the plan."""
    lines = ['case,start,time_to_form,chirality']
    for case, start, time, handed in zip(*(values.tolist() for values in columns.values())):
        lines.append(f'{names[case]},{start},{"" if math.isnan(time) else repr(time)},{handed}')
    return ('\n'.join(lines) + '\n').encode()


def _print(summary, directory):
    from rich.console import Console
    from rich.table import Table
    from rich.text import Text
    console = Console(width=None if sys.stdout.isatty() else 120)
    table = Table()
    table.add_column('case')
    for heading in ('formed', 'of', 'chance above (95 %)', 'median [s]', '95 %', '99.9 %',
                    'slowest'):
        table.add_column(heading, justify='right')
    for case in summary['cases']:
        times = case['time_to_form']
        table.add_row(
            case['name'], f'{case["formed"]}', f'{case["starts"]}',
            f'{case["fraction_above_with_95_percent"]:.6%}',
            *(f'{times[q]:.2f}' if times else '-' for q in ('0.5', '0.95', '0.999', '1')))
    console.print(table)
    for case in summary['cases']:
        counts = case['histogram']['counts']
        if counts:
            bars = ''.join(' ▁▂▃▄▅▆▇█'[math.ceil(8 * c / max(counts))] for c in counts)
            console.print(Text(f'{case["name"]}: time to form, 0 to '
                               f'{case["histogram"]["edges"][-1]:.2f} s |{bars}|'))
    console.print(Text(f'results, slowest starts and summary are in {directory}'))
