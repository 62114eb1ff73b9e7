# Copyright 2026 The tetra_ros2 authors
# SPDX-License-Identifier: Apache-2.0

"""``tetra verify``: every claim of the paper, checked, in a table."""

import json
import sys


def add_arguments(parser):
    """Add the arguments of ``tetra verify``."""
    parser.add_argument(
        'claims', nargs='*', metavar='CLAIM', help='what to check (default: everything)')
    parser.add_argument('--list', action='store_true', help='name the claims and check none')
    parser.add_argument(
        '--thorough', action='store_true', help='ten times the random points and starts')
    parser.add_argument(
        '--without-nodes', action='store_true', help='leave out what runs the real nodes')
    parser.add_argument(
        '--seed', type=int, default=0, metavar='N',
        help='of all that is random (default: %(default)s)')
    parser.add_argument('--json', action='store_true', help='print the rows as JSON')


def run(arguments):
    """
    Check the claims and print what came of it.

    :returns: 0 if every claim holds, 1 if one does not
    :raises ConfigurationError: for an unknown claim; nothing has been checked then
    """
    from tetra_ros2.paper.claims import Subject
    chosen = select(arguments.claims, arguments.without_nodes)
    if arguments.list:
        for entry in chosen:
            print(f'{entry.key:<28} {entry.label}: {entry.says}')
        return 0
    if arguments.seed < 0:
        from tetra_ros2.config.parameters import ConfigurationError
        raise ConfigurationError(
            f'{arguments.seed} is not valid, expected an integer from 0 up', key='--seed')
    subject = Subject(seed=arguments.seed, effort=10 if arguments.thorough else 1)
    rows = check(chosen, subject, _progress(len(chosen), not arguments.json))
    if arguments.json:
        print(json.dumps([_document(*row) for row in rows], indent=2, allow_nan=False))
    else:
        _print(rows)
    return 0 if all(finding.passed for _, finding, _ in rows) else 1


def select(keys=(), without_nodes=False):
    """
    Return the claims of the given keys, or all, in the paper's order.

    :raises ConfigurationError: if there is no claim of such a key
    """
    from tetra_ros2.config.parameters import ConfigurationError, nearest
    from tetra_ros2.paper.claims import CLAIMS
    from tetra_ros2.paper.errata import MISPRINTS
    known = {**CLAIMS, **{key: entry.as_claim() for key, entry in MISPRINTS.items()}}
    for key in keys:
        if key not in known:
            raise ConfigurationError(
                f'there is no claim {key!r}{nearest(key, known)}; see tetra verify --list')
    chosen = [known[key] for key in dict.fromkeys(keys)] if keys else list(known.values())
    if without_nodes:
        chosen = [entry for entry in chosen if not entry.nodes]
    elif any(entry.nodes for entry in chosen):
        import rclpy  # noqa: F401, so that its absence is told before anything was checked
    return chosen


def check(chosen, subject, progress=lambda entry: None):
    """
    Check claims.

    :param chosen: a list of :class:`~tetra_ros2.paper.claims.Claim`
    :param subject: what to put to the test
    :param progress: called with each claim before it is checked
    :returns: a list of claim, finding and the time it took [s]
    """
    import time
    rows = []
    for entry in chosen:
        progress(entry)
        begun = time.perf_counter()
        finding = entry.check(subject)
        rows.append((entry, finding, time.perf_counter() - begun))
    progress(None)
    return rows


def _progress(count, wanted):
    """Return a function that shows on a terminal what is being checked."""
    from rich.console import Console
    console = Console(stderr=True)
    if not (wanted and console.is_terminal):
        return lambda entry: None
    status = console.status('')
    done = iter(range(1, count + 2))

    def show(entry):
        if entry is None:
            status.stop()
        else:
            status.start()
            status.update(f'{next(done)} of {count}: {entry.key}')
    return show


def _shown(value):
    return value if isinstance(value, str) else f'{value:.6g}'


def _print(rows):
    from rich.console import Console
    from rich.table import Table
    from rich.text import Text
    # On a terminal the table fits it. A file or a pipe gets all of every row on wide lines.
    console = Console(width=None if sys.stdout.isatty() else 200)
    table = Table(show_lines=True)
    for heading, ratio in (('claim', 3), ('says', 5), ('checked by', 4)):
        table.add_column(heading, overflow='fold', ratio=ratio)
    for heading in ('predicted', 'measured', 'tolerance'):
        table.add_column(heading, justify='right', min_width=9)
    table.add_column('verdict', min_width=7)
    for entry, finding, _ in rows:
        how = f'{entry.how}. {finding.note}' if finding.note else entry.how
        table.add_row(*map(Text, (
            f'{entry.key}\n{entry.label}', entry.says, how, _shown(finding.predicted),
            _shown(finding.measured), _shown(finding.tolerance))),
            Text('holds', 'green') if finding.passed else Text('FAILS', 'bold red'))
    console.print(table)
    failed = [entry.key for entry, finding, _ in rows if not finding.passed]
    elapsed = sum(seconds for _, _, seconds in rows)
    console.print(Text(f'{len(rows) - len(failed)} of {len(rows)} claims hold, '
                       f'in {elapsed:.1f} s' + (f'; not: {", ".join(failed)}' if failed else '')))


def _document(entry, finding, seconds):
    import math

    def plain(value):
        number = not isinstance(value, str)
        return None if number and not math.isfinite(value) else value

    return {'claim': entry.key, 'label': entry.label, 'says': entry.says, 'how': entry.how,
            'predicted': plain(finding.predicted), 'measured': plain(finding.measured),
            'tolerance': plain(finding.tolerance), 'passed': finding.passed,
            'note': finding.note, 'seconds': seconds}
