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

"""What analyze predicts, and runs of the nodes just inside and just outside of its limits."""

import json

import numpy as np
import pytest
from tetra_ros2.cli import main
from tetra_ros2.commands.analyze import analyze, analyze_bodies
from tetra_ros2.formation import analysis, measures, rotation, shapes, topology
from tetra_ros2.formation.gain import Cosine
from tetra_ros2.paper.runs import run_nodes

COMPLETE = topology.complete(4)
NEARLY = rotation.multiply(
    rotation.between(np.array([1.0, 0.0, 0.0]), shapes.TETRAHEDRON.points),
    rotation.exp(1e-2 * np.random.default_rng(0).standard_normal((4, 3))))


@pytest.fixture
def configuration(tmp_path):
    """Return a function that writes a configuration and returns its path."""
    def write(text):
        path = tmp_path / 'formation.yaml'
        path.write_text('/**:\n  ros__parameters:\n' + text)
        return str(path)
    return write


def error_of(capsys, *arguments):
    assert main(['analyze', *arguments]) == 2
    text = capsys.readouterr().err
    assert text.startswith('tetra: error: ')
    assert text.count('\n') == 1
    return text


def test_the_papers_complete_graph():
    found = analyze('complete')
    assert found.strongly_connected
    assert found.symmetric
    assert found.shape == 'regular tetrahedron'
    assert found.period is None
    assert found.slowest_rate == pytest.approx(8.0 / 3.0)
    assert found.fastest_rate == pytest.approx(32.0 / 9.0)
    assert found.settling_time == pytest.approx(3.0 / 8.0 * np.log(100.0))
    assert found.max_sample_time == pytest.approx(0.5625)
    assert found.max_delay == pytest.approx(0.4418, abs=1e-4)
    assert found.max_delay_steps == 43


def test_the_papers_rotating_graph():
    found = analyze('rotating')
    assert not found.symmetric
    assert found.period == pytest.approx(2.0 * np.sqrt(3.0) * np.pi)
    assert found.slowest_rate == pytest.approx(1.52197, abs=1e-5)
    assert found.max_sample_time == pytest.approx(0.9761, abs=1e-4)
    assert found.max_delay_steps == 61
    assert found.offset == pytest.approx(2.9e-4, abs=1e-5)


def test_any_weighted_digraph(configuration):
    found = analyze(configuration(
        '    topology: {kind: custom, n: 3, edges: ["1 2", "2 3", "3 1"]}\n'
        '    gain: {kind: exponential}\n'))
    assert found.strongly_connected
    assert found.shape is None
    assert found.angles == pytest.approx([2.0 * np.pi / 3.0] * 3, abs=1e-7)
    assert found.spin_rate > 0.0


def test_a_shape_among_a_continuum_of_others_is_told(configuration):
    found = analyze(configuration('    topology: {n: 6}\n'))
    assert not found.hyperbolic


def test_components():
    strong, weak = analysis.components(
        topology.custom(5, [(1, 2), (2, 1), (2, 3), (4, 5)]).weights)
    assert strong == [(1, 2), (3,), (4,), (5,)]
    assert weak == [(1, 2, 3), (4, 5)]
    # Weights of opposite sign are edges in both directions, and not none.
    assert analysis.components([[0.0, 1.0], [-1.0, 0.0]])[1] == [(1, 2)]


def size_late(parameters, rate, duration):
    """Return the deviation of the cosines in the second and the last quarter of a run."""
    run = run_nodes(COMPLETE, Cosine(), duration, rate=rate, attitudes=NEARLY,
                    parameters=parameters)
    off = np.max(np.abs(measures.pairwise_cosines(run.gamma) + 1.0 / 3.0), axis=1)
    quarter = len(off) // 4
    return np.max(off[quarter:2 * quarter]), np.max(off[-quarter:])


def test_nodes_hold_at_a_sample_time_of_0_55_and_do_not_at_0_57():
    assert size_late({}, 1.0 / 0.55, 0.55 * 400)[1] < 1e-5
    assert size_late({}, 1.0 / 0.57, 0.57 * 400)[1] > 1e-2


def test_nodes_hold_at_the_delay_limit_and_not_a_step_beyond():
    steps = analyze('complete').max_delay_steps
    before, after = size_late({'plant:measurement_delay': steps / 100.0}, 100.0, 80.0)
    assert after < 0.7 * before
    before, after = size_late({'plant:measurement_delay': (steps + 1) / 100.0}, 100.0, 80.0)
    assert after > 1.2 * before


def test_delay_and_sampling_together_limit_the_nodes():
    steps = analyze('complete', rate=10.0).max_delay_steps
    assert steps == 3
    before, after = size_late({'plant:measurement_delay': 0.1 * steps}, 10.0, 60.0)
    assert after < 0.01 * before
    before, after = size_late({'plant:measurement_delay': 0.1 * (steps + 1)}, 10.0, 60.0)
    assert after > 2.0 * before


def test_nodes_with_noisy_sensors_show_the_predicted_error():
    sigma = 2e-3
    predicted = analyze('complete', rate=20.0, noise=sigma).mean_error
    run = run_nodes(COMPLETE, Cosine(), 400.0, rate=20.0, attitudes=NEARLY,
                    parameters={'plant:measurement_noise': sigma})
    error = measures.shape_error(run.gamma[200:], shapes.TETRAHEDRON.angles)
    assert np.mean(error) == pytest.approx(predicted, rel=0.05)


def test_a_loop_that_is_not_stable_at_its_rate_makes_exit_status_1(capsys):
    assert main(['analyze', '--rate', '1.7']) == 1
    assert 'not stable' in capsys.readouterr().out


def test_json_has_every_figure(capsys):
    assert main(['analyze', '--json']) == 0
    document = json.loads(capsys.readouterr().out)
    assert document['max_delay_steps'] == 43
    assert len(document['eigenvalues']) == 5


def test_what_cannot_be_analysed_is_refused_in_one_line(capsys, configuration):
    assert 'no such file' in error_of(capsys, '--config', 'nowhere.yaml')
    apart = configuration('    topology: {kind: custom, n: 4, edges: ["1 2", "2 1", "3 4"]}\n')
    assert '{1, 2} and {3, 4} do not see one another' in error_of(capsys, '--config', apart)
    assert 'too many' in error_of(
        capsys, '--config', configuration('    topology: {n: 500}\n'))
    assert '--rate' in error_of(capsys, '--rate', '-1')
    assert '--error' in error_of(capsys, '--error', '0.5')


def test_an_agent_with_a_gain_of_its_own_is_refused(capsys, configuration):
    path = configuration('    gain: {a: 1.0}\n')
    with open(path, 'a') as file:
        file.write('/agent_2:\n  ros__parameters:\n    gain: {a: 2.0}\n')
    assert 'agent_2' in error_of(capsys, '--config', path)


def test_bodies_with_mass_are_analysed_with_their_rate_loop(capsys):
    assert main(['analyze', '--config', 'rotating', '--body', 'wheels', '--bandwidth', '20',
                 '--json']) == 0
    bodies = json.loads(capsys.readouterr().out)['bodies']
    assert bodies['spin_rate'] == pytest.approx(0.57476, abs=1e-4)
    assert bodies['offset'] == pytest.approx(3.19e-3, rel=0.01)
    assert 0.15 < bodies['min_bandwidth'] < bodies['sampled_min_bandwidth'] < 0.2
    assert bodies['torque'] < bodies['torque_limit']
    assert bodies['lifetime'] is None


def test_a_rate_loop_below_the_limit_is_not_stable():
    assert not analyze_bodies('rotating', body='gimbal', bandwidth=0.1).is_stable
    assert analyze_bodies('rotating', body='gimbal', bandwidth=0.3).is_stable


def test_a_disturbance_fills_the_wheels_in_a_time_that_is_said(tmp_path):
    file = tmp_path / 'sun.yaml'
    file.write_text('/**:\n  ros__parameters: {topology: {kind: rotating}}\n/**/plant:\n'
                    '  ros__parameters:\n    body: wheels\n'
                    '    wheels: {disturbance: [1.0e-4, 0.0, 0.0]}\n')
    found = analyze_bodies(file)
    # 0.12 N m s less what the spin asks for, over 1e-4 N m.
    assert found.lifetime == pytest.approx((0.12 - found.momentum) / 1e-4)


def test_kinematic_bodies_ask_for_nothing():
    assert analyze_bodies('complete') is None
