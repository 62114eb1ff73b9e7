# Copyright 2026 The tetra_ros2 authors
# SPDX-License-Identifier: Apache-2.0

"""Intrinsic formations of reduced attitudes over ROS 2; see :mod:`tetra_ros2.formation`."""
