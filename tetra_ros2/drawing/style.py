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

"""How every figure of this package looks, for a screen, in print and in grey."""

from typing import Any

from tetra_ros2.drawing import colors

RC: dict[Any, Any] = {
    'font.family': 'DejaVu Serif', 'mathtext.fontset': 'dejavuserif', 'axes.linewidth': 0.6,
    'axes.edgecolor': colors.INK, 'axes.labelcolor': colors.INK, 'text.color': colors.INK,
    'xtick.color': colors.INK, 'ytick.color': colors.INK, 'xtick.major.width': 0.6,
    'ytick.major.width': 0.6, 'lines.linewidth': 1.2, 'legend.frameon': False,
    'legend.handlelength': 2.8, 'pdf.fonttype': 42, 'svg.hashsalt': 'tetra'}
"""matplotlib's settings, but for the sizes of letters."""

PREDICTION: dict[str, Any] = {
    'color': '0.83', 'linewidth': 3.4, 'solid_capstyle': 'round', 'zorder': 1.9}
"""What theory says lies under what was measured, broad and pale."""

WITHOUT_DATE: dict[str, dict[str, Any]] = {
    'svg': {'Date': None}, 'pdf': {'CreationDate': None}, 'png': {}}
"""The same data make the same file."""


def _line(index: int) -> Any:
    """Return a line style of matplotlib's."""
    dash = colors.DASHES[index % len(colors.DASHES)]
    return (0, dash) if dash else '-'


def agent(i: int) -> dict[str, Any]:
    """Return colour, dashes and marker of agent i, from 1; no two of forty have the same."""
    return {'color': colors.agent(i), 'linestyle': _line(i - 1), 'marker': marker(i)}


def marker(i: int) -> str:
    """Return the marker of agent i, from 1, as matplotlib names it."""
    return colors.MARKERS[(i - 1) % len(colors.MARKERS)]


def pair(index: int) -> dict[str, Any]:
    """Return colour and dashes of a pair of agents by its place in lexicographic order."""
    dash = colors.pair_dash(index)
    return {'color': colors.pair(index), 'linestyle': (0, dash) if dash else '-'}


def marks(index: int, points: int, count: int = 7) -> tuple[int, int]:
    """Return where along a line its markers lie, for ``markevery``: not where others have them."""
    step = max(points // count, 1)
    return (index * step * 3 // 8) % step, step
