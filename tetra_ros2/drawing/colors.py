# Copyright 2026 The tetra_ros2 authors
# SPDX-License-Identifier: Apache-2.0

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


def agent(i):
    """Return the colour of agent i, from 1, as ``#rrggbb``."""
    return AGENTS[(i - 1) % len(AGENTS)]


def marker(i):
    """Return which kind of marker agent i has, from 0: agents of the same colour differ in it."""
    return (i - 1) // len(AGENTS)


def pair(index):
    """Return the colour of a pair of agents by its place in lexicographic order, from 0."""
    return AGENTS[index % len(AGENTS)]


def rgb(color):
    """Return the red, green and blue of ``#rrggbb``, from 0 to 255."""
    return tuple(int(color[k:k + 2], 16) for k in (1, 3, 5))


def unit_rgb(color):
    """Return the red, green and blue of ``#rrggbb``, from 0 to 1."""
    return tuple(value / 255.0 for value in rgb(color))
