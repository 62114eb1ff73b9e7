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

"""``tetra plot`` draws what was recorded, of any recording, quickly, and without ROS."""

from dataclasses import replace
import subprocess
import sys
import xml.etree.ElementTree as ElementTree

import bags
from harness import run
import numpy as np
import pytest
from tetra_ros2.cli import main
from tetra_ros2.commands import plot
from tetra_ros2.drawing import colors
from tetra_ros2.drawing import picture as drawing
from tetra_ros2.formation import measures, shapes, topology
from tetra_ros2.recording import plot as figures
from tetra_ros2.recording import reader as recording

MESSAGES = 1_000_000
KINEMATIC = [name for name in plot.FIGURES if name not in ('bodies', 'joints')]


@pytest.fixture(scope='module')
def bag(tmp_path_factory):
    path = tmp_path_factory.mktemp('plot') / 'bag'
    bags.write(path, 600, topology.rotating())
    return path


@pytest.mark.timeout(300)
def test_every_figure_is_written_in_all_formats(tmp_path, bag):
    status, output, _ = run('plot', bag, '--out', tmp_path / 'new' / 'figures', timeout=200.0)
    assert status == 0
    assert 'cosine gain, a = 1,' in output
    for name in KINEMATIC:
        png = (tmp_path / 'new' / 'figures' / f'{name}.png').read_bytes()
        assert png.startswith(b'\x89PNG')
        assert len(png) > 10_000
        root = ElementTree.parse(tmp_path / 'new' / 'figures' / f'{name}.svg').getroot()
        assert root.tag == '{http://www.w3.org/2000/svg}svg'
        assert (tmp_path / 'new' / 'figures' / f'{name}.pdf').read_bytes().startswith(b'%PDF')


def lines(run, name):
    """Return the lines of a figure, each as its label and its points."""
    return {line.get_label(): np.array(line.get_data())
            for axes in figures._FIGURES[name](run).axes for line in axes.lines}


def test_lines_are_those_of_the_states(bag):
    loaded = recording.load(bag)
    run = figures.Run(loaded)
    cosines = lines(run, 'cosines')
    expected = measures.pairwise_cosines(loaded.gamma)
    for index, (i, j) in enumerate(measures.pairs(4)):
        np.testing.assert_allclose(
            cosines[rf'$\theta_{{{i}{j}}}$'], [loaded.times, expected[:, index]])
    measured = lines(run, 'error')['measured'][1]
    np.testing.assert_allclose(
        measured, measures.shape_error(loaded.gamma, shapes.TETRAHEDRON.angles))
    rates = lines(run, 'rates')
    np.testing.assert_allclose(
        rates['agent 3'][1], np.linalg.norm(loaded.answers(3), axis=1))


def test_the_predicted_slope_is_drawn_as_steep_as_it_is(bag):
    run = figures.Run(recording.load(bag))
    (label, (times, error)), = ((k, v) for k, v in lines(run, 'error').items() if 'slope' in k)
    slope = np.diff(np.log(error))[0] / np.diff(times)[0]
    assert slope == pytest.approx(-run.predicted_rate, rel=1e-9)
    assert f'{run.predicted_rate:.4g}' in label
    assert run.predicted_rate == pytest.approx(1.522, abs=1e-3)


@pytest.mark.parametrize('options', [
    {'commands': False}, {'measurements': False}, {'graph': topology.complete(2)},
    {'graph': topology.complete(12)}, {'graph': topology.custom(3, [(1, 2), (2, 3)])},
    {'count': 2}], ids=str)
def test_whatever_was_recorded_is_drawn(tmp_path, options):
    bags.write(tmp_path / 'bag', **{'count': 60, **options})
    status, _, errors = run('plot', tmp_path / 'bag', '--out', tmp_path, '--format', 'png')
    assert status == 0, errors
    expected = set(KINEMATIC) - ({'rates'} if 'commands' in options else set())
    assert {path.stem for path in tmp_path.glob('*.png')} == expected
    assert 'Warning' not in errors
    assert ('rates: not drawn' in errors) == ('commands' in options)


@pytest.mark.parametrize('options', [{}, {'commands': False}, {'count': 2}], ids=str)
def test_no_panel_is_empty(tmp_path, options):
    bags.write(tmp_path / 'bag', **{'count': 60, **options})
    run = figures.Run(recording.load(tmp_path / 'bag'))
    for name, make in figures._FIGURES.items():
        if (figure := make(run)) is None:
            assert name in {'rates', 'bodies', 'joints'}
            continue
        for axes in figure.axes:
            drawn = [*axes.lines, *axes.collections, *axes.patches]
            assert drawn, name
            assert name == 'sphere' or any(
                np.any(np.isfinite(line.get_ydata())) for line in axes.lines)


WHEELS = ('wheel_x', 'wheel_y', 'wheel_z')


def wheels(k, i):
    return WHEELS, (0.1 * k,) * 3, (9.0 * i, 0.0, -k), (0.005 if k < 15 else 0.001, 0.0, 0.0)


def head(k, i):
    return ('pan', 'tilt'), (0.02 * k, -0.5 if i == 2 else 0.1), (2.0, 0.0), ()


def test_wheels_are_drawn_with_their_limits(tmp_path):
    bags.write(tmp_path / 'bag', 60, joints=wheels, figures={
        'speed limit of wheel_y [rad/s]': '600', 'torque limit of wheel_x [N m]': '0.005',
        'torque limit of wheel_z [N m]': 'none', 'body': 'wheels'})
    loaded = recording.load(tmp_path / 'bag')
    track = loaded.joints[3]
    assert track.names == WHEELS
    assert track.velocities[7].tolist() == [27.0, 0.0, -7.0]
    assert np.array_equal(track.stamps, loaded.stamps)
    assert loaded.limits['wheel_x'].torque == 0.005
    run = figures.Run(loaded)
    speed, torque = figures._FIGURES['joints'](run).axes
    assert speed.get_title('left') == 'limit 600; at most 59'
    assert torque.get_title('left') == 'limit 0.005; at most 0.005, at a limit 25 % of the time'
    levels = [line.get_ydata()[0] for line in torque.lines if len(set(line.get_ydata())) == 1]
    assert 0.005 in levels and -0.005 in levels
    body, = figures._FIGURES['bodies'](run).axes
    assert len(body.patches) > 4 * 20  # the faces of four boxes with wheels, beside the sphere


def test_gimbals_are_drawn_with_their_ranges_and_the_one_at_its_limit_in_red(tmp_path):
    bags.write(tmp_path / 'bag', 60, joints=head, namespace='/left', figures={
        'lower limit of tilt [rad]': '-0.5', 'upper limit of tilt [rad]': '0.5'})
    run = figures.Run(recording.load(tmp_path / 'bag').between(0.2, 0.4))
    assert len(run.recording.joints[1].stamps) == 21
    panels = figures._FIGURES['joints'](run).axes
    assert [axes.get_ylabel() for axes in panels] == ['pan [rad]', 'tilt [rad]', 'speed [rad/s]']
    assert panels[0].get_title('left') == 'no limit is known'
    assert panels[1].get_title('left') == 'limit 0.5; at most 0.5, at a limit 25 % of the time'
    axes, = figures._FIGURES['bodies'](run).axes
    red = [line for line in axes.collections if len(line.get_segments()) == 1 and tuple(
        line.get_color()[0][:3]) == colors.unit_rgb('#d1242f')]
    assert len(red) == 1


def test_joints_that_cannot_be_read_are_left_out(tmp_path):
    def broken(k, i):
        return WHEELS if i != 2 else ('other', 'joints'), (), (1.0,) * (3 if i != 2 else 2), ()

    bags.write(tmp_path / 'bag', 20, joints=broken)
    loaded = recording.load(tmp_path / 'bag')
    assert loaded.joints[2].names == ('other', 'joints')
    assert np.all(np.isnan(loaded.joints[1].positions))
    assert loaded.limits == {}
    status, _, errors = run('plot', tmp_path / 'bag', '--out', tmp_path, '--only', 'bodies',
                            'joints', '--format', 'png')
    assert status == 0, errors


def test_a_plant_that_repeats_itself_is_nothing_to_worry_about(tmp_path):
    bags.write(tmp_path / 'bag', 60)
    loaded = recording.load(tmp_path / 'bag')
    assert replace(loaded, dropped=7, repeated=7).unused == 0
    status, _, errors = run('plot', tmp_path / 'bag', '--out', tmp_path, '--only', 'error',
                            '--format', 'pdf')
    assert status == 0
    assert not errors


def test_the_error_that_sampling_leaves_is_named(tmp_path):
    bags.write(tmp_path / 'bag', 2000, topology.rotating())
    run = figures.Run(recording.load(tmp_path / 'bag'))
    (label, (_, level)), = ((k, v) for k, v in lines(run, 'error').items() if 'sampling' in k)
    assert 'sampling at 100 Hz: 0.000294 rad' in label
    assert level[0] == pytest.approx(run.error[-1], rel=0.01)


def test_trajectories_are_whole_and_their_starts_are_marked(tmp_path):
    bags.write(tmp_path / 'bag', 2000, topology.rotating())
    run = figures.Run(recording.load(tmp_path / 'bag'))
    axes, = figures._FIGURES['sphere'](run).axes
    see = drawing.Camera(drawing.best_view(run.gamma[-1]))
    hollow = [line for line in axes.lines if line.get_markerfacecolor() == 'white']
    assert {line.get_marker() for line in hollow} == set('os^D')
    starts = np.array([[line.get_xdata()[0], line.get_ydata()[0]] for line in hollow])
    np.testing.assert_allclose(starts, see(run.gamma[0])[:, :2], atol=1e-12)
    segments = np.concatenate([c.get_segments() for c in axes.collections if len(
        c.get_segments())])
    for start in starts:
        assert np.min(np.linalg.norm(segments - start, axis=-1)) < 1e-9, 'a trail begins there'


def test_two_plots_of_one_recording_are_the_same_files(tmp_path, bag):
    for name in ('a', 'b'):
        run('plot', bag, '--out', tmp_path / name, '--only', 'cosines')
    for path in (tmp_path / 'a').iterdir():
        assert path.read_bytes() == (tmp_path / 'b' / path.name).read_bytes(), path.name


def test_a_moving_picture_moves(tmp_path):
    from PIL import Image
    bags.write(tmp_path / 'bag', 12, topology.rotating(), h=0.1)
    assert main(['plot', str(tmp_path / 'bag'), '--out', str(tmp_path), '--only', 'sphere',
                 '--format', 'png', '--movie']) == 0
    with Image.open(tmp_path / 'sphere.gif') as movie:
        assert movie.n_frames == 12
        first = np.asarray(movie.convert('RGB')).astype(int)
        assert first[0, 0].tolist() == [255, 255, 255]
        movie.seek(movie.n_frames - 1)
        assert np.count_nonzero(np.asarray(movie.convert('RGB')).astype(int) - first) > 5000


def test_a_moving_picture_of_many_states_has_no_more_frames_than_are_wanted(tmp_path, bag):
    from PIL import Image
    run = recording.load(bag)
    assert len(run.times) > drawing.MOVIE_FRAMES
    for more, frames in (({'most': 5}, 5), ({'size': 40}, drawing.MOVIE_FRAMES)):
        path = drawing.write_movie(run.times, run.gamma, (), tmp_path / 'x.gif', **more)
        with Image.open(path) as movie:
            assert movie.n_frames == frames


@pytest.mark.slow
def test_a_million_messages_take_less_than_20_s_and_1_gb(tmp_path):
    bags.write(tmp_path / 'bag', 600, topology.rotating(), repeat=-(-MESSAGES // (600 * 14)))
    script = (
        'import resource, sys, time\n'
        'begun = time.monotonic()\n'
        'from tetra_ros2.cli import main\n'
        'status = main(sys.argv[1:])\n'
        'print(status, time.monotonic() - begun,\n'
        '      resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1e6)\n')
    done = subprocess.run(
        [sys.executable, '-c', script, 'plot', tmp_path / 'bag', '--out', tmp_path],
        capture_output=True, text=True, check=True)
    status, seconds, gigabytes = map(float, done.stdout.splitlines()[-1].split())
    print(f'{seconds:.1f} s, {gigabytes:.2f} GB')
    assert status == 0
    assert seconds < 20.0
    assert gigabytes < 1.0


def test_ros_is_not_needed(tmp_path, bag):
    script = ('import sys\n'
              'sys.modules["rclpy"] = None\n'
              'from tetra_ros2.cli import main\n'
              'sys.exit(main(sys.argv[1:]))\n')
    done = subprocess.run(
        [sys.executable, '-c', script, 'plot', bag, '--out', tmp_path, '--only', 'error'],
        capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr


def test_wrong_input_is_one_line_and_status_2(tmp_path, bag, capsys):
    (tmp_path / 'file').write_text('x')
    for arguments in (['plot', tmp_path / 'none', '--out', tmp_path],
                      ['plot', tmp_path / 'file', '--out', tmp_path],
                      ['plot', bag, '--out', tmp_path / 'file'],
                      ['plot', bag, '--out', tmp_path, '--from', '99'],
                      ['plot', bag, '--out', tmp_path, '--namespace', 'elsewhere'],
                      ['plot', bag, '--out', tmp_path, '--only', 'everything']):
        try:
            status = main(list(map(str, arguments)))
        except SystemExit as ended:
            status = ended.code
        output, errors = capsys.readouterr()
        assert status == 2, errors
        assert errors.count('\n') == 1
        assert errors.startswith('tetra: error: ')
        assert not output
