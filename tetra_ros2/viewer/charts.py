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

"""The charts beside the scene: uPlot, which viser brings along, so that no network is needed."""

import math
from typing import Any

import numpy as np
from numpy.typing import NDArray
from tetra_ros2.drawing import colors
from tetra_ros2.formation import measures, shapes
import viser
from viser import uplot

FLOOR = 1e-16
LINEAR = 0.1
"""The error below which it decays as the linearisation has it [rad]."""

MOST_PAIRS = 66
"""Pairs that are drawn one by one; of more, the smallest and the largest cosine."""

MOST_VALUES = 60_000
"""As many cosines as may be computed for a chart; of longer runs, every other state or so."""

HEIGHT = 190
"""Of each chart [px]: high enough for several marks on each axis."""

DECADES = (4, 8, 12, 16)
"""The error's axis reaches down to one of these negative powers of ten."""

_DIGITS = str.maketrans('-0123456789', '⁻⁰¹²³⁴⁵⁶⁷⁸⁹')
_FONT = '12px system-ui, sans-serif'


def _power(exponent: int) -> str:
    return '1' if not exponent else '10' + str(exponent).translate(_DIGITS)


def _theta(i: int, j: int) -> str:
    """Return the name of a pair's angle."""
    below = str.maketrans('0123456789', '₀₁₂₃₄₅₆₇₈₉')
    separator = ',' if max(i, j) > 9 else ''
    return f'cos θ{str(i).translate(below)}{separator}{str(j).translate(below)}'


def _axes(splits: tuple[float, ...], values: tuple[str, ...]) -> tuple[uplot.Axis, ...]:
    # No colours: the page has those that can be seen on it, light or dark.
    line = uplot.Axis(font=_FONT, labelFont=_FONT)
    return (uplot.Axis(**line, size=34, label='time [s]', labelSize=18, space=50),
            uplot.Axis(**line, size=52, space=28, splits=splits, values=values))


class Charts:
    """
    Cosines with their targets, and the error with its predicted slope.

    :param gui: a viser server's ``gui``
    :param container: the handle of the folder to put them into
    """

    def __init__(self, gui: viser.GuiApi, container: viser.GuiFolderHandle) -> None:
        self._gui, self._container = gui, container
        self._n: int | None = None
        self._targets: tuple[float, ...] = ()
        self._decades = DECADES[0]
        self._cosines: Any = None
        self._error: Any = None

    def hide(self) -> None:
        """Take the charts away, as there is nothing to put in them."""
        for chart in (self._cosines, self._error):
            if chart is not None:
                chart.remove()
        self._cosines = self._error = self._n = None

    def _make(self, n: int, targets: tuple[float, ...]) -> None:
        self.hide()
        self._n, self._targets, self._decades = n, targets, DECADES[0]
        pairs = measures.pairs(n)
        labels = [_theta(i, j) for i, j in pairs] if len(pairs) <= MOST_PAIRS \
            else ['smallest', 'largest']
        nothing = np.zeros(2)
        series = [uplot.Series(label='time [s]')]
        series += [uplot.Series(label=label, stroke=colors.pair(k), width=1.5,
                                dash=colors.pair_dash(k)) for k, label in enumerate(labels)]
        series += [uplot.Series(label=f'target {value:.4g}', stroke=colors.MUTED, width=1.5,
                                dash=(6, 4)) for value in targets]
        common: dict[str, Any] = {
            'height': HEIGHT, 'cursor': uplot.Cursor(show=False), 'padding': (8, 12, 0, 0)}
        self._cosines = self._gui.add_uplot(
            (nothing,) * len(series), tuple(series), title='cosines of the pairwise angles',
            legend=uplot.Legend(show=len(labels) <= 6, live=False), axes=_axes(
                splits=(-1.0, -0.5, 0.0, 0.5, 1.0), values=('-1', '-0.5', '0', '0.5', '1')),
            scales={'x': uplot.Scale(time=False), 'y': uplot.Scale(range=(-1.05, 1.05))},
            **common)
        self._error = self._gui.add_uplot(
            (nothing, np.ones(2), np.ones(2)),
            (uplot.Series(label='time [s]'),
             uplot.Series(label='predicted slope', stroke=colors.AGENTS[1], width=2,
                          dash=(6, 4)),
             uplot.Series(label='error', stroke=colors.AGENTS[0], width=2)),
            title='error [rad]', visible=bool(targets),
            legend=uplot.Legend(show=True, live=False), axes=self._error_axes(),
            scales=self._error_scales(), **common)

    def _error_axes(self) -> tuple[uplot.Axis, ...]:
        marks = range(-self._decades, 1, self._decades // 4)
        return _axes(splits=tuple(map(float, marks)), values=tuple(map(_power, marks)))

    def _error_scales(self) -> dict[str, uplot.Scale]:
        return {'x': uplot.Scale(time=False), 'y': uplot.Scale(range=(-self._decades - 0.2, 0.6))}

    def draw(self, times: NDArray[np.float64], gamma: NDArray[np.float64],
             error: NDArray[np.float64], shape: shapes.Shape | None, rate: float | None) -> None:
        """
        Show the recent past.

        :param times: [s], ``(k,)``
        :param gamma: reduced attitudes, ``(k, n, 3)``
        :param error: [rad], ``(k,)``
        :param shape: the shape that is to come out, or None
        :param rate: at which theory lets the error decay in the end [1/s], or None
        """
        targets = () if shape is None else tuple(
            np.unique(np.round(np.cos(shape.angles), 6)).tolist())
        if len(times) < 2:
            return
        if (gamma.shape[1], targets) != (self._n, self._targets):
            with self._container:
                self._make(gamma.shape[1], targets)
        cosines = measures.pairwise_cosines(gamma).T
        if len(cosines) > MOST_PAIRS:
            cosines = np.array([cosines.min(axis=0), cosines.max(axis=0)])
        self._cosines.data = (
            times, *cosines, *(np.full(len(times), target) for target in targets))
        shown = np.maximum(error, FLOOR)
        deepest = -math.log10(float(np.min(shown)))
        decades = next((d for d in DECADES if d >= deepest), DECADES[-1])
        if decades != self._decades:
            self._decades = decades
            self._error.axes, self._error.scales = self._error_axes(), self._error_scales()
        self._error.data = (times, np.log10(slope(times, shown, rate)), np.log10(shown))


def slope(times: NDArray[np.float64], error: NDArray[np.float64],
          rate: float | None) -> NDArray[np.float64]:
    """Return a line of the predicted slope beside the error; the error itself elsewhere."""
    # And under it: uPlot could not show a series with gaps of NaN.
    line: NDArray[np.float64] = error.copy()
    large = np.flatnonzero(error > LINEAR)
    first = int(large[-1]) + 1 if len(large) else 0
    # A history that begins when all is over has no decay to compare with.
    if rate is not None and first < len(times) and error[first] > 3.0 * np.min(error[first:]):
        decayed = 2.0 * error[first] * np.exp(-rate * (times[first:] - times[first]))
        line[first:] = np.where(decayed > 0.5 * max(np.min(error), FLOOR), decayed, error[first:])
    return line
