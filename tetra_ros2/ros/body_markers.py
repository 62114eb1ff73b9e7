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

"""Bodies with mass as markers: each where it points on the sphere, as its model looks."""

from collections.abc import Callable, Iterable
from typing import Any

from geometry_msgs.msg import Point
from rclpy.qos_overriding_options import QoSOverridingOptions
from tetra_ros2.drawing import colors
from tetra_ros2.formation._types import Vector
from tetra_ros2.ros import qos
from tetra_ros2.ros.markers import color_message, PERIOD, set_lifetime
from tetra_ros2.ros.node import FormationNode
from tetra_ros2.wire import names
from visualization_msgs.msg import Marker, MarkerArray

DISTANCE = 1.25
"""How far from the centre of the sphere a body is shown, along where it points."""

SCALE = 1.0
"""How large a metre is shown: the sphere has the radius 1."""

WIDTH = 0.008
"""Of the arcs that show how far a joint can go."""

AT_LIMIT = '#d1242f'
"""The colour of such an arc when its joint is at an end of it."""

_TYPES = {'box': Marker.CUBE, 'cylinder': Marker.CYLINDER, 'sphere': Marker.SPHERE,
          'arc': Marker.LINE_STRIP}


class BodyMarkers:
    """
    Publishes ``formation/bodies`` while somebody listens, and does nothing otherwise.

    :param node: the node
    :param look: called without arguments; returns the stamp [ns], the reduced attitudes and the
        parts of all bodies, :class:`~tetra_ros2.physics.bodies.Part`
    """

    def __init__(self, node: FormationNode,
                 look: Callable[[], tuple[int, list[Vector], Iterable[Any]]]) -> None:
        self._look = look
        self._publisher = node.create_publisher(
            MarkerArray, names.BODIES, qos.PICTURE,
            qos_overriding_options=QoSOverridingOptions.with_default_policies())
        node.create_steady_timer(PERIOD, self.refresh)

    def refresh(self) -> None:
        """Publish the bodies as they are, if there is somebody to see them."""
        if self._publisher.get_subscription_count():
            self._publisher.publish(make_body_markers(*self._look()))


def make_body_markers(stamp: int, reduced: list[Vector], parts: Iterable[Any]) -> MarkerArray:
    """
    Return the markers of all parts.

    :param stamp: their time [ns]
    :param reduced: the reduced attitudes
    :param parts: the parts
    :returns: a ``visualization_msgs/MarkerArray`` in the frame ``world``, one namespace a body
    """
    markers = []
    counts: dict[int, int] = {}
    for part in parts:
        counts[part.body] = number = counts.get(part.body, -1) + 1
        made = Marker(ns=f'body_{part.body + 1}', id=number, type=_TYPES[part.kind],
                      action=Marker.ADD)
        made.header.frame_id = names.WORLD
        made.header.stamp.sec, made.header.stamp.nanosec = divmod(stamp, 1_000_000_000)
        made.scale.x, made.scale.y, made.scale.z = (SCALE * length for length in part.size)
        color = colors.agent(part.body + 1)
        if part.points:
            made.scale.x, made.scale.y, made.scale.z = WIDTH, 0.0, 0.0
            made.points = [Point(x=SCALE * x, y=SCALE * y, z=SCALE * z) for x, y, z in part.points]
            color = AT_LIMIT if part.at_limit else color
        place = made.pose.position
        place.x, place.y, place.z = (
            DISTANCE * g + SCALE * p for g, p in zip(reduced[part.body], part.position))
        turn = made.pose.orientation
        turn.x, turn.y, turn.z, turn.w = part.attitude
        made.color = color_message(color, 0.9 if number else 0.6)
        set_lifetime(made)
        markers.append(made)
    return MarkerArray(markers=markers)
