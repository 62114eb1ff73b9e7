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

"""Agents and lines are told apart by everybody: with any sight, on white, and in grey."""

import itertools

import numpy as np
import pytest
from tetra_ros2.drawing import colors, style
from tetra_ros2.viewer.rig import TIPS

MACHADO = {
    'normal': np.eye(3),
    'protanope': [[.152286, 1.052583, -.204868], [.114503, .786281, .099216],
                  [-.003882, -.048116, 1.051998]],
    'deuteranope': [[.367322, .860646, -.227968], [.280085, .672501, .047413],
                    [-.011820, .042940, .968881]],
    'tritanope': [[1.255528, -.076749, -.178779], [-.078411, .930809, .147602],
                  [.004733, .691367, .303900]],
}
"""How linear RGB looks to whom; Machado, Oliveira, Fernandes 2009, severity 1."""


def lab(color, sight):
    """Return CIE L*a*b* (D65) of a colour as somebody sees it."""
    c = np.array(colors.unit_rgb(color))
    linear = np.where(c <= 0.04045, c / 12.92, ((c + 0.055) / 1.055) ** 2.4)
    linear = np.clip(np.array(MACHADO[sight]) @ linear, 0.0, 1.0)
    xyz = np.array([[.4124564, .3575761, .1804375], [.2126729, .7151522, .0721750],
                    [.0193339, .1191920, .9503041]]) @ linear / [.95047, 1.0, 1.08883]
    f = np.where(xyz > 216 / 24389, np.cbrt(xyz), (24389 / 27 * xyz + 16) / 116)
    return np.array([116 * f[1] - 16, 500 * (f[0] - f[1]), 200 * (f[1] - f[2])])


@pytest.mark.parametrize('sight', MACHADO)
def test_twelve_agents_are_told_apart_by_everybody(sight):
    seen = np.array([lab(color, sight) for color in (*colors.AGENTS, '#ffffff')])
    distances = np.linalg.norm(seen[:, None] - seen[None], axis=-1)
    closest = np.min(distances[~np.eye(len(seen), dtype=bool)])
    assert closest > 12.0, 'CIE76; 2.3 is just noticeable'


@pytest.mark.parametrize('sight', MACHADO)
def test_twenty_agents_are_told_apart_by_colour_or_by_what_is_on_their_tip(sight):
    looks = [(lab(colors.agent(i), sight), colors.marker(i) % len(TIPS)) for i in range(1, 21)]
    for (a, tip), (b, other) in itertools.combinations(looks, 2):
        assert tip != other or np.linalg.norm(a - b) > 12.0
    lines = [(lab(colors.agent(i), sight), str(style.agent(i)['linestyle']), style.marker(i))
             for i in range(1, 21)]
    for (a, *look), (b, *other) in itertools.combinations(lines, 2):
        assert look != other, 'in grey the dashes and the markers have to do'
        assert np.linalg.norm(a - b) > 12.0 or look[0] != other[0] or look[1] != other[1]


def test_lines_of_twenty_agents_differ_in_grey_and_so_do_those_of_six_pairs():
    agents = {(str(look['linestyle']), look['marker']) for look in map(style.agent, range(1, 21))}
    assert len(agents) == 20
    assert len({str(style.pair(k)['linestyle']) for k in range(6)}) == 6
    pairs = {(style.pair(k)['color'], str(style.pair(k)['linestyle'])) for k in range(66)}
    assert len(pairs) == 66, 'twelve agents'


@pytest.mark.parametrize('points', [1, 5, 40, 1500])
def test_markers_of_different_lines_lie_at_different_places(points):
    places = []
    for index in range(4):
        start, step = style.marks(index, points)
        assert 0 <= start < step
        places.append(tuple(range(start, points, step)))
        assert len(places[-1]) <= 2 * 7
    if points > 100:
        assert len(set(places)) == 4


def test_figures_of_the_paper_and_of_recordings_have_one_style():
    from tetra_ros2.paper import figures
    from tetra_ros2.recording import plot
    for i, (color, line, marker) in enumerate(figures.AGENTS, start=1):
        assert style.agent(i) == {'color': color, 'linestyle': line, 'marker': marker}
    assert style.RC.items() <= plot.STYLE.items()
