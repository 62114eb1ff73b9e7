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

"""What ``tetra design`` says and writes, and how it refuses."""

import json

import numpy as np
import pytest
from tetra_ros2.cli import main
from tetra_ros2.commands.design import read_points
from tetra_ros2.config import configuration
from tetra_ros2.formation import polyhedra

pytest.importorskip('scipy')

TRIANGLE = '1 0 0\n-0.5 0.8 0.1\n-0.5 -0.8 0.1\n0 0.1 -1\n'


@pytest.fixture
def write(tmp_path):
    """Return a function that writes a file and returns its path."""
    def write(text, name='points.txt'):
        path = tmp_path / name
        path.write_text(text)
        return str(path)
    return write


@pytest.mark.parametrize(('name', 'text'), [
    ('a.txt', '# four\n1 0 0\n0 2 0\n\n0 0 3  # long\n-1 -1 -1\n'),
    ('a.csv', '1,0,0\n0,2,0\n0,0,3\n-1,-1,-1\n'),
    ('a.json', '{"points": [[1, 0, 0], [0, 2, 0], [0, 0, 3], [-1, -1, -1]]}'),
    ('a.yaml', '- [1, 0, 0]\n- [0, 2.0, 0]\n- [0, 0, 3]\n- [-1, -1, -1]\n')])
def test_points_are_read_from_any_of_these(write, name, text):
    np.testing.assert_allclose(
        read_points(write(text, name)),
        np.vstack([np.eye(3), np.full(3, -1.0 / np.sqrt(3.0))]), atol=1e-15)


@pytest.mark.parametrize(('arguments', 'fragments'), [
    (['--polyhedron', 'cubed'], ["'cubed' is not valid (did you mean 'cube'?)"]),
    (['--points', 'no/such/file'], ['no/such/file: cannot be read: No such file']),
    (['--polyhedron', 'cube', '--spin', '0', '0', '0'], ['--spin', 'not all zero']),
    (['--polyhedron', 'cube', '--gain', 'cosin'], ['--gain', "did you mean 'cosine'"]),
    (['--polyhedron', 'cube', '--gain', 'linear', '--gain-b', '2'], ['--gain-b', 'f > 0']),
    (['--polyhedron', 'cube', '--max-degree', '0'], ['--max-degree', '0 is not valid']),
    (['--polyhedron', 'cube', '--visible', '-1'], ['--visible', '-1.0 is not valid'])])
def test_a_wrong_call_is_refused_in_one_line(arguments, fragments, capsys):
    assert main(['design', *arguments]) == 2
    text = capsys.readouterr().err
    assert text.startswith('tetra: error: ')
    assert text.count('\n') == 1
    for fragment in fragments:
        assert fragment in text


@pytest.mark.parametrize(('name', 'text', 'fragment'), [
    ('a.txt', '1 0 0\n0 1\n', "line 2: '0 1' is not valid, expected three numbers"),
    ('a.txt', '1 0 0\n0 one 0\n', "line 2: '0 one 0' is not valid, expected three numbers"),
    ('a.txt', '1 0 0\n0 0 0\n', 'line 2: [0.0, 0.0, 0.0] is not valid: a direction must be'),
    ('a.txt', '1 0 0\nnan 0 0\n', 'line 2: [nan, 0.0, 0.0] is not valid'),
    ('a.txt', '# nothing\n', 'holds no directions'),
    ('a.json', '{"points": 3}', 'expected a list of directions'),
    ('a.yaml', '[1, 2', 'is not YAML or JSON'),
    ('a.yaml', '- [1, 0]\n', "direction 1: '1 0' is not valid"),
    ('a.txt', '1 0 0\n1 0 0\n0 1 0\n', 'points 1 and 2 coincide'),
    ('a.txt', '0 0 1\n0 0 -2\n', 'agent 1 is antipodal to all that it sees')])
def test_a_wrong_file_is_refused_with_its_place(write, capsys, name, text, fragment):
    path = write(text, name)
    assert main(['design', '--points', path]) == 2
    error = capsys.readouterr().err
    assert error.startswith(f'tetra: error: {path}: ')
    assert error.count('\n') == 1
    assert fragment in error


def test_what_is_written_is_a_configuration_that_knows_its_shape(write, tmp_path, capsys):
    out = tmp_path / 'made.yaml'
    assert main(['design', '--points', write(TRIANGLE), '--gain', 'exponential', '--starts', '40',
                 '--json', '--out', str(out)]) == 0
    figures = json.loads(capsys.readouterr().out)
    assert figures['formed'] == 40
    assert figures['fraction_above_with_95_percent'] == pytest.approx(0.05 ** (1 / 40))
    file = configuration.load(str(out))
    formation = file.formation()
    np.testing.assert_allclose(formation.topology.weights, figures['weights'], rtol=1e-11)
    np.testing.assert_allclose(
        formation.shape.points, read_points(str(tmp_path / 'points.txt')), atol=1e-14)
    analysis = formation.analyze()
    assert analysis.slowest_rate == pytest.approx(figures['slowest_rate'], rel=1e-6)
    assert 'topology.points' not in file.values('agent', '/agent_1')
    assert main(['design', '--points', write(TRIANGLE), '--out', str(out)]) == 2, 'it is there'


def test_a_refusal_says_why_for_each_gain_and_exits_with_1(write, capsys):
    path = write('1 0 1\n0 1 1\n-1 -1 1\n0.1 0.1 1\n')
    assert main(['design', '--points', path]) == 1
    lines = capsys.readouterr().err.splitlines()
    assert len(lines) == 5
    assert all('no weights hold agent 1: all that it sees lies on the side of' in line
               for line in lines)


def test_a_person_is_told_the_rates_the_limits_and_the_chance(capsys):
    assert main(['design', '--polyhedron', 'tetrahedron', '--gain', 'cosine', '--starts', '50',
                 '--spin', *(str(x / np.sqrt(3.0)) for x in polyhedra.SOLIDS['tetrahedron'][0])
                 ]) == 0
    out = capsys.readouterr().out
    for fragment in ('regular tetrahedron', '0.333333', 'sample time below', '50 of 50 random',
                     'a chance above 94.18%'):
        assert fragment in out
