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

"""``tetra analyze``: the numbers that an engineer has to choose, from theory, for any config."""

import argparse
from collections.abc import Callable
from dataclasses import asdict
import json
import math
from pathlib import Path

import numpy as np
from rich.table import Table
from rich.text import Text
from tetra_ros2.commands._console import make_console
from tetra_ros2.config import configuration
from tetra_ros2.config.bodies import physics_from_parameters
from tetra_ros2.config.configuration import formation_from_parameters
from tetra_ros2.config.parameters import check_parameters, ConfigurationError
from tetra_ros2.formation import Formation
from tetra_ros2.formation.analysis import Analysis, NotAnalyzable
from tetra_ros2.physics.demands import Demands, demands


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the arguments of ``tetra analyze``."""
    parser.add_argument(
        '--config', metavar='FILE', default='complete',
        help='a ROS 2 parameter file, or the name of one that ships (default: %(default)s)')
    parser.add_argument(
        '--rate', type=float, metavar='HZ',
        help='of the loop [Hz] (default: that of the plant in FILE)')
    parser.add_argument(
        '--delay', type=float, metavar='S',
        help='age of the measurements [s] (default: that of the plant in FILE)')
    parser.add_argument(
        '--noise', type=float, default=1e-3, metavar='RAD',
        help='standard deviation of a measured direction, per axis [rad] (default: %(default)s)')
    parser.add_argument(
        '--start', type=float, default=0.1, metavar='RAD',
        help='error from which on to count the settling time [rad] (default: %(default)s)')
    parser.add_argument(
        '--error', type=float, default=1e-3, metavar='RAD',
        help='error at which it has settled [rad] (default: %(default)s)')
    parser.add_argument(
        '--body', metavar='BODY', help='bodies with mass: wheels, gimbal, or an MJCF file '
        '(default: that of the plant in FILE)')
    parser.add_argument(
        '--bandwidth', type=float, metavar='K', help='of their rate loop [1/s] (default: that of '
        'the plant in FILE)')
    parser.add_argument('--json', action='store_true', help='print the figures as JSON')


def run(arguments: argparse.Namespace) -> int:
    """
    Analyse a configuration and print what was found.

    :returns: 0; 1 if the loop is not stable at the rate and delay asked for
    :raises ConfigurationError: if it cannot be analysed
    """
    for name in ('rate', 'noise', 'start', 'error', 'bandwidth'):
        value = getattr(arguments, name)
        if value is not None and not 0.0 < value < 1e9:
            raise ConfigurationError(
                f'{value!r} is not valid, expected a number greater than 0', key=f'--{name}')
    if arguments.delay is not None and not 0.0 <= arguments.delay < 1e9:
        raise ConfigurationError(
            f'{arguments.delay!r} is not valid, expected a number from 0 up', key='--delay')
    if arguments.error >= arguments.start:
        raise ConfigurationError(
            f'{arguments.error!r} is not valid, expected less than --start', key='--error')
    analysis = analyze(arguments.config, rate=arguments.rate, delay=arguments.delay,
                       noise=arguments.noise, start=arguments.start, error=arguments.error)
    bodies = analyze_bodies(
        arguments.config, rate=arguments.rate, delay=arguments.delay, body=arguments.body,
        bandwidth=arguments.bandwidth)
    if arguments.json:
        document = asdict(analysis)
        if bodies is not None:
            document['bodies'] = asdict(bodies)
        print(json.dumps(document, indent=2, allow_nan=False))
    else:
        _print(analysis, arguments, bodies)
    return 0 if analysis.is_stable and (bodies is None or bodies.is_stable) else 1


def analyze_bodies(config: str | Path, *, rate: float | None = None, delay: float | None = None,
                   body: str | None = None, bandwidth: float | None = None) -> Demands | None:
    """
    Say what the formation of a configuration asks of bodies with mass.

    :param config: a path, or the name of a configuration that ships
    :param rate: of the loop [Hz]; by default the plant's
    :param delay: how old the measurements are [s]; by default the plant's
    :param body: what turns; by default the plant's
    :param bandwidth: of the rate loop [1/s]; by default the plant's
    :returns: a :class:`~tetra_ros2.physics.demands.Demands`; None for kinematic bodies
    :raises ConfigurationError: if it cannot be analysed
    """
    file = configuration.load(config)
    values = file.values('plant')
    given = {'body': body, 'rate_loop.bandwidth': bandwidth}
    values.update(check_parameters('plant', {
        **values, **{key: value for key, value in given.items() if value is not None}}))
    try:
        formation = _formation(file)
        physics = physics_from_parameters(values, formation.n)
        if physics is None:
            return None
        return demands(formation, physics,
                       rate=values['rate'] if rate is None else rate,
                       delay=values['measurement_delay'] if delay is None else delay)
    except ConfigurationError as problem:
        raise problem.at(file.path) from None


def analyze(config: str | Path, *, rate: float | None = None, delay: float | None = None,
            noise: float = 1e-3, start: float = 0.1, error: float = 1e-3) -> Analysis:
    """
    Analyse a configuration.

    :param config: a path, or the name of a configuration that ships
    :param rate: of the loop [Hz]; by default the plant's
    :param delay: how old the measurements are [s]; by default the plant's
    :param noise: standard deviation of a measured direction, per axis [rad]
    :param start: error from which on to count the settling time [rad]
    :param error: error at which it has settled [rad]
    :returns: an :class:`~tetra_ros2.formation.Analysis`
    :raises ConfigurationError: if it cannot be analysed
    """
    file = configuration.load(config)
    try:
        formation, values = _formation(file), file.values('plant')
        return formation.analyze(
            rate=values['rate'] if rate is None else rate,
            delay=values['measurement_delay'] if delay is None else delay,
            noise=noise, start=start, error=error,
            initial=configuration.initial_attitudes(values, formation.n),
            seed=max(values['seed'], 0))
    except ConfigurationError as problem:
        raise problem.at(file.path) from None
    except NotAnalyzable as problem:
        raise ConfigurationError(
            str(problem), source=file.path,
            key={'delay': 'measurement_delay'}.get(problem.key, problem.key)) from None


def _formation(file: configuration.ParameterFile) -> Formation:
    """Return the formation of a file, if all its agents agree on it."""
    formation = file.formation()
    for i in range(1, formation.n + 1):
        own = formation_from_parameters(file.values('agent', f'/agent_{i}'))
        if own.gain != formation.gain or type(own.gain) is not type(formation.gain) \
                or not np.array_equal(own.topology.weights, formation.topology.weights):
            raise ConfigurationError(
                'an agent with a gain or topology of its own cannot be analysed',
                key=f'agent_{i}')
    return formation


def _print(a: Analysis, arguments: argparse.Namespace, bodies: Demands | None) -> None:
    table = Table.grid(padding=(0, 2))

    def row(caption: str, text: str) -> None:
        table.add_row(Text(caption, 'bold'), Text(text))

    connected = 'strongly connected' if a.strongly_connected else 'connected, not strongly'
    row('graph', f'{a.agents} agents, {a.edges} edges, {connected}, '
                 f'{"symmetric" if a.symmetric else "directed"}')
    degrees = [math.degrees(angle) for angle in a.angles]
    row('formation', (a.shape or 'no shape of a known name') +
        f', {min(degrees):.3f} to {max(degrees):.3f} deg between any two')
    if a.period:
        row('', f'a relative equilibrium: spins at {a.spin_rate:.6g} rad/s, '
                f'one turn in {a.period:.6g} s')
    else:
        row('', 'an equilibrium: comes to rest')
    if not a.hyperbolic:
        row('', 'not hyperbolic: the shape is one of a continuum and drifts among the others')
    row('eigenvalues', ', '.join(
        f'{re:.5g}' + (f'{im:+.5g}i' if im else '') for re, im in a.eigenvalues) + ' 1/s')
    row('rates', f'slowest {a.slowest_rate:.6g} 1/s, fastest {a.fastest_rate:.6g} 1/s')
    row('settling', f'{a.settling_time:.4g} s from an error of {arguments.start:g} rad '
                    f'to {arguments.error:g} rad')
    row('limits', f'sample time below {a.max_sample_time:.6g} s with no delay, '
                  f'delay below {a.max_delay:.5g} s with no sampling')
    late = f', {a.delay_steps} steps late' if a.delay_steps else ''
    if not a.is_stable:
        remedy = 'take fresher measurements' if a.max_delay_steps >= 0 else 'sample faster'
        row(f'at {a.rate:g} Hz', f'not stable{late}: {remedy}, or take a smaller gain')
    else:
        delay = a.max_delay_steps / a.rate
        row(f'at {a.rate:g} Hz', f'slowest rate {a.sampled_rate:.6g} 1/s{late}; measurements may '
            f'be {a.max_delay_steps} steps late, {delay:.4g} s')
        if a.spin_rate:
            row('', f'spins at {a.sampled_spin_rate:.6g} rad/s')
    if a.offset > 1e-12:
        row('', f'sampling and delay take the angles {a.offset:.3g} rad off')
    row('both', '; '.join(f'{rate:.3g} Hz: {steps} steps, {delay:.3g} s'
                          for rate, steps, delay in a.max_delay_by_rate))
    if a.mean_error is not None:
        row('noise', f'of {a.noise:g} rad leaves an error of {a.mean_error:.3g} rad in the mean; '
            f'angles deviate by {a.angle_deviation:.3g} rad')
    if bodies is not None:
        _print_bodies(row, bodies, a.rate)
    make_console().print(table)


def _print_bodies(row: Callable[[str, str], None], b: Demands, rate: float) -> None:
    """Add the rows for bodies with mass."""
    def limit(value: float | None) -> str:
        return 'any will do' if value == 0.0 else 'none will do' if value is None else \
            f'above {value:.5g} 1/s'

    row('bodies', f'{b.body}, rate loop of {b.bandwidth:g} 1/s')
    row('bandwidth', f'{limit(b.min_bandwidth)}; at {rate:g} Hz {limit(b.sampled_min_bandwidth)}')
    if b.is_stable:
        row('', f'slowest rate {b.sampled_rate:.6g} 1/s at {rate:g} Hz, '
                f'{b.slowest_rate:.6g} 1/s with no sampling')
        if b.spin_rate:
            row('', f'spins at {b.spin_rate:.6g} rad/s, angles {b.offset:.3g} rad off; a body '
                    f'turns at {b.body_rate:.4g} rad/s, {b.angular_acceleration:.4g} rad/s^2')
    else:
        row('', f'not stable with {b.bandwidth:g} 1/s: take a faster rate loop')
    if b.torque is None or b.torque_limit is None or b.enough_torque is None:
        return
    row('wheels', f'saturate where a command is off by more than {b.saturation_rate:.3g} rad/s; '
                  f'turn a body at {b.rate_limit:.4g} rad/s at most')
    often = 'once at most, after the start' if b.torque_limit > b.enough_torque else \
        f'maybe often: only a torque limit above {b.enough_torque:.3g} N m rules it out'
    row('', f'saturate {often}')
    row('', f'asked for: torque {b.torque:.3g} of {b.torque_limit:g} N m, speed '
            f'{b.wheel_speed:.4g} of {b.wheel_speed_limit:g} rad/s, '
            f'momentum {b.momentum:.3g} N m s')
    row('', 'last for ever: a spin uses up no momentum, and nothing disturbs it'
        if b.lifetime is None else f'last {b.lifetime:.4g} s under the disturbance')
