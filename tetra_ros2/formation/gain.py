# Copyright 2026 The tetra_ros2 authors
# SPDX-License-Identifier: Apache-2.0

"""
Gain functions ``f(theta)``: how strongly a neighbour at geodesic distance theta repels.

A formula is written once, over the functions of a module ``xp``: numpy for arrays, ``math`` for
the plain floats of an agent's callback. To add a gain, write its class here and list it in KINDS.
"""

from abc import ABC, abstractmethod
from dataclasses import dataclass
import math

import numpy as np


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

    def __post_init__(self):
        """Refuse parameters with which the paper's assumption does not hold."""
        if reason := violation(self):
            raise ValueError(reason)

    @abstractmethod
    def f(self, theta, xp=np):
        """Return f(theta) [rad/s], of the shape of ``theta`` [rad]."""

    @abstractmethod
    def derivative(self, theta, xp=np):
        """Return f'(theta) [1/s], of the shape of ``theta`` [rad]."""

    def of_cosine(self, cosine):
        """Return F(c) = f(arccos c) [rad/s], the gain over the cosine; eq:SF:newCorDynf1Detial."""
        return self.f(np.arccos(np.clip(cosine, -1.0, 1.0)))

    def of_one_cosine(self, cosine):
        """Return F(c) [rad/s] for a plain float from -1 to 1: for the callback of an agent."""
        return self.f(math.acos(cosine), math)

    def of_cosine_derivative(self, cosine):
        """Return F'(c) = -f'(theta) / sin(theta) [1/s], for c in (-1, 1)."""
        theta = np.arccos(np.clip(cosine, -1.0, 1.0))
        return -self.derivative(theta) / np.sin(theta)


class Cosine(Gain):
    """The paper's gain a (1 + cos theta), As:SFG:f, with almost global convergence proven."""

    def f(self, theta, xp=np):
        """Return f(theta) [rad/s]."""
        return self.a * (1.0 + xp.cos(theta))

    def derivative(self, theta, xp=np):
        """Return f'(theta) [1/s]."""
        return -self.a * xp.sin(theta)

    def of_cosine(self, cosine):
        """Return F(c) [rad/s]."""
        return self.a * (1.0 + cosine)

    of_one_cosine = of_cosine


class Exponential(Gain):
    """The paper's gain a exp(-b theta), with b = 1 there."""

    def f(self, theta, xp=np):
        """Return f(theta) [rad/s]."""
        return self.a * xp.exp(-self.b * theta)

    def derivative(self, theta, xp=np):
        """Return f'(theta) [1/s]."""
        return -self.b * self.a * xp.exp(-self.b * theta)


class Gaussian(Gain):
    """The gain a exp(-(b theta)^2 / 2): strong nearby, soon forgotten."""

    def f(self, theta, xp=np):
        """Return f(theta) [rad/s]."""
        u = self.b * theta
        return self.a * xp.exp(-0.5 * (u * u))

    def derivative(self, theta, xp=np):
        """Return f'(theta) [1/s]."""
        u = self.b * theta
        return -self.b * u * self.a * xp.exp(-0.5 * (u * u))


class Linear(Gain):
    """The gain a (1 - b theta / pi), with b below or equal to 1: it needs no transcendental."""

    def f(self, theta, xp=np):
        """Return f(theta) [rad/s]."""
        return self.a * (1.0 - self.b * (theta / math.pi))

    def derivative(self, theta, xp=np):
        """Return f'(theta) [1/s]."""
        return -self.a * self.b / math.pi + 0.0 * theta


class Rational(Gain):
    """The gain a / (1 + (b theta)^2): the longest reach of these families."""

    def f(self, theta, xp=np):
        """Return f(theta) [rad/s]."""
        u = self.b * theta
        return self.a / (1.0 + u * u)

    def derivative(self, theta, xp=np):
        """Return f'(theta) [1/s]."""
        u = self.b * theta
        v = 1.0 + u * u
        return -2.0 * self.b * u * self.a / (v * v)


KINDS = {
    'cosine': Cosine,
    'exponential': Exponential,
    'gaussian': Gaussian,
    'linear': Linear,
    'rational': Rational,
}


def violation(gain, points=2001):
    """
    Say how a gain violates As:SF:f: f bounded, f > 0 and f' < 0 on the open interval (0, pi).

    :param gain: the gain
    :param points: how many interior points of (0, pi) to look at
    :returns: a sentence, or None if the assumption holds
    """
    if not (0.0 < gain.a < math.inf and 0.0 < gain.b < math.inf):
        return f'a and b must be finite and greater than 0, not {gain.a!r} and {gain.b!r}'
    theta = np.linspace(0.0, np.pi, points + 2)
    with np.errstate(over='ignore', invalid='ignore'):
        f, df = gain.f(theta), gain.derivative(theta[1:-1])
    if not np.all(np.isfinite(f)):
        return f'f is not bounded on [0, pi]: f({theta[~np.isfinite(f)][0]:.4g}) is not finite'
    for value, holds, what in ((f[1:-1], f[1:-1] > 0.0, 'f > 0'), (df, df < 0.0, "f' < 0")):
        if not np.all(holds):
            worst = int(np.argmin(holds))
            return (f'{what} must hold on (0, pi), '
                    f'but it is {value[worst]:.4g} at theta = {theta[worst + 1]:.4g}')
    return None
