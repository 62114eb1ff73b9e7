# Copyright 2026 The tetra_ros2 authors
# SPDX-License-Identifier: Apache-2.0

"""``python -m tetra_ros2``."""

import sys

from tetra_ros2.cli import main

sys.exit(main())
