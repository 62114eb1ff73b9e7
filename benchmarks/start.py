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
How long a large formation takes to start in one process: ``python -m benchmarks.start``.

Each start is one of a process of its own. It ends with the first step, to which every agent has
answered. `complete` is the graph where all see all, `ring` one where each sees two.
"""

import argparse
from concurrent.futures import ProcessPoolExecutor
from multiprocessing import get_context
import os
from pathlib import Path
import statistics
import tempfile
import time

from benchmarks.domain import reserved

FORMATIONS = ('complete 4', 'complete 16', 'complete 32', 'ring 100')


def configuration(graph: str, n: int) -> str:
    """Return a parameter file for n agents."""
    edges = [f'{i + 1} {(i + k) % n + 1}' for i in range(n) for k in (1, n - 1)]
    topology = f'kind: complete, n: {n}' if graph == 'complete' else \
        f'kind: custom, n: {n}, edges: {edges}'
    return ('/**:\n  ros__parameters:\n'
            f'    topology: {{{topology}}}\n'
            '    gain: {kind: cosine, a: 1.0}\n'
            '    pointing_axis: [1.0, 0.0, 0.0]\n    seed: 7\n')


def start(graph: str, n: int) -> tuple[float, float, float, int]:
    """
    Start it, and end it.

    :returns: how long it took to make the nodes and have them find each other [s], from then to
        the first step [s], processor time of both [s], how many topics there are
    """
    from tetra_ros2.launcher import Launcher  # in a process of its own
    with tempfile.TemporaryDirectory() as directory:
        file = Path(directory) / f'{graph}_{n}.yaml'
        file.write_text(configuration(graph, n))
        begun, busy = time.perf_counter(), time.process_time()
        with Launcher(file) as formation:
            made = time.perf_counter()
            formation.run_for(0.01)
            stepped = time.perf_counter()
            busy = time.process_time() - busy
            topics = len(formation.monitor.get_topic_names_and_types())
    return made - begun, stepped - made, busy, topics


def main() -> None:
    """Measure, and print a table."""
    parser = argparse.ArgumentParser(prog='python -m benchmarks.start', description=__doc__)
    parser.add_argument('formations', nargs='*', default=FORMATIONS, metavar='"GRAPH N"',
                        help='such as "complete 32" or "ring 100"')
    parser.add_argument('--times', type=int, default=3, metavar='N',
                        help='how many starts, of which the median counts (default: %(default)s)')
    arguments = parser.parse_args()
    os.environ['ROS_AUTOMATIC_DISCOVERY_RANGE'] = 'LOCALHOST'
    print('| graph | agents | topics | ready [s] | first step after [s] | together [s] '
          '| processor time [s] |')
    print('| --- | ---: | ---: | ---: | ---: | ---: | ---: |')
    for formation in arguments.formations:
        graph, n = formation.split()
        found = []
        for _ in range(arguments.times):
            with reserved() as domain, ProcessPoolExecutor(
                    1, mp_context=get_context('spawn')) as process:
                os.environ['ROS_DOMAIN_ID'] = str(domain)
                found.append(process.submit(start, graph, int(n)).result())
        ready, first, busy, topics = map(statistics.median, zip(*found))
        print(f'| {graph} | {n} | {topics:.0f} | {ready:.2f} | {first:.2f} | {ready + first:.2f} '
              f'| {busy:.2f} |', flush=True)


if __name__ == '__main__':
    main()
