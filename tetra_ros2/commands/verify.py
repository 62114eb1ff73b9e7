# Copyright 2026 The tetra_ros2 authors
# SPDX-License-Identifier: Apache-2.0

"""``tetra verify``: check every claim of the paper."""

from tetra_ros2.paper.verify import add_arguments, run

__all__ = ['add_arguments', 'run']
