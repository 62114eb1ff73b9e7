# Copyright 2026 The tetra_ros2 authors
# SPDX-License-Identifier: Apache-2.0

"""``tetra figures``: the paper's figures."""

from tetra_ros2.paper.figures import add_arguments, run

__all__ = ['add_arguments', 'run']
