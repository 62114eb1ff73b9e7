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

"""Bodies with mass in the browser: the same boxes, wheels and gimbals as RViz shows."""

import math
from typing import Any

import numpy as np
from rclpy.serialization import deserialize_message
import viser
from visualization_msgs.msg import Marker, MarkerArray

MOST_PARTS = 600
"""More parts than these are not shown."""

LINE_WIDTH = 2.0
"""Of an arc [px]."""

MOST_POINTS = 200
"""Nor is an arc of more points."""

LARGEST = 10.0
"""Nothing that is shown is larger, or further away."""

STALE = 1.0
"""After how long without news the bodies are taken out [s]."""


class Bodies:
    """
    Draws what ``formation/bodies`` says.

    :param server: of the viewer
    """

    def __init__(self, server: viser.ViserServer) -> None:
        self._server = server
        self._parts: dict[tuple[str, int], tuple[tuple[Any, ...], Any]] = {}
        self._heard_at = -math.inf
        self.reach = 0.0
        """How far from the middle of the sphere they reach."""

    def show(self, message: bytes, now: float) -> bool:
        """
        Draw the bodies.

        :param message: a ``visualization_msgs/MarkerArray`` as bytes, from anybody
        :param now: [s]
        :returns: whether it was one that can be drawn
        """
        try:
            markers = deserialize_message(message, MarkerArray).markers
        except Exception:  # anybody may send anything, and DDS has no one error for that
            return False
        if len(markers) > MOST_PARTS or not all(map(_is_sound, markers)):
            return False
        self._heard_at = now
        self.reach = max(map(_reach, markers), default=0.0)
        with self._server.atomic():
            for key in self._parts.keys() - {(m.ns, m.id) for m in markers}:
                self._parts.pop(key)[1].remove()
            for marker in markers:
                self._put(marker)
        return True

    def forget(self, now: float) -> None:
        """Take the bodies out if nothing was heard of them for some time."""
        if self._parts and now - self._heard_at > STALE:
            with self._server.atomic():
                for _, handle in self._parts.values():
                    handle.remove()
            self._parts.clear()
            self.reach = 0.0

    def _put(self, marker: Marker) -> None:
        key = marker.ns, marker.id
        color = tuple(round(255 * c) for c in (marker.color.r, marker.color.g, marker.color.b))
        points = tuple((p.x, p.y, p.z) for p in marker.points)
        look = (marker.type, marker.scale.x, marker.scale.y, marker.scale.z, color, points)
        known = self._parts.get(key)
        place, turn = marker.pose.position, marker.pose.orientation
        position, wxyz = (place.x, place.y, place.z), (turn.w, turn.x, turn.y, turn.z)
        if known is not None and known[0] == look:
            known[1].position, known[1].wxyz = position, wxyz
            return
        if known is not None:
            known[1].remove()
        name = f'/bodies/{marker.ns}/{marker.id}'
        scene = self._server.scene
        x, y, z = marker.scale.x, marker.scale.y, marker.scale.z
        common = {'color': color, 'opacity': marker.color.a, 'position': position, 'wxyz': wxyz}
        if marker.type == Marker.LINE_STRIP:
            ends = np.array(points, dtype=np.float32)
            handle: Any = scene.add_line_segments(
                name, points=np.stack([ends[:-1], ends[1:]], axis=1), colors=color,
                thickness=LINE_WIDTH, thickness_units='screen', position=position, wxyz=wxyz)
        elif marker.type == Marker.CUBE:
            handle = scene.add_box(name, dimensions=(x, y, z), **common)
        elif marker.type == Marker.CYLINDER:
            handle = scene.add_cylinder(name, radius=0.5 * x, height=z, **common)
        else:
            handle = scene.add_icosphere(name, radius=0.5 * max(x, y, z), **common)
        self._parts[key] = look, handle


def _reach(marker: Marker) -> float:
    """Return how far from the middle any part of a marker may lie, however it is turned."""
    place, size = marker.pose.position, marker.scale
    if marker.type == Marker.LINE_STRIP:
        radius = max(math.hypot(p.x, p.y, p.z) for p in marker.points)
    elif marker.type == Marker.CUBE:
        radius = 0.5 * math.hypot(size.x, size.y, size.z)
    elif marker.type == Marker.CYLINDER:
        radius = 0.5 * math.hypot(size.x, size.z)
    else:
        radius = 0.5 * max(size.x, size.y, size.z)
    return math.hypot(place.x, place.y, place.z) + radius


def _is_sound(marker: Marker) -> bool:
    """Return whether a marker is one of those that are drawn, and every number a sound one."""
    place, turn, size, color = (marker.pose.position, marker.pose.orientation, marker.scale,
                                marker.color)
    square = turn.x**2 + turn.y**2 + turn.z**2 + turn.w**2
    lengths: tuple[float, ...] = (size.x, size.y, size.z)
    if marker.type == Marker.LINE_STRIP:
        lengths = (size.x,)
    points = marker.points
    return (marker.type in (Marker.CUBE, Marker.CYLINDER, Marker.SPHERE, Marker.LINE_STRIP)
            and (marker.type == Marker.LINE_STRIP) * 2 <= len(points) <= MOST_POINTS
            and all(abs(v) <= LARGEST for p in points for v in (p.x, p.y, p.z))
            and marker.ns.replace('_', '').isalnum()
            and all(abs(v) <= LARGEST for v in (place.x, place.y, place.z))
            and all(0.0 < v <= LARGEST for v in lengths)
            and all(0.0 <= v <= 1.0 for v in (color.r, color.g, color.b, color.a))
            and abs(square - 1.0) < 1e-2)
