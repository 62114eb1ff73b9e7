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

"""The formation as markers, for RViz and Foxglove: sphere, axes, trails, faces, labels."""

from collections import deque
from collections.abc import Callable, Sequence

from builtin_interfaces.msg import Duration
from geometry_msgs.msg import Point
import numpy as np
from numpy.typing import ArrayLike
from rclpy.qos_overriding_options import QoSOverridingOptions
from std_msgs.msg import ColorRGBA
from tetra_ros2.drawing import colors, geometry
from tetra_ros2.formation._types import Array, Vector
from tetra_ros2.ros import qos
from tetra_ros2.ros.node import FormationNode
from tetra_ros2.wire import names
from visualization_msgs.msg import Marker, MarkerArray

PERIOD = 1.0 / 30.0
"""How often to publish [s], on a clock that runs even when formation time does not."""

LIFETIME = 1.0
"""How long a marker stays when no other takes its place [s]: the monitor may be gone."""

TRAIL = 150
"""How many past positions make a trail."""

LONGEST_ARC = 0.15
"""A trail that leaves more between two positions than this [rad] is filled up on the sphere."""


class Markers:
    """
    Publishes ``formation/markers`` while somebody listens, and does nothing otherwise.

    :param node: the rclpy node
    :param look: called without arguments; returns the last state as its stamp [ns] and the
        reduced attitudes ``(n, 3)``, or None
    """

    def __init__(self, node: FormationNode,
                 look: Callable[[], tuple[int, Array] | None]) -> None:
        self._look = look
        self._trails: deque[Array] = deque(maxlen=TRAIL)
        self._stamp = 0  # of the last of them [ns]
        # Not one of the node's outputs: those are recorded, and this is nothing new.
        self._publisher = node.create_publisher(
            MarkerArray, names.MARKERS, qos.PICTURE,
            qos_overriding_options=QoSOverridingOptions.with_default_policies())
        node.create_steady_timer(PERIOD, self.refresh)

    def refresh(self) -> None:
        """Publish the last state, if there is one and somebody to see it."""
        if not self._publisher.get_subscription_count():
            self._trails.clear()
            return
        if (state := self._look()) is None:
            return
        stamp, gamma = state
        if self._trails and (stamp < self._stamp or geometry.is_elsewhere(
                self._trails[-1], gamma, (stamp - self._stamp) / 1e9)):
            self._trails.clear()  # the plant was started again, or reset
        if not self._trails or stamp != self._stamp:
            self._trails.append(gamma)
        self._stamp = stamp
        self._publisher.publish(make_markers(stamp, gamma, self._trails))


def make_markers(stamp: int, gamma: Array, trails: Sequence[Array]) -> MarkerArray:
    """
    Return the markers of a state.

    :param stamp: its time [ns]
    :param gamma: reduced attitudes, ``(n, 3)``
    :param trails: reduced attitudes before and at that time, each ``(n, 3)``
    :returns: a ``visualization_msgs/MarkerArray`` in the frame ``world``
    """
    def marker(namespace: str, number: int, kind: int, color: str, opacity: float = 1.0,
               scale: Vector = (0.0, 0.0, 0.0)) -> Marker:
        made = Marker(ns=namespace, id=number, type=kind, action=Marker.ADD)
        made.header.frame_id = names.WORLD
        made.header.stamp.sec, made.header.stamp.nanosec = divmod(stamp, 1_000_000_000)
        made.pose.orientation.w = 1.0
        made.scale.x, made.scale.y, made.scale.z = scale
        made.color = color_message(color, opacity)
        set_lifetime(made)
        markers.append(made)
        return made

    markers: list[Marker] = []
    marker('sphere', 0, Marker.SPHERE, colors.SPHERE, 0.25, (2.0, 2.0, 2.0))
    faces = marker('faces', 0, Marker.TRIANGLE_LIST, colors.FACE, 0.35, (1.0, 1.0, 1.0))
    faces.points = _points(gamma[geometry.faces(gamma).ravel()])
    if len(gamma) > geometry.MOST_POINTS:  # three markers each would be too much for anybody
        tips = marker('tips', 0, Marker.POINTS, colors.AGENTS[0], 1.0, (0.02, 0.02, 0.0))
        tips.points = _points(gamma)
        return MarkerArray(markers=[markers[0], tips])
    ways = np.stack(trails, axis=1)
    for i, direction in enumerate(gamma, start=1):
        color = colors.agent(i)
        axis = marker('axes', i, Marker.ARROW, color, 1.0, (0.025, 0.06, 0.1))
        axis.points = _points([np.zeros(3), direction])
        trail = marker('trails', i, Marker.LINE_STRIP, color, 0.7, (0.012, 0.0, 0.0))
        trail.points = _points(_filled(ways[i - 1]))
        label = marker('labels', i, Marker.TEXT_VIEW_FACING, color, 1.0, (0.0, 0.0, 0.14))
        label.text = names.agent(i)
        x, y, z = (1.14 * direction).tolist()
        label.pose.position = Point(x=x, y=y, z=z)
    return MarkerArray(markers=[
        m for m in markers if m.type not in (Marker.TRIANGLE_LIST, Marker.LINE_STRIP)
        or len(m.points) > 1])


def _filled(way: Array) -> Array:
    """Return a trail with points on the sphere between those that are far apart."""
    gaps = np.arccos(np.clip(np.sum(way[:-1] * way[1:], axis=-1), -1.0, 1.0))
    pieces = [way[:1]]
    for start, end, gap in zip(way[:-1], way[1:], gaps):
        pieces.append(geometry.along_arc(start, end, 2 + int(gap / LONGEST_ARC))[1:])
    return np.concatenate(pieces)


def _points(vectors: ArrayLike) -> list[Point]:
    return [Point(x=x, y=y, z=z) for x, y, z in np.asarray(vectors, dtype=float).tolist()]


def set_lifetime(marker: Marker) -> None:
    """Let a marker vanish when no other takes its place."""
    marker.lifetime = Duration(sec=int(LIFETIME), nanosec=round(LIFETIME % 1 * 1e9))


def color_message(color: str, opacity: float) -> ColorRGBA:
    """Return a color as the messages have it."""
    red, green, blue = colors.unit_rgb(color)
    return ColorRGBA(r=red, g=green, b=blue, a=opacity)
