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
Faults at random on a running formation, one after the other: ``make chaos``.

Plant, agents, monitor, recorder and viewer each have a host of their own
(:mod:`benchmarks.hosts`). A fault is drawn from a seed, done, and undone. Then the formation has
to form again. A fault is survived if

- all agents answer again and the error falls below the tolerance, within :data:`PATIENCE`;
- every number in every message of the formation's own nodes was finite;
- no node ended, and every node tells again how it is;
- the diagnostics named it within :data:`REPORT_TIME`, where somebody was away for 2 s or more,
  or an intruder spoke for 1.5 s or more where only one node should;
- the recording can be read: all of them are, after ``tetra recover`` where they were cut off.

Four formations are tried: both modes, both of the paper's graphs. Fault k of a formation is the
same whatever came before it: ``--first k --faults 1 --formation MODE GRAPH`` does it again.
"""

import argparse
from collections import defaultdict
from dataclasses import asdict, dataclass
import json
from pathlib import Path
import random
import shutil
import signal
import statistics
import subprocess
import sys
import tempfile
import time
import traceback
from typing import Any

from benchmarks import clocks
from benchmarks.hosts import unavailable
from benchmarks.rig import GAIN, RATE, Rig, TOLERANCE
from tetra_ros2.formation import Formation

FORMATIONS = tuple((mode, graph) for mode in ('realtime', 'lockstep')
                   for graph in ('complete', 'rotating'))

PATIENCE = 60.0
"""How long a formation may take to form again, once the fault is over [s]."""

REPORT_TIME = 2.0
"""How soon a fault has to be reported [s]."""

HOLD = 0.4
"""How long all is to be well [s]: for longer than silence goes unnoticed."""

FEW = 3
"""Of fewer decays than this no median is given."""

STARTS = 3
"""How often in a row a formation may fail to start before it is given up."""


@dataclass
class Outcome:
    """
    What came of a fault.

    :param k: which fault of its formation, from 1
    :param kind: its kind
    :param what: what it was
    :param formation: mode and graph
    :param seed: from which it is drawn again
    :param survived: whether it was
    :param why: why not
    :param error: the largest error that it led to [rad]
    :param time: from its end until the formation had formed again [s]
    :param decay: of this, how long the error fell for good [s]; None if there was nothing to fall
    :param theory: how long the sampled loop takes from the same state [s]
    :param owed: whether it had to be reported
    :param reported: after how long it was reported [s], None if it was not
    """

    k: int
    kind: str
    what: str
    formation: str
    seed: int
    survived: bool
    why: str
    error: float
    time: float
    decay: float | None = None
    theory: float | None = None
    owed: bool = False
    reported: float | None = None


def predicted(rig: Rig, gamma: list[tuple[float, ...]]) -> float | None:
    """Return how long the sampled loop takes from these directions to the tolerance [s]."""
    gain = type(rig.formation.gain)(GAIN)
    formation = Formation(rig.formation.topology, gain, rig.formation.pointing_axes)
    run = formation.simulate(gamma, duration=15.0, rate=RATE)
    return run.time_to_form(TOLERANCE)


def one(rig: Rig, k: int, kind: str, seed: int) -> Outcome:
    """Do a fault, wait until the formation has formed again, and judge."""
    from benchmarks.faults import FAULTS  # with rclpy: see Rig.__enter__
    watcher = rig.watcher
    chance = random.Random(seed)
    watcher.begin()
    # Half of the faults come while the formation forms.
    if chance.random() < 0.5:
        watcher.restart(at_random=True)
        time.sleep(chance.uniform(0.0, 0.5))
    watcher.begin_to_listen()
    done = FAULTS[kind][1](rig, chance)
    over = time.monotonic()
    watcher.begin_way_back()
    formed = watcher.wait(lambda: watcher.alive and watcher.error < TOLERANCE, PATIENCE, hold=HOLD)
    at = time.monotonic() - HOLD
    outcome = Outcome(k, kind, done.what, f'{rig.mode} {rig.graph}', seed, True, '',
                      watcher.worst, max(0.0, at - over), owed=bool(done.owed))
    why = []
    if not formed:
        why.append(f'not formed again: error {watcher.error:.3g} rad'
                   + ('' if watcher.fresh else ', formation time stands still')
                   + ('' if watcher.alive else ', not all speak'))
    elif watcher.way_back[0] and watcher.largest > 2.0 * TOLERANCE:
        outcome.decay = max(0.0, at - watcher.way_back[0])
        outcome.theory = predicted(rig, watcher.way_back[1])
    if not watcher.wait(lambda: all(watcher.heard_from.get(n, 0.0) > over for n in done.targets)
                        and not rig.silent(), PATIENCE):
        why.append(f'says nothing any more: {", ".join(rig.silent() or done.targets)}')
    for words in done.owed:
        watcher.wait(lambda words=words: watcher.reported_at(*words) is not None,
                     done.begun + REPORT_TIME - time.monotonic())
        reported = watcher.reported_at(*words)
        if reported is None or reported - done.begun > REPORT_TIME:
            when = '' if reported is None else f' for {reported - done.begun:.2f} s'
            why.append(f'not reported{when}: {words[0]}')
        if reported is not None:
            outcome.reported = max(outcome.reported or 0.0, reported - done.begun)
    if not done.owed and (reported := watcher.reported_at(*done.welcome)) is not None:
        outcome.reported = max(0.0, reported - done.begun)
    if watcher.not_finite:
        why.append(f'not finite: {", ".join(sorted(set(watcher.not_finite)))}')
    if rig.bag_is_large() and rig.end_recorder():
        why.append('the recorder did not end with 0')
    why += [f'recording: {problem}' for problem in rig.unreadable_bags()]
    if ended := rig.ended():
        why.append(f'ended: {", ".join(ended)}')
        for name in ended:
            rig.start(name)
    outcome.survived, outcome.why = not why, '; '.join(why)
    return outcome


def say(outcome: Outcome) -> None:
    """Print a line about a fault."""
    reported = 'none' if outcome.reported is None else f'{outcome.reported:.2f} s'
    print(f'{outcome.formation} {outcome.k} (seed {outcome.seed}): {outcome.kind}: '
          f'{outcome.what}: {outcome.why or "survived"}; error {outcome.error:.2g} rad, '
          f'{outcome.time:.2f} s, reported: {reported}', flush=True)


def run(mode: str, graph: str, first: int, count: int, seed: int, out: Path, verbose: bool,
        only: list[str]) -> int:
    """
    Do faults on a formation, and write a line of JSON for each.

    :param first: the number of the first fault, from 1
    :returns: 0, or 1 if it ended before the last fault, as the formation was in no state for more
    """
    from benchmarks.faults import FAULTS  # as above
    directory = Path(tempfile.mkdtemp(prefix='tetra_chaos_'))
    kinds = [kind for kind in FAULTS if (not only or kind in only)
             and (kind != 'clock' or clocks.LIBRARY.exists())]
    weights = [FAULTS[kind][0] for kind in kinds]
    good = True
    with Rig(mode, graph, seed, directory) as rig, out.open('a') as file:
        def write(outcome: Outcome) -> None:
            nonlocal good
            good &= outcome.survived
            file.write(json.dumps(asdict(outcome)) + '\n')
            file.flush()
            if verbose or not outcome.survived:
                say(outcome)

        watcher = rig.watcher
        if not watcher.wait(lambda: watcher.alive and watcher.error < TOLERANCE
                            and not rig.silent(), 2.0 * PATIENCE, hold=1.0):
            print(f'{mode} {graph} did not form at the start; see {directory}', flush=True)
            return 1
        for k in range(first, first + count):
            chance = random.Random(f'{seed} {mode} {graph} {k}')
            kind, own_seed = chance.choices(kinds, weights)[0], chance.randrange(2**32)
            try:
                outcome = one(rig, k, kind, own_seed)
            except Exception as error:
                traceback.print_exc()
                write(Outcome(k, kind, '', f'{mode} {graph}', own_seed, False,
                              f'{type(error).__name__}: {error}', 0.0, 0.0))
                return 1
            write(outcome)
            if 'not formed' in outcome.why or 'says nothing' in outcome.why:
                print(f'{mode} {graph} is started anew; see {directory}', flush=True)
                return 1
        rig.end_recorder()
        if problems := rig.unreadable_bags():
            print(f'{mode} {graph}: the last recording: {problems[0]}', flush=True)
            return 1
    if good:
        shutil.rmtree(directory, ignore_errors=True)
    return 0


def median(values: list[float]) -> str:
    """Return a median with two digits, or a dash if there is nothing."""
    return f'{statistics.median(values):.2f}' if values else '-'


def worst(values: list[float]) -> str:
    """Return the largest value with two digits, or a dash if there is nothing."""
    return f'{max(values):.2f}' if values else '-'


def group(outcome: Outcome) -> str:
    """Return the kind of a fault, and of whom it was."""
    if outcome.kind in ('kill', 'stop', 'reboot', 'partition', 'clock'):
        for who in ('plant', 'agent'):
            if who in outcome.what:
                return f'{outcome.kind}: {who}'
        return f'{outcome.kind}: monitor, recorder, viewer'
    return outcome.kind


def table(outcomes: list[Outcome]) -> str:
    """Return the table of what came of the faults, in Markdown."""
    rows = ['| fault | done | survived | largest error [rad] | forms again after: median [s] '
            '| worst [s] | of this decay: median [s] | theory [s] | decay / theory: median '
            '| had to be reported | was, at the latest after [s] |',
            '| --- |' + ' ---: |' * 10]
    kinds = defaultdict(list)
    for outcome in outcomes:
        kinds[group(outcome)].append(outcome)
    for kind, some in [*sorted(kinds.items()), ('all', outcomes)]:
        times = [o.time for o in some]
        fell = [(o.decay, o.theory) for o in some if o.decay is not None and o.theory]
        fell = fell if len(fell) >= FEW else []  # the median of one or two is none
        rows.append(
            f'| {kind} | {len(some)} | {sum(o.survived for o in some)} '
            f'| {max(o.error for o in some):.2f} | {median(times)} | {worst(times)} '
            f'| {median([d for d, _ in fell])} | {median([t for _, t in fell])} '
            f'| {median([d / t for d, t in fell])} | {sum(o.owed for o in some)} '
            f'| {worst([o.reported for o in some if o.owed and o.reported is not None])} |')
    return '\n'.join(rows)


class Share:
    """The faults of one formation, done by a process, and by another if that one gives up."""

    def __init__(self, mode: str, graph: str, arguments: Any) -> None:
        self.name = f'{mode} {graph}'
        self.formation = mode, graph
        self._arguments = arguments
        self._count = -(-arguments.faults // len(FORMATIONS))
        self._starts = 0
        self.process: subprocess.Popen[bytes] | None = None

    def _done(self) -> int:
        out = self._arguments.out
        lines = out.read_text().splitlines() if out.exists() else []
        return max((fault['k'] for fault in map(json.loads, lines)
                    if fault['formation'] == self.name), default=0)

    def goes_on(self) -> bool:
        """Start a process for what is left to do; return whether there is anything."""
        done = self._done()
        if done >= self._count or self._starts >= STARTS:
            return False
        arguments = self._arguments
        self.process = subprocess.Popen([
            sys.executable, '-m', 'benchmarks.chaos', '--formation', *self.formation,
            '--first', str(done + 1), '--faults', str(self._count - done),
            '--seed', str(arguments.seed), '--out', arguments.out,
            *(['--verbose'] if arguments.verbose else []),
            *(word for kind in arguments.only for word in ('--only', kind))])
        self._begun_at = done
        return True

    def has_ended(self) -> bool:
        """Return whether the process has; there may be more to do."""
        if self.process is None or self.process.poll() is None:
            return False
        self.process = None
        self._starts = 0 if self._done() > self._begun_at else self._starts + 1
        return True

    @property
    def whole(self) -> bool:
        """Return whether all faults were done."""
        return self._done() >= self._count


def _end_at_the_first_signal() -> None:
    """Have SIGINT and SIGTERM remove the hosts, and let nothing disturb that."""
    def end(_number: int, _frame: object) -> None:
        for number in (signal.SIGINT, signal.SIGTERM):
            signal.signal(number, signal.SIG_IGN)
        raise KeyboardInterrupt

    for number in (signal.SIGINT, signal.SIGTERM):
        signal.signal(number, end)


def main() -> int:
    """Do faults on the four formations, some at a time; return 0 if all were survived."""
    parser = argparse.ArgumentParser(
        prog='python -m benchmarks.chaos', description=__doc__,
        formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument('--faults', type=int, default=1000, metavar='N',
                        help='how many in all (default: %(default)s)')
    parser.add_argument('--seed', type=int, default=1, metavar='N', help='(default: %(default)s)')
    parser.add_argument('--formation', nargs=2, metavar=('MODE', 'GRAPH'),
                        help='only this formation, in this process')
    parser.add_argument('--first', type=int, default=1, metavar='K',
                        help='with --formation: the number of the first fault')
    parser.add_argument('--jobs', type=int, default=2, metavar='N',
                        help='how many formations at a time (default: %(default)s)')
    parser.add_argument('--out', type=Path, default=Path('chaos.jsonl'), metavar='FILE',
                        help='where the outcomes are kept (default: %(default)s)')
    parser.add_argument('--continue', dest='go_on', action='store_true',
                        help='go on where the run that wrote FILE was stopped')
    parser.add_argument('--only', action='append', default=[], metavar='KIND',
                        help='only faults of this kind')
    parser.add_argument('--verbose', action='store_true', help='print every fault')
    arguments = parser.parse_args()
    if reason := unavailable():
        print(f'no chaos here: {reason}', file=sys.stderr)
        return 2
    _end_at_the_first_signal()
    if arguments.formation:
        return run(*arguments.formation, arguments.first, arguments.faults, arguments.seed,
                   arguments.out, arguments.verbose, arguments.only)
    print(f'seed {arguments.seed}, {arguments.faults} faults', flush=True)
    if not clocks.LIBRARY.exists():
        print(f'no clock is set, as there is no {clocks.LIBRARY} (Debian package libfaketime)')
    if not arguments.go_on:
        arguments.out.unlink(missing_ok=True)
    shares = [Share(mode, graph, arguments) for mode, graph in FORMATIONS]
    waiting, running = list(shares), []
    try:
        while waiting or running:
            while waiting and len(running) < arguments.jobs:
                share = waiting.pop(0)
                if share.goes_on():
                    running.append(share)
            for share in [share for share in running if share.has_ended()]:
                running.remove(share)
                waiting.insert(0, share)
            time.sleep(0.2)
    finally:
        for share in running:
            if share.process is not None:
                share.process.terminate()
                share.process.wait()
    outcomes = [Outcome(**json.loads(line)) for line in arguments.out.read_text().splitlines()]
    if not outcomes:
        return 1
    print(table(outcomes))
    lost = [outcome for outcome in outcomes if not outcome.survived]
    print(f'seed {arguments.seed}: {len(outcomes) - len(lost)} of {len(outcomes)} faults survived')
    for outcome in lost:
        say(outcome)
    return 0 if not lost and all(share.whole for share in shares) else 1


if __name__ == '__main__':
    try:
        sys.exit(main())
    except KeyboardInterrupt:
        sys.exit(130)
