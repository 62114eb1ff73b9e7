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

"""The paper's two simulation figures, from runs of the real nodes."""

from collections.abc import Sequence
from pathlib import Path
from typing import Any

import matplotlib
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.layout_engine import ConstrainedLayoutEngine
from matplotlib.lines import Line2D
import numpy as np
from tetra_ros2.drawing import style
from tetra_ros2.formation import flow, measures, sampling, shapes, stability
from tetra_ros2.paper.runs import NodeRun, run_nodes, slowest_rate
from tetra_ros2.paper.system import SystemUnderTest

DURATIONS = {('complete', 0): 8.0, ('complete', 1): 40.0,
             ('rotating', 0): 24.0, ('rotating', 1): 110.0}
"""Formation time of each run [s]: long enough to form, and to turn twice."""

NAMES = (r'$f_1(\theta) = 1 + \cos\theta$', r'$f_2(\theta) = e^{-\theta}$')

AGENTS = tuple((look['color'], look['linestyle'], look['marker'])
               for look in map(style.agent, range(1, 5)))
"""Colour, line and marker of each agent, those of every figure of this package."""

PAIRS = tuple((look['color'], look['linestyle']) for look in map(style.pair, range(6)))

VIEW = (-60.0, 22.0)
"""From where the sphere is seen: longitude and latitude [deg]."""


class Measured:
    """
    A run of the nodes, and the same motion by theory.

    Theory is the continuous closed loop from the same start, and its linearisation: the nodes
    sample it.

    :param graph: ``complete`` or ``rotating``
    :param which: of the paper's two gains, 0 or 1
    :param run: of the nodes, under these
    """

    def __init__(self, system: SystemUnderTest, graph: str, which: int, run: NodeRun):
        topology, gain = getattr(system, graph), system.gains[which]
        self.graph, self.which, self.run = graph, which, run
        self.cosines = measures.pairwise_cosines(run.gamma)
        self.theory = flow.reduced_attitudes(run.gamma[0], topology.weights, gain, run.times)
        spectrum = stability.transverse(
            shapes.TETRAHEDRON.points, topology.weights, gain).eigenvalues
        self.predicted_rate = float(-np.max(spectrum.real))
        there = sampling.sampled_equilibrium(run.gamma[-1], topology.weights, gain, run.h)
        self.sampled_rate = float(-np.log(abs(there.floquet_multipliers()[0])) / run.h)
        self.measured_rate = slowest_rate(run, topology, gain)
        self.measured_spin = float(run.angular_velocity(50) @ run.gamma[-1, 0])
        self.predicted_spin = float(shapes.predicted_angular_velocity(
            run.gamma[-1], topology, gain) @ run.gamma[-1, 0])

    def __str__(self) -> str:
        text = (f'{self.graph:<9} f{self.which + 1}  slowest rate {self.measured_rate:.4f} 1/s '
                f'measured, {self.predicted_rate:.4f} 1/s predicted, {self.sampled_rate:.4f} 1/s '
                'with sampling')
        if self.graph == 'rotating':
            text += (f'; spin {self.measured_spin:+.6f} rad/s measured, '
                     f'{self.predicted_spin:+.6f} rad/s predicted; one turn in '
                     f'{2 * np.pi / abs(self.measured_spin):.3f} s')
        return text


def measure(rate: float, seed: int) -> list[Measured]:
    """
    Run the nodes for both figures, and compute what theory says of each run.

    :param rate: of the loop [Hz]
    :param seed: of the initial attitudes
    """
    system = SystemUnderTest()
    return [Measured(system, graph, which, run_nodes(
        getattr(system, graph), system.gains[which], duration, rate=rate, seed=seed))
        for (graph, which), duration in DURATIONS.items()]


def draw(measured: Sequence[Measured], directory: Path) -> None:
    """
    Write both figures as PDF, SVG and PNG.

    :param measured: of :func:`measure`
    :param directory: that exists
    """
    with matplotlib.rc_context({
            **style.RC, 'font.size': 8, 'axes.titlesize': 8, 'lines.linewidth': 1.1,
            'legend.fontsize': 7, 'legend.handlelength': 2.6}):
        for graph, name, figure in (('complete', 'stationary', _stationary),
                                    ('rotating', 'rotating', _rotating)):
            _save(figure([m for m in measured if m.graph == graph]), directory, name)


def _project(points: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return where points of the sphere are seen, and how far in front they are."""
    longitude, latitude = np.radians(VIEW)
    right = np.array([-np.sin(longitude), np.cos(longitude), 0.0])
    up = np.array([-np.sin(latitude) * np.cos(longitude),
                   -np.sin(latitude) * np.sin(longitude), np.cos(latitude)])
    return points @ right, points @ up, points @ np.cross(right, up)


def _curve(axes: Axes, points: np.ndarray, **style: Any) -> None:
    """Draw a curve on the sphere: full in front, faint behind."""
    x, y, depth = _project(points)
    front = depth >= 0.0
    # Each part keeps one point of the other, so that no gap shows at the rim.
    for visible, factor in ((front, 1.0), (~front, 0.35)):
        wider = visible | np.r_[visible[1:], False] | np.r_[False, visible[:-1]]
        axes.plot(np.where(wider, x, np.nan), np.where(wider, y, np.nan),
                  **{**style, 'alpha': style.get('alpha', 1.0) * factor})


def _sphere(axes: Axes, result: Measured, letter: str) -> None:
    """Draw the trajectories on the sphere, start and end marked."""
    angle = np.linspace(0.0, 2.0 * np.pi, 361)
    axes.plot(np.cos(angle), np.sin(angle), color='0.4', linewidth=0.7)
    for latitude in np.radians((-60, -30, 0, 30, 60)):
        _curve(axes, np.stack([np.cos(latitude) * np.cos(angle), np.cos(latitude) * np.sin(angle),
                               np.full_like(angle, np.sin(latitude))], axis=-1),
               color='0.7', linewidth=0.35)
    for longitude in np.radians(np.arange(0, 180, 30)):
        circle = np.stack([np.sin(angle) * np.cos(longitude), np.sin(angle) * np.sin(longitude),
                           np.cos(angle)], axis=-1)
        _curve(axes, circle, color='0.7', linewidth=0.35)
    for i, (color, line, marker) in enumerate(AGENTS):
        _curve(axes, result.theory[:, i], **style.PREDICTION)
        _curve(axes, result.run.gamma[:, i], color=color, linestyle=line, linewidth=1.2)
        for index, face in ((0, 'white'), (-1, color)):
            x, y, depth = _project(result.run.gamma[index, i])
            axes.plot(x, y, marker=marker, markersize=5, markerfacecolor=face,
                      markeredgecolor=color, markeredgewidth=1.0,
                      alpha=1.0 if depth >= 0.0 else 0.5, linestyle='none', zorder=5)
    axes.set(aspect='equal', xlim=(-1.06, 1.06), ylim=(-1.06, 1.06))
    axes.axis('off')
    _title(axes, f'({letter}) trajectories with {NAMES[result.which]}')


def _title(axes: Axes, text: str) -> None:
    axes.set_title(text, loc='left')


def _agents_legend(figure: Figure) -> None:
    handles = [Line2D([], [], color=color, linestyle=line, marker=marker, markersize=4,
                      label=rf'$\Gamma_{i}$')
               for i, (color, line, marker) in enumerate(AGENTS, 1)]
    handles += [
        Line2D([], [], color='0.2', marker='o', markerfacecolor='white', linestyle='none',
               markersize=4, label='start'),
        Line2D([], [], color='0.2', marker='o', linestyle='none', markersize=4, label='end'),
        Line2D([], [], **style.PREDICTION, label='predicted')]
    figure.legend(handles=handles, loc='outside upper center', ncols=7, frameon=False)


def _figure() -> tuple[Figure, np.ndarray]:
    figure = Figure(
        figsize=(7.1, 7.6), layout=ConstrainedLayoutEngine(w_pad=0.06, h_pad=0.06))
    return figure, figure.subplots(3, 2, gridspec_kw={'height_ratios': (1.35, 1.0, 1.0)})


def _time_axis(axes: Axes, result: Measured) -> None:
    axes.set_xlabel('time [s]')
    axes.set_xlim(0.0, result.run.times[-1])
    axes.tick_params(width=0.6)


def _stationary(results: Sequence[Measured]) -> Figure:
    """Return the paper's Fig:Sim:SF, with the convergence below it."""
    figure, grid = _figure()
    for column, result in enumerate(results):
        _sphere(grid[0, column], result, 'ab'[column])
        axes = grid[1, column]
        predicted = measures.pairwise_cosines(result.theory)
        for pair, ((i, j), (color, line)) in enumerate(zip(measures.pairs(4), PAIRS)):
            axes.plot(result.run.times, predicted[:, pair], **style.PREDICTION)
            axes.plot(result.run.times, result.cosines[:, pair], color=color, linestyle=line,
                      label=f'{i}{j}')
        axes.axhline(-1.0 / 3.0, color='0.2', linewidth=0.5)
        axes.annotate(r'$-\frac{1}{3}$', (1.0, -1.0 / 3.0), xycoords=('axes fraction', 'data'),
                      xytext=(3, 0), textcoords='offset points', va='center')
        axes.set(ylim=(-1.05, 1.05), ylabel=r'$\cos\theta_{ij}$ [1]')
        axes.legend(ncols=3, title=r'$ij$', loc='upper right', frameon=False)
        _time_axis(axes, result)
        _title(axes, f'({"cd"[column]}) cosines of the geodesic distances, $f_{column + 1}$')
        _convergence(grid[2, column], result, 'ef'[column])
    _agents_legend(figure)
    return figure


def _convergence(axes: Axes, result: Measured, letter: str) -> None:
    """Draw the error over time beside the slope that the slowest eigenvalue predicts."""
    error = measures.shape_error(result.run.gamma, shapes.TETRAHEDRON.angles)
    times = result.run.times
    anchor = int(np.argmax(error < 1e-2))
    late = times >= times[anchor]
    axes.semilogy(times[late], error[anchor] * np.exp(
        -result.predicted_rate * (times[late] - times[anchor])), **style.PREDICTION)
    axes.semilogy(times, error, color='black')
    axes.set(ylim=(1e-10, 10.0), ylabel=r'$\max|\theta_{ij} - \theta^*|$ [rad]')
    axes.text(0.97, 0.93, f'slowest rate [1/s]\nmeasured {result.measured_rate:.4f}\n'
              f'predicted {result.predicted_rate:.4f}\n'
              f'sampled at {1.0 / result.run.h:g} Hz {result.sampled_rate:.4f}',
              transform=axes.transAxes, va='top', ha='right', fontsize=7)
    _time_axis(axes, result)
    _title(axes, f'({letter}) formation error, $f_{result.which + 1}$')


def _rotating(results: Sequence[Measured]) -> Figure:
    """Return the paper's Fig:Sim:RF, with the components for both gains."""
    figure, grid = _figure()
    grid[1, 0].remove()
    grid[1, 1].remove()
    grid[2, 0].remove()
    grid[2, 1].remove()
    lower = [grid[1, column].get_gridspec()[1:, column].subgridspec(3, 1, hspace=0.08)
             for column in (0, 1)]
    for column, result in enumerate(results):
        _sphere(grid[0, column], result, 'ab'[column])
        panels = []
        for component in range(3):
            axes = figure.add_subplot(lower[column][component])
            panels.append(axes)
            for i, (color, line, _) in enumerate(AGENTS):
                axes.plot(result.run.times, result.theory[:, i, component], **style.PREDICTION)
                axes.plot(result.run.times, result.run.gamma[:, i, component], color=color,
                          linestyle=line)
            axes.set(ylim=(-1.08, 1.08), ylabel=rf'$[\Gamma_i]_{component + 1}$ [1]')
            _time_axis(axes, result)
            if component < 2:
                axes.set_xlabel('')
                axes.tick_params(labelbottom=False)
        _title(panels[0],
               f'({"cd"[column]}) components of the reduced attitudes, $f_{column + 1}$')
        period = 2.0 * np.pi / abs(result.predicted_spin)
        end = result.run.times[-1]
        panels[2].annotate(
            '', (end - period, -1.3), (end, -1.3),
            arrowprops={'arrowstyle': '<->', 'linewidth': 0.7, 'shrinkA': 0, 'shrinkB': 0})
        panels[2].text(
            end, -1.42, f'one turn: {period:.2f} s predicted, '
            f'{2.0 * np.pi / abs(result.measured_spin):.2f} s measured ', ha='right', va='top',
            fontsize=6.5)
        panels[2].set_ylim(-1.85, 1.08)
    _agents_legend(figure)
    return figure


def _save(figure: Figure, directory: Path, name: str) -> None:
    """Write a figure as PDF, SVG and PNG, each as a whole or not at all."""
    for suffix, keywords in (('pdf', {'metadata': {'CreationDate': None}}),
                             ('svg', {'metadata': {'Date': None}}), ('png', {'dpi': 200})):
        temporary = directory / f'.{name}.tmp.{suffix}'
        try:
            figure.savefig(temporary, **keywords)
            temporary.replace(directory / f'{name}.{suffix}')
        finally:
            temporary.unlink(missing_ok=True)
