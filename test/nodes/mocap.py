# Copyright 2026 The tetra_ros2 authors
# SPDX-License-Identifier: Apache-2.0

"""
Bodies under motion capture by somebody else: they follow cmd_vel, their poses are published.

Poses at 120 Hz, 2 ms jitter, 1 % of them missing, noise of 1e-4 rad, with best effort.
"""

from contextlib import suppress
import random
import sys

from geometry_msgs.msg import PoseStamped, TwistStamped
import numpy as np
import rclpy
from rclpy.executors import ExternalShutdownException
from rclpy.node import Node
from rclpy.qos import qos_profile_sensor_data
from std_srvs.srv import SetBool

RATE = 120.0


def multiply(p, q):
    px, py, pz, pw = p
    qx, qy, qz, qw = q
    return np.array([pw * qx + px * qw + py * qz - pz * qy, pw * qy + py * qw + pz * qx - px * qz,
                     pw * qz + pz * qw + px * qy - py * qx, pw * qw - px * qx - py * qy - pz * qz])


class MotionCapture(Node):
    def __init__(self, bodies):
        super().__init__('motion_capture')
        rng = np.random.default_rng(2)
        self.random = random.Random(3)
        self.noise = rng
        self.attitudes = {i: q / np.linalg.norm(q) for i in bodies
                          for q in [rng.standard_normal(4)]}
        self.rates = {i: np.zeros(3) for i in bodies}
        self.frozen = None
        self.senders = {i: self.create_publisher(
            PoseStamped, f'/vrpn_mocap/agent_{i}/pose', qos_profile_sensor_data) for i in bodies}
        for i in bodies:
            self.create_subscription(
                TwistStamped, f'agent_{i}/cmd_vel',
                lambda message, i=i: self.on_command(i, message), 1)
        self.create_service(SetBool, 'freeze', self.on_freeze)
        self.before = self.get_clock().now()
        self.timer = self.create_timer(1.0 / RATE, self.step)

    def on_command(self, i, message):
        w = message.twist.angular
        self.rates[i] = np.array([w.x, w.y, w.z])

    def on_freeze(self, request, response):
        self.frozen = {i: q.copy() for i, q in self.attitudes.items()} if request.data else None
        response.success = True
        return response

    def step(self):
        now = self.get_clock().now()
        h = (now - self.before).nanoseconds / 1e9
        self.before = now
        for i, w in self.rates.items():
            turn = 0.5 * h * w
            q = multiply(self.attitudes[i], np.array([*turn, 1.0]))
            self.attitudes[i] = q / np.linalg.norm(q)
            if self.random.random() < 0.01:
                continue
            shown = (self.frozen or self.attitudes)[i]
            if self.frozen is None:
                q = multiply(shown, np.array([*(5e-5 * self.noise.standard_normal(3)), 1.0]))
                shown = q / np.linalg.norm(q)
            message = PoseStamped()
            jitter = round(1e6 * self.random.gauss(0.0, 0.7))
            stamp = now.nanoseconds + max(-2_000_000, min(2_000_000, jitter))
            message.header.stamp.sec, message.header.stamp.nanosec = divmod(stamp, 10**9)
            message.header.frame_id = 'lab'
            o = message.pose.orientation
            o.x, o.y, o.z, o.w = map(float, shown)
            self.senders[i].publish(message)


def main():
    rclpy.init()
    with suppress(KeyboardInterrupt, ExternalShutdownException):
        rclpy.spin(MotionCapture([int(i) for i in sys.argv[1:]]))


if __name__ == '__main__':
    main()
