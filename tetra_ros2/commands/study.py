# Copyright 2026 The tetra_ros2 authors
# SPDX-License-Identifier: Apache-2.0

"""``tetra study``: very many random starts."""

from tetra_ros2.study.montecarlo import add_arguments, run

__all__ = ['add_arguments', 'run']
