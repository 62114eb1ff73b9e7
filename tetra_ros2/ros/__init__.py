# Copyright 2026 The tetra_ros2 authors
# SPDX-License-Identifier: Apache-2.0

"""The ROS vocabulary of the package: names, quality of service, encoding, parameters, spinning."""
