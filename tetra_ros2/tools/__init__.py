# Copyright 2026 The tetra_ros2 authors
# SPDX-License-Identifier: Apache-2.0

"""What a person runs on a formation: each module has ``add_arguments(parser)`` and ``run()``."""
