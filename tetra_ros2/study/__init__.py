# Copyright 2026 The tetra_ros2 authors
# SPDX-License-Identifier: Apache-2.0

"""Monte Carlo studies: very many random starts, on one machine or on a cluster; no ROS."""
