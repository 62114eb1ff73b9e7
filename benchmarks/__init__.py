# Copyright 2026 The tetra_ros2 authors
# SPDX-License-Identifier: Apache-2.0

"""How fast the formation is, beside what there is to compare with; ``python -m benchmarks``."""
