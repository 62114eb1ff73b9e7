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
Write a plant of your own, on plain rclpy: nothing of ``tetra_ros2`` is imported here.

It stands for a simulator, or for the drivers of real bodies, in real time, with the complete graph
of four agents. Start it, and then the agents::

    python examples/own_plant.py &
    tetra launcher --config complete --without plant

It sends every agent what that agent sees of each neighbour, takes the angular velocities that the
agents command, and publishes the attitudes for those who watch.
"""

from contextlib import suppress
import sys

from geometry_msgs.msg import Pose, PoseArray, TwistStamped, Vector3Stamped
import numpy as np
import rclpy
from rclpy.executors import ExternalShutdownException
from rclpy.node import Node

PERIOD = 0.01


def turn(w):
    """Return the rotation matrix of a rotation vector, by Rodrigues' formula."""
    angle = np.linalg.norm(w)
    if angle == 0.0:
        return np.eye(3)
    x, y, z = w / angle
    hat = np.array([[0.0, -z, y], [z, 0.0, -x], [-y, x, 0.0]])
    return np.eye(3) + np.sin(angle) * hat + (1.0 - np.cos(angle)) * hat @ hat


class OwnPlant(Node):
    """Four rigid bodies that turn at the commanded rates."""

    def __init__(self):
        super().__init__('spacecraft_simulator')
        rng = np.random.default_rng(20)
        self.attitudes = [turn(3.0 * rng.standard_normal(3)) for _ in range(4)]
        self.rates = [np.zeros(3)] * 4
        self.state = self.create_publisher(PoseArray, 'formation/attitudes', 10)
        self.sensors = {(i, j): self.create_publisher(
            Vector3Stamped, f'agent_{i}/relative_attitude/agent_{j}', 1)
            for i in range(1, 5) for j in range(1, 5) if i != j}
        for i in range(1, 5):
            self.create_subscription(TwistStamped, f'agent_{i}/cmd_vel',
                                     lambda message, i=i: self.on_command(i, message), 1)
        self.create_timer(PERIOD, self.step)

    def on_command(self, i, message):
        """Take the angular velocity of body i in its own frame [rad/s]."""
        w = message.twist.angular
        self.rates[i - 1] = np.array([w.x, w.y, w.z])

    def step(self):
        """Turn all bodies for one period, and say where they are and what they see."""
        self.attitudes = [attitude @ turn(PERIOD * w)
                          for attitude, w in zip(self.attitudes, self.rates, strict=True)]
        now = self.get_clock().now().to_msg()
        state = PoseArray()
        state.header.stamp, state.header.frame_id = now, 'world'
        for attitude in self.attitudes:
            pose = Pose()
            pose.position.x, pose.position.y, pose.position.z = attitude[:, 0].tolist()
            # The position is where the body points. The orientation, R_i, is left out here: only
            # recordings and pictures use it.
            state.poses.append(pose)
        self.state.publish(state)
        for (i, j), publisher in self.sensors.items():
            message = Vector3Stamped()
            message.header.stamp, message.header.frame_id = now, f'agent_{i}'
            y = self.attitudes[i - 1].T @ self.attitudes[j - 1][:, 0]
            message.vector.x, message.vector.y, message.vector.z = y.tolist()
            publisher.publish(message)


def main():
    """Run the plant until it is signalled."""
    rclpy.init()
    with suppress(KeyboardInterrupt, ExternalShutdownException):
        rclpy.spin(OwnPlant())


if __name__ == '__main__':
    sys.exit(main())
