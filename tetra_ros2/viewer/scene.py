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

"""The formation in three dimensions, in a browser, with viser."""

from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray
from tetra_ros2.drawing import colors, geometry
from tetra_ros2.viewer.rig import CENTER, Rig
import viser

FADED = np.array([170.0, 176.0, 182.0])
"""What the end of a trail fades to: seen on a light page and on a dark one, loud on neither."""

TRAIL = 60
"""Segments of a trail."""

LONGEST_ARC = 0.4
"""A state that is further from the one before than this [rad] is not joined to it."""

LABEL_HEIGHT = 1.13
WEIGHT_PLACE = 0.72
"""Where along an edge its weight is written."""

CAMERA = (3.0, 1.6, 1.5)
FIELD_OF_VIEW = float(np.radians(42.0))
"""Of the camera, upwards [rad]."""

FEW_AGENTS = 6
"""So many have room for their whole names, and for the weights of the edges."""

MOST_AGENTS = 60
"""So many are drawn one by one; of more, the tips only, in one colour."""

MANY_EDGES = 64
"""So many edges hide what they connect: from here on they are drawn only if asked for."""

Edge = tuple[int, int, float | None]


class Scene:
    """
    Sphere, axes with labels, trails, edges with weights, and the solid that the axes span.

    What is in it changes with the number of agents, the edges and the faces; from state to state
    only the places of bones and labels do, all in one and the same picture.

    :param server: a ``viser.ViserServer``
    """

    def __init__(self, server: viser.ViserServer) -> None:
        self._server = server
        self._scene = server.scene
        self._n = 0
        self._edges: tuple[Edge, ...] | None = None
        self._faces: Sequence[geometry.Polygon] = ()
        self._bodies: dict[str, tuple[Rig, Any]] = {}
        self._labels: list[Any] = []
        self._weights: list[tuple[Any, int, int, float]] = []
        self._trail: Any = None
        self._cloud: Any = None
        self.show_edges: bool | None = None
        """Whether edges are drawn; None for: unless they are many."""
        self.hidden_edges = 0
        """How many edges are not drawn."""
        self._furnish()

    def _furnish(self) -> None:
        """Put in what stays."""
        self._scene.set_up_direction('+z')
        self._server.initial_camera.position = CAMERA
        self._server.initial_camera.look_at = (0.0, 0.0, 0.0)
        self._server.initial_camera.fov = FIELD_OF_VIEW
        # Mostly ambient: a strong light from one side would bleach the agents' colours.
        self._scene.configure_environment_map(None)
        self._scene.configure_default_lights(enabled=False)
        self._scene.add_light_ambient('/light/ambient', intensity=1.6)
        self._scene.add_light_directional('/light/sun', intensity=1.1, position=(2.0, 1.0, 4.0))
        lines = geometry.graticule(points=49)
        self._scene.add_line_segments(
            '/sphere/graticule', np.stack([lines[:, :-1], lines[:, 1:]], axis=2).reshape(-1, 2, 3),
            colors.rgb('#cdd5dd'), thickness=0.004)
        self._scene.add_icosphere(
            '/sphere/surface', 0.995, colors.rgb('#dfe6ee'), subdivisions=4, opacity=0.22,
            side='back',  # the front would hide the solid, as both are transparent
            cast_shadow=False, receive_shadow=False)

    def draw(self, gamma: ArrayLike, trail: ArrayLike, edges: Sequence[Edge]) -> None:
        """
        Show a state.

        :param gamma: reduced attitudes, ``(n, 3)``
        :param trail: the states before it, oldest first, itself the last one, ``(k, n, 3)``
        :param edges: (i, j, weight) for each j that agent i sees, from 1; weight may be None
        """
        now = np.asarray(gamma, dtype=float)
        wanted = len(edges) < MANY_EDGES if self.show_edges is None else self.show_edges
        shown = tuple(edges) if wanted else ()
        self.hidden_edges = len(edges) - len(shown)
        # Everything comes and goes as one: no browser ever shows half of a state.
        with self._server.atomic():
            if len(now) != self._n:
                self._clear()
                self._n = len(now)
                self._make_trail()
            if self._n > MOST_AGENTS:
                self._draw_cloud(now)
                return
            if shown != self._edges or not self._labels:
                self._edges = shown
                self._make_agents(now)
            self._make_solid(now)
            for rig, handle in self._bodies.values():
                for bone, place in zip(handle.bones, rig.positions(now), strict=True):
                    bone.position = place
            for label, place in zip(self._labels, LABEL_HEIGHT * now, strict=True):
                label.position = place
            for label, i, j, part in self._weights:
                label.position = (1.0 - part) * now[i] + part * now[j]
            self._draw_trail(np.asarray(trail, dtype=np.float32))

    def _clear(self) -> None:
        """Take out all that moves."""
        for handle in (*(handle for _, handle in self._bodies.values()), *self._labels,
                       *(label for label, *_ in self._weights), self._trail, self._cloud):
            if handle is not None:
                handle.remove()
        self._bodies, self._labels, self._weights = {}, [], []
        self._trail = self._cloud = self._edges = None
        self._faces = ()

    def _put(self, name: str, rig: Rig, now: NDArray[np.float64], color: str,
             opacity: float | None = None) -> None:
        """Put in a body, in the place of the one of that name."""
        # Not until the new one is there: what is taken out and put in at once does not flicker.
        old = self._bodies.pop(name, None)
        if old is not None:
            old[1].remove()
        if rig.agents:
            mesh: dict[str, Any] = rig.mesh(now)
            self._bodies[name] = rig, self._scene.add_mesh_skinned(
                f'/formation/{name}', color=colors.rgb(color), opacity=opacity, side='double',
                flat_shading=True, cast_shadow=False, receive_shadow=False, **mesh)

    def _make_agents(self, now: NDArray[np.float64]) -> None:
        """Put in the axes, their tips and labels, and the edges."""
        edges = self._edges or ()
        largest = max((abs(w) for *_, w in edges if w is not None), default=1.0) or 1.0
        finer = min(1.0, (12.0 / max(len(edges), 1)) ** 0.5)  # many of them hide one another
        mutual = {(i, j) for i, j, _ in edges}
        size = 1.0 if self._n <= FEW_AGENTS else 0.8
        for i in range(self._n):
            rig = Rig()
            rig.add_rod(CENTER, i, ((0.0, 0.012 * size), (1.0, 0.012 * size)), fine=True)
            rig.add_tip(i, 0.036 * size, colors.marker(i + 1))
            for a, b, weight in edges:
                if a - 1 == i:
                    radius = 0.006 if weight is None else 0.0025 + 0.006 * abs(weight) / largest
                    _add_arrow(rig, a - 1, b - 1, radius * finer, (b, a) in mutual)
            self._put(f'agent_{i + 1}', rig, now, colors.agent(i + 1))
        if not self._labels:
            self._labels = [
                self._scene.add_label(
                    f'/label_{i}', f'agent {i}' if self._n <= FEW_AGENTS else f'{i}',
                    anchor='center-center', font_screen_scale=1.15 if self._n <= 12 else 0.9)
                for i in range(1, self._n + 1)]
        for label, *_ in self._weights:
            label.remove()
        self._weights = []
        weights = {weight for *_, weight in edges}
        if len(weights) > 1 and None not in weights and self._n <= FEW_AGENTS:
            self._weights = [
                (self._scene.add_label(f'/weight_{i}_{j}', f'{weight:.3g}',
                                       anchor='center-center', font_screen_scale=0.75),
                 i - 1, j - 1, WEIGHT_PLACE) for i, j, weight in edges]

    def _make_solid(self, now: NDArray[np.float64]) -> None:
        """Put in the solid anew if it has other faces than it had."""
        faces = geometry.polygons(now, self._faces)
        if faces is self._faces:
            return
        self._faces = faces
        solid, outline = Rig(), Rig()
        for face in faces:
            solid.add_face(face)
        for i, j in geometry.sides(faces).tolist():
            outline.add_rod(i, j, ((0.0, 0.005), (1.0, 0.005)))
        self._put('solid', solid, now, colors.FACE, opacity=0.3)
        self._put('outline', outline, now, colors.FACE)

    def _make_trail(self) -> None:
        n = min(self._n, MOST_AGENTS)
        if self._n > MOST_AGENTS:
            return
        tint = np.array([colors.rgb(colors.agent(i)) for i in range(1, n + 1)], dtype=np.uint8)
        age = np.linspace(0.0, 1.0, TRAIL + 1)[:, None, None]
        fading = FADED + (tint[None] - FADED) * age
        self._trail = self._scene.add_line_segments(
            '/formation/trails', np.zeros((TRAIL * n, 2, 3), np.float32),
            _linear(np.stack([fading[:-1], fading[1:]], axis=2).reshape(-1, 2, 3)),
            thickness=0.011)

    def _draw_trail(self, trail: NDArray[np.float32]) -> None:
        self._trail.points = trail_segments(trail)

    def _draw_cloud(self, now: NDArray[np.float64]) -> None:
        """Show very many agents: where they point, and no more."""
        if self._cloud is None:
            self._cloud = self._scene.add_point_cloud(
                '/formation/tips', now.astype(np.float32), colors.rgb(colors.AGENTS[0]),
                point_size=0.02, point_shape='circle', precision='float32', point_shading='flat')
        self._cloud.points = now.astype(np.float32)


def trail_segments(trail: NDArray[np.float32]) -> NDArray[np.float32]:
    """
    Return trails as line segments, an even number for each agent whatever their length.

    :param trail: states, oldest first, ``(k, n, 3)``
    :returns: ``(TRAIL n, 2, 3)``; nothing is drawn between two states that are far apart
    """
    at = np.linspace(0, len(trail) - 1, TRAIL + 1)
    low = np.minimum(np.floor(at).astype(int), max(len(trail) - 2, 0))
    high = np.minimum(low + 1, len(trail) - 1)
    part = (at - low)[:, None, None].astype(np.float32)
    # A start anew is no motion: the point stays at the end that it is nearer to.
    jumps = np.sum(trail[low] * trail[high], axis=-1, keepdims=True) < np.cos(LONGEST_ARC)
    part = np.where(jumps, np.round(part), part)
    way = (1.0 - part) * trail[low] + part * trail[high]
    way /= np.maximum(np.linalg.norm(way, axis=-1, keepdims=True), 1e-6)
    start, end = way[:-1], way[1:]
    joined = np.sum(start * end, axis=-1, keepdims=True) >= np.cos(LONGEST_ARC)
    return np.stack([start, np.where(joined, end, start)], axis=2).reshape(
        -1, 2, 3).astype(np.float32)


def _linear(tint: NDArray[np.float64]) -> NDArray[np.uint8]:
    """Return colours as viser's lines want them: linear, which its other things do not."""
    c = tint / 255.0
    linear = np.where(c <= 0.04045, c / 12.92, ((c + 0.055) / 1.055) ** 2.4)
    return np.round(255.0 * linear).astype(np.uint8)


def _add_arrow(rig: Rig, i: int, j: int, radius: float, mutual: bool) -> None:
    """Put an arrow from the agent that looks to the one it sees, or half of one if both do."""
    head = 2.4 * radius + 0.008
    start = 0.5 if mutual else 0.06
    rig.add_rod(i, j, ((start, radius), (0.9, radius)))
    rig.add_rod(i, j, ((0.9, head), (0.955, 0.0)))
