# Copyright 2026 The tetra_ros2 authors
# SPDX-License-Identifier: Apache-2.0

"""``tetra analyze``: the numbers that an engineer has to choose, from theory, for any config."""

from dataclasses import asdict, dataclass
import json
import math


def add_arguments(parser):
    """Add the arguments of ``tetra analyze``."""
    parser.add_argument(
        '--config', metavar='FILE', default='complete',
        help='a ROS 2 parameter file, or the name of one that ships (default: %(default)s)')
    parser.add_argument(
        '--rate', type=float, metavar='HZ',
        help='of the loop [Hz] (default: that of the plant in FILE)')
    parser.add_argument(
        '--noise', type=float, default=1e-3, metavar='RAD',
        help='standard deviation of a measured direction, per axis [rad] (default: %(default)s)')
    parser.add_argument(
        '--start', type=float, default=0.1, metavar='RAD',
        help='error from which on to count the settling time [rad] (default: %(default)s)')
    parser.add_argument(
        '--error', type=float, default=1e-3, metavar='RAD',
        help='error at which it has settled [rad] (default: %(default)s)')
    parser.add_argument('--json', action='store_true', help='print the figures as JSON')


@dataclass(frozen=True)
class Analysis:
    """
    What theory says of a configuration.

    :param agents: number of agents
    :param edges: number of edges
    :param strongly_connected: whether everybody is seen by everybody, directly or not
    :param symmetric: whether W(i, j) = W(j, i)
    :param shape: name of the shape that attracts, or None if it has none
    :param angles: its pairwise angles [rad], ascending
    :param isolated: whether the shape is isolated; otherwise it drifts along others as good
    :param spin_rate: angular speed of the formation [rad/s], 0 at rest
    :param period: of one turn [s], None at rest
    :param eigenvalues: real and imaginary parts of the transverse ones [1/s], the slowest first
    :param slowest_rate: of the modes that decay [1/s]
    :param fastest_rate: of all of them [1/s]
    :param settling_time: for the error to fall from ``start`` to ``error`` [s]
    :param rate: of the loop [Hz]
    :param sampled_rate: slowest rate of the loop at that rate [1/s]; negative if it grows
    :param offset: how far sampling takes the angles from the shape [rad]
    :param longest_sample_time: below which the loop is stable without delay [s]
    :param longest_delay: below which it is stable without sampling [s]
    :param most_delay_steps: how many whole steps measurements may be late at that rate; -1: none
    :param together: for several rates [Hz] the number of steps, and that in seconds
    :param noise: standard deviation of a measured direction, per axis [rad]
    :param angle_deviation: standard deviation of the worst pairwise angle that it leaves [rad]
    :param mean_error: mean of the formation error that it leaves [rad]
    """

    agents: int
    edges: int
    strongly_connected: bool
    symmetric: bool
    shape: str | None
    angles: tuple
    isolated: bool
    spin_rate: float
    period: float | None
    eigenvalues: tuple
    slowest_rate: float
    fastest_rate: float
    settling_time: float
    rate: float
    sampled_rate: float
    offset: float
    longest_sample_time: float
    longest_delay: float
    most_delay_steps: int
    together: tuple
    noise: float
    angle_deviation: float | None
    mean_error: float | None


MOST_AGENTS = 60
"""Linear algebra on the 2 n coordinates of more would take minutes."""


def run(arguments):
    """
    Analyse a configuration and print what was found.

    :returns: 0; 1 if the loop is not stable at the rate asked for
    :raises ConfigurationError: if it cannot be analysed
    """
    from tetra_ros2.config.parameters import ConfigurationError
    for name in ('rate', 'noise', 'start', 'error'):
        value = getattr(arguments, name)
        if value is not None and not 0.0 < value < 1e9:
            raise ConfigurationError(
                f'{value!r} is not valid, expected a number greater than 0', key=f'--{name}')
    if arguments.error >= arguments.start:
        raise ConfigurationError(
            f'{arguments.error!r} is not valid, expected less than --start', key='--error')
    analysis = analyze(arguments.config, rate=arguments.rate, noise=arguments.noise,
                       start=arguments.start, error=arguments.error)
    if arguments.json:
        print(json.dumps(asdict(analysis), indent=2, allow_nan=False))
    else:
        _print(analysis, arguments)
    return 0 if analysis.sampled_rate > 0.0 else 1


def analyze(config, *, rate=None, noise=1e-3, start=0.1, error=1e-3):
    """
    Analyse a configuration.

    :param config: a path, or the name of a configuration that ships
    :param rate: of the loop [Hz]; by default the plant's
    :param noise: standard deviation of a measured direction, per axis [rad]
    :param start: error from which on to count the settling time [rad]
    :param error: error at which it has settled [rad]
    :returns: an :class:`Analysis`
    :raises ConfigurationError: if it cannot be analysed
    """
    import numpy as np

    from tetra_ros2.config import configuration
    from tetra_ros2.formation import measures, sampling
    file = configuration.load(config)
    try:
        formation, values = _formation(file), file.values('plant')
        equilibrium, shape = _equilibrium(formation, values)
    except configuration.ConfigurationError as problem:
        raise problem.at(file.path) from None
    topology, gain, weights = formation.topology, formation.gain, formation.topology.weights
    eigenvalues = equilibrium.eigenvalues
    scale = float(np.max(np.abs(eigenvalues)))
    decaying = eigenvalues[eigenvalues.real < -1e-7 * scale]
    rate = rate or values['rate']
    h = round(1e9 / rate) / 1e9  # the plant counts nanoseconds
    spin = float(np.linalg.norm(equilibrium.spin))
    spins = spin > 1e-9 * scale
    gamma = equilibrium.gamma
    there = sampling.sampled_equilibrium(gamma, weights, gain, h)
    isolated = len(decaying) == len(eigenvalues)

    longest_sample_time = sampling.longest_sample_time(decaying)
    longest_delay = sampling.longest_delay(decaying)
    if spins:
        # The closed forms hold at rest. Here they are where the search begins.
        longest_sample_time = sampling.spinning_sample_limit(
            gamma, weights, gain, longest_sample_time)
        fine = longest_delay / 500.0
        steps = sampling.spinning_delay_limit(gamma, weights, gain, fine, 500)
        longest_delay = (steps + 0.5) * fine

    def most_steps(h):
        if h >= longest_sample_time:
            return -1
        if not spins:
            return sampling.most_delay_steps(decaying, h)
        return sampling.spinning_delay_limit(
            gamma, weights, gain, h, max(1, int(longest_delay / h)))

    together = []
    for fraction in (0.9, 0.5, 0.2, 0.1, 0.05, 0.02):
        step = float(f'{fraction * longest_sample_time:.2g}')
        together.append((1.0 / step, most_steps(step), most_steps(step) * step))
    sampled = there.multipliers() if isolated else 1.0 + h * decaying
    stable = isolated and there.residual < 1e-9 and np.abs(sampled[0]) < 1.0
    deviation, mean_error = there.steady_angles(noise) if stable else ([math.nan], math.nan)
    angles = measures.pairwise_angles(gamma)
    return Analysis(
        agents=topology.n,
        edges=len(topology.edges),
        strongly_connected=len(components(weights)[0]) == 1,
        symmetric=bool(np.all(weights == weights.T)),
        shape=shape.name if shape is not None else None,
        angles=tuple(np.sort(angles).tolist()),
        isolated=isolated,
        spin_rate=spin if spins else 0.0,
        period=2.0 * math.pi / spin if spins else None,
        eigenvalues=tuple((float(v.real), float(v.imag)) for v in eigenvalues),
        slowest_rate=float(np.min(-decaying.real)),
        fastest_rate=float(np.max(np.abs(decaying))),
        settling_time=math.log(start / error) / float(np.min(-decaying.real)),
        rate=rate,
        sampled_rate=float(-np.log(np.max(np.abs(sampled))) / h),
        offset=float(np.max(np.abs(np.sort(measures.pairwise_angles(there.gamma))
                                   - np.sort(angles)))) if stable and spins else 0.0,
        longest_sample_time=longest_sample_time,
        longest_delay=longest_delay,
        most_delay_steps=most_steps(h),
        together=tuple(together),
        noise=noise,
        angle_deviation=float(np.max(deviation)) if stable else None,
        mean_error=mean_error if stable else None,
    )


def _formation(file):
    """Return the formation of a file, if all its agents agree on it."""
    import numpy as np

    from tetra_ros2.config.configuration import formation_from_parameters
    from tetra_ros2.config.parameters import ConfigurationError
    formation = file.formation()
    if formation.topology.n > MOST_AGENTS:
        raise ConfigurationError(
            f'{formation.topology.n} agents are too many to analyse, expected {MOST_AGENTS} '
            'at most', key='topology.n')
    for i in range(1, formation.topology.n + 1):
        own = formation_from_parameters(file.values('agent', f'/agent_{i}'))
        if own.gain != formation.gain or type(own.gain) is not type(formation.gain) \
                or not np.array_equal(own.topology.weights, formation.topology.weights):
            raise ConfigurationError(
                'an agent with a gain or topology of its own cannot be analysed',
                key=f'agent_{i}')
    return formation


def components(weights):
    """
    Return the strongly and the weakly connected components of a graph, as lists of agents.

    :param weights: ``(n, n)``
    """
    import numpy as np

    def reach(edges):
        n = len(edges)
        reached = (edges != 0.0) | np.eye(n, dtype=bool)
        for _ in range(int(n).bit_length()):
            reached = reached @ reached
        return reached

    def classes(together):
        return sorted({tuple((np.flatnonzero(row) + 1).tolist()) for row in together})

    forward = reach(np.asarray(weights))
    return classes(forward & forward.T), classes(reach(weights + weights.T))


def _equilibrium(formation, values):
    """Return the relative equilibrium that attracts, and its shape where that has a name."""
    import numpy as np

    from tetra_ros2.config.configuration import initial_attitudes
    from tetra_ros2.config.parameters import ConfigurationError
    from tetra_ros2.formation import rotation, shapes, stability
    topology, gain = formation.topology, formation.gain
    parts = components(topology.weights)[1]
    if len(parts) > 1:
        shown = ' and '.join(str(set(part)) for part in parts)
        raise ConfigurationError(
            f'agents {shown} do not see one another, so there is no one formation to analyse',
            key='topology')
    shape = shapes.known_shape(topology)
    if shape is not None:
        equilibrium = stability.transverse(shape.points, topology.weights, gain)
        if equilibrium.inertia[0] == 0:
            return equilibrium, shape
    attitudes = initial_attitudes(values, topology.n)
    if attitudes is None:
        rng = np.random.default_rng(max(values['seed'], 0))
        attitudes = rotation.random(rng, (topology.n,))
    start = rotation.rotate(attitudes, formation.pointing_axes)
    gamma = stability.settle(start, topology.weights, gain)
    if gamma is None:
        raise ConfigurationError(
            'its shape goes on changing, so there is no formation to analyse', key='topology')
    equilibrium = stability.transverse(gamma, topology.weights, gain)
    if not np.any(equilibrium.eigenvalues.real < -1e-7 * np.max(np.abs(equilibrium.eigenvalues))):
        raise ConfigurationError(
            'no deviation from its formation decays, so it has no rate', key='topology')
    return equilibrium, None


def _print(a, arguments):
    from rich.console import Console
    from rich.table import Table
    from rich.text import Text
    table = Table.grid(padding=(0, 2))

    def row(caption, text):
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
    if not a.isolated:
        row('', 'not isolated: it drifts among other shapes as good, and only the others decay')
    row('eigenvalues', ', '.join(
        f'{re:.5g}' + (f'{im:+.5g}i' if im else '') for re, im in a.eigenvalues) + ' 1/s')
    row('rates', f'slowest {a.slowest_rate:.6g} 1/s, fastest {a.fastest_rate:.6g} 1/s')
    row('settling', f'{a.settling_time:.4g} s from an error of {arguments.start:g} rad '
                    f'to {arguments.error:g} rad')
    row('limits', f'sample time below {a.longest_sample_time:.6g} s with no delay, '
                  f'delay below {a.longest_delay:.5g} s with no sampling')
    if a.most_delay_steps < 0:
        row(f'at {a.rate:g} Hz', 'not stable: sample faster, or take a smaller gain')
    else:
        delay = a.most_delay_steps / a.rate
        row(f'at {a.rate:g} Hz', f'slowest rate {a.sampled_rate:.6g} 1/s; measurements may be '
            f'{a.most_delay_steps} steps late, {delay:.4g} s')
    if a.offset > 1e-12:
        row('', f'sampling takes the angles {a.offset:.3g} rad off')
    row('both', '; '.join(f'{rate:.3g} Hz: {steps} steps, {delay:.3g} s'
                          for rate, steps, delay in a.together))
    if a.mean_error is not None:
        row('noise', f'of {a.noise:g} rad leaves an error of {a.mean_error:.3g} rad in the mean; '
            f'angles deviate by {a.angle_deviation:.3g} rad')
    Console(width=None).print(table)
