# Copyright 2026 The tetra_ros2 authors
# SPDX-License-Identifier: Apache-2.0

"""
The picture of a formation: its colours, its parts, and what is drawn with them.

What is drawn is the same whether it comes from topics or from a recording, so nothing in here
knows of either.
"""
