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

"""A gain in a file outside of the package: real nodes, studies and analyses take it."""

import json
import subprocess
import sys
from types import SimpleNamespace

from harness import DEADLINE
import numpy as np
import pytest
from rclpy.parameter import Parameter
from tetra_ros2.config.parameters import ConfigurationError, FORMATION
from tetra_ros2.formation import Formation, gain, law, rotating
from tetra_ros2.formation.identify import identify
from tetra_ros2.launcher import Launcher
from tetra_ros2.viewer.node import Viewer

GAINS = '''
import numpy as np

from tetra_ros2.formation import Gain


class Quartic(Gain):
    """Nearly constant for near neighbours."""

    def f(self, theta, xp=np):
        return self.a / (1.0 + self.b * theta**4)


class Rising(Gain):
    def f(self, theta, xp=np):
        return self.a * (1.0 + theta)


class Fussy(Gain):
    def __init__(self, a):
        raise RuntimeError('not today')

    def f(self, theta, xp=np):
        return self.a / theta


helpful = 3
'''

CONFIG = """
/**:
  ros__parameters:
    topology: {kind: rotating}
    gain: {kind: "laboratory_gains:Quartic", a: 20.0, b: 2.0}
/**/plant:
  ros__parameters: {seed: 7, rate: 50.0}
"""


@pytest.fixture
def workplace(tmp_path, monkeypatch):
    """Return a directory with the gains and a configuration, the current one from now on."""
    (tmp_path / 'laboratory_gains.py').write_text(GAINS)
    (tmp_path / 'mine.yaml').write_text(CONFIG)
    monkeypatch.chdir(tmp_path)
    yield tmp_path
    sys.modules.pop('laboratory_gains', None)
    sys.path[:] = [entry for entry in sys.path if entry != str(tmp_path)]


def run(*arguments):
    """Run ``tetra`` as the script in bin does: the current directory is on no path."""
    done = subprocess.run(
        [sys.executable, '-c', 'import sys; del sys.path[0]\n'
         'from tetra_ros2.cli import main\nif __name__ == "__main__":\n    sys.exit(main())',
         *arguments], capture_output=True, text=True, timeout=DEADLINE, check=False)
    return done.returncode, done.stdout, done.stderr


def predicted(parameters):
    """Return the spin of the rotating tetrahedron under the gain above [rad/s]."""
    theta = np.arccos(-1.0 / 3.0)
    return np.sqrt(3.0) / 2.0 * parameters['a'] / (1.0 + parameters['b'] * theta**4)


def test_real_nodes_form_and_spin_as_predicted(workplace):
    with Launcher('mine.yaml') as formation:
        assert formation.formation.gain.kind == 'laboratory_gains:Quartic'
        assert formation.run_until(lambda: formation.error < 2e-3, timeout=60.0)
        formation.run_for(10.0)
        summary = formation.summary()
    rate = predicted({'a': 20.0, 'b': 2.0})
    assert summary.predicted.rate == pytest.approx(rate, rel=1e-12)
    assert summary.measured.rate == pytest.approx(rate, rel=1e-2)


def test_the_nodes_do_what_the_library_simulates_to_the_last_bit(workplace):
    own = gain.family('laboratory_gains:Quartic')(20.0, 2.0)
    trajectory = Formation(rotating(), own).simulate(seed=7, rate=50.0, duration=4.0)
    with Launcher('mine.yaml') as formation:
        formation.run_for(4.0)
        assert formation.attitudes.tolist() == trajectory.attitudes[-1].tolist()


def test_the_commands_take_it(workplace):
    status, output, errors = run('launcher', '--config', 'mine.yaml', '--json', '--duration',
                                 '30')
    document = json.loads(output)
    assert document['gain'] == {'kind': 'laboratory_gains:Quartic', 'a': 20.0, 'b': 2.0}
    status, output, errors = run('analyze', '--config', 'mine.yaml', '--json')
    assert status == 0, errors
    assert json.loads(output)['spin_rate'] == pytest.approx(predicted({'a': 20.0, 'b': 2.0}))
    status, output, errors = run('study', '--config', 'mine.yaml', '--starts', '40', '--workers',
                                 '1', '--tolerance', '0.05', '--json', '--out', 'study')
    assert status == 0, errors
    case = json.loads(output)['cases'][0]
    assert case['formed'] == 40
    assert case['name'] == 'mine_laboratory_gains.Quartic'
    replay = workplace / 'study' / 'worst' / 'mine_laboratory_gains.Quartic_1.yaml'
    assert 'laboratory_gains:Quartic' in replay.read_text()


@pytest.mark.parametrize('kind, what', [
    ('laboratory_gains:Rising', "f' < 0 must hold"),
    ('laboratory_gains:Quadratic', 'there is no Quadratic in laboratory_gains'),
    ('laboratory_gains:helpful', 'helpful is not a subclass of tetra_ros2.formation.Gain'),
    ('laboratory_gains:Fussy', 'is not valid: TypeError'),
    ('laboratory:Quartic', "there is no module 'laboratory'"),
    ('laboratory gains', 'expected one of cosine')])
def test_what_cannot_be_used_is_refused_in_one_line(workplace, kind, what):
    (workplace / 'wrong.yaml').write_text(CONFIG.replace('laboratory_gains:Quartic', kind))
    for command in ('agent', 'plant', 'analyze'):
        more = ('--id', '1') if command == 'agent' else ()
        status, _, errors = run(command, '--config', 'wrong.yaml', *more)
        assert status == 2
        assert errors.startswith('tetra: error: wrong.yaml: gain')
        assert what in errors
        assert errors.count('\n') == 1
    with pytest.raises(ConfigurationError, match='gain'):
        Launcher('wrong.yaml')


def test_a_running_node_imports_nothing_because_a_parameter_says_so(workplace):
    with Launcher('complete') as formation:
        agent = formation.agents[1]
        result, = agent.set_parameters([Parameter('gain.kind', value='laboratory_gains:Quartic')])
        assert not result.successful
        assert 'only when it starts' in result.reason
        assert 'laboratory_gains' not in sys.modules


def test_a_viewer_imports_nothing_because_a_node_says_so(workplace):
    settings = {'gain.kind': 'laboratory_gains:Quartic', 'gain.a': 1.0, 'gain.b': 1.0}
    viewer = SimpleNamespace(_settings={'agent_1': dict.fromkeys(
        (spec.name for spec in FORMATION), 0) | settings})
    assert Viewer._formation(viewer, 'agent_1') is None
    assert 'laboratory_gains' not in sys.modules


def test_a_law_that_no_known_family_explains_is_not_identified(workplace):
    own = gain.family('laboratory_gains:Quartic')(1.0, 2.0)
    formation = Formation(rotating(), own)
    trajectory = formation.simulate(seed=1, duration=10.0)
    rates = law.world_angular_velocity(
        trajectory.reduced_attitudes, formation.topology.weights, own)
    edges = [(i, j) for i, j, _ in formation.topology.edges]
    assert identify(trajectory.reduced_attitudes, rates, edges) is None
