# Copyright 2026 The tetra_ros2 authors
# SPDX-License-Identifier: Apache-2.0

"""What all tests share."""

from hypothesis import settings

settings.register_profile('tetra', derandomize=True, deadline=None, max_examples=30)
settings.load_profile('tetra')
