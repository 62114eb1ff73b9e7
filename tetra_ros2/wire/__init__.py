# Copyright 2026 The tetra_ros2 authors
# SPDX-License-Identifier: Apache-2.0

"""What is on the wire: the names of topics and the bytes of the busiest messages; no rclpy."""
