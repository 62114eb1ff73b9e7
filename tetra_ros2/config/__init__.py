# Copyright 2026 The tetra_ros2 authors
# SPDX-License-Identifier: Apache-2.0

"""Parameters, the files that hold them, and the way from a file to checked objects; no ROS."""
