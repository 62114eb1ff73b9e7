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

"""``tetra verify``: check every claim of the paper."""

from __future__ import annotations

import argparse
from collections.abc import Callable
import json
import math
import textwrap
from typing import Any, TYPE_CHECKING

from rich.console import Console
from rich.table import Table
from rich.text import Text
from tetra_ros2.commands._console import make_console
from tetra_ros2.config.parameters import ConfigurationError

if TYPE_CHECKING:
    from tetra_ros2.paper.registry import Claim
    from tetra_ros2.paper.verify import Row

WIDE = 140
"""Columns that a table needs; on fewer, each claim is a paragraph."""


def add_arguments(parser: argparse.ArgumentParser) -> None:
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


def run(arguments: argparse.Namespace) -> int:
    """
    Check the claims and print what came of it.

    :returns: 0 if every claim holds, 1 if one does not
    :raises ConfigurationError: for an unknown claim; nothing has been checked then
    """
    # The claims want SciPy, and load most of the library: --help works without, and at once.
    from tetra_ros2.paper.system import SystemUnderTest
    from tetra_ros2.paper.verify import check, select
    if arguments.seed < 0:
        raise ConfigurationError(
            f'{arguments.seed} is not valid, expected an integer from 0 up', key='--seed')
    chosen = select(arguments.claims, arguments.without_nodes)
    console = make_console()
    if arguments.list:
        for claim in chosen:
            _paragraph(console, claim.key, claim.label, [claim.says])
        return 0
    if any(claim.nodes for claim in chosen):
        import rclpy  # noqa: F401, so that its absence is told before anything was checked
    system = SystemUnderTest(seed=arguments.seed, effort=10 if arguments.thorough else 1)
    rows = check(chosen, system, _progress(len(chosen), not arguments.json))
    if arguments.json:
        print(json.dumps([_document(row) for row in rows], indent=2, allow_nan=False))
    else:
        _print(console, rows)
    return 0 if all(row.result.passed for row in rows) else 1


def _progress(count: int, wanted: bool) -> Callable[[Claim | None], None]:
    """Return a function that shows on a terminal what is being checked."""
    console = Console(stderr=True)
    if not (wanted and console.is_terminal):
        return lambda claim: None
    status = console.status('')
    done = iter(range(1, count + 2))

    def show(claim: Claim | None) -> None:
        if claim is None:
            status.stop()
        else:
            status.start()
            status.update(f'{next(done)} of {count}: {claim.key}')
    return show


def _shown(value: float | str) -> str:
    return value if isinstance(value, str) else f'{value:.6g}'


def _print(console: Console, rows: list[Row]) -> None:
    (_print_table if console.width >= WIDE else _print_paragraphs)(console, rows)
    failed = [row.claim.key for row in rows if not row.result.passed]
    elapsed = sum(row.seconds for row in rows)
    console.print(Text(f'{len(rows) - len(failed)} of {len(rows)} claims hold, '
                       f'in {elapsed:.1f} s' + (f'; not: {", ".join(failed)}' if failed else '')))


def _verdict(row: Row) -> Any:
    return Text('holds', 'green') if row.result.passed else Text('FAILS', 'bold red')


def _how(row: Row) -> str:
    return f'{row.claim.how}; {row.result.note}' if row.result.note else row.claim.how


def _print_table(console: Console, rows: list[Row]) -> None:
    table = Table(show_lines=True)
    for heading, ratio in (('claim', 3), ('says', 5), ('checked by', 4)):
        table.add_column(heading, overflow='fold', ratio=ratio)
    for heading in ('predicted', 'measured', 'tolerance'):
        table.add_column(heading, justify='right', min_width=9)
    table.add_column('verdict', min_width=7)
    for row in rows:
        claim, result = row.claim, row.result
        table.add_row(*map(Text, (
            f'{claim.key}\n{claim.label}', claim.says, _how(row), _shown(result.predicted),
            _shown(result.measured), _shown(result.tolerance))), _verdict(row))
    console.print(table)


def _print_paragraphs(console: Console, rows: list[Row]) -> None:
    for row in rows:
        result = row.result
        _paragraph(console, row.claim.key, row.claim.label, [
            row.claim.says, f'checked by: {_how(row)}',
            f'predicted {_shown(result.predicted)}, measured {_shown(result.measured)}, '
            f'tolerance {_shown(result.tolerance)}'], _verdict(row))


def _paragraph(console: Console, key: str, label: str, lines: list[str],
               verdict: Any = '') -> None:
    console.print(
        Text.assemble(verdict, ' ' if verdict else '', (key, 'bold'), f'  ({label})'))
    for line in lines:
        console.print(Text(textwrap.fill(
            line, console.width, initial_indent='    ', subsequent_indent='    ')))


def _document(row: Row) -> dict[str, Any]:
    def plain(value: float | str) -> float | str | None:
        return value if isinstance(value, str) or math.isfinite(value) else None

    claim, result = row.claim, row.result
    return {'claim': claim.key, 'label': claim.label, 'says': claim.says, 'how': claim.how,
            'predicted': plain(result.predicted), 'measured': plain(result.measured),
            'tolerance': plain(result.tolerance), 'passed': result.passed,
            'note': result.note, 'seconds': row.seconds}
