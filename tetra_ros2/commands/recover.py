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

"""``tetra recover``: a whole recording from a torn one."""

import argparse
from datetime import datetime, timezone
from pathlib import Path


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the arguments of ``tetra recover``."""
    parser.add_argument('bag', metavar='DIR', help='a rosbag2 directory, MCAP or SQLite')
    parser.add_argument(
        '-o', '--output', metavar='NEW',
        help='directory to make (default: DIR_recovered)')


def run(arguments: argparse.Namespace) -> int:
    """
    Copy what can be read into a new bag, and say what is missing.

    :returns: 0
    :raises ConfigurationError: if it is no recording, or nowhere be written to
    """
    from tetra_ros2.recording import recover  # needs rosbags and mcap
    path = Path(arguments.bag)
    output = Path(arguments.output or f'{path.absolute()}_recovered')
    recover.files(path)
    if recover.is_whole(path) and arguments.output is None:
        print(f'{path} is whole, there is nothing to recover')
        return 0
    found = recover.recover(path, output)
    begin, end = min(found.first.values()), max(found.last.values())
    print(f'{output}: {found.messages.total()} messages of {len(found.messages)} topics, '
          f'{(end - begin) / 1e9:.3f} s, the last of them at {_clock(end)}')
    width = max(map(len, found.messages))
    print(f'{"topic":<{width}}  {"messages":>9}  {"last":>12}  before the end [s]')
    for topic, count in sorted(found.messages.items()):
        last = found.last[topic]
        print(f'{topic:<{width}}  {count:>9}  {(last - begin) / 1e9:>10.3f} s  '
              f'{(end - last) / 1e9:.3f}')
    for text in found.lost or ['nothing of what is in the files']:
        print(f'missing: {text}')
    print(f'{path} is as it was')
    return 0


def _clock(time: int) -> str:
    """Return a time [ns] as a date, or as seconds where it is formation time."""
    if time < 10**17:  # before 1973: nobody recorded then
        return f'{time / 1e9:.3f} s of formation time'
    return f'{datetime.fromtimestamp(time / 1e9, timezone.utc):%Y-%m-%d %H:%M:%S} UTC'
