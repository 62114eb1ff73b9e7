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
Write an agent of your own, on plain rclpy: nothing of ``tetra_ros2`` is imported here.

It takes the place of agent 3 of the rotating formation. Start it, and then the others::

    python examples/own_agent.py &
    tetra launcher --config rotating --without agent_3

All that it relies on is the interface: the topics, their types, their frames and stamps. It
answers when the newest measurements of all its neighbours are of one time.
"""

from contextlib import suppress
import sys

from geometry_msgs.msg import TwistStamped, Vector3Stamped
import numpy as np
import rclpy
from rclpy.executors import ExternalShutdownException
from rclpy.node import Node


class OwnAgent(Node):
    """
    The control law for one agent.

    :param i: which agent, from 1
    :param neighbors: the weight W(i, j) for each agent j that it sees
    :param axis: its pointing axis b_i in its own body frame, a unit vector
    """

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
        """Take y_ij, the direction in which agent j points, seen from agent i's body."""
        self.seen[j] = message
        stamps = {(m.header.stamp.sec, m.header.stamp.nanosec) for m in self.seen.values()}
        if len(self.seen) < len(self.neighbors) or len(stamps) > 1:
            return
        # w_i = -sum_j W(i, j) f(theta_ij) b_i x y_ij, with the gain f = 1 + cos(theta).
        rate = np.zeros(3)
        for j, weight in self.neighbors.items():
            y = np.array([self.seen[j].vector.x, self.seen[j].vector.y, self.seen[j].vector.z])
            rate -= weight * (1.0 + self.axis @ y) * np.cross(self.axis, y)
        command = TwistStamped()
        command.header.stamp = message.header.stamp  # that of the measurements it answers
        command.header.frame_id = self.frame
        command.twist.angular.x, command.twist.angular.y, command.twist.angular.z = rate.tolist()
        self.publisher.publish(command)


def main():
    """Run the agent until it is signalled."""
    rclpy.init()
    # Agent 3 of the rotating graph with k = 1, p = 1: it sees agents 1 and 4.
    node = OwnAgent(3, {1: 0.5, 4: 1.0}, [1.0, 0.0, 0.0])
    with suppress(KeyboardInterrupt, ExternalShutdownException):
        rclpy.spin(node)


if __name__ == '__main__':
    sys.exit(main())
