# Copyright 2026 The tetra_ros2 authors
# SPDX-License-Identifier: Apache-2.0

"""The charts beside the scene: uPlot, which viser brings along, so that no network is needed."""

import numpy as np
from viser import uplot

from tetra_ros2.drawing import colors
from tetra_ros2.formation import measures
from tetra_ros2.viewer.history import LINEAR

FLOOR = 1e-16
MOST_PAIRS = 66
"""Pairs that are drawn one by one; of more, the smallest and the largest cosine."""

HEIGHT = 106
"""Of each chart [px]: both are seen at once on a page of 800."""


def _axes():
    line = {'stroke': colors.INK, 'grid': {'stroke': '#e3e7eb', 'width': 1},
            'font': '12px system-ui, sans-serif', 'ticks': {'stroke': '#e3e7eb', 'width': 1}}
    return (uplot.Axis(**line, size=36), uplot.Axis(**line, size=62))


class Charts:
    """
    Cosines with their targets, and the error with its predicted slope.

    :param gui: a viser server's ``gui``
    :param container: the handle of the folder to put them into
    """

    def __init__(self, gui, container):
        self._gui, self._container = gui, container
        self._n = self._targets = None
        self._cosines = self._error = None

    def _make(self, n, targets):
        for chart in (self._cosines, self._error):
            if chart is not None:
                chart.remove()
        self._n, self._targets = n, targets
        pairs = measures.pairs(n)
        labels = [f'{i} {j}' for i, j in pairs] if len(pairs) <= MOST_PAIRS else ['min', 'max']
        nothing = np.zeros(2)
        series = [uplot.Series(label='time [s]')]
        series += [uplot.Series(label=label, stroke=colors.pair(k), width=1.5)
                   for k, label in enumerate(labels)]
        series += [uplot.Series(label=f'target {value:.4g}', stroke=colors.INK, width=1,
                                dash=(6, 4)) for value in targets]
        common = {'scales': {'x': uplot.Scale(time=False)}, 'axes': _axes(), 'height': HEIGHT,
                  'cursor': uplot.Cursor(show=False), 'padding': (8, 12, 0, 0)}
        self._cosines = self._gui.add_uplot(
            (nothing,) * len(series), tuple(series), title='cosines of the pairwise angles',
            legend=uplot.Legend(show=len(pairs) <= 6, live=False),
            **{**common, 'scales': {'x': uplot.Scale(time=False),
                                    'y': uplot.Scale(range=(-1.05, 1.05))}})
        self._error = self._gui.add_uplot(
            (nothing, np.ones(2), np.ones(2)),
            (uplot.Series(label='time [s]'),
             uplot.Series(label='predicted slope', stroke=colors.AGENTS[1], width=2,
                          dash=(6, 4)),
             uplot.Series(label='error', stroke=colors.AGENTS[0], width=2)),
            title='error [rad], powers of ten', visible=bool(targets),
            legend=uplot.Legend(show=True, live=False),
            **{**common, 'scales': {'x': uplot.Scale(time=False),
                                    'y': uplot.Scale(auto=True)}})

    def draw(self, times, gamma, error, shape, rate):
        """
        Show the recent past.

        :param times: [s], ``(k,)``
        :param gamma: reduced attitudes, ``(k, n, 3)``
        :param error: [rad], ``(k,)``
        :param shape: the :class:`~tetra_ros2.formation.shapes.Shape` that is to come out, or None
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
            cosines = (cosines.min(axis=0), cosines.max(axis=0))
        self._cosines.data = (
            times, *cosines, *(np.full(len(times), target) for target in targets))
        shown = np.maximum(error, FLOOR)
        self._error.data = (times, np.log10(_slope(times, shown, rate)), np.log10(shown))


def _slope(times, error, rate):
    """Return a line of the predicted slope beside the error; the error itself elsewhere."""
    line = error.copy()  # and under it: uPlot could not show a series with gaps of NaN
    large = np.flatnonzero(error > LINEAR)
    first = large[-1] + 1 if len(large) else 0
    # A history that begins when all is over has no decay to compare with.
    if rate is not None and first < len(times) and error[first] > 3.0 * np.min(error[first:]):
        decayed = 2.0 * error[first] * np.exp(-rate * (times[first:] - times[first]))
        line[first:] = np.where(decayed > 0.5 * max(np.min(error), FLOOR), decayed, error[first:])
    return line
