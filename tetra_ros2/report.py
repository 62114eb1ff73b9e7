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

"""``tetra launcher``: run a formation, show how it goes, and say what came of it."""

import argparse
from collections import Counter
from collections.abc import Sequence
from dataclasses import asdict
import json
import math
from pathlib import Path
import sys
import time
from typing import Any

from rclpy.parameter import Parameter
from rich.console import Console
from rich.progress import BarColumn, Progress, TextColumn
from tetra_ros2 import signals
from tetra_ros2.config.parameters import ConfigurationError
from tetra_ros2.formation.summary import Spin, Summary
from tetra_ros2.launcher import Launcher, STALL_TIMEOUT
from tetra_ros2.nodes.plant import Plant
from tetra_ros2.ros.executor import keep_watch, spin_some, until_signalled

REFRESH_PERIOD = 0.1
"""How often the progress is drawn [s]."""

DURATION = 30.0
"""How long a formation runs if nobody says [s]."""

FOREVER = 9e8
"""As long as it runs if somebody looks on [s]."""


def main(arguments: argparse.Namespace, config: str | Path,
         ros_arguments: Sequence[str]) -> int:
    """
    Run a formation for a time.

    :param arguments: parsed arguments of ``tetra launcher``
    :param config: path of the configuration
    :param ros_arguments: arguments as after ``--ros-args``
    :returns: the exit status: 0 if it formed, 1 if it did not or could not be recorded, 130 if it
        was interrupted
    :raises ConfigurationError: if it was called wrongly; nothing was started then
    """
    duration = arguments.duration
    if duration is None:
        duration = FOREVER if arguments.view else DURATION
    if not 0.0 < duration < 1e9:
        raise ConfigurationError(
            f'{duration!r} is not valid, expected a time greater than 0',
            key='--duration')
    launcher = Launcher(
        config, seed=arguments.seed, mode=arguments.mode, body=arguments.body,
        namespace=arguments.namespace, record=arguments.record, storage=arguments.storage,
        without=arguments.without,
        view=(arguments.host, arguments.port, arguments.read_only) if arguments.view else None,
        ros_arguments=ros_arguments)
    with launcher, until_signalled(launcher.executor) as signalled:
        keep_watch(launcher.monitor, signalled)
        interrupt = signalled.future
        if arguments.view:
            _keep_pace(launcher.plant)
        begun = time.monotonic()
        with _Progress(launcher, duration, arguments.quiet or duration == FOREVER):
            try:
                complete = launcher.run_for(
                    duration, interrupt=interrupt,
                    stall_timeout=math.inf if arguments.view else STALL_TIMEOUT)
            except TimeoutError as error:
                print(f'tetra: error: {error}', file=sys.stderr)
                return 1
        wall_time = time.monotonic() - begun
        if launcher.viewer is not None:
            launcher.viewer.ended = True
        while arguments.view and not interrupt.done():
            spin_some(launcher.executor, interrupt)  # who looks may look on
        if not launcher.monitor.observer.count:
            return signals.INTERRUPTED
        summary = launcher.summary()
        complete = complete or arguments.view  # Ctrl-C is how looking ends
        if not complete:
            print(f'interrupted after {summary.duration:.2f} s', file=sys.stderr)
    if arguments.json:
        print(json.dumps(_document(summary, launcher, wall_time), indent=2, allow_nan=False))
    else:
        _print(describe(summary, launcher, wall_time))
    if launcher.recorder is not None and launcher.recorder.failure is not None:
        print(f'tetra: error: {launcher.recorder.path} could not be written to the end: '
              f'{launcher.recorder.failure}', file=sys.stderr)
        return signals.INTERRUPTED if not complete else 1
    if not complete:
        return signals.INTERRUPTED
    return 0 if summary.formed else 1


def _keep_pace(plant: Plant | None) -> None:
    """Let formation time pass as fast as time, unless the plant was given another pace."""
    if plant is not None and plant.mode == 'lockstep' \
            and not plant.get_parameter('real_time_factor').value:
        plant.set_parameters([Parameter('real_time_factor', value=1.0)])


class _Progress:
    """Show formation time and error while the launcher runs, on a terminal only."""

    def __init__(self, launcher: Launcher, duration: float, quiet: bool) -> None:
        self._launcher = launcher
        self._duration = duration
        self._console = Console(stderr=True)
        self._shown = not quiet and self._console.is_terminal

    def __enter__(self) -> None:
        if self._shown:
            self._bar = Progress(
                TextColumn('{task.completed:8.2f} s of {task.total:g} s'), BarColumn(),
                TextColumn('{task.fields[state]}'), console=self._console, transient=True,
                auto_refresh=False)
            self._task = self._bar.add_task('', total=self._duration, state='')
            self._bar.start()
            self._timer = self._launcher.monitor.create_steady_timer(REFRESH_PERIOD, self._show)

    def _show(self) -> None:
        observer = self._launcher.monitor.observer
        if observer.count:
            unit = 'rad' if observer.shape else 'rad/s'
            state = f'error {observer.error:.2e} {unit}'
            self._bar.update(self._task, completed=self._launcher.time, state=state, refresh=True)

    def __exit__(self, *_: object) -> None:
        if self._shown:
            self._timer.cancel()
            self._bar.stop()


def _print(rows: Sequence[tuple[str, str]]) -> None:
    for caption, text in rows:
        print(f'{caption:<10} {text}'.rstrip())


def _document(summary: Summary, launcher: Launcher, wall_time: float) -> Any:
    """Return the summary as a mapping of plain values; what is infinite is None in JSON."""
    topology, gain = launcher.formation.topology, launcher.formation.gain
    plant, recorder = launcher.plant, launcher.recorder
    return _finite({
        **asdict(summary),
        'agents': topology.n,
        'topology': {'kind': topology.kind, 'k': topology.axis_agent, 'p': topology.direction,
                     'edges': topology.edges},
        'gain': {'kind': gain.kind, 'a': gain.a, 'b': gain.b},
        'plant': plant and {'mode': plant.mode, 'rate': plant.rate, 'seed': plant.seed,
                            'steps': plant.stepper.steps},
        'rejected': dict(sum((node.health.rejected for node in launcher.nodes), Counter())),
        'wall_time': wall_time,
        'recording': recorder and {'path': str(recorder.path),
                                   'messages': sum(recorder.counts.values()),
                                   'failure': recorder.failure},
    })


def _finite(value: Any) -> Any:
    if isinstance(value, dict):
        return {key: _finite(item) for key, item in value.items()}
    if isinstance(value, (list, tuple)):
        return [_finite(item) for item in value]
    return None if isinstance(value, float) and not math.isfinite(value) else value


def describe(summary: Summary, launcher: Launcher,
             wall_time: float) -> list[tuple[str, str]]:
    """
    Return the lines of text that tell a person what a run came to.

    :param summary: a :class:`~tetra_ros2.formation.summary.Summary`
    :param launcher: the :class:`Launcher` that ran it
    :param wall_time: how long it took [s]
    :returns: pairs of a caption and a text
    """
    topology, gain = launcher.formation.topology, launcher.formation.gain
    kind = {'rotating': f'rotating, k = {topology.axis_agent}, p = {topology.direction}'}.get(
        topology.kind, topology.kind)
    rows = [('formation', f'{topology.n} agents, {kind}, {len(topology.edges)} edges; '
                          f'{gain.kind} gain, a = {gain.a:g}')]
    if launcher.plant is not None:
        rows.append(('plant', f'{launcher.plant.mode}, {launcher.plant.rate:g} Hz, '
                              f'{launcher.plant.start_description}'))
    goal = 'a shape at rest'
    if summary.shape is not None:
        goal = f'{"an" if summary.shape[0] in "aeiou" else "a"} {summary.shape}'
    rows.append(('formed', f'yes, {goal} after {summary.time_to_form:.2f} s' if summary.formed
                 else f'no, not {goal} within {summary.duration:.2f} s'))
    unit = 'rad' if summary.shape else 'rad/s'
    rows.append(('error', f'{summary.error:.3g} {unit} (tolerance {summary.tolerance:g})'))
    angles = [math.degrees(angle) for angle in summary.angles]
    rows.append(('angles', f'{min(angles):.4f} to {max(angles):.4f} deg between any two'))
    spins = summary.predicted is not None or topology.axis_name is not None
    if spins:
        rows.append(('', ''))
    for caption, spin in (('predicted', summary.predicted), ('measured', summary.measured)):
        if spin is not None and spins:
            rows.append((caption, _describe_spin(spin)))
    if summary.axis_drift is not None:
        rows.append(('axis', f'agent_{topology.axis_agent} itself moves at '
                             f'{summary.axis_drift:.2g} rad/s'))
    rejected = sum(node.health.rejected.total() for node in launcher.nodes)
    if rejected:
        rows.append(('rejected', f'{rejected} messages; see diagnostics'))
    since = ''
    if launcher.monitor.observer.restarts:
        since = f'{summary.duration:.2f} s since the last start; '
    rows.append(('time', f'{since}{launcher.time:.2f} s in {wall_time:.2f} s, '
                         f'{launcher.time / wall_time:.1f} times real time'))
    if launcher.recorder is not None:
        recorder = launcher.recorder
        messages = f'{sum(recorder.counts.values())} messages'
        if recorder.failure is not None:
            messages = f'cut off, less than {messages}'
        rows.append(('recording', f'{recorder.path}: {messages}'))
    return rows


def _describe_spin(spin: Spin) -> str:
    if math.isinf(spin.period):
        return 'at rest'
    text = f'{spin.rate:.6f} rad/s, one turn in {spin.period:.4f} s'
    if spin.about is not None:
        sense = {1: 'counter-clockwise', -1: 'clockwise', 0: 'not'}[spin.sense]
        text += f', {sense} about {spin.about}'
    return text
