# Copyright 2026 The tetra_ros2 authors
# SPDX-License-Identifier: Apache-2.0

"""The commands of the command line, one module each, loaded when it is called for."""
