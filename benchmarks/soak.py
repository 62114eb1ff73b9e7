# Copyright 2026 The tetra_ros2 authors
# SPDX-License-Identifier: Apache-2.0

"""
A formation for hours, and what it takes of the machine meanwhile: ``make soak``.

Plant, agents, monitor, recorder and viewer run in processes of their own, in real time. Memory,
file descriptors and threads of each, and the shared memory of all, are written down every few
seconds. At the end a picture shows the curves, and the growth over the second half is judged: in
the first half a process may still fill its buffers.
"""

import argparse
from contextlib import suppress
import csv
import os
from pathlib import Path
import signal
import subprocess
import sys
import tempfile
import time

MOST_GROWTH = {'memory': 1.0, 'files': 0.0, 'threads': 0.0, 'shared': 0.0}
"""By how much a figure may grow over the second half: MB of memory, and counts."""

NODES = {
    'plant': ('plant', '--config', 'rotating', '--ros-args', '-p', 'mode:=realtime'),
    **{f'agent_{i}': ('agent', '--id', str(i), '--config', 'rotating') for i in range(1, 5)},
    'monitor': ('monitor', '--config', 'rotating'),
    'recorder': ('recorder',),
    'viewer': ('viewer', '--port', '0'),
}


def figures(pid: int) -> dict[str, float]:
    """Return private memory [MB], open files and threads of a process."""
    process = Path(f'/proc/{pid}')
    private = sum(int(line.split()[1]) for line in (process / 'smaps_rollup').read_text().split(
        '\n') if line.startswith('Private_'))
    return {'memory': private / 1024.0, 'files': len(list((process / 'fd').iterdir())),
            'threads': len(list((process / 'task').iterdir()))}


def shared_memory() -> float:
    """Return what this machine's shared memory holds [MB]."""
    total = 0
    for file in Path('/dev/shm').iterdir():
        with suppress(OSError):
            total += file.stat().st_blocks * 512
    return total / 2**20


def watch(processes: dict[str, 'subprocess.Popen[bytes]'], seconds: float, period: float,
          table: Path) -> list[dict[str, float]]:
    """Write the figures of all processes down until the time is over, or one has ended."""
    begun = time.monotonic()
    rows: list[dict[str, float]] = []
    with table.open('w', newline='') as file:
        writer = None
        while (elapsed := time.monotonic() - begun) < seconds:
            row = {'time': round(elapsed, 1), 'shared': shared_memory()}
            for name, process in processes.items():
                if process.poll() is not None:
                    raise RuntimeError(f'{name} has ended with status {process.returncode}')
                row |= {f'{name} {key}': value for key, value in figures(process.pid).items()}
            rows.append(row)
            if writer is None:
                writer = csv.DictWriter(file, list(row))
                writer.writeheader()
            writer.writerow(row)
            file.flush()
            time.sleep(max(0.0, begun + len(rows) * period - time.monotonic()))
    return rows


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
    import matplotlib
    matplotlib.use('Agg')
    from matplotlib import pyplot as plt
    hours = [row['time'] / 60.0 for row in rows]
    figure, axes = plt.subplots(2, 2, figsize=(9.0, 5.5), sharex=True, layout='constrained')
    for ax, (what, label) in zip(axes.flat, (
            ('memory', 'private memory [MB]'), ('files', 'open files'), ('threads', 'threads'))):
        for k, name in enumerate(NODES):
            ax.plot(hours, [row[f'{name} {what}'] for row in rows], label=name,
                    linestyle=('-', '--', '-.', ':')[k % 4], linewidth=1.2)
        ax.set_ylabel(label)
        ax.set_ylim(bottom=0)
    axes[1, 1].plot(hours, [row['shared'] for row in rows], color='0.2')
    axes[1, 1].set_ylabel('shared memory of all [MB]')
    axes[1, 1].set_ylim(bottom=0)
    axes[0, 0].legend(fontsize=7, ncols=2)
    for ax in axes[1]:
        ax.set_xlabel('time [min]')
    figure.savefig(path, dpi=110)


def main() -> int:
    """Run the formation, watch it, and judge; return 0 if nothing grew."""
    parser = argparse.ArgumentParser(prog='python -m benchmarks.soak', description=__doc__)
    parser.add_argument('--minutes', type=float, default=480.0, metavar='M',
                        help='how long (default: %(default)s)')
    parser.add_argument('--period', type=float, default=10.0, metavar='S',
                        help='between two looks [s] (default: %(default)s)')
    parser.add_argument('--out', type=Path, default=Path('soak'), metavar='DIR',
                        help='for the table and the picture (default: %(default)s)')
    arguments = parser.parse_args()
    arguments.out.mkdir(parents=True, exist_ok=True)
    env = {**os.environ, 'ROS_AUTOMATIC_DISCOVERY_RANGE': 'LOCALHOST'}
    env.setdefault('ROS_DOMAIN_ID', '99')
    with tempfile.TemporaryDirectory() as scratch, (arguments.out / 'nodes.log').open('w') as log:
        processes = {}
        try:
            for name, words in NODES.items():
                extra = ('--output', f'{scratch}/bag') if name == 'recorder' else ()
                processes[name] = subprocess.Popen(
                    [sys.executable, '-m', 'tetra_ros2', *words, *extra], env=env, stdout=log,
                    stderr=log)
            time.sleep(10.0)  # what every start takes is not growth
            rows = watch(processes, 60.0 * arguments.minutes, arguments.period,
                         arguments.out / 'soak.csv')
        finally:
            for process in processes.values():
                process.send_signal(signal.SIGINT)
            for process in processes.values():
                process.wait()
        bag = sum(file.stat().st_size for file in Path(scratch).rglob('*') if file.is_file())
    draw(rows, arguments.out / 'soak.png')
    grown = growth(rows)
    bad = {key: value for key, value in grown.items()
           if value > MOST_GROWTH[key.rpartition(' ')[2]]}
    print('| process | memory [MB] | growth [MB] | files | threads |')
    print('| --- | ---: | ---: | ---: | ---: |')
    for name in NODES:
        last = rows[-1]
        print(f'| {name} | {last[f"{name} memory"]:.1f} | {grown[f"{name} memory"]:+.2f} '
              f'| {last[f"{name} files"]:.0f} | {last[f"{name} threads"]:.0f} |')
    print(f'{arguments.minutes:g} minutes; shared memory {rows[-1]["shared"]:.1f} MB, '
          f'{grown["shared"]:+.2f} MB; recording {bag / 1e6:.0f} MB')
    for key, value in bad.items():
        print(f'{key} grew by {value:.2f}', file=sys.stderr)
    return 1 if bad else 0


if __name__ == '__main__':
    sys.exit(main())
