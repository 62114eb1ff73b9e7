# Copyright 2026 The tetra_ros2 authors
# SPDX-License-Identifier: Apache-2.0

"""``python -m tetra_ros2``."""

import os
import signal
import sys

for number in (signal.SIGINT, signal.SIGTERM):  # before anything that takes its time to load
    signal.signal(number, lambda *_: os._exit(130))

from tetra_ros2.cli import main  # noqa: E402

sys.exit(main())
