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
Bodies under motion capture by somebody else: they follow cmd_vel, their poses are published.

Poses at 120 Hz, 2 ms jitter, 1 % of them missing, noise of 1e-4 rad, with best effort. Arguments:
how to tell them, `pose`, `array` or `tf`, and the numbers of the bodies.
"""

from contextlib import suppress
import random
import sys

from geometry_msgs.msg import PoseArray, PoseStamped, TransformStamped, TwistStamped
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

    def __init__(self, kind, bodies):
        super().__init__('motion_capture')
        rng = np.random.default_rng(2)
        self.random = random.Random(3)
        self.noise = rng
        self.attitudes = {i: q / np.linalg.norm(q) for i in bodies
                          for q in [rng.standard_normal(4)]}
        self.rates = {i: np.zeros(3) for i in bodies}
        self.frozen = None
        self.kind = kind
        if kind == 'tf':
            from tf2_msgs.msg import TFMessage  # only a whole ROS 2 has it
            self.transforms = TFMessage
            self.sender = self.create_publisher(TFMessage, '/tf', 100)
        elif kind == 'array':
            self.sender = self.create_publisher(PoseArray, '/poses', qos_profile_sensor_data)
        else:
            self.senders = {i: self.create_publisher(
                PoseStamped, f'/vrpn_mocap/agent_{i}/pose', qos_profile_sensor_data)
                for i in bodies}
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
        poses = {}
        for i, w in self.rates.items():
            turn = 0.5 * h * w
            q = multiply(self.attitudes[i], np.array([*turn, 1.0]))
            self.attitudes[i] = q / np.linalg.norm(q)
            if self.kind != 'array' and self.random.random() < 0.01:
                continue
            shown = (self.frozen or self.attitudes)[i]
            if self.frozen is None:
                q = multiply(shown, np.array([*(5e-5 * self.noise.standard_normal(3)), 1.0]))
                shown = q / np.linalg.norm(q)
            poses[i] = shown.tolist()
        if self.kind == 'array':
            if self.random.random() >= 0.01:
                message = PoseArray(header=self.header(now))
                message.poses = [PoseStamped().pose for _ in poses]
                for pose, q in zip(message.poses, poses.values()):
                    set_orientation(pose.orientation, q)
                self.sender.publish(message)
            return
        for i, q in poses.items():
            if self.kind == 'tf':
                message = TransformStamped(header=self.header(now), child_frame_id=f'body_{i}')
                set_orientation(message.transform.rotation, q)
                self.sender.publish(self.transforms(transforms=[message]))
            else:
                message = PoseStamped(header=self.header(now))
                set_orientation(message.pose.orientation, q)
                self.senders[i].publish(message)

    def header(self, now):
        header = PoseStamped().header
        jitter = round(1e6 * self.random.gauss(0.0, 0.7))
        stamp = now.nanoseconds + max(-2_000_000, min(2_000_000, jitter))
        header.stamp.sec, header.stamp.nanosec = divmod(stamp, 10**9)
        header.frame_id = 'lab'
        return header


def set_orientation(orientation, q):
    orientation.x, orientation.y, orientation.z, orientation.w = q


def main():
    rclpy.init()
    kind, *numbers = sys.argv[1:]
    with suppress(KeyboardInterrupt, ExternalShutdownException):
        rclpy.spin(MotionCapture(kind, [int(i) for i in numbers]))


if __name__ == '__main__':
    main()
