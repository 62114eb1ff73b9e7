# Copyright 2026 The tetra_ros2 authors
# SPDX-License-Identifier: Apache-2.0

"""The formation in three dimensions, in a browser, with viser."""

from collections import defaultdict

import numpy as np

from tetra_ros2.drawing import colors, geometry
from tetra_ros2.formation import rotation

BACKGROUND = np.array([255.0, 255.0, 255.0])
TRAIL = 60
"""Segments of a trail."""

LABEL_HEIGHT = 1.13
WEIGHT_PLACE = 0.62
"""Where along an edge its weight is written."""

UP = np.array([0.0, 0.0, 1.0])

CAMERA = (3.0, 1.6, 1.5)


class Scene:
    """
    Sphere, axes with labels, trails, edges with weights, and the solid that the axes span.

    What is in it changes with the number of agents and the edges; from state to state only
    positions do, so that nothing is taken away and put back, and nothing flickers.

    :param server: a ``viser.ViserServer``
    """

    def __init__(self, server):
        self._server = server
        self._scene = server.scene
        self._n = 0
        self._edges = None
        self._edge_groups = []
        self._weight_labels = []
        self._furnish()

    def _furnish(self):
        """Put in what stays."""
        self._scene.set_up_direction('+z')
        self._server.initial_camera.position = CAMERA
        self._server.initial_camera.look_at = (0.0, 0.0, 0.0)
        self._server.initial_camera.fov = np.radians(42.0)
        # Mostly ambient: a strong light from one side would bleach the agents' colours.
        self._scene.configure_environment_map(None)
        self._scene.configure_default_lights(enabled=False)
        self._scene.add_light_ambient('/light/ambient', intensity=1.2)
        self._scene.add_light_directional('/light/sun', intensity=1.4, position=(2.0, 1.0, 4.0))
        lines = geometry.graticule(points=49)
        self._scene.add_line_segments(
            '/sphere/graticule', np.stack([lines[:, :-1], lines[:, 1:]], axis=2).reshape(-1, 2, 3),
            colors.rgb('#cdd5dd'), thickness=0.004)
        self._scene.add_icosphere(
            '/sphere/surface', 0.995, colors.rgb('#dfe6ee'), subdivisions=4, opacity=0.22,
            side='back',  # the front would hide the solid, as both are transparent
            cast_shadow=False, receive_shadow=False)

    def draw(self, gamma, trail, edges):
        """
        Show a state.

        :param gamma: reduced attitudes, ``(n, 3)``
        :param trail: the states before it, oldest first, itself the last one, ``(k, n, 3)``
        :param edges: (i, j, weight) for each j that agent i sees, from 1; weight may be None
        """
        gamma = np.asarray(gamma, dtype=np.float32)
        # Both come and go as one: no browser ever shows half of a state.
        with self._server.atomic():
            if len(gamma) != self._n:
                self._make_agents(len(gamma))
            if edges != self._edges:
                self._make_edges(edges)
            for agent, (x, y, z, w) in zip(self._agents, rotation.between(UP, gamma)):
                agent.wxyz = (w, x, y, z)
            self._draw_trail(np.asarray(trail, dtype=np.float32))
            self._draw_solid(gamma)
            self._draw_edges(gamma)

    def _make_agents(self, n):
        """Put in what there is one of for each agent."""
        if self._n:
            for handle in (self._trail, self._solid, *self._agents):
                handle.remove()
            self._make_edges(())
        self._n = n
        tint = np.array([colors.rgb(colors.agent(i)) for i in range(1, n + 1)], dtype=np.uint8)
        # Axis, tip and label hang on one frame that turns: they cannot come apart.
        self._agents = [self._make_agent(i, color) for i, color in enumerate(tint, start=1)]
        age = np.linspace(0.0, 1.0, TRAIL + 1)[:, None, None]
        fading = BACKGROUND + (tint[None] - BACKGROUND) * (0.1 + 0.9 * age)
        self._trail = self._scene.add_line_segments(
            '/formation/trails', np.zeros((TRAIL * n, 2, 3), np.float32),
            np.stack([fading[:-1], fading[1:]], axis=2).reshape(-1, 2, 3).astype(np.uint8),
            thickness=0.011)
        self._solid = self._scene.add_mesh_simple(
            '/formation/solid', np.zeros((3, 3), np.float32), np.array([[0, 1, 2]], np.uint32),
            color=colors.rgb(colors.FACE), opacity=0.3, side='double', flat_shading=True,
            cast_shadow=False, receive_shadow=False)
        self._faces = None

    def _make_agent(self, i, color):
        """Put in an agent that points up, and return the frame that turns it."""
        name = f'/agent_{i}'
        frame = self._scene.add_frame(name, show_axes=False)
        self._scene.add_arrows(
            f'{name}/axis', np.array([[np.zeros(3), UP]], np.float32), _for_arrows(color[None]),
            shaft_radius=0.013, head_radius=0.032, head_length=0.08)
        self._scene.add_point_cloud(
            f'{name}/tip', np.array([UP], np.float32), color[None], point_size=0.036,
            point_shape='circle', precision='float32', point_shading='flat')
        self._scene.add_label(
            f'{name}/label', f'agent {i}', position=LABEL_HEIGHT * UP, anchor='center-center',
            font_screen_scale=1.15)
        return frame

    def _make_edges(self, edges):
        """Put in the edges, those of one weight together: an arrow is as thick as it counts."""
        for handle in (*(group for group, _ in self._edge_groups), *self._weight_labels):
            handle.remove()
        self._edges, self._edge_groups, self._weight_labels = edges, [], []
        by_weight = defaultdict(list)
        for i, j, weight in edges:
            by_weight[abs(weight) if weight is not None else None].append((i, j))
        largest = max((w for w in by_weight if w is not None), default=1.0)
        finer = min(1.0, (12.0 / max(len(edges), 1)) ** 0.5)  # many of them hide one another
        for k, (weight, pairs) in enumerate(by_weight.items()):
            thickness = 0.006 if weight is None else 0.003 + 0.006 * weight / largest
            thickness *= finer
            tint = np.array([colors.rgb(colors.agent(i)) for i, _ in pairs], dtype=np.uint8)
            handle = self._scene.add_arrows(
                f'/formation/edges/{k}', np.zeros((len(pairs), 2, 3), np.float32),
                _for_arrows(tint),
                shaft_radius=thickness, head_radius=2.4 * thickness + 0.008, head_length=0.06)
            self._edge_groups.append((handle, np.array(pairs) - 1))
        if len(by_weight) > 1 and None not in by_weight and self._n <= 6:
            self._weight_labels = [
                self._scene.add_label(f'/formation/weights/{i}_{j}', f'{weight:.3g}',
                                      anchor='center-center', font_screen_scale=0.75)
                for i, j, weight in edges]

    def _draw_trail(self, trail):
        at = np.linspace(0, len(trail) - 1, TRAIL + 1)
        low = np.floor(at).astype(int)
        part = (at - low)[:, None, None].astype(np.float32)
        way = (1.0 - part) * trail[low] + part * trail[np.minimum(low + 1, len(trail) - 1)]
        way /= np.maximum(np.linalg.norm(way, axis=-1, keepdims=True), 1e-6)
        self._trail.points = np.stack([way[:-1], way[1:]], axis=2).reshape(-1, 2, 3)

    def _draw_solid(self, gamma):
        faces = geometry.faces(gamma)
        self._solid.visible = len(faces) > 0
        if not len(faces):
            return
        self._solid.vertices = gamma
        if self._faces is None or not np.array_equal(faces, self._faces):
            self._solid.faces = faces.astype(np.uint32)
            self._faces = faces

    def _draw_edges(self, gamma):
        for handle, pairs in self._edge_groups:
            handle.points = _arrows(gamma, pairs)
        if self._weight_labels:
            pairs = np.array([(i - 1, j - 1) for i, j, _ in self._edges])
            ends = _arrows(gamma, pairs)
            places = (1.0 - WEIGHT_PLACE) * ends[:, 0] + WEIGHT_PLACE * ends[:, 1]
            for label, place in zip(self._weight_labels, places):
                label.position = place


def _for_arrows(tint):
    """Return colours as viser's arrows want them: linear, which its other things do not."""
    c = tint / 255.0
    linear = np.where(c <= 0.04045, c / 12.92, ((c + 0.055) / 1.055) ** 2.4)
    return np.round(255.0 * linear).astype(np.uint8)


def _arrows(gamma, pairs):
    """Return the ends of arrows from agent to agent, two opposite ones side by side."""
    start, end = gamma[pairs[:, 0]], gamma[pairs[:, 1]]
    # To the left of its own way: the other way round that is the other side.
    aside = np.cross(start, end)
    aside *= 0.02 / np.maximum(np.linalg.norm(aside, axis=-1, keepdims=True), 1e-3)
    way = end - start
    return np.stack([start + 0.07 * way + aside, end - 0.07 * way + aside],
                    axis=1).astype(np.float32)
