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
A formation for hours, and what it takes of the machine meanwhile: ``make soak``.

Plant, agents, monitor, recorder and viewer run in processes of their own, in real time. A browser
looks on, and its page is loaded anew every ten minutes. Every minute a node of somebody else's
comes, asks the plant for a parameter, hears a state, and goes. Memory, file descriptors and
threads of each process, and the shared memory that they have in use, are written down every few
seconds. At the end a picture shows the curves, and the growth over the second half is judged: in
the first half a process may still fill its buffers.
"""

import argparse
from contextlib import suppress
import csv
from importlib.metadata import version
import os
from pathlib import Path
import signal
import socket
import subprocess
import sys
import tempfile
import threading
import time

from benchmarks.domain import reserved
from geometry_msgs.msg import PoseArray
import msgspec
from rcl_interfaces.srv import GetParameters
from rclpy.context import Context
from rclpy.executors import SingleThreadedExecutor
from rclpy.node import Node
from tetra_ros2.ros import ports
from tetra_ros2.ros.executor import leave
from websockets.exceptions import ConnectionClosed
from websockets.sync.client import connect

MOST_GROWTH = {'memory': 1.0, 'files': 0.0, 'threads': 0.0, 'shared': 0.0}
"""By how much a figure may grow over the second half: MB of memory, and counts."""

RELOAD_PERIOD = 600.0
"""How often the browser loads its page anew [s]."""

VISIT_PERIOD = 60.0
"""How often somebody else's node comes [s]."""

PATIENCE = 30.0
"""How long anything that is asked for may take [s]."""

NODES = ('plant', *(f'agent_{i}' for i in range(1, 5)), 'monitor', 'recorder', 'viewer')
_CAMERA = {
    'type': 'ViewerCameraMessage', 'wxyz': [1.0, 0.0, 0.0, 0.0], 'position': [3.0, 0.0, 0.0],
    'fov': 1.0, 'near': 0.1, 'far': 100.0, 'image_height': 600, 'image_width': 800,
    'look_at': [0.0, 0.0, 0.0], 'up_direction': [0.0, 0.0, 1.0]}
_TICKS = os.sysconf('SC_CLK_TCK')


def command(name: str, rate: float, bag: Path, port: int) -> list[str]:
    """Return the words after ``tetra`` that start a node."""
    if name == 'recorder':
        return ['recorder', '--output', str(bag)]
    if name == 'viewer':
        return ['viewer', '--port', str(port)]
    node, _, number = name.partition('_')
    words = [node, *(['--id', number] if number else []), '--config', 'rotating']
    if name == 'plant':
        words += ['--ros-args', '-p', 'mode:=realtime', '-p', f'rate:={rate}']
    return words


def figures(pid: int) -> dict[str, float]:
    """Return private memory [MB], open files and threads of a process."""
    process = Path(f'/proc/{pid}')
    private = sum(int(line.split()[1]) for line in (process / 'smaps_rollup').read_text().split(
        '\n') if line.startswith('Private_'))
    return {'memory': private / 1024.0, 'files': len(list((process / 'fd').iterdir())),
            'threads': len(list((process / 'task').iterdir()))}


def writer_of(recorder: int) -> int:
    """Wait for the process that writes for a recorder, and return it."""
    end = time.monotonic() + PATIENCE
    while time.monotonic() < end:
        if children := Path(f'/proc/{recorder}/task/{recorder}/children').read_text().split():
            return int(children[0])
        time.sleep(0.1)
    raise TimeoutError('the recorder has not begun')


def processor_time(pid: int) -> float:
    """Return how long a process has had a core so far [s]."""
    fields = Path(f'/proc/{pid}/stat').read_text().rpartition(')')[2].split()
    return (int(fields[11]) + int(fields[12])) / _TICKS


def shared_memory(pids: list[int]) -> float:
    """Return what these processes have in use of the machine's shared memory [MB]."""
    files = {line[5] for pid in pids
             for text in Path(f'/proc/{pid}/maps').read_text().splitlines()
             if len(line := text.split(maxsplit=5)) == 6 and line[5].startswith('/dev/shm/')}
    total = 0
    for file in files:
        with suppress(OSError):  # removed, as its owner has ended
            total += os.stat(file).st_blocks * 512
    return total / 2**20


class Browser:
    """Somebody who looks, in a thread of this process."""

    def __init__(self, port: int) -> None:
        self._port = port
        self._stopping = False
        self.messages = 0
        self.pages = 0
        self._thread = threading.Thread(target=self._look)
        self._thread.start()

    def _look(self) -> None:
        while not self._stopping:
            try:
                self._load()
            except (OSError, TimeoutError, ConnectionClosed):  # it is not there yet
                time.sleep(1.0)

    def _load(self) -> None:
        protocol = [f'viser-v{version("viser")}']
        with connect(f'ws://127.0.0.1:{self._port}/', max_size=None, subprotocols=protocol,
                     compression=None) as page:
            page.send(msgspec.msgpack.encode(_CAMERA))
            self.pages += 1
            end = time.monotonic() + RELOAD_PERIOD
            while time.monotonic() < end and not self._stopping:
                with suppress(TimeoutError):
                    page.recv(timeout=1.0)
                    self.messages += 1

    def close(self) -> None:
        """Look no more."""
        self._stopping = True
        self._thread.join()


def visit(domain: int) -> bool:
    """Come, hear a state, ask the plant for a parameter, and go; return whether both came."""
    context = Context()
    context.init(domain_id=domain)
    node = Node('visitor', context=context)
    ports.reopen_lost(new=True)
    executor = SingleThreadedExecutor(context=context)
    executor.add_node(node)
    try:
        heard: list[bytes] = []
        node.create_subscription(PoseArray, 'formation/attitudes', heard.append, 1, raw=True)
        client = node.create_client(GetParameters, 'plant/get_parameters')
        answer = None
        end = time.monotonic() + PATIENCE
        while time.monotonic() < end and not (heard and answer is not None and answer.done()):
            if answer is None and client.service_is_ready():
                answer = client.call_async(GetParameters.Request(names=['rate']))
            executor.spin_once(timeout_sec=0.1)
            ports.reopen_lost()
        return bool(heard) and answer is not None and answer.done()
    finally:
        leave(executor)


def watch(pids: dict[str, int], seconds: float, period: float, table: Path,
          domain: int) -> tuple[list[dict[str, float]], int, int]:
    """
    Write the figures of all processes down until the time is over.

    :returns: the figures, how many visits there were, and how many had no answer
    :raises OSError: if a process has ended
    """
    begun = time.monotonic()
    rows: list[dict[str, float]] = []
    visits = failures = 0
    with table.open('w', newline='') as file:
        writer = None
        while (elapsed := time.monotonic() - begun) < seconds:
            row = {'time': round(elapsed, 1), 'shared': shared_memory([*pids.values()])}
            for name, pid in pids.items():
                row |= {f'{name} {key}': value for key, value in figures(pid).items()}
            rows.append(row)
            if writer is None:
                writer = csv.DictWriter(file, list(row))
                writer.writeheader()
            writer.writerow(row)
            file.flush()
            # Between two looks: while it is there, it has its part of the shared memory.
            if elapsed >= VISIT_PERIOD * (visits + 1):
                visits += 1
                failures += not visit(domain)
            time.sleep(max(0.0, begun + len(rows) * period - time.monotonic()))
    return rows, visits, failures


def growth(rows: list[dict[str, float]]) -> dict[str, float]:
    """Return by how much each figure grew, from the third quarter's median to the last one's."""
    def median(values: list[float]) -> float:
        return sorted(values)[len(values) // 2]

    half = rows[len(rows) // 2:]
    middle = len(half) // 2
    return {key: median([row[key] for row in half[middle:]])
            - median([row[key] for row in half[:middle]]) for key in rows[0] if key != 'time'}


def draw(rows: list[dict[str, float]], path: Path) -> None:
    """Draw the curves."""
    import matplotlib  # only to draw
    matplotlib.use('Agg')
    from matplotlib import pyplot as plt
    minutes = [row['time'] / 60.0 for row in rows]
    figure, axes = plt.subplots(2, 2, figsize=(9.0, 5.5), sharex=True, layout='constrained')
    for ax, (what, label) in zip(axes.flat, (
            ('memory', 'private memory [MB]'), ('files', 'open files'), ('threads', 'threads'))):
        for k, name in enumerate((*NODES, 'writer')):
            ax.plot(minutes, [row[f'{name} {what}'] for row in rows], label=name,
                    linestyle=('-', '--', '-.', ':')[k % 4], linewidth=1.2)
        ax.set_ylabel(label)
        ax.set_ylim(bottom=0)
    axes[1, 1].plot(minutes, [row['shared'] for row in rows], color='0.2')
    axes[1, 1].set_ylabel('shared memory of all [MB]')
    axes[1, 1].set_ylim(bottom=0)
    axes[0, 0].set_ylim(top=1.5 * axes[0, 0].get_ylim()[1])  # for the legend
    axes[0, 0].legend(fontsize=7, ncols=3, loc='upper center')
    for ax in axes[1]:
        ax.set_xlabel('time [min]')
    figure.savefig(path, dpi=110)


def main() -> int:
    """Run the formation, watch it, and judge; return 0 if nothing grew."""
    parser = argparse.ArgumentParser(prog='python -m benchmarks.soak', description=__doc__)
    parser.add_argument('--minutes', type=float, default=480.0, metavar='M',
                        help='how long (default: %(default)s)')
    parser.add_argument('--rate', type=float, default=100.0, metavar='HZ',
                        help='steps per second (default: %(default)s)')
    parser.add_argument('--period', type=float, default=10.0, metavar='S',
                        help='between two looks [s] (default: %(default)s)')
    parser.add_argument('--out', type=Path, default=Path('soak'), metavar='DIR',
                        help='for the table and the picture (default: %(default)s)')
    arguments = parser.parse_args()
    arguments.out.mkdir(parents=True, exist_ok=True)
    with socket.create_server(('127.0.0.1', 0)) as free:
        port = free.getsockname()[1]
    with tempfile.TemporaryDirectory() as scratch, reserved() as domain, \
            (arguments.out / 'nodes.log').open('w') as log:
        os.environ['ROS_DOMAIN_ID'] = str(domain)
        os.environ['ROS_AUTOMATIC_DISCOVERY_RANGE'] = 'LOCALHOST'
        processes = {}
        browser = None
        try:
            for name in NODES:
                words = command(name, arguments.rate, Path(scratch) / 'bag', port)
                processes[name] = subprocess.Popen(
                    [sys.executable, '-m', 'tetra_ros2', *words], stdout=log, stderr=log)
            browser = Browser(port)
            time.sleep(10.0)  # what every start takes is not growth
            pids = {name: process.pid for name, process in processes.items()}
            pids['writer'] = writer_of(pids['recorder'])
            begun = time.monotonic()
            before = {name: processor_time(pid) for name, pid in pids.items()}
            rows, visits, failures = watch(
                pids, 60.0 * arguments.minutes, arguments.period,
                arguments.out / 'soak.csv', domain)
            elapsed = time.monotonic() - begun
            busy = {name: 100.0 * (processor_time(pid) - before[name]) / elapsed
                    for name, pid in pids.items()}
        finally:
            if browser is not None:
                browser.close()
            for process in processes.values():
                process.send_signal(signal.SIGINT)
            for process in processes.values():
                process.wait()
        bag = sum(file.stat().st_size for file in Path(scratch).rglob('*') if file.is_file())
    draw(rows, arguments.out / 'soak.png')
    grown = growth(rows)
    bad = {key: value for key, value in grown.items()
           if value > MOST_GROWTH[key.rpartition(' ')[2]]}
    print('| process | memory [MB] | growth [MB] | files | threads | processor [% of a core] |')
    print('| --- | ---: | ---: | ---: | ---: | ---: |')
    for name in pids:
        last = rows[-1]
        print(f'| {name} | {last[f"{name} memory"]:.1f} | {grown[f"{name} memory"]:+.2f} '
              f'| {last[f"{name} files"]:.0f} | {last[f"{name} threads"]:.0f} '
              f'| {busy[name]:.1f} |')
    print(f'{arguments.minutes:g} minutes at {arguments.rate:g} Hz, all together '
          f'{sum(busy.values()):.1f} % of a core; shared memory {rows[-1]["shared"]:.1f} MB, '
          f'{grown["shared"]:+.2f} MB; recording {bag / 1e6:.0f} MB; {visits} visits, {failures} '
          f'without an answer; {browser.pages} pages with {browser.messages} messages')
    for key, value in bad.items():
        print(f'{key} grew by {value:.2f}', file=sys.stderr)
    return 1 if bad or failures else 0


if __name__ == '__main__':
    sys.exit(main())
