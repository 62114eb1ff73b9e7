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

"""The integrator: the equations that make its coefficients those of its order, and its steps."""

import itertools

import numpy as np
import pytest
from tetra_ros2.formation import _dop853 as dop853

ROWS = (*dop853.STAGES, dop853.SOLUTION, *dop853.DENSE_STAGES)
"""The factors of the slopes for each stage, the end of the step as number 12 among them."""


def matrix(rows):
    """Return factors as a matrix: a row for each row, a column for each slope."""
    result = np.zeros((len(rows), 16))
    for k, row in enumerate(rows):
        for source, factor in row:
            result[k, source] += factor
    return result


FACTORS = matrix(ROWS)
TIMES = np.sum(FACTORS, axis=1)
POWERS = TIMES**np.arange(16)[:, None]
"""The powers 0 to 15 of the times at which the slopes are taken, in parts of the step."""

# To which power of time each stage is exact: Hairer, Norsett, Wanner, II.5 and II.6.
EXACT = (0, 0, 1, 2, 2, 4, 4, 4, 4, 4, 4, 4, 7, 4, 4, 4)


def test_no_stage_needs_one_that_comes_later():
    assert all(source < k for k, row in enumerate(ROWS) for source, _ in row)


@pytest.mark.parametrize('stage', range(1, 16))
def test_a_stage_is_exact_for_powers_of_time_up_to_its_order(stage):
    powers = np.arange(EXACT[stage] + 1)
    np.testing.assert_allclose(
        POWERS[powers] @ FACTORS[stage], TIMES[stage]**(powers + 1) / (powers + 1), atol=1e-14)


def test_the_estimates_of_the_error_are_zero_up_to_their_order_and_not_beyond():
    fifth, third = matrix([dop853.FIFTH_ERROR, dop853.THIRD_ERROR]) @ POWERS.T
    np.testing.assert_allclose(fifth[:5], 0.0, atol=1e-14)
    np.testing.assert_allclose(third[:3], 0.0, atol=1e-14)
    assert abs(fifth[5]) > 1e-4
    assert abs(third[3]) > 1e-2


def pendulum(x):
    return np.array([x[1], -np.sin(x[0])])


START = np.array([2.0, 0.3])


def one_step(h, start=START, rate=pendulum):
    """Return one step of a length, whatever its error."""
    return next(dop853.steps(rate, start, 1e300, lambda x: x, h))


def exactly(time, parts=40):
    """Return the solution at a time, by steps so short that rounding is all."""
    x = START
    for _ in range(parts):
        x = one_step(time / parts, x).after
    return x


def test_a_step_half_as_long_is_two_to_the_ninth_as_exact():
    long, short = (np.linalg.norm(one_step(h).after - exactly(h)) for h in (0.8, 0.4))
    assert 2.0**8 < long / short < 2.0**10.5
    assert short < 1e-10


def test_inside_a_step_powers_of_time_are_exact_up_to_the_seventh():
    powers = np.arange(7)

    def rate(x):
        return np.array([1.0, *x[0]**powers])

    times = np.linspace(0.0, 1.0, 9)
    inside = one_step(1.0, np.zeros(8), rate).at(times)
    np.testing.assert_allclose(inside[:, 1:], times[:, None]**(powers + 1) / (powers + 1),
                               rtol=0.0, atol=1e-13)


def test_inside_a_step_half_as_long_it_is_two_to_the_eighth_as_exact():
    x = np.linspace(0.0, 1.0, 9)
    long, short = (np.max(np.abs(one_step(h).at(h * x) - [exactly(h * y) for y in x]))
                   for h in (0.8, 0.4))
    assert 2.0**7 < long / short < 2.0**9.5
    assert short < 1e-8


def test_inside_a_step_the_ends_are_those_of_the_step():
    step = one_step(0.7)
    np.testing.assert_allclose(step.at(np.array([0.0, 0.7])), [step.before, step.after],
                               atol=1e-15)


@pytest.mark.parametrize('tolerance', [1e-4, 1e-7, 1e-10])
def test_the_solution_is_as_exact_as_wanted_and_not_much_more(tolerance):
    times = np.linspace(0.0, 3.0, 7)
    found = dop853.solve(pendulum, START, times, tolerance, lambda x: x, 0.1)
    exact = np.array([exactly(time, 100) for time in times])
    assert 1e-4 * tolerance < np.max(np.abs(found - exact)) < 10.0 * tolerance


def test_steps_adapt_to_the_solution_by_a_factor_of_six_at_most():
    ends = [step.end for step in itertools.islice(
        dop853.steps(np.zeros_like, np.zeros(1), 1e-9, lambda x: x, 1.0), 3)]
    assert ends == [1.0, 7.0, 43.0]
    calls = []

    def counted(x):
        calls.append(x)
        return pendulum(x)

    found = list(dop853.steps(counted, START, 1e-10, lambda x: x, 125.0, 200.0))
    refused = (len(calls) - 1 - 12 * len(found)) / 11
    assert refused == int(refused)
    assert refused < 0.5 * len(found)
    assert np.max([step.end - step.begin for step in found]) < 1.0


@pytest.mark.parametrize('tolerance', [1e-3, 1e-6, 1e-9, 1e-12])
@pytest.mark.parametrize('h', [0.02, 0.3, 2.0])
def test_the_next_step_is_as_long_as_the_estimate_of_the_error_allows(tolerance, h):
    # Hairer, Norsett, Wanner, II.4 and II.10: both estimates together, and a factor for safety.
    calls, slopes = [], [pendulum(START)]
    for row in dop853.STAGES[1:]:
        slopes.append(pendulum(START + h * sum(f * slopes[k] for k, f in row)))
    fifth, third = (np.linalg.norm(sum(f * slopes[k] for k, f in row))
                    for row in (dop853.FIFTH_ERROR, dop853.THIRD_ERROR))
    error = h * fifth**2 / np.hypot(fifth, 0.1 * third) / np.sqrt(2.0) / tolerance
    factor = np.clip(0.9 * error**(-1.0 / 8.0), 0.2, 6.0)

    def counted(x):
        calls.append(x)
        return pendulum(x)

    found = dop853.steps(counted, START, tolerance, lambda x: x, h)
    first = next(found)
    if error <= 1.0:
        assert first.end == h
        second = next(found)
        if len(calls) == 1 + 2 * 12:
            assert second.end - second.begin == pytest.approx(factor * h, rel=1e-6)
    elif len(calls) == 1 + 11 + 12:
        assert first.end == pytest.approx(factor * h, rel=1e-6)
    else:
        assert first.end < factor * h


def test_it_ends_at_the_time_wished_for_and_restores_each_step():
    found = list(dop853.steps(pendulum, START, 1e-8, lambda x: np.round(x, 6), 0.3, 2.0))
    assert found[0].begin == 0.0
    assert found[-1].end == 2.0
    for before, after in itertools.pairwise(found):
        assert before.end == after.begin
        assert np.array_equal(before.after, after.before)
        assert np.array_equal(after.before, np.round(after.before, 6))


@pytest.mark.filterwarnings('ignore:overflow', 'ignore:invalid value')
def test_what_is_not_finite_is_an_error():
    with pytest.raises(FloatingPointError, match='not finite'):
        list(dop853.steps(lambda x: x**2, np.array([1e200]), 1e-6, lambda x: x, 0.1, 10.0))
