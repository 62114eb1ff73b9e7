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

"""``tetra completion``: what lets a shell complete the words of ``tetra``."""

import argparse

SHELLS = ('bash', 'zsh', 'fish')


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the arguments of ``tetra completion``."""
    parser.add_argument('shell', choices=SHELLS, help=f'one of {", ".join(SHELLS)}')


def run(arguments: argparse.Namespace) -> int:
    """Print it; return 0."""
    from argcomplete.shell_integration import shellcode  # optional
    print(shellcode(['tetra'], shell=arguments.shell))
    return 0
