# Copyright 2026 The tetra_ros2 authors
#
# Licensed under the Apache License, Version 2.0 (the "License");
# you may not use this file except in compliance with the License.
# You may obtain a copy of the License at
#
#     http://www.apache.org/licenses/LICENSE-2.0
#
# Unless required by applicable law or agreed to in writing, software
# distributed under the License is distributed on an "AS IS" BASIS,
# WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied.
# See the License for the specific language governing permissions and
# limitations under the License.

"""``python -m tetra_ros2``."""

import os
import signal
import sys

# Before anything that takes its time to load, even the list of the commands: what a node is.
NODES = ('agent', 'plant', 'sensors', 'body', 'monitor', 'recorder', 'viewer')
command = next((word for word in sys.argv[1:] if not word.startswith('-')), '')
for number in (signal.SIGINT, signal.SIGTERM):
    signal.signal(number, lambda *_: os._exit(0 if command in NODES else 130))

from tetra_ros2.cli import main  # noqa: E402

sys.exit(main())
