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

"""
What the nodes here want of Fast DDS otherwise than it comes.

A reliable subscription that has missed a message holds back all later ones until it gets it again.
It learns from a heartbeat of the publisher that there is one to be asked for. Fast DDS sends a
heartbeat every three seconds, and with each message where only the newest is kept. So one lost
state delays the next states by up to three seconds. Here there are two heartbeats a second. Only
a profile in a file can say so: the period is no part of ROS 2's quality of service.
"""

import os
from pathlib import Path

PROFILES = Path(__file__).with_suffix('.xml')
"""The profile of this package's publishers."""

VARIABLE = 'FASTRTPS_DEFAULT_PROFILES_FILE'
"""The environment variable from which Fast DDS 2 takes a file of profiles."""

LOCAL = Path('DEFAULT_FASTRTPS_PROFILES.xml')
"""The file of profiles that Fast DDS takes if it is in the working directory."""


def load_profiles() -> None:
    """
    Have Fast DDS take the profile of this package, unless the user has profiles of his own.

    To be called before the process makes its first node. Other implementations of ROS 2's
    middleware do not look at it.
    """
    if not LOCAL.exists():
        os.environ.setdefault(VARIABLE, str(PROFILES))
