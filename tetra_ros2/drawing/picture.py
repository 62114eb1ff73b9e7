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
The formation on its sphere, drawn flat: pointing axes, trails, edges and the solid they span.

The projection is orthographic and done here, so that what lies behind the sphere can be drawn
as lying behind it.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from pathlib import Path
from typing import TYPE_CHECKING

from matplotlib.axes import Axes
from matplotlib.collections import LineCollection
from matplotlib.patches import Circle, FancyArrowPatch, Polygon
import numpy as np
from numpy.typing import ArrayLike
from tetra_ros2.drawing import colors, geometry, style
from tetra_ros2.formation import measures
from tetra_ros2.formation._types import Array

if TYPE_CHECKING:
    from PIL.Image import Image as Picture

View = tuple[float, float]
"""Longitude and latitude of the eye [deg]."""

Edge = tuple[int, int, float]
"""Agent j, from 1, whom agent i sees, and how much it counts: i, j, weight."""

LATITUDES = (16.0, 24.0, 32.0)
"""From how far above the equator one may look [deg]: enough to see that it is a sphere."""

LIGHT = np.array([-0.45, 0.65, 0.6])
"""Where the light comes from, in the picture: x, y, and towards the eye."""

REACH = 1.24
"""How far the picture goes from the middle of the unit sphere."""

TRAIL = 400
"""Points of a trail; more cannot be told apart."""

MANY_EDGES = 64
"""From so many on, arrows would hide what they connect, and are not drawn."""

FRAMES_PER_SECOND = 16
WHITE = 95
"""Index of white in the palette of a moving picture, and how many other colours it has."""

MOVIE_FRAMES = 110
"""As many frames as make a moving picture that a page can bear."""


class Camera:
    """An orthographic projection: two coordinates in the picture, and one towards the eye."""

    def __init__(self, view: View) -> None:
        longitude, latitude = np.radians(view)
        toward = np.array([np.cos(latitude) * np.cos(longitude),
                           np.cos(latitude) * np.sin(longitude), np.sin(latitude)])
        right = np.array([-np.sin(longitude), np.cos(longitude), 0.0])
        self._matrix = np.stack([right, np.cross(toward, right), toward], axis=-1)

    def __call__(self, points: ArrayLike) -> Array:
        """Return points in the world, ``(..., 3)``, as seen: x, y, and depth towards the eye."""
        seen: Array = np.asarray(points) @ self._matrix
        return seen


def best_view(gamma: ArrayLike) -> View:
    """
    Return where to look from so that no axis hides another, nor points at the eye.

    :param gamma: reduced attitudes at one or several times, ``(..., n, 3)``
    :returns: longitude and latitude of the eye [deg]
    """
    points = np.asarray(gamma).reshape(-1, *np.shape(gamma)[-2:])
    # The origin counts as one of them: an axis that points at the eye covers it.
    ends = np.concatenate([points, np.zeros_like(points[:, :1])], axis=1)
    i, j = np.triu_indices(ends.shape[1], k=1)

    def clearance(view: View) -> float:
        see = Camera(view)
        seen, opposite = see(ends)[..., :2], -see(points)[..., :2]
        apart = np.linalg.norm(seen[:, i] - seen[:, j], axis=-1)
        # Two axes in one line look like one. Opposite agents always do, from everywhere.
        in_line = np.linalg.norm(seen[:, :-1, None] - opposite[:, None], axis=-1)
        return float(np.mean(np.min(apart, axis=1) + np.min(in_line, axis=(1, 2))))

    views = [(longitude, latitude) for latitude in LATITUDES
             for longitude in np.arange(0.0, 360.0, 7.5)]
    return max(views, key=clearance)


def trail_time(times: Array, gamma: Array) -> float | None:
    """Return how long a trail tells most [s]: a third of a turn where the formation spins."""
    last = max(2, len(times) // 20)
    if len(times) < last or times[-1] == times[-last]:
        return None
    moved = measures.mean_angular_velocity(gamma[-2], gamma[-1], times[-1] - times[-2])
    rate = float(np.linalg.norm(moved))
    return 2.0 * np.pi / rate / 3.0 if rate > 1e-2 else None


def draw(axes: Axes, times: Array, gamma: Array, edges: Sequence[Edge] = (), *,
         trail: float | None = None, clock: bool = False, view: View | None = None,
         reach: float = REACH, labels: float = 0.15) -> None:
    """
    Draw the last of a number of states, and the way it came.

    :param axes: matplotlib's
    :param times: of the states [s], ``(k,)``
    :param gamma: reduced attitudes, ``(k, n, 3)``
    :param edges: (i, j, weight) for each j that agent i sees, from 1
    :param trail: for how long the trails reach back [s]; by default to the start
    :param clock: whether to write the time
    :param view: longitude and latitude of the eye [deg]; by default the clearest
    :param reach: how far the picture goes from the middle of the unit sphere
    :param labels: how far the names of the axes are from their ends
    """
    see = Camera(best_view(gamma[-1]) if view is None else view)
    n = gamma.shape[1]
    first = 0 if trail is None else int(np.searchsorted(times, times[-1] - trail))
    chosen = np.unique(np.linspace(first, len(times) - 1, TRAIL).astype(int))
    way, now = gamma[chosen], gamma[-1]

    axes.set(xlim=(-reach, reach), ylim=(-reach, reach), aspect='equal')
    axes.axis('off')
    _ball(axes, see)
    for i in range(n):
        _trail(axes, see(way[:, i]), colors.agent(i + 1), whole=trail is None)
        if trail is None and len(way) > 1:
            _start(axes, see(way[0, i]), i + 1)
    _solid(axes, see, now)
    _edges(axes, see, now, edges)
    for i in np.argsort(see(now)[:, 2]):
        _agent(axes, see, now[i], int(i) + 1, 1.0 if n <= 6 else 0.65, labels)
    if clock:
        axes.text(-0.96 * reach, -0.96 * reach, f't = {times[-1] - times[0]:5.2f} s',
                  color=colors.MUTED, fontsize=11, family='monospace')


def _ball(axes: Axes, see: Camera) -> None:
    """Draw the sphere: a disc shaded towards its limb, and meridians where they can be seen."""
    for k, radius in enumerate(np.linspace(1.0, 0.05, 24)):
        shade = 0.88 + 0.1 * (k / 23.0) ** 0.6
        axes.add_patch(Circle((-0.25 * (1.0 - radius), 0.3 * (1.0 - radius)), radius,
                              facecolor=(shade, shade + 0.008, shade + 0.02), edgecolor='none',
                              zorder=0.0))
    axes.add_patch(Circle((0.0, 0.0), 1.0, fill=False, edgecolor='#b6c0ca', linewidth=1.2,
                          zorder=1.0))
    lines = see(geometry.graticule())
    segments = np.stack([lines[:, :-1], lines[:, 1:]], axis=2).reshape(-1, 2, 3)
    front = segments[:, :, 2].mean(axis=1) > 0.0
    axes.add_collection(LineCollection(
        list(segments[front, :, :2]), colors='#c5ced7', linewidths=0.7, zorder=0.5))


def _start(axes: Axes, seen: Array, i: int) -> None:
    """Mark where an agent began: its marker, hollow."""
    axes.plot(*seen[:2], marker=style.marker(i), markersize=6.0, markerfacecolor='white',
              markeredgecolor=colors.agent(i), markeredgewidth=1.2, linestyle='none',
              alpha=1.0 if seen[2] > 0.0 else 0.5, zorder=4.5 if seen[2] > 0.0 else 0.9)


def _trail(axes: Axes, seen: Array, color: str, whole: bool = False) -> None:
    """Draw a trail that fades towards its beginning, and shines through the sphere behind it."""
    segments = np.stack([seen[:-1], seen[1:]], axis=1)
    depth = segments[:, :, 2].mean(axis=1)
    age = np.linspace(0.0, 1.0, len(segments))
    for front in (False, True):
        part = (depth > 0.0) == front
        faintest = 0.5 if whole else 0.12
        opacity = (faintest + (1.0 - faintest) * age ** 1.5) * (1.0 if front else 0.28)
        rgba = np.concatenate([np.tile(colors.unit_rgb(color), (len(segments), 1)),
                               opacity[:, None]], axis=1)
        axes.add_collection(LineCollection(
            list(segments[part, :, :2]), colors=rgba[part], capstyle='butt',
            linewidths=2.4 if front else 1.6, zorder=4.0 if front else 0.8))


def _solid(axes: Axes, see: Camera, now: Array) -> None:
    gray = colors.unit_rgb(colors.FACE)
    seen = see(now)
    for face in geometry.polygons(now):
        corners = seen[list(face)]
        normal = np.cross(corners[1] - corners[0], corners[2] - corners[0])
        facing = normal[2]
        light = float(normal @ LIGHT) / np.linalg.norm(normal)
        axes.add_patch(Polygon(
            corners[:, :2], closed=True, facecolor=(*gray, 0.2 - 0.14 * light),
            edgecolor=(*gray, 0.75 if facing > 0.0 else 0.3), linewidth=1.0, joinstyle='round',
            zorder=2.0 if facing > 0.0 else 1.5))


def _edges(axes: Axes, see: Camera, now: Array, edges: Sequence[Edge]) -> None:
    """Draw who sees whom: an arrow from the one that looks, bowed so that two do not overlap."""
    if len(edges) >= MANY_EDGES:
        return
    seen = see(now)
    largest = max((abs(weight) for _, _, weight in edges), default=1.0)
    for i, j, weight in edges:
        ends = seen[[i - 1, j - 1], :2]
        axes.add_patch(FancyArrowPatch(
            *ends, connectionstyle='arc3,rad=0.09', arrowstyle='-|>', mutation_scale=9.0,
            shrinkA=9.0, shrinkB=11.0, linewidth=0.5 + 0.8 * abs(weight) / largest, zorder=2.5,
            color=(*colors.unit_rgb(colors.agent(i)), 0.6)))


def _agent(axes: Axes, see: Camera, direction: Array, i: int, size: float,
           label: float) -> None:
    tip = see(direction)
    front = tip[2] > 0.0
    color = colors.agent(i)
    axes.plot([0.0, tip[0]], [0.0, tip[1]], color=color, linewidth=2.4 if front else 1.8,
              alpha=1.0 if front else 0.55, zorder=3.0, solid_capstyle='round')
    axes.plot(*tip[:2], marker=style.marker(i), color=color,
              markersize=size * (10.5 if front else 8.0), markeredgecolor='white',
              markeredgewidth=1.2, alpha=1.0 if front else 0.75, zorder=5.0 + tip[2])
    # Outwards of the tip, and never on top of it when the axis points at the eye.
    distance = float(np.hypot(*tip[:2]))
    outward = tip[:2] / distance if distance > 0.2 else np.array([0.7, 0.7])
    axes.annotate(rf'$\Gamma_{{{i}}}$', tip[:2] + label * size ** 0.5 * outward, color=color,
                  fontsize=15 * size, ha='center', va='center', zorder=7.0,
                  alpha=1.0 if front else 0.8)


def write_movie(times: Array, gamma: Array, edges: Sequence[Edge], path: Path,
                progress: Callable[[float], object] | None = None, size: int = 360,
                most: int = MOVIE_FRAMES) -> Path:
    """
    Write a moving picture of the formation, as GIF.

    :param times: of the states [s], ``(k,)``
    :param gamma: reduced attitudes, ``(k, n, 3)``
    :param edges: (i, j, weight) for each j that agent i sees, from 1
    :param path: to write to
    :param progress: called with how much is done, from 0 to 1
    :param size: width and height [px]
    :param most: as many frames as it may have
    :returns: the path
    """
    # Matplotlib and Pillow are optional, here and below.
    from matplotlib.backends.backend_agg import FigureCanvasAgg
    from matplotlib.figure import Figure
    from PIL import Image
    frames = []
    count = min(most, len(times))
    moments = np.linspace(times[0], times[-1], count)
    figure = Figure(figsize=(size / 100.0, size / 100.0), dpi=100)
    canvas = FigureCanvasAgg(figure)
    palette = None
    view = best_view(gamma[np.linspace(0.5 * len(gamma), len(gamma) - 1, 24).astype(int)])
    trail = trail_time(times, gamma)
    for k, moment in enumerate(moments):
        figure.clear()
        axes = figure.add_axes((0.0, 0.0, 1.0, 1.0))
        upto = int(np.searchsorted(times, moment, side='right'))
        draw(axes, times[:upto], gamma[:upto], edges, trail=trail, clock=True, view=view)
        canvas.draw()
        frame = Image.fromarray(np.asarray(canvas.buffer_rgba())).convert('RGB')
        if palette is None:
            palette = _palette(frame)
        frames.append(_indexed(frame, palette))
        if progress is not None:
            progress((k + 1) / count)
    frames[0].save(path, save_all=True, append_images=frames[1:], loop=0, optimize=True,
                   duration=1000 // FRAMES_PER_SECOND)
    return path


def _palette(frame: Picture) -> Picture:
    """Return the colours that a frame needs, and those of all agents, in an image of a pixel."""
    from PIL import Image
    own = [colors.rgb(color) for color in colors.AGENTS]
    common = frame.quantize(WHITE - len(own), dither=Image.Dither.NONE).getpalette() or []
    palette = Image.new('P', (1, 1))
    palette.putpalette([*common[:3 * (WHITE - len(own))], *sum(own, ())])
    return palette


def _indexed(frame: Picture, palette: Picture) -> Picture:
    """Return a frame in the colours of a palette, and white where it is white."""
    from PIL import Image
    # One palette for all frames, and no dithering: then nothing flickers between them.
    indices = np.array(frame.quantize(palette=palette, dither=Image.Dither.NONE))
    indices[np.all(np.asarray(frame) == 255, axis=-1)] = WHITE
    indexed = Image.fromarray(indices)
    indexed.putpalette([*(palette.getpalette() or [])[:3 * WHITE], 255, 255, 255])
    return indexed
