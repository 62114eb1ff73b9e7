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
Very many random starts, and what becomes of them.

The starts are cut into chunks of a fixed size. Each chunk has a random generator of its own, so
that the numbers do not depend on who computes which. A chunk that is done is a file in ``parts``:
an interrupted study goes on from there. The results are written when the last chunk is there.
"""

from collections.abc import Callable
from concurrent.futures import Executor, FIRST_COMPLETED, Future, wait
from dataclasses import dataclass
import io
import json
import math
from pathlib import Path
import shutil
from typing import Any

import numpy as np
from tetra_ros2.config.configuration import formation_from_parameters
from tetra_ros2.config.parameters import check_parameters, ConfigurationError
from tetra_ros2.formation import batch, Formation, measures, rotation, shapes
from tetra_ros2.formation.simulation import sample_time
from tetra_ros2.study.confidence import lower_bound
import yaml

CHUNK = 5000
"""Starts per task: some seconds of work, so that an interrupt costs no more than that."""

QUANTILES = (0.01, 0.05, 0.25, 0.5, 0.75, 0.95, 0.99, 0.999, 1.0)


@dataclass(frozen=True)
class Case:
    """
    A topology and a gain.

    :param name: for people and for file names
    :param parameters: of the formation, and the plant's rate, plain values
    """

    name: str
    parameters: dict[str, Any]

    def formation(self) -> Formation:
        """Return the :class:`~tetra_ros2.formation.Formation`."""
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

    cases: tuple[Case, ...]
    starts: int
    seed: int
    tolerance: float
    hold: float
    longest: float
    chunk: int = CHUNK

    @property
    def chunks(self) -> int:
        """Return how many chunks there are of each case."""
        return -(-self.starts // self.chunk)

    def attitudes(self, chunk: int, n: int) -> np.ndarray:
        """
        Return the initial attitudes of a chunk, uniform on SO(3)^n, ``(m, n, 4)``.

        :param chunk: which chunk, from 0
        :param n: number of agents
        """
        count = min(self.chunk, self.starts - chunk * self.chunk)
        return rotation.random(np.random.default_rng([self.seed, chunk]), (count, n))

    def document(self) -> dict[str, Any]:
        """Return it as plain values."""
        return {'cases': [{'name': case.name, 'parameters': case.parameters}
                          for case in self.cases],
                'starts': self.starts, 'seed': self.seed, 'tolerance': self.tolerance,
                'hold': self.hold, 'longest': self.longest, 'chunk': self.chunk}


def run_chunk(plan: Plan, which: int, chunk: int) -> tuple[np.ndarray, np.ndarray]:
    """
    Follow the starts of one chunk; this runs in a worker.

    :param plan: the :class:`Plan`
    :param which: which case, from 0
    :param chunk: which chunk, from 0
    :returns: the time to form [s], NaN where it did not, ``(m,)``; and the chirality, ``(m,)``
    """
    case = plan.cases[which]
    formation = case.formation()
    topology, gain = formation.topology, formation.gain
    gamma = rotation.rotate(plan.attitudes(chunk, topology.n), formation.pointing_axes)
    h = sample_time(case.parameters['rate'])
    shape, admissible = shapes.known_shape(topology), shapes.admissible_angles(topology)
    assert shape is not None  # a study of no known shape is refused before
    angles = measures.pairwise_angles(shape.points)
    labelled = admissible.is_complete and len(admissible.permutations) == 1
    formed, gamma = batch.fastest(gain, topology.n, labelled)(
        gamma, topology.weights, gain, angles if labelled else np.sort(angles), plan.tolerance, h,
        math.ceil(plan.longest / h), math.ceil(plan.hold / h), labelled)
    if not labelled:
        # Agents may change places. The right angles between the wrong ones are another shape.
        formed = np.where(admissible.errors(gamma) <= plan.tolerance, formed, batch.NEVER)
    times = np.where(formed == batch.NEVER, np.nan, formed * h)
    handed = np.array([shapes.chirality(points, topology) for points in gamma])
    return times, handed.astype(np.int8)


def prepare(directory: Path, plan: Plan, form: str, resume: bool) -> None:
    """
    Make the directory of a new study, or look whether the one there is the same.

    :raises ConfigurationError: if it cannot be written, or is another one's
    """
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


def _part(directory: Path, which: int, chunk: int) -> Path:
    return directory / 'parts' / f'{which}_{chunk}.npz'


def missing(directory: Path, plan: Plan) -> list[tuple[int, int]]:
    """Return the (case, chunk) that are not done, all cases of a chunk before the next chunk."""
    # In this order the time that is left can be told from the time that it took so far.
    return [(which, chunk) for chunk in range(plan.chunks) for which in range(len(plan.cases))
            if not _part(directory, which, chunk).is_file()]


def compute(executor: Executor, width: int, plan: Plan, directory: Path,
            todo: list[tuple[int, int]], advance: Callable[[], None]) -> None:
    """
    Have chunks computed, and keep each one as it comes.

    :param executor: a standard executor
    :param width: how many tasks to keep under way
    :param plan: the study
    :param directory: of the study
    :param todo: the (case, chunk) to compute
    :param advance: called when one is kept
    """
    waiting = iter(todo)
    under_way: dict[Future[tuple[np.ndarray, np.ndarray]], tuple[int, int]] = {}

    def submit() -> None:
        for which, chunk in waiting:
            future = executor.submit(run_chunk, plan, which, chunk)
            under_way[future] = which, chunk
            return

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


def _write(path: Path, content: bytes) -> None:
    """Write a file as a whole or not at all."""
    temporary = path.with_name(f'.{path.name}.tmp')
    temporary.write_bytes(content)
    temporary.replace(path)


def _text(document: dict[str, Any]) -> bytes:
    return (json.dumps(document, indent=2, allow_nan=False) + '\n').encode()


def conclude(directory: Path, plan: Plan, form: str, worst: int) -> dict[str, Any]:
    """
    Put the parts together, write the results, and return the summary as plain values.

    :param directory: of the study
    :param plan: the study
    :param form: of the results, ``parquet`` or ``csv``
    :param worst: how many of the slowest starts to keep as configurations
    """
    chunks: dict[str, list[np.ndarray]] = {
        'case': [], 'start': [], 'time_to_form': [], 'chirality': []}
    summary: dict[str, Any] = {'plan': plan.document(), 'format': form, 'cases': []}
    replays = {}
    for which, case in enumerate(plan.cases):
        parts = [np.load(_part(directory, which, chunk)) for chunk in range(plan.chunks)]
        times = np.concatenate([part['times'] for part in parts])
        chunks['case'].append(np.full(plan.starts, which, dtype=np.int16))
        chunks['start'].append(np.arange(plan.starts))
        chunks['time_to_form'].append(times)
        chunks['chirality'].append(np.concatenate([part['chirality'] for part in parts]))
        slowest = np.argsort(-np.where(np.isnan(times), np.inf, times), kind='stable')[:worst]
        for place, start in enumerate(slowest.tolist(), 1):
            name = f'worst/{case.name}_{place}.yaml'
            replays[name] = _replay(plan, case, start, times[start])
        summary['cases'].append(_summarize(case, times, slowest))
    columns = {name: np.concatenate(values) for name, values in chunks.items()}
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


def _summarize(case: Case, times: np.ndarray, slowest: np.ndarray) -> dict[str, Any]:
    """Return what became of the starts of a case, as plain values."""
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


def _replay(plan: Plan, case: Case, start: int, time: float) -> str:
    """Return a configuration with which the launcher repeats a start."""
    chunk, place = divmod(start, plan.chunk)
    attitudes = plan.attitudes(chunk, case.formation().topology.n)[place]
    # ROS 2 cannot tell the type of an empty list.
    shared = {k: v for k, v in case.parameters.items() if k != 'rate' and v != []}
    document = {
        '/**': {'ros__parameters': shared},
        '/**/plant': {'ros__parameters': {
            'mode': 'lockstep', 'rate': case.parameters['rate'],
            'initial_attitudes': attitudes.ravel().tolist()}}}
    outcome = 'did not form' if math.isnan(time) else f'formed after {time:.2f} s'
    return (f'# Start {start} of {case.name}, seed {plan.seed}: it {outcome}.\n'
            + yaml.safe_dump(document, sort_keys=False))


def _parquet(columns: dict[str, np.ndarray], names: list[str], plan: Plan) -> bytes:
    """Return the results as the bytes of a Parquet file that knows its plan."""
    import pyarrow  # it is optional
    from pyarrow import parquet
    case = pyarrow.DictionaryArray.from_arrays(columns['case'], names)
    table = pyarrow.table({
        'case': case, **{k: v for k, v in columns.items() if k != 'case'}})
    table = table.replace_schema_metadata({'tetra_ros2': json.dumps(plan.document())})
    content = io.BytesIO()
    parquet.write_table(table, content)
    return content.getvalue()


def _csv(columns: dict[str, np.ndarray], names: list[str]) -> bytes:
    """Return the results as the bytes of a CSV file; ``study.json`` beside it has the plan."""
    lines = ['case,start,time_to_form,chirality']
    for case, start, time, handed in zip(*(values.tolist() for values in columns.values())):
        lines.append(f'{names[case]},{start},{"" if math.isnan(time) else repr(time)},{handed}')
    return ('\n'.join(lines) + '\n').encode()
