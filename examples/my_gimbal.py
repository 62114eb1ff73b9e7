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
A driver for a pan-tilt gimbal that takes lines of text over TCP.

    tetra body --id 4 --driver my_gimbal:Gimbal --option address=192.168.0.7:5005
"""

import math
import socket


class Gimbal:
    """It takes ``pan_rate tilt_rate`` [rad/s] a line, and answers ``pan tilt`` [rad]."""

    def __init__(self, address):
        host, port = address.rsplit(':', 1)
        self.line = socket.create_connection((host, int(port)), timeout=0.1).makefile('rw')
        self.tilt = 0.0
        self.turn(0.0, 0.0)

    def turn(self, pan_rate, tilt_rate):
        """Say how fast to turn, and take note of where it points."""
        self.line.write(f'{pan_rate} {tilt_rate}\n')
        self.line.flush()
        self.pan, self.tilt = map(float, self.line.readline().split())

    def apply(self, angular_velocity, dt):
        """Turn at that rate [rad/s], in the frame of the body, until the next call."""
        _, y, z = angular_velocity
        self.turn(z / max(math.cos(self.tilt), 0.1), y)

    def attitude(self):
        """Return x y z w, body to world."""
        p, t = 0.5 * self.pan, 0.5 * self.tilt
        return (-math.sin(p) * math.sin(t), math.cos(p) * math.sin(t),
                math.sin(p) * math.cos(t), math.cos(p) * math.cos(t))

    def close(self):
        """Let go of it."""
        self.line.close()
