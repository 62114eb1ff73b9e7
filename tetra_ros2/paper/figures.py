# Copyright 2026 The tetra_ros2 authors
# SPDX-License-Identifier: Apache-2.0

"""``tetra figures``: the paper's two simulation figures, from runs of the real nodes."""

from pathlib import Path

SEED = 7

DURATIONS = {('complete', 0): 8.0, ('complete', 1): 40.0,
             ('rotating', 0): 24.0, ('rotating', 1): 110.0}
"""Formation time of each run [s]: long enough to form, and to turn twice."""

NAMES = (r'$f_1(\theta) = 1 + \cos\theta$', r'$f_2(\theta) = e^{-\theta}$')

AGENTS = (('#000000', '-', 'o'), ('#0b5fa5', '--', 's'), ('#c8501e', '-.', '^'),
          ('#6b9416', (0, (1, 1)), 'D'))
"""Colour, line and marker of each agent: as colours they differ in lightness, and in grey too."""

PAIRS = (('#000000', '-'), ('#5b2a86', '--'), ('#0b5fa5', '-.'), ('#b03a2e', (0, (1, 1))),
         ('#c98a00', (0, (5, 1, 1, 1, 1, 1))), ('#6b9416', (0, (6, 2))))

VIEW = (-60.0, 22.0)
"""From where the sphere is seen: longitude and latitude [deg]."""

PREDICTION = {'color': '0.83', 'linewidth': 3.4, 'solid_capstyle': 'round',
              'zorder': 1.9}


def add_arguments(parser):
    """Add the arguments of ``tetra figures``."""
    parser.add_argument('--out', required=True, metavar='DIR', help='directory to write into')
    parser.add_argument(
        '--seed', type=int, default=SEED, metavar='N',
        help='of the initial attitudes (default: %(default)s)')
    parser.add_argument(
        '--rate', type=float, default=100.0, metavar='HZ',
        help='of the loop [Hz] (default: %(default)s)')


def run(arguments):
    """
    Run the nodes, draw both figures, and say what was measured.

    :returns: 0
    :raises ConfigurationError: if it was called wrongly; nothing was written then
    """
    import matplotlib

    from tetra_ros2.config.parameters import ConfigurationError
    from tetra_ros2.paper.claims import Subject
    if arguments.seed < 0:
        raise ConfigurationError(
            f'{arguments.seed} is not valid, expected an integer from 0 up', key='--seed')
    if not 1.0 <= arguments.rate <= 1e4:
        raise ConfigurationError(
            f'{arguments.rate!r} is not valid, expected a number from 1 to 10000', key='--rate')
    directory = Path(arguments.out)
    _require_writable(directory)
    subject = Subject()
    measured = {key: _measure(subject, *key, arguments) for key in DURATIONS}
    with matplotlib.rc_context({
            'font.size': 8, 'axes.titlesize': 8, 'axes.linewidth': 0.6, 'lines.linewidth': 1.1,
            'legend.fontsize': 7, 'legend.handlelength': 2.6, 'font.family': 'DejaVu Serif',
            'mathtext.fontset': 'dejavuserif', 'pdf.fonttype': 42, 'svg.hashsalt': 'tetra'}):
        for graph, draw in (('complete', _stationary), ('rotating', _rotating)):
            name = {'complete': 'stationary', 'rotating': 'rotating'}[graph]
            _save(draw([measured[graph, which] for which in (0, 1)]), directory, name)
    for (graph, which), result in measured.items():
        print(f'{graph:<9} f{which + 1}  {result.text}')
    return 0


def _require_writable(directory):
    """
    Make the directory.

    :raises ConfigurationError: if that, or a file in it, cannot be made
    """
    import tempfile

    from tetra_ros2.config.parameters import ConfigurationError
    try:
        directory.mkdir(parents=True, exist_ok=True)
        with tempfile.TemporaryFile(dir=directory):
            pass
    except OSError as error:
        raise ConfigurationError(
            f'{directory} cannot be written: {error.strerror}', key='--out') from None


class _Measured:
    """
    A run of the nodes, and the same motion by theory.

    Theory is the continuous closed loop from the same start, and its linearisation: the nodes
    sample it.
    """

    def __init__(self, subject, graph, which, run):
        import numpy as np

        from tetra_ros2.formation import measures, sampling, shapes, stability
        from tetra_ros2.paper.runs import decay_rate
        self.graph, self.which, self.run = graph, which, run
        self.topology, self.gain = getattr(subject, graph), subject.gains[which]
        self.cosines = measures.pairwise_cosines(run.gamma)
        self.theory = _continuous(run, self.topology, self.gain)
        spectrum = stability.transverse(
            shapes.TETRAHEDRON.points, self.topology.weights, self.gain).eigenvalues
        self.predicted_rate = float(-np.max(spectrum.real))
        there = sampling.sampled_equilibrium(
            run.gamma[-1], self.topology.weights, self.gain, run.h)
        self.sampled_rate = float(-np.log(abs(there.floquet_multipliers()[0])) / run.h)
        self.measured_rate = decay_rate(run, self.topology, self.gain)
        spin = measures.mean_angular_velocity(run.gamma[-51], run.gamma[-1], 50 * run.h)
        self.measured_spin = float(spin @ run.gamma[-1, 0])
        self.predicted_spin = float(shapes.predicted_angular_velocity(
            run.gamma[-1], self.topology, self.gain) @ run.gamma[-1, 0])
        self.text = (f'slowest rate {self.measured_rate:.4f} 1/s measured, '
                     f'{self.predicted_rate:.4f} 1/s predicted, {self.sampled_rate:.4f} 1/s '
                     'with sampling')
        if graph == 'rotating':
            self.text += (f'; spin {self.measured_spin:+.6f} rad/s measured, '
                          f'{self.predicted_spin:+.6f} rad/s predicted; one turn in '
                          f'{2 * np.pi / abs(self.measured_spin):.3f} s')


def _measure(subject, graph, which, arguments):
    from tetra_ros2.paper.runs import run_nodes
    run = run_nodes(getattr(subject, graph), subject.gains[which], DURATIONS[graph, which],
                    rate=arguments.rate, seed=arguments.seed)
    return _Measured(subject, graph, which, run)


def _continuous(run, topology, gain, substeps=2):
    """Return the closed loop's own solution at the times of a run, ``(k, n, 3)``."""
    import numpy as np

    from tetra_ros2.formation import law, sphere
    h = run.h / substeps

    def rate(gamma):
        return law.velocity(gamma, topology.weights, gain)

    gamma, kept = run.gamma[0], [run.gamma[0]]
    for _ in range(len(run.times) - 1):
        for _ in range(substeps):
            # The midpoint rule: its error, of h^2, is far below what sampling makes.
            middle = sphere.normalize(gamma + 0.5 * h * rate(gamma))
            gamma = sphere.normalize(gamma + h * rate(middle))
        kept.append(gamma)
    return np.stack(kept)


def _project(points):
    """Return where points of the sphere are seen, and how far in front they are."""
    import numpy as np
    longitude, latitude = np.radians(VIEW)
    right = np.array([-np.sin(longitude), np.cos(longitude), 0.0])
    up = np.array([-np.sin(latitude) * np.cos(longitude),
                   -np.sin(latitude) * np.sin(longitude), np.cos(latitude)])
    return points @ right, points @ up, points @ np.cross(right, up)


def _curve(axes, points, **style):
    """Draw a curve on the sphere: full in front, faint behind."""
    import numpy as np
    x, y, depth = _project(points)
    front = depth >= 0.0
    # Each part keeps one point of the other, so that no gap shows at the rim.
    for visible, factor in ((front, 1.0), (~front, 0.35)):
        wider = visible | np.r_[visible[1:], False] | np.r_[False, visible[:-1]]
        axes.plot(np.where(wider, x, np.nan), np.where(wider, y, np.nan),
                  **{**style, 'alpha': style.get('alpha', 1.0) * factor})


def _sphere(axes, result, letter):
    """Draw the trajectories on the sphere, start and end marked."""
    import numpy as np
    angle = np.linspace(0.0, 2.0 * np.pi, 361)
    axes.plot(np.cos(angle), np.sin(angle), color='0.4', linewidth=0.7)
    for latitude in np.radians((-60, -30, 0, 30, 60)):
        _curve(axes, np.stack([np.cos(latitude) * np.cos(angle), np.cos(latitude) * np.sin(angle),
                               np.full_like(angle, np.sin(latitude))], axis=-1),
               color='0.7', linewidth=0.35)
    for longitude in np.radians(np.arange(0, 180, 30)):
        circle = np.stack([np.sin(angle) * np.cos(longitude), np.sin(angle) * np.sin(longitude),
                           np.cos(angle)], axis=-1)
        _curve(axes, circle, color='0.7', linewidth=0.35)
    for i, (color, line, marker) in enumerate(AGENTS):
        _curve(axes, result.theory[:, i], **PREDICTION)
        _curve(axes, result.run.gamma[:, i], color=color, linestyle=line, linewidth=1.2)
        for index, face in ((0, 'white'), (-1, color)):
            x, y, depth = _project(result.run.gamma[index, i])
            axes.plot(x, y, marker=marker, markersize=5, markerfacecolor=face,
                      markeredgecolor=color, markeredgewidth=1.0,
                      alpha=1.0 if depth >= 0.0 else 0.5, linestyle='none', zorder=5)
    axes.set(aspect='equal', xlim=(-1.06, 1.06), ylim=(-1.06, 1.06))
    axes.axis('off')
    _title(axes, f'({letter}) trajectories with {NAMES[result.which]}')


def _title(axes, text):
    axes.set_title(text, loc='left')


def _agents_legend(figure):
    from matplotlib.lines import Line2D
    handles = [Line2D([], [], color=color, linestyle=line, marker=marker, markersize=4,
                      label=rf'$\Gamma_{i}$')
               for i, (color, line, marker) in enumerate(AGENTS, 1)]
    handles += [
        Line2D([], [], color='0.2', marker='o', markerfacecolor='white', linestyle='none',
               markersize=4, label='start'),
        Line2D([], [], color='0.2', marker='o', linestyle='none', markersize=4, label='end'),
        Line2D([], [], **PREDICTION, label='predicted')]
    figure.legend(handles=handles, loc='outside upper center', ncols=7, frameon=False)


def _figure():
    from matplotlib.figure import Figure
    figure = Figure(figsize=(7.1, 7.6), layout='constrained')
    figure.get_layout_engine().set(w_pad=0.06, h_pad=0.06)
    return figure, figure.subplots(3, 2, gridspec_kw={'height_ratios': (1.35, 1.0, 1.0)})


def _time_axis(axes, result):
    axes.set_xlabel('time [s]')
    axes.set_xlim(0.0, result.run.times[-1])
    axes.tick_params(width=0.6)


def _stationary(results):
    """Return the paper's Fig:Sim:SF, with the convergence below it."""
    from tetra_ros2.formation import measures
    figure, grid = _figure()
    for column, result in enumerate(results):
        _sphere(grid[0, column], result, 'ab'[column])
        axes = grid[1, column]
        predicted = measures.pairwise_cosines(result.theory)
        for pair, ((i, j), (color, line)) in enumerate(zip(measures.pairs(4), PAIRS)):
            axes.plot(result.run.times, predicted[:, pair], **PREDICTION)
            axes.plot(result.run.times, result.cosines[:, pair], color=color, linestyle=line,
                      label=f'{i}{j}')
        axes.axhline(-1.0 / 3.0, color='0.2', linewidth=0.5)
        axes.annotate(r'$-\frac{1}{3}$', (1.0, -1.0 / 3.0), xycoords=('axes fraction', 'data'),
                      xytext=(3, 0), textcoords='offset points', va='center')
        axes.set(ylim=(-1.05, 1.05), ylabel=r'$\cos\theta_{ij}$ [1]')
        axes.legend(ncols=3, title=r'$ij$', loc='upper right', frameon=False)
        _time_axis(axes, result)
        _title(axes, f'({"cd"[column]}) cosines of the geodesic distances, $f_{column + 1}$')
        _convergence(grid[2, column], result, 'ef'[column])
    _agents_legend(figure)
    return figure


def _convergence(axes, result, letter):
    """Draw the error over time beside the slope that the slowest eigenvalue predicts."""
    import numpy as np

    from tetra_ros2.formation import measures, shapes
    error = measures.shape_error(result.run.gamma, shapes.TETRAHEDRON.angles)
    times = result.run.times
    anchor = int(np.argmax(error < 1e-2))
    late = times >= times[anchor]
    axes.semilogy(times[late], error[anchor] * np.exp(
        -result.predicted_rate * (times[late] - times[anchor])), **PREDICTION)
    axes.semilogy(times, error, color='black')
    axes.set(ylim=(1e-10, 10.0), ylabel=r'$\max|\theta_{ij} - \theta^*|$ [rad]')
    axes.text(0.97, 0.93, f'slowest rate [1/s]\nmeasured {result.measured_rate:.4f}\n'
              f'predicted {result.predicted_rate:.4f}\n'
              f'sampled at {1.0 / result.run.h:g} Hz {result.sampled_rate:.4f}',
              transform=axes.transAxes, va='top', ha='right', fontsize=7)
    _time_axis(axes, result)
    _title(axes, f'({letter}) formation error, $f_{result.which + 1}$')


def _rotating(results):
    """Return the paper's Fig:Sim:RF, with the components for both gains."""
    import numpy as np
    figure, grid = _figure()
    grid[1, 0].remove()
    grid[1, 1].remove()
    grid[2, 0].remove()
    grid[2, 1].remove()
    lower = [grid[1, column].get_gridspec()[1:, column].subgridspec(3, 1, hspace=0.08)
             for column in (0, 1)]
    for column, result in enumerate(results):
        _sphere(grid[0, column], result, 'ab'[column])
        panels = []
        for component in range(3):
            axes = figure.add_subplot(lower[column][component])
            panels.append(axes)
            for i, (color, line, _) in enumerate(AGENTS):
                axes.plot(result.run.times, result.theory[:, i, component], **PREDICTION)
                axes.plot(result.run.times, result.run.gamma[:, i, component], color=color,
                          linestyle=line)
            axes.set(ylim=(-1.08, 1.08), ylabel=rf'$[\Gamma_i]_{component + 1}$ [1]')
            _time_axis(axes, result)
            if component < 2:
                axes.set_xlabel('')
                axes.tick_params(labelbottom=False)
        _title(panels[0],
               f'({"cd"[column]}) components of the reduced attitudes, $f_{column + 1}$')
        period = 2.0 * np.pi / abs(result.predicted_spin)
        end = result.run.times[-1]
        panels[2].annotate(
            '', (end - period, -1.3), (end, -1.3),
            arrowprops={'arrowstyle': '<->', 'linewidth': 0.7, 'shrinkA': 0, 'shrinkB': 0})
        panels[2].text(
            end, -1.42, f'one turn: {period:.2f} s predicted, '
            f'{2.0 * np.pi / abs(result.measured_spin):.2f} s measured ', ha='right', va='top',
            fontsize=6.5)
        panels[2].set_ylim(-1.85, 1.08)
    _agents_legend(figure)
    return figure


def _save(figure, directory, name):
    """Write a figure as PDF, SVG and PNG, each as a whole or not at all."""
    for suffix, keywords in (('pdf', {'metadata': {'CreationDate': None}}),
                             ('svg', {'metadata': {'Date': None}}), ('png', {'dpi': 200})):
        temporary = directory / f'.{name}.tmp.{suffix}'
        try:
            figure.savefig(temporary, **keywords)
            temporary.replace(directory / f'{name}.{suffix}')
        finally:
            temporary.unlink(missing_ok=True)
