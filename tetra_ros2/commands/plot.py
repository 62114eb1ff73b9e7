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

"""``tetra plot``: the figures of a recording."""

import argparse
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
import sys

from rich.console import Console
from rich.progress import BarColumn, Progress, TextColumn
from tetra_ros2.config.parameters import ConfigurationError

FIGURES = ('sphere', 'components', 'cosines', 'error', 'rates', 'timing', 'bodies', 'joints')
NEEDED = {'rates': 'commands', 'bodies': 'joint states', 'joints': 'joint states'}
"""Without what a figure is not drawn."""
FORMATS = ('png', 'svg', 'pdf')


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the arguments of ``tetra plot``."""
    parser.add_argument('bag', metavar='BAG', help='a rosbag2 directory')
    parser.add_argument(
        '--out', metavar='DIR', required=True,
        help='directory to write the figures into; made if need be')
    parser.add_argument(
        '--only', nargs='+', choices=FIGURES, metavar='FIGURE', default=FIGURES,
        help=f'of {", ".join(FIGURES)} (default: all)')
    parser.add_argument(
        '--format', nargs='+', choices=FORMATS, default=FORMATS, help='(default: all three)')
    parser.add_argument(
        '--movie', action='store_true', help='write sphere.gif too: the formation as it moves')
    parser.add_argument(
        '--from', type=float, default=0.0, metavar='S', dest='start',
        help='time since the first state to begin at [s] (default: %(default)s)')
    parser.add_argument(
        '--to', type=float, metavar='S', dest='end',
        help='time to end at [s] (default: to the end)')
    parser.add_argument(
        '--namespace', metavar='NS', default=None,
        help='of the formation, where the recording has several')


def run(arguments: argparse.Namespace) -> int:
    """
    Write the figures.

    :returns: 0
    :raises ConfigurationError: if the recording cannot be read, or nowhere be written to
    """
    import matplotlib  # optional, as what the next three want
    matplotlib.use('Agg')
    from tetra_ros2.drawing import picture as drawing
    from tetra_ros2.recording import plot as figures
    from tetra_ros2.recording import reader as recording

    out = Path(arguments.out)
    with _progress() as show:
        loaded = recording.load(
            arguments.bag, arguments.namespace, lambda part: show('reading', 0.5 * part))
        loaded = loaded.between(arguments.start, arguments.end)
        try:
            out.mkdir(parents=True, exist_ok=True)
        except OSError as error:
            raise ConfigurationError(
                f'cannot be written to: {error.strerror}', source=out) from None
        run = figures.Run(loaded)
        written, missing = [], []
        names = [name for name in FIGURES if name in arguments.only]
        for k, name in enumerate(names):
            show(name, 0.5 + 0.5 * k / len(names))
            paths = figures.write(run, name, out, arguments.format)
            written += paths
            missing += [] if paths else [name]
        if arguments.movie:
            written.append(drawing.write_movie(
                loaded.times, loaded.gamma, run.edges, out / 'sphere.gif',
                lambda part: show('movie', part)))
        show('done', 1.0)
    law = loaded.law
    if law is not None:
        gain = law.gain
        print(f'{gain.kind} gain, a = {gain.a:.6g}, as read off the commands')
    elif loaded.commands:
        print('the commands follow no gain that is known here, so no slope is predicted',
              file=sys.stderr)
    if loaded.unused:
        print(f'{loaded.unused} states are of another run, out of order or invalid, and were not '
              'used', file=sys.stderr)
    for name in missing:
        # Most bodies have no joints, and nobody has asked for them.
        if name == 'rates' or arguments.only is not FIGURES:
            print(f'{name}: not drawn, as no {NEEDED.get(name, "two states")} were recorded',
                  file=sys.stderr)
    for path in written:
        print(path)
    return 0


@contextmanager
def _progress() -> Iterator[Callable[[str, float], None]]:
    """Yield a function to show progress with; on a terminal it moves a bar."""
    console = Console(stderr=True)
    if not console.is_terminal:
        yield lambda _what, _part: None
        return
    with Progress(TextColumn('{task.description:<10}'), BarColumn(), console=console,
                  transient=True) as bar:
        task = bar.add_task('', total=1.0)
        yield lambda what, part: bar.update(task, description=what, completed=part)
