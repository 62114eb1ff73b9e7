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

"""The body frames as TF has them, ``world`` to ``agent_<i>``, for RViz and its like."""

from collections.abc import Callable
from typing import Any

from geometry_msgs.msg import TransformStamped
from rclpy.time import Time
from tetra_ros2.formation._types import Array
from tetra_ros2.ros.node import FormationNode
from tetra_ros2.wire import names

DEPTH = 100
"""Depth of the queue, as that of tf2_ros."""

PERIOD = 1.0 / 30.0
"""How often to publish [s]."""

State = tuple[int, Array, Array]
"""Stamp [ns], attitudes ``(n, 4)`` as x y z w and reduced attitudes ``(n, 3)``."""


class Transforms:
    """
    Publishes the frames of the bodies, while somebody listens.

    Where tf2_msgs is not installed, which the wheels do not have, it says so once and does no
    more.

    :param node: the node to publish with
    :param look: returns the last :data:`State`, or None
    """

    def __init__(self, node: FormationNode, look: Callable[[], State | None]) -> None:
        self._look = look
        self._last = 0  # the stamp that was sent last [ns]
        try:
            from tf2_msgs.msg import TFMessage  # optional
        except ImportError:
            node.get_logger().warning(
                'no transforms on /tf: tf2_msgs is not installed, which ROS 2 from apt has and '
                'the wheels have not')
            return
        self._message: Any = TFMessage
        self._publisher = node.create_publisher(TFMessage, names.TF, DEPTH)
        node.create_steady_timer(PERIOD, self._publish)

    def _publish(self) -> None:
        if not self._publisher.get_subscription_count() or (state := self._look()) is None:
            return
        if state[0] != self._last:  # TF warns of what it has already
            self._last = state[0]
            self._publisher.publish(self._message(transforms=make_transforms(*state)))


def make_transforms(stamp: int, attitudes: Array, gamma: Array) -> list[TransformStamped]:
    """
    Return the transforms from ``world`` to each body frame, as ``formation/attitudes`` has them.

    :param stamp: formation time [ns]
    :param attitudes: unit quaternions x y z w, body to world, ``(n, 4)``
    :param gamma: reduced attitudes, where the bodies are drawn, ``(n, 3)``
    """
    transforms = []
    for i, (quaternion, position) in enumerate(zip(attitudes.tolist(), gamma.tolist()), start=1):
        transform = TransformStamped()
        transform.header.stamp = Time(nanoseconds=stamp).to_msg()
        transform.header.frame_id = names.WORLD
        transform.child_frame_id = names.body_frame(i)
        rotation, translation = transform.transform.rotation, transform.transform.translation
        rotation.x, rotation.y, rotation.z, rotation.w = quaternion
        translation.x, translation.y, translation.z = position
        transforms.append(transform)
    return transforms
