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
What a claim of the paper is here: a check that can fail, in a registry, under a name.

A check is given the :class:`~tetra_ros2.paper.system.SystemUnderTest`, which is to be what the
paper says it is, and returns a :class:`Result`: what the paper predicts, what was measured, and
how far apart the two may be. Nothing is compared with a number of this package's own making: the
closed forms are the paper's. What they are compared with is computed from the law, from random
points, from simulation, or from a run of the real nodes.

To add a claim, write its check with the decorator :func:`claim` in a module of
:mod:`tetra_ros2.paper.claims`. A new module is named in its SECTIONS.
"""

from collections.abc import Callable, Iterable
from dataclasses import dataclass
import math
from typing import Any

import numpy as np
from numpy.typing import ArrayLike
from tetra_ros2.paper.system import SystemUnderTest

RELATIVE = 1e-9
"""How well a spectrum must agree with its closed form."""


@dataclass(frozen=True)
class Result:
    """
    The outcome of a check.

    :param predicted: what the paper says, a number or a bound in words
    :param measured: what came out
    :param tolerance: how far apart they may be
    :param passed: the verdict
    :param note: what else is worth knowing
    """

    predicted: float | str
    measured: float | str
    tolerance: float | str
    passed: bool
    note: str = ''

    def __post_init__(self) -> None:
        """Turn numpy's scalars into Python's, which print and serialise as such."""
        for name in ('predicted', 'measured', 'tolerance', 'passed'):
            value = getattr(self, name)
            object.__setattr__(self, name, getattr(value, 'item', lambda value=value: value)())


def equal(predicted: float, measured: float, tolerance: float, note: str = '') -> Result:
    """Return the result that two numbers are to be the same; NaN never is."""
    passed = bool(abs(measured - predicted) <= tolerance)
    return Result(float(predicted), float(measured), tolerance, passed, note)


def vanishes(deviation: ArrayLike, tolerance: float, note: str = '') -> Result:
    """Return the result that a deviation, or the largest of many, is to be zero."""
    return equal(0.0, np.max(np.abs(deviation)), tolerance, note)


def negative(values: ArrayLike, note: str = '') -> Result:
    """Return the result that the largest real part is to be below zero."""
    worst = float(np.max(np.real(values)))
    return Result('< 0', worst, 0.0, worst < 0.0, note)


def same_spectrum(measured: ArrayLike, predicted: ArrayLike, note: str = '') -> Result:
    """Return the result that two sets of eigenvalues agree, relative to the largest."""
    measured, left = np.asarray(measured, complex), list(np.asarray(predicted, complex))
    scale = np.max(np.abs(left))
    worst = 0.0 if len(measured) == len(left) else math.inf
    for value in measured[:len(left)]:
        nearest = int(np.argmin([abs(value - other) for other in left]))
        worst = max(worst, abs(value - left.pop(nearest)) / scale)
    return equal(0.0, worst, RELATIVE, note)


def worst_of(results: Iterable[Result]) -> Result:
    """Return the result with the largest deviation; one that did not pass before all others."""
    return max(results, key=lambda result: (not result.passed, result.measured))


@dataclass(frozen=True)
class Claim:
    """
    A claim of the paper.

    :param key: its name on the command line
    :param label: where it stands in the paper: a label, or a section
    :param says: what it says
    :param how: how it is checked here
    :param check: takes the system under test, returns a :class:`Result`
    :param section: the module of the check, which stands for a section of the paper
    :param nodes: whether that runs the real nodes
    """

    key: str
    label: str
    says: str
    how: str
    check: Callable[[SystemUnderTest], Result]
    section: str
    nodes: bool = False


Check = Callable[..., Result]

CLAIMS: dict[str, Claim] = {}


def claim(key: str, label: str, says: str, how: str, nodes: bool = False,
          **fixed: Any) -> Callable[[Check], Check]:
    """
    Register a check under a key; ``fixed`` goes to it as keyword arguments.

    :raises ValueError: if the key is taken
    """
    def register(check: Check) -> Check:
        if key in CLAIMS:
            raise ValueError(f'there are two claims {key}')
        CLAIMS[key] = Claim(
            key, label, says, how, lambda system: check(system, **fixed),
            check.__module__.rpartition('.')[2], nodes)
        return check
    return register
