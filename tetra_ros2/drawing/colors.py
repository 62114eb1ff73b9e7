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

"""Colours that tell agents apart, for everybody."""

AGENTS = ('#0072b2', '#d55e00', '#009e73', '#cc79a7', '#661111', '#442255',
          '#88bbff', '#0000cc', '#bbbb66', '#aa3311', '#005544', '#995577')
"""
One colour for each agent, from the first on; beyond the twelfth they begin anew.

The first four are Okabe's and Ito's; the others were searched for so that any two of all differ
by 12 or more (CIEDE2000) to people with normal sight and to those without one kind of cones, and
none of them vanishes on white.
"""

INK = '#24292f'
MUTED = '#6e7781'
SPHERE = '#eef2f6'
FACE = '#8c9bab'


DASHES = ((), (6.0, 2.0), (6.0, 2.0, 1.5, 2.0), (1.5, 1.5),
          (6.0, 1.5, 1.5, 1.5, 1.5, 1.5), (10.0, 3.0))
"""What tells lines apart in grey: for each, how long its dashes and gaps are in turn [points]."""

MARKERS = ('o', 's', '^', 'D', 'v', 'P', 'X')
"""And what tells points apart, as matplotlib names them."""


def agent(i: int) -> str:
    """Return the colour of agent i, from 1, as ``#rrggbb``."""
    return AGENTS[(i - 1) % len(AGENTS)]


def marker(i: int) -> int:
    """Return which kind of marker agent i has, from 0: agents of the same colour differ in it."""
    return (i - 1) // len(AGENTS)


def pair(index: int) -> str:
    """Return the colour of a pair of agents by its place in lexicographic order, from 0."""
    return AGENTS[index % len(AGENTS)]


def pair_dash(index: int) -> tuple[float, ...]:
    """Return the dashes of a pair's line: pairs of the same colour differ in them."""
    return DASHES[(index + index // len(AGENTS)) % len(DASHES)]


def rgb(color: str) -> tuple[int, int, int]:
    """Return the red, green and blue of ``#rrggbb``, from 0 to 255."""
    red, green, blue = (int(color[k:k + 2], 16) for k in (1, 3, 5))
    return red, green, blue


def unit_rgb(color: str) -> tuple[float, float, float]:
    """Return the red, green and blue of ``#rrggbb``, from 0 to 1."""
    red, green, blue = (value / 255.0 for value in rgb(color))
    return red, green, blue
