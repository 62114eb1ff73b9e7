# Copyright 2026 The tetra_ros2 authors
# SPDX-License-Identifier: Apache-2.0

"""
An agent by somebody else, who has read nothing but the contract.

Plain rclpy: message objects, the default executor, numpy. It answers with the newest it has
whenever the newest measurements are all of one time.
"""

from contextlib import suppress
import sys

from geometry_msgs.msg import TwistStamped, Vector3Stamped
import numpy as np
import rclpy
from rclpy.executors import ExternalShutdownException
from rclpy.node import Node


class ForeignAgent(Node):
    def __init__(self, i, neighbors, axis):
        super().__init__('attitude_controller')
        self.frame, self.neighbors, self.axis = f'agent_{i}', neighbors, np.array(axis)
        self.seen = {}
        self.publisher = self.create_publisher(TwistStamped, f'agent_{i}/cmd_vel', 1)
        for j in neighbors:
            self.create_subscription(
                Vector3Stamped, f'agent_{i}/relative_attitude/agent_{j}',
                lambda message, j=j: self.on_measurement(j, message), 1)

    def on_measurement(self, j, message):
        self.seen[j] = message
        stamps = {(m.header.stamp.sec, m.header.stamp.nanosec) for m in self.seen.values()}
        if len(self.seen) < len(self.neighbors) or len(stamps) > 1:
            return
        command = TwistStamped()
        command.header.stamp = message.header.stamp
        command.header.frame_id = self.frame
        rate = np.zeros(3)
        for j, weight in self.neighbors.items():
            y = np.array([self.seen[j].vector.x, self.seen[j].vector.y, self.seen[j].vector.z])
            rate -= weight * (1.0 + self.axis @ y) * np.cross(self.axis, y)
        command.twist.angular.x, command.twist.angular.y, command.twist.angular.z = rate.tolist()
        self.publisher.publish(command)


def main():
    rclpy.init()
    # Agent 3 of the rotating graph with k = 1, p = 1: it sees agents 1 and 4.
    node = ForeignAgent(3, {1: 0.5, 4: 1.0}, [1.0, 0.0, 0.0])
    with suppress(KeyboardInterrupt, ExternalShutdownException):
        rclpy.spin(node)


if __name__ == '__main__':
    sys.exit(main())
