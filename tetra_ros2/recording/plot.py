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

"""The figures of a recording, with matplotlib."""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Iterable, Mapping, Sequence
from fractions import Fraction
from functools import cached_property
from pathlib import Path

from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.layout_engine import ConstrainedLayoutEngine
import numpy as np
from tetra_ros2.drawing import bodies, colors, style
from tetra_ros2.drawing import picture as drawing
from tetra_ros2.drawing.theory import recognize, Theory
from tetra_ros2.formation import measures
from tetra_ros2.formation._types import Array, JointLimits
from tetra_ros2.recording.joints import Joints
from tetra_ros2.recording.reader import Recording

POINTS = 1500
"""As many points of a line as a figure can show."""

FLOOR = 1e-16
"""The error below which there is nothing but rounding [rad]."""

AT_LIMIT = 1e-3
"""What is this near to a limit, relative to it, is at the limit."""

STYLE = {**style.RC, 'font.size': 9, 'axes.titlesize': 9, 'legend.fontsize': 8,
         'axes.spines.top': False, 'axes.spines.right': False, 'axes.grid': True,
         'grid.color': '#e3e7eb', 'grid.linewidth': 0.6}


class Run:
    """
    A recording and what follows from it, computed when it is asked for.

    :param recording: a :class:`~tetra_ros2.recording.reader.Recording`
    """

    def __init__(self, recording: Recording) -> None:
        self.recording = recording
        self.times, self.gamma, self.n = recording.times, recording.gamma, recording.n

        law = recording.law
        self.theory = Theory(self.n) if law is None else Theory(
            self.n, recognize(law.rounded, law.gain, self.gamma[-1]), law.gain, recording.period)
        self.shape = self.theory.shape
        self.edges = tuple((i, j, 1.0) for i, j in recording.edges) if law is None \
            else law.rounded.edges

    @cached_property
    def cosines(self) -> Array:
        """Return ``cos(theta_ij)`` for i < j, ``(k, n (n - 1) / 2)``."""
        return measures.pairwise_cosines(self.gamma)

    @cached_property
    def error(self) -> Array:
        """Return how far the worst pairwise angle is [rad], from the last where none is known."""
        return self.theory.error(self.gamma)

    @cached_property
    def predicted_rate(self) -> float | None:
        """Return the rate [1/s] at which theory lets the error decay in the end, or None."""
        return self.theory.rates[1]


def write(run: Run, name: str, directory: Path, formats: Iterable[str]) -> list[Path]:
    """
    Write one figure.

    :param run: a :class:`Run`
    :param name: which
    :param directory: an existing directory
    :param formats: of ``png``, ``svg`` and ``pdf``
    :returns: the paths that were written; none where there is nothing to show
    """
    from matplotlib import rc_context  # optional
    with rc_context(STYLE):
        figure = _FIGURES[name](run)
        if figure is None:
            return []
        paths = [directory / f'{name}.{suffix}' for suffix in formats]
        for path, suffix in zip(paths, formats, strict=True):
            figure.savefig(path, dpi=150, metadata=style.WITHOUT_DATE[suffix])
    return paths


def _axes() -> tuple[Figure, Axes]:
    figure = Figure(figsize=(8.0, 4.2), layout='constrained')
    return figure, figure.subplots()


def _thin(run: Run, values: Array) -> tuple[Array, Array]:
    """Return times and values, of which no more than a line can show."""
    step = -(-len(run.times) // POINTS)
    return run.times[::step], values[::step]


def _agent_line(axes: Axes, run: Run, values: Array, i: int) -> None:
    """Draw what belongs to an agent, with its colour, dashes and markers."""
    times, values = _thin(run, values)
    axes.plot(times, values, **style.agent(i), label=f'agent {i}', markersize=4,
              markeredgewidth=0.0, markevery=style.marks(i - 1, len(times)))


def _legend(axes: Axes, count: int) -> None:
    if count <= 24:
        axes.legend(loc='center left', bbox_to_anchor=(1.0, 0.5), labelspacing=0.4,
                    ncols=1 if count <= 12 else 2)


def _sphere(run: Run) -> Figure:
    figure = Figure(figsize=(5.4, 5.4))
    drawing.draw(figure.add_axes((0.0, 0.0, 1.0, 1.0)), run.times, run.gamma, run.edges)
    return figure


def _components(run: Run) -> Figure:
    figure = Figure(figsize=(8.0, 6.4), layout='constrained')
    rows = figure.subplots(3, 1, sharex=True)
    for component, axes in enumerate(rows):
        for i in range(1, run.n + 1):
            _agent_line(axes, run, run.gamma[:, i - 1, component], i)
        axes.set_ylim(-1.08, 1.08)
        axes.set_ylabel(rf'$[\Gamma_i]_{component + 1}$')
    _legend(rows[1], run.n)
    rows[-1].set_xlabel('time [s]')
    return figure


def _cosines(run: Run) -> Figure:
    figure, axes = _axes()
    pairs = measures.pairs(run.n)
    for index, (i, j) in enumerate(pairs):
        axes.plot(*_thin(run, run.cosines[:, index]), **style.pair(index),
                  label=rf'$\theta_{{{i}{j}}}$' if run.n < 10 else f'{i}, {j}')
    if run.shape is not None:
        targets = np.unique(np.round(np.cos(run.shape.angles), 9))
        for target in targets:
            axes.axhline(target, color=colors.INK, linewidth=0.5, zorder=1)
            fraction = Fraction(float(target)).limit_denominator(12)
            name = f'${fraction}$' if abs(fraction - target) < 1e-6 else f'${target:.4f}$'
            axes.annotate(f'target {name}', (run.times[-1], target), (0, 4),
                          textcoords='offset points', ha='right', fontsize=8)
    axes.set(ylim=(-1.08, 1.08), xlabel='time [s]', ylabel=r'$\cos\,\theta_{ij}$')
    _legend(axes, len(pairs))
    return figure


def _error(run: Run) -> Figure:
    figure, axes = _axes()
    if run.predicted_rate is not None and (anchor := _anchor(run)) is not None:
        rate, (since, size) = run.predicted_rate, anchor
        length = min(run.times[-1] - since, np.log(size / max(np.min(run.error), 1e-15)) / rate)
        axes.semilogy([since, since + length], [size, size * np.exp(-rate * length)],
                      **style.PREDICTION, label=f'predicted slope, ${-rate:.4g}$ 1/s')
    times, error = _thin(run, np.maximum(run.error, FLOOR))
    axes.semilogy(times, error, color=colors.INK, linewidth=1.4, label='measured')
    floor = run.theory.floor
    if floor is not None and run.theory.h is not None and floor > 1e-9:
        axes.axhline(floor, color=colors.AGENTS[1], linestyle=(0, (4, 3)), linewidth=1.0,
                     label=f'left by sampling at {1.0 / run.theory.h:.4g} Hz: {floor:.3g} rad')
    goal = f'from the {run.shape.name}' if run.shape is not None else 'from the last shape'
    axes.set(xlabel='time [s]', ylabel='error [rad]')
    axes.set_title(f'largest deviation of a pairwise angle {goal}', loc='left')
    axes.legend(loc='upper right')
    return figure


def _anchor(run: Run) -> tuple[float, float] | None:
    """Return time and size of the error when it last became small enough to be linear."""
    large = np.flatnonzero(run.error > 0.1)
    first = large[-1] + 1 if len(large) else 0
    return (run.times[first], run.error[first]) if first < len(run.times) else None


def _rates(run: Run) -> Figure | None:
    if not run.recording.commands:
        return None
    figure, axes = _axes()
    speeds = np.linalg.norm(run.recording.body_rates, axis=-1)
    for i in sorted(run.recording.commands):
        _agent_line(axes, run, speeds[:, i - 1], i)
    axes.set(xlabel='time [s]', ylabel=r'commanded rate $|\omega_i|$ [rad/s]')
    axes.set_ylim(bottom=0.0)
    _legend(axes, run.n)
    return figure


def _bodies(run: Run) -> Figure | None:
    """Return the formation with its bodies, where they are known to have joints."""
    if not run.recording.joints:
        return None
    figure = Figure(figsize=(6.4, 6.4))
    axes = figure.add_axes((0.0, 0.0, 1.0, 1.0))
    view = drawing.best_view(run.gamma[-1])
    drawing.draw(axes, run.times[-1:], run.gamma[-1:], run.edges, view=view, trail=0.0,
                 reach=bodies.REACH, labels=0.55)
    bodies.draw(axes, drawing.Camera(view), run.gamma[-1], run.recording.attitudes[-1],
                {i: (track.names, track.positions[-1])
                 for i, track in run.recording.joints.items()}, run.recording.limits)
    return figure


def _joints(run: Run) -> Figure | None:
    """Return a panel for each joint that has a range, one for speeds, and one for torques."""
    if not run.recording.joints:
        return None
    kinds = Counter(track.names for track in run.recording.joints.values())
    names = max(kinds, key=kinds.__getitem__)  # a panel cannot be of joints that most have not
    tracks = {i: track for i, track in run.recording.joints.items() if track.names == names}
    limits = {name: run.recording.limits.get(name, JointLimits()) for name in names}
    rows: list[tuple[str, str, Sequence[int]]] = [
        (f'{name} [rad]', 'positions', [k]) for k, name in enumerate(names)
        if name in (bodies.PAN, bodies.TILT) or np.isfinite(
            limits[name].high - limits[name].low)]
    rows += [('speed [rad/s]', 'velocities', range(len(names))),
             ('torque [N m]', 'efforts', range(len(names)))]
    rows = [row for row in rows if any(
        np.any(np.isfinite(getattr(track, row[1])[:, row[2]])) for track in tracks.values())]
    if not rows:
        return None
    # Long numbers push the labels out otherwise.
    figure = Figure(figsize=(8.0, 0.6 + 2.0 * len(rows)),
                    layout=ConstrainedLayoutEngine(w_pad=0.15))
    panels = np.atleast_1d(figure.subplots(len(rows), 1, sharex=True))
    for axes, (label, quantity, columns) in zip(panels, rows, strict=True):
        ends = _ends(limits, names, quantity, columns)
        _joint_panel(axes, run.recording.stamps[0], tracks, quantity, columns, ends)
        axes.set_ylabel(label)
    _legend(panels[len(panels) // 2], len(tracks))
    panels[-1].set_xlabel('time [s]')
    return figure


def _ends(limits: Mapping[str, JointLimits], names: Sequence[str], quantity: str,
          columns: Iterable[int]) -> tuple[float, float]:
    """Return the lower and the upper limit of some joints, the narrowest; infinite for none."""
    of = [limits[names[k]] for k in columns]
    if quantity == 'positions':
        return max(limit.low for limit in of), min(limit.high for limit in of)
    widest = min(limit.speed if quantity == 'velocities' else limit.torque for limit in of)
    return -widest, widest


def _joint_panel(axes: Axes, first: int, tracks: Mapping[int, Joints], quantity: str,
                 columns: Sequence[int], ends: tuple[float, float]) -> None:
    largest, at_limit, count = 0.0, 0, 0
    for i, track in sorted(tracks.items()):
        values = getattr(track, quantity)[:, columns]
        step = -(-len(values) // POINTS)
        axes.plot((track.stamps[::step] - first) / 1e9, values[::step], linewidth=1.0,
                  color=colors.agent(i), linestyle=style.agent(i)['linestyle'],
                  label=[f'agent {i}', *[None] * (values.shape[1] - 1)])
        largest = max(largest, float(np.nanmax(np.abs(values), initial=0.0)))
        reached = (values >= ends[1] - AT_LIMIT * abs(ends[1])) \
            | (values <= ends[0] + AT_LIMIT * abs(ends[0]))
        at_limit, count = at_limit + np.count_nonzero(reached.any(axis=1)), count + len(values)
    limit = max(map(abs, ends))
    if not np.isfinite(limit):
        axes.set_title('no limit is known', loc='left')
        return
    # Limits far away would make a flat line of what there is to see.
    if largest > 0.3 * limit:
        for end in ends:
            axes.axhline(end, color=bodies.AT_LIMIT, linestyle=(0, (4, 3)), linewidth=1.0)
    share = f', at a limit {100.0 * at_limit / count:.3g} % of the time' if at_limit else ''
    span = f'limit {limit:.4g}' if ends[0] == -ends[1] else f'limits {ends[0]:.4g}, {ends[1]:.4g}'
    axes.set_title(f'{span}; at most {largest:.3g}{share}', loc='left')


def _timing(run: Run) -> Figure | None:
    """Return panels for what there is: periods, their jitter, and the age of commands."""
    periods = np.diff(run.recording.stamps) / 1e6
    if not len(periods):
        return None
    typical = float(np.median(periods))
    jitter = np.abs(periods - typical)
    ages = {}
    for i in sorted(run.recording.commands):
        age = 1e3 * run.recording.ages(i)
        if np.any(np.isfinite(age)):
            ages[i] = np.sort(age[np.isfinite(age)])
    panels: list[Callable[[Axes], None]] = [lambda axes: _periods(axes, run, periods, typical)]
    if np.any(jitter > 1e-9):
        panels.append(lambda axes: _jitter(axes, jitter))
    if ages:
        panels.append(lambda axes: _ages(axes, run, ages))
    figure = Figure(figsize=(8.0, 0.6 + 2.0 * len(panels)), layout='constrained')
    for axes, panel in zip(np.atleast_1d(figure.subplots(len(panels), 1)), panels, strict=True):
        panel(axes)
    return figure


def _periods(axes: Axes, run: Run, periods: Array, typical: float) -> None:
    step = -(-len(periods) // (4 * POINTS))
    axes.plot(run.times[1:][::step], periods[::step], '.', color=colors.INK, markersize=2.5)
    axes.set(xlabel='time [s]', ylabel='period [ms]')
    same = ', every one the same to the nanosecond' if not np.ptp(periods) else ''
    axes.set_title(f'period of the state: median {typical:.4g} ms{same}', loc='left')
    axes.set_ylim(bottom=0.0)


def _jitter(axes: Axes, jitter: Array) -> None:
    ordered = np.sort(np.maximum(jitter, 1e-3))
    share = 1.0 - np.arange(len(ordered)) / len(ordered)
    step = -(-len(ordered) // POINTS)
    axes.loglog(ordered[::step], share[::step], color=colors.INK, linewidth=1.4)
    axes.set(xlabel='jitter, |period - median| [ms]', ylabel='share of periods above')
    axes.set_title(f'jitter: 99 % below {float(np.percentile(jitter, 99.0)):.3g} ms', loc='left')


def _ages(axes: Axes, run: Run, ages: Mapping[int, Array]) -> None:
    for i, ordered in ages.items():
        share = np.arange(1, len(ordered) + 1) / len(ordered)
        keep = np.unique(np.linspace(0, len(ordered) - 1, POINTS).astype(int))
        axes.step(np.concatenate([ordered[:1], ordered[keep]]),
                  np.concatenate([[0.0], share[keep]]), where='post', label=f'agent {i}',
                  **style.agent(i), markersize=4, markeredgewidth=0.0,
                  markevery=style.marks(i - 1, len(keep) + 1, 3))
    axes.set(xlabel='age of the newest command when the next state came [ms]',
             ylabel='share below', ylim=(-0.03, 1.03))
    axes.set_xlim(left=0.0)
    _legend(axes, run.n)


_FIGURES: dict[str, Callable[[Run], Figure | None]] = {
    'sphere': _sphere, 'components': _components, 'cosines': _cosines, 'error': _error,
    'rates': _rates, 'timing': _timing, 'bodies': _bodies, 'joints': _joints}
