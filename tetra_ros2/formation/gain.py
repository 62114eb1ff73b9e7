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

"""
Gain functions ``f(theta)``: how strongly a neighbour at geodesic distance theta repels.

A formula is written once, over the functions of a module ``xp``: numpy for arrays, ``math`` for
the plain floats of an agent's callback.

A gain of one's own is a subclass of :class:`Gain` in any module::

    class Quartic(Gain):
        def f(self, theta: Any, xp: ModuleType = np) -> Any:
            return self.a / (1.0 + self.b * theta**4)

``Quartic(a=2.0)`` can be used wherever a gain is wanted. The name ``module:Quartic`` chooses it in
a configuration, see :func:`family`. To add a family to those that ship, write its class here and
list it in KINDS.
"""

from abc import ABC, abstractmethod
from dataclasses import dataclass
import importlib
import math
import os
import re
import sys
from types import ModuleType
from typing import Any

import numpy as np
from numpy.typing import ArrayLike
from tetra_ros2.formation._types import Array


@dataclass(frozen=True)
class Gain(ABC):
    """
    A gain function of the geodesic distance theta in [0, pi] [rad], in rad/s.

    :param a: amplitude [rad/s], greater than 0
    :param b: shape, greater than 0; its meaning, if any, is the family's
    :raises ValueError: if the function violates the assumption As:SF:f
    """

    a: float = 1.0
    b: float = 1.0

    def __post_init__(self) -> None:
        """Refuse parameters with which the paper's assumption does not hold."""
        if reason := violation(self):
            raise ValueError(reason)

    @property
    def kind(self) -> str:
        """Return the name of the family: one of KINDS, or ``module:Class`` for any other."""
        for name, shipped in KINDS.items():
            if type(self) is shipped:
                return name
        return f'{type(self).__module__}:{type(self).__qualname__}'

    @abstractmethod
    def f(self, theta: Any, xp: ModuleType = np) -> Any:
        """Return f at theta [rad/s], of the shape of ``theta`` [rad]."""

    def derivative(self, theta: Any, xp: ModuleType = np) -> Any:
        """
        Return f'(theta) [1/s], of the shape of ``theta`` [rad].

        A family need not write it if its formula is analytic: the imaginary part of
        ``f(theta + 1e-30 i)`` is the derivative to rounding.
        """
        return np.imag(self.f(np.asarray(theta) + 1e-30j)) / 1e-30

    def of_cosine(self, cosine: ArrayLike) -> Array:
        """Return F(c) = f(arccos c) [rad/s], the gain over the cosine; eq:SF:newCorDynf1Detial."""
        value: Array = self.f(np.arccos(np.clip(cosine, -1.0, 1.0)))
        return value

    def of_one_cosine(self, cosine: float) -> float:
        """Return F(c) [rad/s] for a plain float from -1 to 1: for the callback of an agent."""
        value: float = self.f(math.acos(cosine), math)
        return value

    def of_cosine_derivative(self, cosine: ArrayLike) -> Array:
        """Return F'(c) = -f'(theta) / sin(theta) [1/s], for c in (-1, 1)."""
        theta = np.arccos(np.clip(cosine, -1.0, 1.0))
        slope: Array = -self.derivative(theta) / np.sin(theta)
        return slope


class Cosine(Gain):
    """The paper's gain a (1 + cos theta), As:SFG:f, with almost global convergence proven."""

    def f(self, theta: Any, xp: ModuleType = np) -> Any:
        """Return f at theta [rad/s]."""
        return self.a * (1.0 + xp.cos(theta))

    def derivative(self, theta: Any, xp: ModuleType = np) -> Any:
        """Return f'(theta) [1/s]."""
        return -self.a * xp.sin(theta)

    def of_cosine(self, cosine: Any) -> Any:
        """Return F(c) [rad/s]."""
        return self.a * (1.0 + cosine)

    of_one_cosine = of_cosine


class Exponential(Gain):
    """The paper's gain a exp(-b theta), with b = 1 there."""

    def f(self, theta: Any, xp: ModuleType = np) -> Any:
        """Return f at theta [rad/s]."""
        return self.a * xp.exp(-self.b * theta)

    def derivative(self, theta: Any, xp: ModuleType = np) -> Any:
        """Return f'(theta) [1/s]."""
        return -self.b * self.a * xp.exp(-self.b * theta)


class Gaussian(Gain):
    """The gain a exp(-(b theta)^2 / 2): strong nearby, soon forgotten."""

    def f(self, theta: Any, xp: ModuleType = np) -> Any:
        """Return f at theta [rad/s]."""
        u = self.b * theta
        return self.a * xp.exp(-0.5 * (u * u))

    def derivative(self, theta: Any, xp: ModuleType = np) -> Any:
        """Return f'(theta) [1/s]."""
        u = self.b * theta
        return -self.b * u * self.a * xp.exp(-0.5 * (u * u))


class Linear(Gain):
    """The gain a (1 - b theta / pi), with b below or equal to 1: it needs no transcendental."""

    def f(self, theta: Any, xp: ModuleType = np) -> Any:
        """Return f at theta [rad/s]."""
        return self.a * (1.0 - self.b * (theta / math.pi))

    def derivative(self, theta: Any, xp: ModuleType = np) -> Any:
        """Return f'(theta) [1/s]."""
        return -self.a * self.b / math.pi + 0.0 * theta


class Rational(Gain):
    """The gain a / (1 + (b theta)^2): the longest reach of these families."""

    def f(self, theta: Any, xp: ModuleType = np) -> Any:
        """Return f at theta [rad/s]."""
        u = self.b * theta
        return self.a / (1.0 + u * u)

    def derivative(self, theta: Any, xp: ModuleType = np) -> Any:
        """Return f'(theta) [1/s]."""
        u = self.b * theta
        v = 1.0 + u * u
        return -2.0 * self.b * u * self.a / (v * v)


KINDS: dict[str, type[Gain]] = {
    'cosine': Cosine,
    'exponential': Exponential,
    'gaussian': Gaussian,
    'linear': Linear,
    'rational': Rational,
}


OWN = re.compile(r'([A-Za-z_]\w*(?:\.[A-Za-z_]\w*)*):([A-Za-z_]\w*)')
"""What the name of a family of one's own looks like: ``module:Class``."""


class UnknownGain(ValueError):
    """The name of a family does not lead to a family."""


def is_known(kind: str) -> bool:
    """Return whether :func:`family` can answer without importing anything."""
    match = OWN.fullmatch(kind)
    return kind in KINDS or (match is not None and match[1] in sys.modules)


def family(kind: str) -> type[Gain]:
    """
    Return the family of gains that has a name.

    :param kind: one of KINDS; or ``module:Class``, where the module is one that Python finds, on
        PYTHONPATH, among what is installed, or in the current directory
    :raises UnknownGain: if there is no such module or class, or it is not a family of gains
    """
    if kind in KINDS:
        return KINDS[kind]
    match = OWN.fullmatch(kind)
    if match is None:
        raise UnknownGain(f'expected one of {", ".join(KINDS)} or module:Class')
    module_name, class_name = match.groups()
    # Last, so that no file in the current directory takes the place of an installed module.
    if not {'', os.getcwd()} & set(sys.path):
        sys.path.append(os.getcwd())
    try:
        module = importlib.import_module(module_name)
    except ModuleNotFoundError as error:
        if error.name is not None and f'{module_name}.'.startswith(f'{error.name}.'):
            raise UnknownGain(
                f'there is no module {error.name!r}; it is looked for on PYTHONPATH, among the '
                f'installed packages and in {os.getcwd()}') from None
        raise UnknownGain(f'{module_name} cannot be imported: {error}') from error
    except Exception as error:  # whatever a module may raise while it is imported
        raise UnknownGain(
            f'{module_name} cannot be imported: {type(error).__name__}: {error}') from error
    found = getattr(module, class_name, None)
    if found is None:
        place = getattr(module, '__file__', None) or 'built in'
        raise UnknownGain(f'there is no {class_name} in {module_name} ({place})')
    if not (isinstance(found, type) and issubclass(found, Gain)):
        raise UnknownGain(f'{class_name} is not a subclass of tetra_ros2.formation.Gain')
    if found.__abstractmethods__:
        raise UnknownGain(f'{class_name} has no method f(self, theta, xp)')
    return found


def violation(gain: Gain, points: int = 2001) -> str | None:
    """
    Say how a gain violates As:SF:f: f bounded, f > 0 and f' < 0 on the open interval (0, pi).

    What a family of one's own may get wrong besides is looked at too: that f takes plain floats
    with ``math`` as well as arrays with numpy, and that the derivative is that of f.

    :param gain: the gain
    :param points: how many interior points of (0, pi) to look at
    :returns: a sentence, or None if the assumption holds
    """
    if not (0.0 < gain.a < math.inf and 0.0 < gain.b < math.inf):
        return f'a and b must be finite and greater than 0, not {gain.a!r} and {gain.b!r}'
    theta = np.linspace(0.0, np.pi, points + 2)
    shipped = type(gain) in KINDS.values()
    if not shipped and (reason := _not_usable(gain, theta)):
        return reason
    with np.errstate(all='ignore'):
        f, df = gain.f(theta), gain.derivative(theta[1:-1])
    if not np.all(np.isfinite(f)):
        return f'f is not bounded on [0, pi]: f({theta[~np.isfinite(f)][0]:.4g}) is not finite'
    for value, holds, what in ((f[1:-1], f[1:-1] > 0.0, 'f > 0'), (df, df < 0.0, "f' < 0")):
        if not np.all(holds):
            worst = int(np.argmin(holds))
            return (f'{what} must hold on (0, pi), '
                    f'but it is {value[worst]:.4g} at theta = {theta[worst + 1]:.4g}')
    return None if shipped else _inconsistency(gain, theta[1:-1], df)


def _not_usable(gain: Gain, theta: Array) -> str | None:
    """Say why a family of somebody else's cannot be evaluated, or return None."""
    name = type(gain).__name__
    try:
        with np.errstate(all='ignore'):
            shapes = {np.shape(gain.f(theta)), np.shape(gain.derivative(theta))}
            one = gain.f(1.0, math)
    except Exception as error:  # it is somebody else's code
        return f'{name}.f cannot be evaluated: {type(error).__name__}: {error}'
    if shapes != {theta.shape}:
        return f'{name}.f and its derivative must return an array of the shape of theta'
    if not isinstance(one, float):
        return f'{name}.f(1.0, math) must be a float, not {type(one).__name__}'
    if not math.isclose(one, float(gain.f(np.array([1.0]))[0]), rel_tol=1e-9):
        return f'{name}.f gives one value for math and another for numpy'
    return None


def _inconsistency(gain: Gain, theta: Array, slope: Array) -> str | None:
    """Say where the derivative of a family of somebody else's is not that of f, or None."""
    step = 0.25 * (theta[1] - theta[0])
    with np.errstate(all='ignore'):
        numeric = (gain.f(theta + step) - gain.f(theta - step)) / (2.0 * step)
    # The error of the difference itself is of step^2; a kink shows in two points at most.
    wrong = np.abs(numeric - slope) > 1e-3 * np.max(np.abs(numeric))
    if np.sum(wrong) <= 0.01 * len(theta):
        return None
    worst = int(np.argmax(np.abs(numeric - slope)))
    return (f'the derivative must be that of f, but at theta = {theta[worst]:.4g} it is '
            f'{slope[worst]:.4g} and f changes by {numeric[worst]:.4g} per rad; write '
            f'{type(gain).__name__}.derivative')
