# Copyright 2026 The tetra_ros2 authors
# SPDX-License-Identifier: Apache-2.0

"""
A plant by somebody else, who has read nothing but the contract.

Plain rclpy, a timer, rotation matrices, and the complete graph of four.
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
    """Rodrigues' formula."""
    angle = np.linalg.norm(w)
    if angle == 0.0:
        return np.eye(3)
    x, y, z = w / angle
    hat = np.array([[0.0, -z, y], [z, 0.0, -x], [-y, x, 0.0]])
    return np.eye(3) + np.sin(angle) * hat + (1.0 - np.cos(angle)) * hat @ hat


class ForeignPlant(Node):
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
        w = message.twist.angular
        self.rates[i - 1] = np.array([w.x, w.y, w.z])

    def step(self):
        self.attitudes = [attitude @ turn(PERIOD * w)
                          for attitude, w in zip(self.attitudes, self.rates, strict=True)]
        now = self.get_clock().now().to_msg()
        state = PoseArray()
        state.header.stamp, state.header.frame_id = now, 'world'
        for attitude in self.attitudes:
            pose = Pose()
            pose.position.x, pose.position.y, pose.position.z = attitude[:, 0].tolist()
            state.poses.append(pose)  # whoever wants to know how it turns about its axis, asks
        self.state.publish(state)
        for (i, j), publisher in self.sensors.items():
            message = Vector3Stamped()
            message.header.stamp, message.header.frame_id = now, f'agent_{i}'
            y = self.attitudes[i - 1].T @ self.attitudes[j - 1][:, 0]
            message.vector.x, message.vector.y, message.vector.z = y.tolist()
            publisher.publish(message)


def main():
    rclpy.init()
    with suppress(KeyboardInterrupt, ExternalShutdownException):
        rclpy.spin(ForeignPlant())


if __name__ == '__main__':
    sys.exit(main())
