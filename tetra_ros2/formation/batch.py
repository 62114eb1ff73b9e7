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
The sampled loop for very many starts: does each of them form, and when.

:func:`run` does it with numpy. :func:`compiled` makes the same of the same gain with numba, if
that is installed, some hundred times as fast. Both follow the reduced attitudes alone: commands
are orthogonal to the pointing axes, so a held command moves Gamma along a great circle.
"""

from collections import namedtuple
from collections.abc import Callable
from dataclasses import fields
from functools import cache
import math
from typing import Any, TypeVar

import numpy as np
from numpy.typing import ArrayLike, NDArray
from tetra_ros2.formation import law, measures, sphere
from tetra_ros2.formation._types import Array
from tetra_ros2.formation.gain import Gain

Run = Callable[..., tuple[NDArray[np.int64], Array]]
F = TypeVar('F', bound=Callable[..., Any])

NEVER = -1
"""Where there would be the number of a step: the start did not form."""


def advance(gamma: Array, weights: Array, gain: Gain, h: float) -> Array:
    """
    Return the reduced attitudes one step of the sampled loop later.

    :param gamma: reduced attitudes, ``(..., n, 3)``
    :param weights: ``(n, n)``
    :param gain: a :class:`~tetra_ros2.formation.gain.Gain`
    :param h: length of the step [s]
    """
    return sphere.exp(gamma, h * law.velocity(gamma, weights, gain))


def run(gamma: ArrayLike, weights: ArrayLike, gain: Gain, target_angles: Array,
        tolerance: float, h: float, longest: int, hold: int,
        labelled: bool = False) -> tuple[NDArray[np.int64], Array]:
    """
    Run every start until it has formed, or for so many steps.

    A formation has formed when its error stays below the tolerance; the first step of the
    stretch counts, and ``hold`` more of them confirm it.

    :param gamma: reduced attitudes at the start, ``(m, n, 3)``
    :param weights: ``(n, n)``
    :param gain: a :class:`~tetra_ros2.formation.gain.Gain`
    :param target_angles: the shape's pairwise angles [rad] in ascending order, which those of a
        start are compared with in ascending order; if ``labelled``, that of each pair
    :param tolerance: on each of them [rad]
    :param h: length of a step [s]
    :param longest: how many steps at most
    :param hold: for how many steps the error must stay below the tolerance
    :param labelled: whether each pair has an angle of its own, for i < j in lexicographic order
    :returns: the step at which each formed or NEVER, ``(m,)``, and the last reduced attitudes
    """
    gamma, weights = np.array(gamma, dtype=float), np.asarray(weights, dtype=float)
    formed = np.full(len(gamma), NEVER)
    active = np.arange(len(gamma))
    for step in range(longest + 1):
        angles = measures.pairwise_angles(gamma[active])
        angles = angles if labelled else np.sort(angles, axis=-1)
        good = np.max(np.abs(angles - target_angles), axis=-1) <= tolerance
        since = formed[active]
        formed[active] = np.where(good, np.where(since == NEVER, step, since), NEVER)
        done = good & (step - formed[active] >= hold)
        active = active[~done]
        if not len(active) or step == longest:
            return formed, gamma
        gamma[active] = advance(gamma[active], weights, gain, h)
    return formed, gamma


def fastest(gain: Gain, n: int, labelled: bool = False) -> Run:
    """
    Return the fastest there is: what :func:`compiled` returns, or else :func:`run`.

    That is :func:`run` if numba is not installed, does not go with this numpy, or cannot compile
    the gain's family, as one of somebody's own may use more of Python than numba knows.

    :param gain: a :class:`~tetra_ros2.formation.gain.Gain`
    :param n: number of agents
    :param labelled: as :func:`run` will be told
    """
    try:
        import numba  # it is optional
    except ImportError:  # which it raises too where numpy is too new for it
        return run
    errors = numba.core.errors
    # Of its errors this one stands apart, since numba 0.61.
    unable = (errors.NumbaError, getattr(errors, 'UnsupportedBytecodeError', errors.NumbaError))
    try:
        made = compiled(gain)
        # It compiles here; no step is taken.
        made(np.tile([1.0, 0.0, 0.0], (1, n, 1)), np.zeros((n, n)), gain,
             np.zeros(n * (n - 1) // 2), 1e-3, 1.0, 0, 0, labelled)
    except unable:
        return run
    return made


def compiled(gain: Gain) -> Run:
    """
    Return :func:`run`, compiled for a gain's family.

    :param gain: a :class:`~tetra_ros2.formation.gain.Gain`
    :raises ModuleNotFoundError: if numba is not installed
    :raises numba.core.errors.NumbaError: when it is called, if numba cannot compile the family;
        ``UnsupportedBytecodeError``, which is none, if it does not know the family's bytecode
    """
    def run_compiled(gamma: ArrayLike, weights: ArrayLike, gain: Gain,
                     target_angles: ArrayLike, tolerance: float, h: float, longest: int,
                     hold: int, labelled: bool = False) -> tuple[NDArray[np.int64], Array]:
        weights = np.array(weights, dtype=float)
        kernel = _kernel(type(gain), len(weights), labelled)
        # Comparing cosines saves the arc tangents. Ascending angles have descending cosines.
        targets = np.asarray(target_angles)
        least = np.where(targets + tolerance < math.pi, np.cos(targets + tolerance), -2.0)
        most = np.where(targets > tolerance, np.cos(targets - tolerance), 2.0)
        gamma = np.array(gamma, dtype=float)
        formed = np.full(len(gamma), NEVER)
        step = 1 if labelled else -1
        kernel(gamma, weights, parameters_of(gain), least[::step].copy(),
               most[::step].copy(), h, longest, hold, formed)
        return formed, gamma

    return run_compiled


def compiler(**options: Any) -> Callable[[F], F]:
    """
    Return numba's decorator, typed.

    :raises ModuleNotFoundError: if numba is not installed
    """
    import numba  # it is optional
    decorator: Callable[[F], F] = numba.njit(**options)
    return decorator


def parameters_of(gain: Gain) -> Any:
    """Return the fields of a gain as a named tuple, which numba takes in its place."""
    return _tuple_type(type(gain))(*(getattr(gain, field.name) for field in fields(gain)))


@cache
def _tuple_type(family: type[Gain]) -> Any:
    return namedtuple(f'{family.__name__}Parameters', [field.name for field in fields(family)])


@cache
def _kernel(family: type[Gain], n: int, labelled: bool) -> Any:
    # A constant n lets the compiler unroll the loops over agents.

    of_cosine: Any
    if family.of_cosine is Gain.of_cosine:
        f = compiler()(family.f)

        @compiler()
        def of_cosine(parameters: Any, cosine: float) -> Any:
            return f(parameters, math.acos(min(max(cosine, -1.0), 1.0)))
    else:
        of_cosine = compiler()(family.of_cosine)

    m = n * (n - 1) // 2

    @compiler()
    def has_formed(cosines: Array, least: Array, most: Array, order: Array) -> bool:
        """Return whether the cosines, in ascending order, lie between their bounds."""
        # The largest cosine alone tells most of those that are not there yet.
        largest = -2.0
        for p in range(m):
            largest = max(largest, cosines[p])
        if not least[m - 1] <= largest <= most[m - 1]:
            return False
        for p in range(m):
            value = cosines[p]
            q = p
            while q and order[q - 1] > value:
                order[q] = order[q - 1]
                q -= 1
            order[q] = value
        for p in range(m):  # noqa: SIM110, numba has no generators here
            if not least[p] <= order[p] <= most[p]:
                return False
        return True

    @compiler()
    def kernel(starts: Array, weights: Array, parameters: Any, least: Array, most: Array,
               h: float, longest: int, hold: int, formed: NDArray[np.int64]) -> None:
        cosines, order = np.empty(m), np.empty(m)
        pull = np.empty((n, 3))
        for start in range(len(starts)):
            gamma = starts[start]
            since = NEVER
            step = 0
            while True:
                pair = 0
                pull[:] = 0.0
                near = True
                for i in range(n):
                    for j in range(i + 1, n):
                        edge = weights[i, j] != 0.0 or weights[j, i] != 0.0
                        # Far from its shape, a start is told by its first pairs.
                        if edge or near:
                            c = (gamma[i, 0] * gamma[j, 0] + gamma[i, 1] * gamma[j, 1]
                                 + gamma[i, 2] * gamma[j, 2])
                            cosines[pair] = c
                            if labelled:
                                near = near and least[pair] <= c <= most[pair]
                        pair += 1
                        if edge:
                            f = of_cosine(parameters, c)
                            there, back = weights[i, j] * f, weights[j, i] * f
                            for a in range(3):
                                pull[i, a] += there * gamma[j, a]
                                pull[j, a] += back * gamma[i, a]
                if near and (labelled or has_formed(cosines, least, most, order)):
                    if since == NEVER:
                        since = step
                    if step - since >= hold:
                        break
                else:
                    since = NEVER
                if step == longest:
                    break
                step += 1
                for i in range(n):
                    along = (gamma[i, 0] * pull[i, 0] + gamma[i, 1] * pull[i, 1]
                             + gamma[i, 2] * pull[i, 2])
                    square = 0.0
                    for a in range(3):
                        pull[i, a] = h * (along * gamma[i, a] - pull[i, a])
                        square += pull[i, a] * pull[i, a]
                    if square < 0.01:  # so that the series are exact to rounding
                        cosine = 1.0 - square / 2.0 * (1.0 - square / 12.0 * (
                            1.0 - square / 30.0 * (1.0 - square / 56.0)))
                        sinc = 1.0 - square / 6.0 * (1.0 - square / 20.0 * (
                            1.0 - square / 42.0 * (1.0 - square / 72.0)))
                    else:
                        angle = math.sqrt(square)
                        cosine, sinc = math.cos(angle), math.sin(angle) / angle
                    for a in range(3):
                        gamma[i, a] = cosine * gamma[i, a] + sinc * pull[i, a]
            formed[start] = since

    return kernel
