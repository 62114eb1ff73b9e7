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

"""The public face of the library: a formation, its runs, its equilibria, its analysis."""

from hypothesis import given, settings
import numpy as np
import pytest
from strategies import any_gain, any_topology, assert_close, attitudes, formations
from tetra_ros2.formation import (
    complete,
    Cosine,
    custom,
    Exponential,
    flow,
    Formation,
    law,
    rotating,
    rotation,
    sphere,
)
from tetra_ros2.formation.simulation import SampledLoop

X = np.array([1.0, 0.0, 0.0])
FEW = settings(max_examples=15, deadline=None)


@FEW
@given(attitudes(4), formations(4), any_topology(4), any_gain())
def test_a_simulation_is_the_sampled_loop_to_the_last_bit(q, axes, topology, gain):
    formation = Formation(topology, gain, axes)
    run = formation.simulate(q, duration=0.1, rate=100.0)
    loop = SampledLoop(run.attitudes[0], formation.pointing_axes, topology, gain)
    for k in range(1, 11):
        loop.advance(0.01)
        assert run.attitudes[k].tolist() == [list(q) for q in loop.bodies.attitudes]
        assert run.reduced_attitudes[k].tolist() == [list(g) for g in loop.bodies.reduced]
    assert_close(run.times, 0.01 * np.arange(11), atol=1e-15)


@pytest.mark.parametrize('topology', [complete(), rotating(), custom(3, [(1, 2), (2, 3)])])
def test_the_continuous_loop_is_what_the_sampled_one_tends_to(topology):
    formation = Formation(topology, Cosine(), sphere.random(np.random.default_rng(6), topology.n))
    exact = formation.simulate(seed=8, duration=0.5, rate=100.0, continuous=True)
    assert_close(np.linalg.norm(exact.attitudes, axis=-1), 1.0, atol=1e-13)
    coarse, fine = (np.max(np.abs(
        formation.simulate(seed=8, duration=0.5, rate=rate).attitudes[-1]
        - exact.attitudes[-1])) for rate in (100.0, 800.0))
    assert coarse / fine == pytest.approx(8.0, rel=0.05)


def test_the_continuous_loop_obeys_the_law_at_every_sample():
    formation = Formation(rotating(), Exponential())
    run = formation.simulate(seed=2, duration=3.0, rate=1000.0, continuous=True)
    gamma = run.reduced_attitudes
    slope = (gamma[:-4] - 8.0 * gamma[1:-3] + 8.0 * gamma[3:-1] - gamma[4:]) / 0.012
    expected = law.velocity(gamma[2:-2], formation.topology.weights, formation.gain)
    assert_close(slope, expected, atol=1e-7)


def test_attitudes_and_reduced_attitudes_have_the_same_solution():
    formation = Formation(custom(3, [(1, 2, 0.5), (2, 3), (3, 1, 2.0)]), Cosine())
    run = formation.simulate(seed=3, duration=5.0, rate=10.0, continuous=True)
    alone = flow.reduced_attitudes(
        run.reduced_attitudes[0], formation.topology.weights, formation.gain, run.times)
    assert_close(run.reduced_attitudes, alone, atol=1e-8)


def test_the_continuous_spinning_formation_has_no_offset():
    run = Formation(rotating(), Cosine()).simulate(seed=7, duration=30.0, continuous=True)
    assert run.errors[-1] < 1e-9
    assert_close(run.spin(), run.predicted_spin(), atol=1e-8)


def test_a_start_may_be_reduced_attitudes():
    axes = sphere.random(np.random.default_rng(0), 4)
    gamma = sphere.random(np.random.default_rng(1), 4)
    run = Formation(complete(), Cosine(), axes).simulate(gamma, duration=0.02)
    assert_close(run.reduced_attitudes[0], gamma, atol=1e-14)
    assert_close(rotation.rotate(run.attitudes[0], axes), gamma, atol=1e-14)


def test_a_seed_gives_the_same_run_and_none_another_one():
    formation = Formation(complete(), Cosine())
    runs = [formation.simulate(seed=seed, duration=0.02).attitudes for seed in (5, 5, 6, None)]
    assert np.array_equal(runs[0], runs[1])
    assert not np.array_equal(runs[0], runs[2])
    assert not np.array_equal(runs[0], runs[3])


def test_time_to_form_is_that_since_which_the_error_stays_below():
    run = Formation(complete(), Cosine()).simulate(seed=1, duration=20.0)
    formed = run.time_to_form(1e-3)
    assert np.all(run.errors[run.times >= formed] < 1e-3)
    assert run.errors[np.searchsorted(run.times, formed) - 1] >= 1e-3
    assert run.time_to_form(1e-300) is None


def test_axes_are_unit_vectors_for_every_body_and_cannot_be_changed():
    formation = Formation(complete(3), Cosine(), [0.0, 0.0, 2.0])
    assert_close(formation.pointing_axes, [[0.0, 0.0, 1.0]] * 3, atol=0.0)
    with pytest.raises(ValueError):
        formation.pointing_axes[0, 0] = 1.0


@pytest.mark.parametrize(('arguments', 'error', 'what'), [
    ((complete(), Cosine), TypeError, r'such as Cosine\(\)'),
    ((complete, Cosine()), TypeError, r'such as complete\(\)'),
    ((complete(), Cosine(), [1.0, 0.0]), ValueError, r'shape \(3,\) or \(4, 3\)'),
    ((complete(), Cosine(), [[1.0, 0.0, 0.0]]), ValueError, r'shape \(3,\) or \(4, 3\)'),
    ((complete(), Cosine(), [0.0, 0.0, 0.0]), ValueError, 'finite and not zero')])
def test_what_makes_no_formation_is_refused(arguments, error, what):
    with pytest.raises(error, match=what):
        Formation(*arguments)


@pytest.mark.parametrize(('arguments', 'what'), [
    ({'duration': -1.0}, 'duration must be'), ({'rate': 0.0}, 'rate must be'),
    ({'rate': np.nan}, 'rate must be'), ({'rate': 1e12}, '1e9 Hz'),
    ({'rate': 1.001e9}, '1e9 Hz'),
    *(({key: value}, 'noise and loss') for key in ('noise', 'loss')
      for value in (-1e-3, 1.001, np.nan)),
    *(({'delay': value}, 'noise and loss') for value in (-1e-3, np.inf, np.nan)),
    ({'delay': 0.1, 'continuous': True}, 'continuous loop are exact'),
    ({'initial': np.ones((3, 4))}, r'shape \(4, 4\), quaternions'),
    ({'initial': 2.0 * np.ones((4, 3))}, 'unit quaternions or unit vectors'),
    ({'initial': np.full((4, 3), np.nan)}, 'unit quaternions or unit vectors')])
def test_what_cannot_be_simulated_is_refused(arguments, what):
    with pytest.raises(ValueError, match=what):
        Formation(complete(), Cosine()).simulate(**arguments)


@pytest.mark.parametrize('whole', [X[[0, 1, 1, 1]], X], ids=['quaternion', 'reduced'])
@pytest.mark.parametrize(('off', 'accepted'), [
    (0.9e-3, True), (-0.9e-3, True), (1.1e-3, False), (-1.1e-3, False)])
def test_what_a_run_begins_with_may_be_a_thousandth_off_unit_length(whole, off, accepted):
    given = np.tile(whole, (4, 1))
    given[2] *= 1.0 + off
    formation = Formation(complete(), Cosine())
    if accepted:
        run = formation.simulate(given, duration=0.01)
        assert_close(np.linalg.norm(run.attitudes[0], axis=1), 1.0, atol=1e-15)
    else:
        with pytest.raises(ValueError, match='unit quaternions or unit vectors'):
            formation.simulate(given, duration=0.01)


@pytest.mark.parametrize(('arguments', 'what'), [
    ({'rate': -1.0}, 'rate must be'), ({'delay': -0.1}, 'delay must be'),
    ({'noise': 0.0}, 'noise must be'), ({'error': 0.2}, 'error must be less'),
    ({'delay': 100.0}, 'too many to analyse')])
def test_what_cannot_be_analysed_is_refused(arguments, what):
    with pytest.raises(ValueError, match=what):
        Formation(complete(), Cosine()).analyze(**arguments)


def test_without_a_known_shape_there_is_no_error_to_tell():
    run = Formation(custom(3, [(1, 2), (2, 3)]), Cosine()).simulate(duration=0.1)
    with pytest.raises(ValueError, match='no shape is known'):
        _ = run.errors
    assert run.angles.shape == (11, 3)


@pytest.mark.parametrize('delay', [0.0, 0.2])
def test_an_analysis_tells_the_spin_of_the_late_sampled_loop(delay):
    formation = Formation(rotating(), Cosine())
    analysis = formation.analyze(rate=20.0, delay=delay)
    run = formation.simulate(seed=4, rate=20.0, delay=delay, duration=60.0)
    assert np.linalg.norm(run.spin()) == pytest.approx(analysis.sampled_spin_rate, rel=1e-7)
    off = np.max(np.abs(np.sort(run.angles[-1]) - np.array(analysis.angles)))
    assert off == pytest.approx(analysis.offset, rel=1e-5)


def test_two_motions_side_by_side_are_those_of_each():
    starts = rotation.random(np.random.default_rng(3), (2, 3, 4))
    axes = sphere.random(np.random.default_rng(4), (4,))
    times = np.array([0.0, 0.3, 1.1])
    given = axes, rotating().weights, Exponential(), times
    together = flow.attitudes(starts, *given)
    for index in np.ndindex(2, 3):
        assert_close(together[(slice(None), *index)], flow.attitudes(starts[index], *given),
                     atol=1e-8)


def test_what_is_not_known_of_a_motion_is_told():
    one = Formation(complete(), Cosine()).simulate(duration=1e-9)
    with pytest.raises(ValueError, match='one sample does not tell'):
        one.spin()
    run = Formation(custom(3, [(1, 2), (2, 3)]), Cosine()).simulate(duration=0.1)
    with pytest.raises(ValueError, match='so no spin is predicted'):
        run.predicted_spin()


def test_a_motion_without_bound_is_told_and_not_followed():
    with pytest.raises(FloatingPointError, match='not finite'):
        flow.reduced_attitudes(np.full((2, 3), np.nan), complete(2).weights, Cosine(), [0.0, 1.0])


def test_what_a_run_came_to_can_be_asked():
    formation = Formation(rotating(), Cosine())
    run = formation.simulate(seed=1, duration=20.0, rate=50.0)
    formed = run.time_to_form(1e-2)
    k = round(formed * 50.0)
    assert np.all(run.errors[k:] < 1e-2)
    assert run.errors[k - 1] >= 1e-2
    assert run.time_to_form(1e-9) is None
    assert np.linalg.norm(run.spin()) == pytest.approx(1.0 / np.sqrt(3.0), rel=1e-2)
    assert_close(run.predicted_spin(), run.spin(), atol=1e-2)
    short = formation.simulate(seed=1, duration=0.02, rate=50.0)
    assert np.linalg.norm(short.spin()) > 0.0


def test_equilibria_of_a_pair_are_two():
    found = Formation(complete(2), Exponential()).equilibria(starts=40, seed=2)
    assert {entry.kind for entry in found} == {'consensus', '1 against 1'}
    for entry in found:
        assert entry.reduced_attitudes.shape == (2, 3)
        assert entry.spin_rate == 0.0
