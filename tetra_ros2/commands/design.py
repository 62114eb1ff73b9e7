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

"""``tetra design``: weights for a formation of one's own, at rest or turning."""

from __future__ import annotations

import argparse
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
import json
import math
from pathlib import Path
import sys
from typing import Any, TYPE_CHECKING

import numpy as np
from rich.console import Console
from rich.table import Table
from rich.text import Text
from tetra_ros2.commands._console import make_console
from tetra_ros2.config.configuration import check_new
from tetra_ros2.config.parameters import ConfigurationError, nearest, shown
from tetra_ros2.formation import (
    equilibria,
    measures,
    polyhedra,
    sampling,
    sphere,
    targets,
)
from tetra_ros2.formation._types import Array
from tetra_ros2.formation.gain import Gain, KINDS
from tetra_ros2.formation.topology import POLYHEDRA
from tetra_ros2.study.confidence import lower_bound
import yaml

if TYPE_CHECKING:
    from tetra_ros2.formation.design import Design, Outcome

Refusals = list[tuple[Gain, str]]
"""The gains under which there is no good design, each with the reason."""

GAINS = (('exponential', 1.0), ('rational', 1.0), ('cosine', 1.0), ('gaussian', 0.5),
         ('linear', 0.8))
"""The gains that are tried one after the other where none is asked for, with their b."""

ENOUGH = 0.99
"""The fraction of random starts that must form for no other gain to be tried."""


RATE = 100.0
"""Of the loop in the configuration that is written [Hz]."""

TOLERANCE = 1e-3
"""The monitor's, by default [rad]."""


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the arguments of ``tetra design``."""
    goal = parser.add_mutually_exclusive_group(required=True)
    goal.add_argument(
        '--polyhedron', metavar='NAME', help=f'the formation is a solid: {", ".join(POLYHEDRA)}')
    goal.add_argument(
        '--points', metavar='FILE',
        help='the formation is a list of directions, one for each agent, three numbers each: '
             'text, CSV, JSON or YAML')
    parser.add_argument(
        '--spin', type=float, nargs=3, metavar=('X', 'Y', 'Z'),
        help='angular velocity of the whole in the frame of the directions [rad/s] '
             '(default: at rest)')
    parser.add_argument(
        '--gain', metavar='KIND',
        help='family of gains (default: several are tried, and the first is kept under which '
             f'{ENOUGH:.0%}% of random starts form)')
    parser.add_argument(
        '--gain-b', type=float, metavar='B', help='its shape b (default: 1)')
    parser.add_argument(
        '--max-degree', type=int, metavar='N', help='agents see N others at most')
    parser.add_argument(
        '--visible', type=float, default=math.pi, metavar='RAD',
        help='agents further apart than this do not see each other [rad] (default: pi)')
    parser.add_argument(
        '--starts', type=int, default=500, metavar='N',
        help='random starts to follow (default: %(default)s)')
    parser.add_argument(
        '--seed', type=int, default=0, metavar='N', help='of the starts (default: %(default)s)')
    parser.add_argument('--out', metavar='FILE', help='configuration to write; must not exist')
    parser.add_argument('--json', action='store_true', help='print the figures as JSON')


def run(arguments: argparse.Namespace) -> int:
    """
    Design a formation, print what was found, and write a configuration.

    :returns: 0; 1 if there are no such weights, or no stable ones were found
    :raises ConfigurationError: if it was called wrongly
    """
    for name, low, high in (('starts', 1, 10**6), ('seed', 0, 2**53), ('max_degree', 1, 1000)):
        value = getattr(arguments, name)
        if value is not None and not low <= value <= high:
            raise ConfigurationError(f'{value} is not valid, expected an integer from {low} up',
                                     key=f'--{name.replace("_", "-")}')
    if not 0.0 < arguments.visible < 10.0:
        raise ConfigurationError(f'{arguments.visible!r} is not valid, expected an angle greater '
                                 'than 0 [rad]', key='--visible')
    if arguments.spin is not None and not (
            all(map(math.isfinite, arguments.spin)) and any(arguments.spin)):
        raise ConfigurationError(f'{arguments.spin} is not valid, expected three finite numbers, '
                                 'not all zero; leave it out for a formation at rest',
                                 key='--spin')
    if arguments.polyhedron is not None and arguments.polyhedron not in POLYHEDRA:
        raise ConfigurationError(
            f'{arguments.polyhedron!r} is not valid{nearest(arguments.polyhedron, POLYHEDRA)}, '
            f'expected one of {", ".join(POLYHEDRA)}', key='--polyhedron')
    if arguments.out is not None:
        check_new(arguments.out)
    gains = _gains(arguments)
    from tetra_ros2.formation import design  # wants SciPy, without which --help works
    points, source = _points(arguments)
    try:
        design.check_points(points, arguments.visible)
    except design.DesignError as error:
        raise ConfigurationError(str(error), source=source) from None
    with _patience(arguments) as say:
        found, refusals = _search(arguments, points, gains, say)
    if found is None:
        for gain, reason in refusals:
            print(f'tetra: no design under the {_named(gain)}: {reason}', file=sys.stderr)
        return 1
    made, outcome = found
    figures = _figures(made, outcome)
    if arguments.out is not None:
        Path(arguments.out).write_text(
            _configuration(made, figures['offset'], arguments), encoding='utf-8')
    if arguments.json:
        print(json.dumps(figures, indent=2, allow_nan=False))
    else:
        _print(figures, made, outcome, refusals, arguments)
    return 0


def _gains(arguments: argparse.Namespace) -> list[Gain]:
    """Return the gains to try."""
    if arguments.gain is None:
        if arguments.gain_b is not None:
            raise ConfigurationError('say --gain as well', key='--gain-b')
        return [KINDS[kind](1.0, b) for kind, b in GAINS]
    if arguments.gain not in KINDS:
        raise ConfigurationError(
            f'{arguments.gain!r} is not valid{nearest(arguments.gain, KINDS)}, expected one '
            f'of {", ".join(KINDS)}', key='--gain')
    try:
        return [KINDS[arguments.gain](
            1.0, 1.0 if arguments.gain_b is None else arguments.gain_b)]
    except ValueError as error:
        raise ConfigurationError(str(error), key='--gain-b') from None


def _points(arguments: argparse.Namespace) -> tuple[Array, str]:
    """Return the directions, unit vectors ``(n, 3)``, and where they are from."""
    if arguments.polyhedron is not None:
        return polyhedra.SOLIDS[arguments.polyhedron], '--polyhedron'
    return read_points(arguments.points), arguments.points


def read_points(name: str) -> Array:
    """
    Read directions from a file, as unit vectors ``(n, 3)``.

    JSON and YAML hold a list of lists of three numbers, or such a list under the key ``points``;
    any other file has three numbers in each line, with spaces, commas or semicolons between them.

    :param name: the file
    :raises ConfigurationError: if it is no such file
    """
    path = Path(name)
    try:
        text = path.read_text(encoding='utf-8')
    except (OSError, UnicodeDecodeError) as error:
        reason = getattr(error, 'strerror', None) or 'not a text file'
        raise ConfigurationError(f'cannot be read: {reason}', source=name) from None
    if path.suffix.lower() in ('.json', '.yaml', '.yml'):
        rows = _structured(text, name)
    else:
        lines = [line.partition('#')[0].replace(',', ' ').replace(';', ' ').split()
                 for line in text.splitlines()]
        rows = [(f'line {k}', line) for k, line in enumerate(lines, 1) if line]
    if not rows:
        raise ConfigurationError('holds no directions', source=name)
    points = []
    for place, row in rows:
        try:
            point = [float(x) for x in row]
            if len(point) != 3:
                raise ValueError
        except (TypeError, ValueError):
            raise ConfigurationError(
                f'{shown(row if isinstance(row, str) else " ".join(map(str, row)))} is not '
                'valid, expected three numbers', source=name, key=place) from None
        try:
            points.append(sphere.normalize(point))
        except ValueError as error:
            raise ConfigurationError(
                f'{point} is not valid: {error}', source=name, key=place) from None
    return np.array(points)


def _structured(text: str, name: str) -> list[tuple[str, list[Any]]]:
    """Return the rows of a JSON or YAML document, each with its place."""
    try:
        document = yaml.safe_load(text)  # JSON is YAML
    except yaml.YAMLError as error:
        mark = getattr(error, 'problem_mark', None)
        place = f' in line {mark.line + 1}' if mark else ''
        raise ConfigurationError(f'is not YAML or JSON{place}', source=name) from None
    if isinstance(document, dict):
        document = document.get('points')
    if not isinstance(document, list):
        raise ConfigurationError(
            'expected a list of directions, or one under the key "points"', source=name)
    return [(f'direction {k}', row if isinstance(row, list) else [row])
            for k, row in enumerate(document, 1)]


def _search(arguments: argparse.Namespace, points: Array, gains: Sequence[Gain],
            say: Callable[[str], object]) -> tuple[tuple[Design, Outcome] | None, Refusals]:
    """Return the first design that forms, or the best, with its outcome; and what failed."""
    from tetra_ros2.formation import design  # as above
    spin = None if arguments.spin is None else np.array(arguments.spin)
    best: tuple[Design, Outcome] | None = None
    refusals: Refusals = []
    for gain in gains:
        say(f'{_named(gain)}: choosing weights')
        try:
            made = design.design(points, gain, spin=spin, visible=arguments.visible,
                                 max_degree=arguments.max_degree)
        except design.DesignError as error:
            refusals.append((gain, str(error)))
            continue
        say(f'{_named(gain)}: following {arguments.starts} random starts')
        outcome = design.try_starts(made, arguments.starts, arguments.seed)
        if best is None or outcome.formed > best[1].formed:
            best = made, outcome
        if outcome.formed >= ENOUGH * arguments.starts:
            break
        refusals.append((gain, f'{outcome.formed} of {outcome.starts} random starts formed'))
    return best, refusals


@contextmanager
def _patience(arguments: argparse.Namespace) -> Iterator[Callable[[str], object]]:
    """Yield a function that says on a terminal what is being done."""
    console = Console(stderr=True)
    if arguments.json or not console.is_terminal:
        yield lambda text: None
        return
    with console.status('') as status:
        yield status.update


def _named(gain: Gain) -> str:
    family = type(gain).__name__.lower()
    return f'{family} gain' + (f', b = {gain.b:g}' if family != 'cosine' else '')


def _offset(made: Design) -> float:
    """Return how far sampling at RATE takes the pairwise angles from those of the points [rad]."""
    if not made.equilibrium.spins:
        return 0.0
    there = sampling.sampled_equilibrium(made.points, made.weights, made.gain, 1.0 / RATE)
    return float(np.max(np.abs(measures.pairwise_angles(there.gamma)
                               - measures.pairwise_angles(made.points))))


def _figures(made: Design, outcome: Outcome) -> dict[str, Any]:
    """Return the figures of a design as plain values."""
    arguments = (made.points, made.weights, made.gain)
    there = made.equilibrium
    spins = there.spins
    return {
        'agents': len(made.points),
        'edges': int(np.sum(made.weights != 0.0)),
        'degree': made.degree,
        'shape': targets.name(made.points),
        'gain': {'kind': type(made.gain).__name__.lower(), 'a': made.gain.a, 'b': made.gain.b},
        'spin': there.spin.tolist() if spins else [0.0, 0.0, 0.0],
        'residual': there.residual,
        'eigenvalues': [[float(v.real), float(v.imag)] for v in there.eigenvalues],
        'slowest_rate': made.slowest,
        'fastest_rate': made.fastest,
        'max_sample_time': sampling.max_sample_time(*arguments),
        'max_delay': sampling.max_delay(*arguments),
        'offset': _offset(made),
        'starts': outcome.starts,
        'formed': outcome.formed,
        'fraction_above_with_95_percent': lower_bound(outcome.formed, outcome.starts),
        'unsettled': outcome.unsettled,
        'others': [{'starts': count, 'angles': np.sort(measures.pairwise_angles(gamma)).tolist(),
                    'reduced_attitudes': gamma.tolist()} for gamma, count in outcome.others],
        'weights': made.weights.tolist(),
    }


def _print(figures: dict[str, Any], made: Design, outcome: Outcome, refusals: Refusals,
           arguments: argparse.Namespace) -> None:
    table = Table.grid(padding=(0, 2))

    def row(caption: str, text: str) -> None:
        table.add_row(Text(caption, 'bold'), Text(text))

    for gain, reason in refusals:
        row('tried', f'{_named(gain)}: {reason}')
    row('formation', f'{figures["shape"]}; {figures["agents"]} agents, {figures["edges"]} edges, '
                     f'each sees {figures["degree"]} others at most')
    row('gain', _named(made.gain) + ', a = 1')
    if made.equilibrium.spins:
        rate = float(np.linalg.norm(figures['spin']))
        row('spin', f'[{", ".join(f"{x:.6g}" for x in figures["spin"])}] rad/s, one turn in '
                    f'{2.0 * math.pi / rate:.5g} s; the mirror image turns the other way')
    row('eigenvalues', ', '.join(
        f'{re:.4g}' + (f'{im:+.4g}i' if abs(im) > 1e-9 else '')
        for re, im in figures['eigenvalues']) + ' 1/s')
    row('rates', f'slowest {made.slowest:.5g} 1/s, fastest {made.fastest:.5g} 1/s')
    row('limits', f'sample time below {figures["max_sample_time"]:.5g} s with no delay, delay '
                  f'below {figures["max_delay"]:.4g} s with no sampling')
    if figures['offset'] > 1e-12:
        row('', f'sampling at {RATE:g} Hz takes the angles {figures["offset"]:.2g} rad off')
    row('starts', f'{outcome.formed} of {outcome.starts} random ones formed: a chance above '
                  f'{figures["fraction_above_with_95_percent"]:.2%} with 95 % confidence')
    for gamma, count in outcome.others:
        angles = np.degrees(measures.pairwise_angles(gamma))
        row('', f'{count} came to another shape ({count / outcome.starts:.1%}): '
                f'{_what(gamma)}, {np.min(angles):.2f} to {np.max(angles):.2f} deg '
                'between any two')
    if outcome.unsettled:
        row('', f'{outcome.unsettled} had come to nothing yet')
    if arguments.out is not None:
        row('written', f'{arguments.out}; tetra launcher --config {arguments.out} runs it')
    make_console().print(table)


def _what(gamma: Array) -> str:
    """Return in words what shape a formation has."""
    name = targets.name(gamma)
    return equilibria.classify(gamma) if name.startswith('formation') else name


def _configuration(made: Design, offset: float, arguments: argparse.Namespace) -> str:
    """Return the text of a configuration that runs the design."""
    edges = [f'{i + 1} {j + 1} {made.weights[i, j]:.12g}'
             for i in range(len(made.points)) for j in range(len(made.points))
             if made.weights[i, j]]
    family = type(made.gain).__name__.lower()
    goal = f'--polyhedron {arguments.polyhedron}' if arguments.polyhedron else \
        f'--points {Path(arguments.points).name}'
    spin = '' if arguments.spin is None else \
        ' --spin ' + ' '.join(f'{x:g}' for x in arguments.spin)
    document = {'/**': {'ros__parameters': {
        'topology': {
            'kind': 'custom', 'n': len(made.points), 'edges': edges,
            # What is to come out: for those who watch, not for the agents.
            'points': [float(f'{x:.15g}') for x in made.points.ravel()]},
        'gain': {'kind': family, 'a': made.gain.a, 'b': made.gain.b}}},
        '/**/plant': {'ros__parameters': {'mode': 'lockstep', 'rate': RATE, 'seed': 7}}}
    if 2.0 * offset > TOLERANCE:
        # The formation of the sampled loop is not quite that of the points, and is to count.
        document['/**/monitor'] = {'ros__parameters': {'tolerance': float(f'{3.0 * offset:.1g}')}}
    return (f'# Made by: tetra design {goal}{spin} --gain {family} --gain-b {made.gain.b:g}\n'
            + yaml.safe_dump(document, sort_keys=False, width=99))
