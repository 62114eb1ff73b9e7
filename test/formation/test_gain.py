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

import dataclasses
import math

from hypothesis import given
from hypothesis import strategies as st
import numpy as np
import pytest
from strategies import any_gain, assert_close
from tetra_ros2.formation import gain as gains

INTERIOR = np.linspace(0.0, math.pi, 501)[1:-1]


@given(any_gain())
def test_the_derivative_is_that_of_the_function(gain):
    # A complex step has no cancellation, so that it is accurate to rounding.
    step = 1e-30
    slope = np.imag(gain.f(INTERIOR + 1j * step)) / step
    np.testing.assert_allclose(gain.derivative(INTERIOR), slope, rtol=1e-13, atol=1e-300)


@given(any_gain())
def test_every_gain_is_positive_and_decreases_between_zero_and_pi(gain):
    f = gain.f(INTERIOR)
    assert np.all(f > 0.0)
    assert np.all(np.diff(f) < 0.0)
    assert np.all(gain.derivative(INTERIOR) < 0.0)


@given(any_gain(), st.floats(0.0, math.pi))
def test_an_agent_and_an_array_evaluate_the_same_function(gain, theta):
    for method in (gain.f, gain.derivative):
        in_array = method(np.full((2, 3), theta))
        assert in_array.shape == (2, 3)
        np.testing.assert_allclose(in_array, method(theta, math), rtol=1e-14, atol=1e-300)
        assert isinstance(method(theta, math), float)


@given(any_gain(), st.floats(-1.0, 1.0))
def test_one_cosine_is_evaluated_as_many_are(gain, cosine):
    assert gain.of_one_cosine(cosine) == pytest.approx(
        gain.of_cosine(np.array([cosine]))[0], rel=1e-14)


@given(any_gain(), st.floats(0.1, 10.0))
def test_a_is_the_amplitude(gain, factor):
    louder = dataclasses.replace(gain, a=factor * gain.a)
    for name in ('f', 'derivative'):
        np.testing.assert_allclose(
            getattr(louder, name)(INTERIOR), factor * getattr(gain, name)(INTERIOR), rtol=1e-14)


def test_the_papers_first_gain_is_one_plus_the_cosine():
    assert_close(
        gains.Cosine().f(np.array([0.0, math.pi / 3.0, math.pi / 2.0, math.pi])),
        [2.0, 1.5, 1.0, 0.0], atol=1e-15)


def test_the_papers_second_gain_falls_by_e_in_one_radian():
    f = gains.Exponential().f(np.array([0.0, 1.0, 2.0]))
    assert_close(f, [1.0, 1.0 / math.e, 1.0 / math.e**2], atol=1e-15)


def test_a_gaussian_falls_by_the_root_of_e_in_one_length():
    gain = gains.Gaussian(a=2.0, b=4.0)
    assert_close(gain.f(np.array([0.0, 0.25])), [2.0, 2.0 / math.sqrt(math.e)], atol=1e-15)


def test_a_linear_gain_is_linear_and_vanishes_at_pi_for_b_one():
    assert_close(
        gains.Linear(a=2.0).f(np.array([0.0, math.pi / 2.0, math.pi])), [2.0, 1.0, 0.0], 1e-15)


def test_a_rational_gain_falls_to_a_half_in_one_length():
    assert_close(gains.Rational(a=2.0, b=4.0).f(np.array([0.0, 0.25])), [2.0, 1.0], atol=1e-15)


@pytest.mark.parametrize('family', gains.KINDS.values())
@pytest.mark.parametrize('wrong', [0.0, -1.0, math.nan, math.inf])
@pytest.mark.parametrize('name', ['a', 'b'])
def test_a_parameter_that_is_not_positive_and_finite_is_refused(family, wrong, name):
    with pytest.raises(ValueError, match='greater than 0') as refused:
        family(**{name: wrong})
    assert repr(wrong) in str(refused.value)


@given(st.floats(1.0, 100.0, exclude_min=True))
def test_a_linear_gain_that_changes_sign_before_pi_is_refused(b):
    if b > 1.001:
        with pytest.raises(ValueError, match='f > 0'):
            gains.Linear(b=b)


def test_a_gain_that_underflows_to_zero_is_refused():
    with pytest.raises(ValueError, match='f > 0'):
        gains.Gaussian(b=100.0)


def test_a_gain_that_overflows_is_refused():
    with pytest.raises(ValueError, match='not bounded'):
        gains.Cosine(a=1.5e308)


class Attraction(gains.Gain):

    def f(self, theta, xp=np):
        return self.a * (1.0 - xp.cos(theta))

    def derivative(self, theta, xp=np):
        return self.a * xp.sin(theta)


class Wave(gains.Gain):

    def f(self, theta, xp=np):
        return self.a * (2.0 + xp.cos(3.0 * theta))

    def derivative(self, theta, xp=np):
        return -3.0 * self.a * xp.sin(3.0 * theta)


class Pole(gains.Gain):

    def f(self, theta, xp=np):
        with np.errstate(divide='ignore'):
            return self.a / theta

    def derivative(self, theta, xp=np):
        return -self.a / (theta * theta)


@pytest.mark.parametrize('family, what', [
    (Attraction, "f' < 0"), (Wave, "f' < 0"), (Pole, 'not bounded')])
def test_a_function_that_violates_the_assumption_is_refused(family, what):
    with pytest.raises(ValueError, match=what):
        family()


def test_the_refusal_names_a_place_where_the_assumption_fails():
    with pytest.raises(ValueError) as refused:
        Wave()
    theta = float(str(refused.value).split('theta = ')[1])
    assert -3.0 * math.sin(3.0 * theta) >= 0.0


def test_every_family_has_a_kind_to_be_chosen_by():
    assert {family for family in gains.Gain.__subclasses__()
            if family.__module__ == gains.__name__} == set(gains.KINDS.values())


def test_a_gain_cannot_be_changed_into_one_that_was_not_checked():
    with pytest.raises(dataclasses.FrozenInstanceError):
        gains.Cosine().a = -1.0


class Quartic(gains.Gain):

    def f(self, theta, xp=np):
        return self.a / (1.0 + self.b * theta**4)


def test_a_gain_of_ones_own_needs_no_derivative():
    exact = -4.0 * INTERIOR**3 / (1.0 + INTERIOR**4)**2
    np.testing.assert_allclose(Quartic().derivative(INTERIOR), exact, rtol=1e-13)
    cosines = np.cos(INTERIOR)
    np.testing.assert_allclose(Quartic().of_cosine_derivative(cosines), -exact / np.sin(INTERIOR),
                               rtol=1e-9)


class Kinked(gains.Gain):

    def f(self, theta, xp=np):
        return self.a * (4.0 - abs(theta))


class Hasty(gains.Gain):

    def f(self, theta, xp=np):
        return self.a * xp.exp(-theta)

    def derivative(self, theta, xp=np):
        return -2.0 * self.a * xp.exp(-theta)


class NoModule(gains.Gain):

    def f(self, theta):
        return self.a * np.exp(-theta)


class Scalar(gains.Gain):

    def f(self, theta, xp=np):
        return self.a if theta < 1.0 else 0.5 * self.a


class Complex(gains.Gain):

    def f(self, theta, xp=np):
        return self.a * np.exp(-theta + 0j)


class Twofold(gains.Gain):

    def f(self, theta, xp=np):
        return self.a * (np.exp(-theta) if xp is np else math.exp(-2.0 * theta))


class Loose(gains.Gain):

    def f(self, theta, xp=np):
        return self.a


@pytest.mark.parametrize('family, what', [
    (Kinked, "the derivative must be that of f|f' < 0"),
    (Hasty, 'the derivative must be that of f'),
    (NoModule, 'cannot be evaluated: TypeError'),
    (Scalar, 'cannot be evaluated: ValueError'),
    (Complex, 'must be a float, not complex'),
    (Twofold, 'one value for math and another for numpy'),
    (Loose, 'an array of the shape of theta')])
def test_what_is_wrong_with_a_gain_of_ones_own_is_said(family, what):
    with pytest.raises(ValueError, match=what):
        family()


def test_a_kind_is_the_name_by_which_a_family_is_chosen():
    for kind, family in gains.KINDS.items():
        assert gains.family(kind) is family
        assert family().kind == kind
    own = Quartic().kind
    assert own == f'{__name__}:Quartic'
    assert gains.is_known(own)
    assert gains.family(own) is Quartic


@pytest.mark.parametrize('kind, what', [
    ('cosin', 'expected one of cosine'),
    ('nowhere.to_be:Found', "there is no module 'nowhere'"),
    ('math:sin', 'sin is not a subclass of tetra_ros2.formation.Gain'),
    ('math:Nothing', 'there is no Nothing in math'),
    (f'{__name__}:INTERIOR', 'INTERIOR is not a subclass'),
    ('tetra_ros2.formation.gain:Gain', 'Gain has no method f')])
def test_a_kind_that_leads_nowhere_is_refused(kind, what):
    with pytest.raises(gains.UnknownGain, match=what):
        gains.family(kind)


def test_a_module_that_cannot_be_imported_is_told_from_one_that_is_not_there(
        tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    (tmp_path / 'gains_that_fail.py').write_text('import not_installed_at_all\n')
    (tmp_path / 'gains_that_raise.py').write_text('1 / 0\n')
    with pytest.raises(gains.UnknownGain, match='cannot be imported: No module'):
        gains.family('gains_that_fail:X')
    with pytest.raises(gains.UnknownGain, match='cannot be imported: ZeroDivisionError'):
        gains.family('gains_that_raise:X')
