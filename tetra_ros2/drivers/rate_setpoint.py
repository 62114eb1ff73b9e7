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

"""Attitude-rate set-points as standard messages, for the bridge to an autopilot."""

from typing import Any

from geometry_msgs.msg import TwistStamped
from tetra_ros2.formation._types import Vector
from tetra_ros2.ros import qos
from tetra_ros2.ros.node import FormationNode


class RateSetpoint:
    """
    Publishes each command as ``geometry_msgs/TwistStamped``, at the rate of the body's node.

    Its ``angular`` is the body rate, x forward, y left, z up (REP 103): what mavros takes on
    ``setpoint_attitude/cmd_vel``, and a few lines turn into PX4's or ArduPilot's own messages.
    The attitude comes from motion capture, or from the bridge, as a ``PoseStamped``.

    :param topic: relative to the node's namespace, or absolute
    :param frame: of the header
    :param node: the node that publishes
    """

    wants_node = True

    def __init__(self, *, topic: str = 'setpoint_attitude/cmd_vel', frame: str = 'base_link',
                 node: FormationNode) -> None:
        self._node: Any = node
        self._frame = frame
        self._publisher = node.create_publisher(TwistStamped, topic, qos.NEWEST)

    def apply(self, angular_velocity: Vector, dt: float) -> None:
        """Publish a set-point."""
        message = TwistStamped()
        message.header.stamp = self._node.get_clock().now().to_msg()
        message.header.frame_id = self._frame
        twist = message.twist.angular
        twist.x, twist.y, twist.z = angular_velocity
        self._publisher.publish(message)

    def close(self) -> None:
        """Publish no more."""
        self._node.destroy_publisher(self._publisher)
