# Copyright 2026 The tetra_ros2 authors
# SPDX-License-Identifier: Apache-2.0

"""The paper, executable: its claims, its errata and its figures."""
