# Copyright 2026 The tetra_ros2 authors
# SPDX-License-Identifier: Apache-2.0

"""``tetra plot`` draws what was recorded, of any recording, quickly, and without ROS."""

import subprocess
import sys
import xml.etree.ElementTree as ElementTree

import bags
from harness import run
import numpy as np
import pytest

from tetra_ros2.commands import plot
from tetra_ros2.drawing import colors, geometry
from tetra_ros2.drawing import picture as drawing
from tetra_ros2.formation import measures, shapes, topology
from tetra_ros2.recording import plot as figures
from tetra_ros2.recording import reader as recording

MESSAGES = 1_000_000


@pytest.fixture(scope='module')
def bag(tmp_path_factory):
    path = tmp_path_factory.mktemp('plot') / 'bag'
    bags.write(path, 600, topology.rotating())
    return path


def test_every_figure_is_written_in_both_formats(tmp_path, bag):
    status, output, _ = run('plot', bag, '--out', tmp_path / 'new' / 'figures')
    assert status == 0
    assert 'cosine gain, a = 1,' in output
    for name in plot.FIGURES:
        png = (tmp_path / 'new' / 'figures' / f'{name}.png').read_bytes()
        assert png.startswith(b'\x89PNG')
        assert len(png) > 10_000
        root = ElementTree.parse(tmp_path / 'new' / 'figures' / f'{name}.svg').getroot()
        assert root.tag == '{http://www.w3.org/2000/svg}svg'


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
    assert len(list(tmp_path.glob('*.png'))) == len(plot.FIGURES)
    assert 'Warning' not in errors


def test_a_moving_picture_moves(tmp_path, bag):
    from PIL import Image
    status, *_ = run('plot', bag, '--out', tmp_path, '--only', 'sphere', '--format', 'png',
                     '--movie', '--to', '1.5')
    assert status == 0
    with Image.open(tmp_path / 'sphere.gif') as movie:
        assert movie.n_frames == drawing.MOVIE_FRAMES
        first = np.asarray(movie.convert('RGB')).astype(int)
        assert first[0, 0].tolist() == [255, 255, 255]
        movie.seek(movie.n_frames - 1)
        assert np.count_nonzero(np.asarray(movie.convert('RGB')).astype(int) - first) > 5000


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


def test_wrong_input_is_one_line_and_status_2(tmp_path, bag):
    (tmp_path / 'file').write_text('x')
    for arguments in (['plot', tmp_path / 'none', '--out', tmp_path],
                      ['plot', tmp_path / 'file', '--out', tmp_path],
                      ['plot', bag, '--out', tmp_path / 'file'],
                      ['plot', bag, '--out', tmp_path, '--from', '99'],
                      ['plot', bag, '--out', tmp_path, '--namespace', 'elsewhere'],
                      ['plot', bag, '--out', tmp_path, '--only', 'everything']):
        status, output, errors = run(*arguments)
        assert status == 2, errors
        assert errors.count('\n') == 1
        assert errors.startswith('tetra: error: ')
        assert not output


MACHADO = {
    'normal': np.eye(3),
    'protanope': [[.152286, 1.052583, -.204868], [.114503, .786281, .099216],
                  [-.003882, -.048116, 1.051998]],
    'deuteranope': [[.367322, .860646, -.227968], [.280085, .672501, .047413],
                    [-.011820, .042940, .968881]],
    'tritanope': [[1.255528, -.076749, -.178779], [-.078411, .930809, .147602],
                  [.004733, .691367, .303900]],
}
"""How linear RGB looks to whom; Machado, Oliveira, Fernandes 2009, severity 1."""


def lab(color, sight):
    """Return CIE L*a*b* (D65) of a colour as somebody sees it."""
    c = np.array(colors.unit_rgb(color))
    linear = np.where(c <= 0.04045, c / 12.92, ((c + 0.055) / 1.055) ** 2.4)
    linear = np.clip(np.array(MACHADO[sight]) @ linear, 0.0, 1.0)
    xyz = np.array([[.4124564, .3575761, .1804375], [.2126729, .7151522, .0721750],
                    [.0193339, .1191920, .9503041]]) @ linear / [.95047, 1.0, 1.08883]
    f = np.where(xyz > 216 / 24389, np.cbrt(xyz), (24389 / 27 * xyz + 16) / 116)
    return np.array([116 * f[1] - 16, 500 * (f[0] - f[1]), 200 * (f[1] - f[2])])


@pytest.mark.parametrize('sight', MACHADO)
def test_twelve_agents_are_told_apart_by_everybody(sight):
    seen = np.array([lab(color, sight) for color in (*colors.AGENTS, '#ffffff')])
    distances = np.linalg.norm(seen[:, None] - seen[None], axis=-1)
    closest = np.min(distances[~np.eye(len(seen), dtype=bool)])
    assert closest > 12.0, 'CIE76; 2.3 is just noticeable'


def test_faces_of_a_formation_are_those_of_its_hull():
    assert len(geometry.faces(shapes.TETRAHEDRON.points)) == 4
    assert len(geometry.faces(shapes.OCTAHEDRON.points)) == 8
    assert geometry.faces(shapes.TRIANGLE.points).tolist() == [[0, 1, 2]]
    assert geometry.faces(shapes.ANTIPODAL.points).shape == (0, 3)
    points = np.random.default_rng(4).standard_normal((12, 3))
    points /= np.linalg.norm(points, axis=1, keepdims=True)
    found = geometry.faces(points)
    assert len(found) == 2 * 12 - 4, 'as Euler has it for triangles'
    a, b, c = (points[found[:, k]] for k in range(3))
    normals = np.cross(b - a, c - a)
    heights = normals @ points.T - np.sum(normals * a, axis=1, keepdims=True)
    assert np.all(heights < 1e-12), 'counter-clockwise from outside'
