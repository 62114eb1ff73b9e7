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
What sampling, delay and noise do to a formation: limits, rates, the error that remains.

Commands are held over a step of length h and answer measurements that are d whole steps old. At
rest, an eigenvalue lambda of the continuous loop then obeys ``z^(d+1) = z^d + h lambda``, and all
limits have a closed form. A spinning formation has another relative equilibrium under sampling
than without, so there the loop's own one is found and linearised: :class:`SampledEquilibrium`.
"""

from collections.abc import Callable
from dataclasses import dataclass
import math

import numpy as np
from numpy.typing import ArrayLike
from tetra_ros2.formation import law, measures, rotation, sphere
from tetra_ros2.formation._types import Array, Spectrum
from tetra_ros2.formation.gain import Gain
from tetra_ros2.formation.stability import (
    complement,
    RelativeEquilibrium,
    tangent_basis,
    transverse,
)

STEP = 1e-5
"""Of central differences: their error of 1e-10 is far below what decides about stability."""

NEUTRAL = 1e-6
"""How far from 1 a Floquet multiplier may be that belongs to a continuum of equilibria."""

AXIS = np.array([1.0, 0.0, 0.0])
"""The pointing axis in the body frames used here; the motion of Gamma does not depend on it."""


def max_sample_time_at_rest(eigenvalues: ArrayLike) -> float:
    """
    Return below which h [s] every ``|1 + h lambda| < 1``, at rest: ``min -2 Re / |lambda|^2``.

    For real eigenvalues that is ``2 / |lambda|max``.

    :param eigenvalues: transverse ones, all with a negative real part [1/s]
    """
    values = np.asarray(eigenvalues)
    return float(np.min(-2.0 * values.real / np.abs(values) ** 2))


def max_delay_at_rest(eigenvalues: ArrayLike) -> float:
    """
    Return the delay [s] that continuous commands can bear: ``min (|arg| - pi/2) / |lambda|``.

    For real eigenvalues that is ``pi / (2 |lambda|max)``.

    :param eigenvalues: transverse ones, all with a negative real part [1/s]
    """
    values = np.asarray(eigenvalues)
    angle = np.abs(np.angle(values)) - 0.5 * np.pi
    return float(np.min(angle / np.abs(values)))


def max_delay_steps_at_rest(eigenvalues: ArrayLike, h: float) -> int:
    """
    Return the greatest number of whole steps that measurements may be late, at rest.

    ``z^(d+1) = z^d + h lambda`` has a root on the unit circle, ``z = exp(i a)``, exactly where
    ``|h lambda| = 2 sin(a / 2)`` and ``|arg lambda| = pi / 2 + a (d + 1/2)``.

    :param eigenvalues: transverse ones, all with a negative real part [1/s]
    :param h: the sample time [s]
    :returns: the number of steps; -1 if not even 0 is stable
    """
    if h >= max_sample_time_at_rest(eigenvalues):
        return -1
    values = np.asarray(eigenvalues)
    angle = np.abs(np.angle(values)) - 0.5 * np.pi
    turn = 2.0 * np.arcsin(0.5 * h * np.abs(values))
    # On the circle itself nothing decays: strictly less.
    return math.ceil(float(np.min(angle / turn)) - 0.5) - 1


def floquet_multipliers_at_rest(eigenvalues: ArrayLike, h: float,
                                delay_steps: int) -> Spectrum:
    """
    Return the slowest root of ``z^(d+1) = z^d + h lambda`` for each lambda, at rest.

    :param eigenvalues: transverse ones [1/s], ``(m,)``
    :param h: the sample time [s]
    :param delay_steps: d
    """
    slowest = []
    for eigenvalue in np.unique(np.round(np.asarray(eigenvalues), 12)):
        coefficients = np.zeros(delay_steps + 2, dtype=complex)
        coefficients[0] = 1.0
        coefficients[1] -= 1.0
        coefficients[-1] -= h * eigenvalue
        roots = np.roots(coefficients)
        slowest.append(roots[np.argmax(np.abs(roots))])
    return np.array(slowest)


@dataclass(frozen=True, eq=False)
class SampledEquilibrium:
    """
    A relative equilibrium of the sampled loop and its linearisation ``x+ = A x + L x_(-d)``.

    x are small rotations of each body in a frame that moves along with it, 3 n numbers.

    :param attitudes: unit quaternions at one instant, ``(n, 4)``
    :param spin: angular velocity of the whole [rad/s], ``(3,)``
    :param residual: how far one step of the loop is from a rotation of the whole [rad]
    :param h: the sample time [s]
    :param delay_steps: d, how old the measurements are
    :param at_once: A, ``(3 n, 3 n)``
    :param late: L, ``(3 n, 3 n)``
    :param noise: covariance of what a measurement noise of 1 rad adds to x, ``(3 n, 3 n)``
    """

    attitudes: Array
    spin: Array
    residual: float
    h: float
    delay_steps: int
    at_once: Array
    late: Array
    noise: Array

    @property
    def gamma(self) -> Array:
        """Return the reduced attitudes, ``(n, 3)``."""
        return rotation.rotate(self.attitudes, AXIS)

    def _history_matrix(self) -> tuple[Array, Array]:
        """Return the matrix that takes (x_k, ..., x_(k-d)) one step on, less the symmetries."""
        m, d = len(self.at_once), self.delay_steps
        matrix = np.zeros((m * (d + 1), m * (d + 1)))
        matrix[:m, :m] = self.at_once
        matrix[:m, m * d:] += self.late
        matrix[m:, :-m] = np.eye(m * d)
        # The whole may be turned, and each body about its own axis, once and for all: 3 + n
        # directions that change nothing. They are an invariant subspace; this is the quotient.
        n = len(self.attitudes)
        inverse = rotation.inverse(self.attitudes)
        turned = np.concatenate([
            rotation.rotate(inverse[:, None, :], rotation.rotate(
                rotation.exp(self.h * back * self.spin), np.eye(3))).transpose(0, 2, 1)
            .reshape(m, 3) for back in range(d + 1)])
        own = np.zeros((n, 3, n))
        own[np.arange(n), :, np.arange(n)] = AXIS
        symmetries = np.concatenate([turned, np.tile(own.reshape(m, n), (d + 1, 1))], axis=1)
        across = complement(symmetries)
        return across.T @ matrix @ across, across

    def floquet_multipliers(self) -> Spectrum:
        """Return by what each mode of the shape is multiplied in a step, the slowest first."""
        values = np.linalg.eigvals(self._history_matrix()[0])
        return values[np.argsort(-np.abs(values))]

    def is_stable(self, neutral: float = 0.0) -> bool:
        """
        Return whether this is an equilibrium and every deviation from its shape decays.

        :param neutral: how much a Floquet multiplier may exceed 1
        """
        largest = float(np.abs(self.floquet_multipliers()[0]))
        return self.residual < 1e-9 and largest < 1.0 + neutral

    def unstable_modes(self) -> int:
        """
        Return how many modes of the shape grow, by the argument principle.

        ``det(z - A - L z^-d)`` over the unit circle, divided by its 3 + n zeros that belong to
        the symmetries, tells the number of zeros outside. That takes matrices of 3 n rows where
        the eigenvalues of the whole history would take 3 n (d + 1).
        """
        m, n = len(self.at_once), len(self.attitudes)
        whole = self.h * float(np.linalg.norm(self.spin))

        def phase(phi: Array) -> Spectrum:
            z = np.exp(1j * phi)
            late = z[:, None, None] ** -self.delay_steps * self.late
            sign = np.linalg.slogdet(z[:, None, None] * np.eye(m) - self.at_once - late)[0]
            known = (z - 1.0) ** (n + 1) * (z - np.exp(1j * whole)) * (z - np.exp(-1j * whole))
            result: Spectrum = sign / (known / np.abs(known))
            return result

        # All that happens does so at angles about h lambda. The function is real at 0 and at pi.
        scale = min(1.0, float(np.max(np.abs(self.late))))
        phi = np.unique(np.concatenate([
            np.linspace(1e-3 * scale, min(math.pi, 12.0 * scale), 3000),
            np.geomspace(min(math.pi, 12.0 * scale), math.pi, 100)]))
        values = phase(phi)
        while True:
            jumps = np.angle(values[1:] / values[:-1])
            wide = (np.abs(jumps) > 0.5) & (np.diff(phi) > 1e-9 * scale)
            if not np.any(wide):
                break
            between = 0.5 * (phi[1:] + phi[:-1])[wide]
            order = np.argsort(np.concatenate([phi, between]), kind='stable')
            phi = np.concatenate([phi, between])[order]
            values = np.concatenate([values, phase(between)])[order]
        return m - (n + 3) - round(float(np.sum(jumps)) / math.pi)

    def steady_angles(self, sigma: float, draws: int = 20000, seed: int = 0
                      ) -> tuple[Array, float]:
        """
        Return what measurement noise leaves of the angles, once the start is forgotten.

        :param sigma: standard deviation of the direction measured, per axis [rad]
        :param draws: of the Gaussian whose largest component is asked for
        :param seed: of these draws
        :returns: the standard deviation of the pairwise angles [rad], ``(m,)``, and the mean of
            the largest deviation among them [rad]
        """
        matrix, across = self._history_matrix()
        m = len(self.at_once)
        power = across.T[:, :m] @ (sigma**2 * self.noise) @ across[:m]
        # The sum of A^k Q A^kT, doubling the number of its terms each time.
        covariance = power
        while np.max(np.abs(power)) > 1e-16 * np.max(np.abs(covariance)):
            power = matrix @ covariance @ matrix.T
            covariance = covariance + power
            matrix = matrix @ matrix
        attitude_covariance = across[:m] @ covariance @ across[:m].T

        gamma = self.gamma
        i, j = np.triu_indices(len(gamma), k=1)
        aligned = np.sum(gamma[i] * gamma[j], axis=1)
        bases = tangent_basis(gamma)[i]

        def deviations(x: Array) -> Array:
            """Return two numbers for each pair, the norm of which is what its angle is off."""
            moved = rotation.rotate(rotation.multiply(
                self.attitudes, rotation.exp(x.reshape(-1, m // 3, 3))), AXIS)
            angle = sphere.geodesic_distance(moved[:, i], moved[:, j])
            # At 0 and at pi an angle can only go one way: there it takes the two components.
            apart = np.einsum('pac,kpa->kpc', bases,
                              moved[:, j] - np.sign(aligned)[:, None] * moved[:, i])
            plain = np.stack([angle, np.zeros_like(angle)], axis=-1)
            straight = np.abs(aligned) > 1.0 - 1e-9
            return np.where(straight[:, None], apart, plain).reshape(len(x), -1)

        slope = _derivative(deviations, np.zeros(m))
        values, vectors = np.linalg.eigh(slope @ attitude_covariance @ slope.T)
        normal = np.random.default_rng(seed).standard_normal((draws, len(values)))
        drawn = normal * np.sqrt(np.maximum(values, 0.0)) @ vectors.T
        size = np.linalg.norm(drawn.reshape(draws, -1, 2), axis=-1)
        spread = np.diag(slope @ attitude_covariance @ slope.T).reshape(-1, 2).sum(axis=1)
        return np.sqrt(spread), float(np.mean(np.max(size, axis=1)))


def _derivative(function: Callable[[Array], Array], x: Array) -> Array:
    """Return the matrix of central differences of a function of arrays ``(k, m)``."""
    change = STEP * np.eye(len(x))
    result: Array = (function(x + change) - function(x - change)).T / (2.0 * STEP)
    return result


def _commands(attitudes: Array, weights: Array, gain: Gain) -> Array:
    gamma = rotation.rotate(attitudes, AXIS)
    seen = rotation.rotate(rotation.inverse(attitudes)[..., :, None, :], gamma[..., None, :, :])
    return law.angular_velocity(AXIS, seen, weights, gain)


def sampled_equilibrium(gamma: ArrayLike, weights: Array, gain: Gain, h: float,
                        delay_steps: int = 0,
                        near: SampledEquilibrium | None = None) -> SampledEquilibrium:
    """
    Return the relative equilibrium of the sampled loop near one of the continuous loop.

    In it, ``R_i(k) = Q^k R_i G_i^k``: the whole turns by Q and each body about its own axis by
    G_i in a step. A command that is d steps old was meant for a body not yet turned by G_i^d.

    :param gamma: reduced attitudes of the continuous loop's relative equilibrium, ``(n, 3)``
    :param weights: ``(n, n)``
    :param gain: a :class:`~tetra_ros2.formation.gain.Gain`
    :param h: the sample time [s]
    :param delay_steps: how old the measurements are
    :param near: a :class:`SampledEquilibrium` to start the search from instead
    """
    gamma = np.asarray(gamma, dtype=float)
    n = len(gamma)
    if near is None:
        base = rotation.between(AXIS, gamma)
        spin = measures.angular_velocity(gamma, law.velocity(gamma, weights, gain))
    else:
        base, spin, gamma = near.attitudes, near.spin, near.gamma

    def advance(frames: Array, x: Array, rates: Array, spin: Array, own: Array) -> Array:
        """Return where the bodies are a step later, in the frames that have moved along."""
        backward = rotation.multiply(rotation.inverse(frames), rotation.multiply(
            rotation.exp(-h * spin)[..., None, :], frames))
        late = rotation.rotate(rotation.exp(delay_steps * own[..., None] * AXIS), rates)
        moved = rotation.multiply(rotation.exp(x), rotation.exp(h * late))
        moved = rotation.multiply(moved, rotation.exp(-own[..., None] * AXIS))
        return rotation.log(rotation.multiply(backward, moved)).reshape(*x.shape[:-2], 3 * n)

    def residual(z: Array) -> Array:
        x, spin, own = z[..., :3 * n], z[..., 3 * n:3 * n + 3], z[..., 3 * n + 3:]
        frames = rotation.multiply(base, rotation.exp(x.reshape(*x.shape[:-1], n, 3)))
        rates = _commands(frames, weights, gain)
        return advance(frames, np.zeros((*x.shape[:-1], n, 3)), rates, spin, own)

    z = np.concatenate([np.zeros(3 * n), spin, -h * (gamma @ spin)])
    for _ in range(12):
        left = residual(z)
        if np.max(np.abs(left)) < 1e-13:
            break
        z = z - np.linalg.pinv(_derivative(residual, z), rcond=1e-8) @ left
    spin, own = z[3 * n:3 * n + 3], z[3 * n + 3:]
    frames = rotation.renormalize(
        rotation.multiply(base, rotation.exp(z[:3 * n].reshape(n, 3))))
    rates = _commands(frames, weights, gain)
    zero = np.zeros(3 * n)

    at_once = _derivative(
        lambda x: advance(frames, x.reshape(-1, n, 3), rates, spin, own), zero)
    by_rates = _derivative(
        lambda u: advance(frames, np.zeros((len(u), n, 3)), u.reshape(-1, n, 3), spin, own),
        rates.ravel())
    commanded = _derivative(lambda x: _commands(
        rotation.multiply(frames, rotation.exp(x.reshape(-1, n, 3))), weights, gain)
        .reshape(-1, 3 * n), zero)
    noise = by_rates @ _command_noise(frames, weights, gain) @ by_rates.T
    return SampledEquilibrium(
        frames, spin, float(np.max(np.abs(residual(z)))), h, delay_steps,
        at_once, by_rates @ commanded, noise)


def _command_noise(attitudes: Array, weights: ArrayLike, gain: Gain) -> Array:
    """Return the covariance of all commands under a measurement noise of 1 rad, (3 n, 3 n)."""
    n = len(attitudes)
    gamma = rotation.rotate(attitudes, AXIS)
    seen = rotation.rotate(rotation.inverse(attitudes)[:, None, :], gamma[None, :, :])
    cross = np.cross(AXIS, seen)
    theta = sphere.geodesic_distance(AXIS, seen)
    sine = np.sin(theta)
    slope = np.divide(gain.derivative(theta), sine, out=np.zeros_like(sine), where=sine > 1e-9)
    # w = -W f(theta) b x y, and theta falls by b . dy / sin(theta) along a tangent dy.
    change = -np.asarray(weights)[..., None, None] * (
        gain.f(theta)[..., None, None] * sphere.hat(AXIS)
        - slope[..., None, None] * cross[..., :, None] * AXIS)
    tangent = np.eye(3) - seen[..., :, None] * seen[..., None, :]
    covariance = np.zeros((n, 3, n, 3))
    covariance[np.arange(n), :, np.arange(n), :] = np.sum(
        change @ tangent @ np.swapaxes(change, -1, -2), axis=1)
    return covariance.reshape(3 * n, 3 * n)


def _stable(gamma: Array, weights: Array, gain: Gain) -> RelativeEquilibrium:
    there = transverse(gamma, weights, gain)
    if there.inertia[0] or not len(there.decaying):
        raise ValueError('this relative equilibrium is not stable even without sampling')
    return there


def max_sample_time(gamma: Array, weights: Array, gain: Gain,
                    relative: float = 1e-6) -> float:
    """
    Return below which sample time [s] a formation is stable, at rest or spinning.

    :param gamma: reduced attitudes of a stable relative equilibrium of the continuous loop,
        ``(n, 3)``
    :param weights: ``(n, n)``
    :param gain: a :class:`~tetra_ros2.formation.gain.Gain`
    :param relative: accuracy, where it spins; at rest there is a closed form
    :raises ValueError: if it is not stable even without sampling
    """
    there = _stable(gamma, weights, gain)
    guess = max_sample_time_at_rest(there.decaying)
    if not there.spins:
        return guess
    neutral = 0.0 if there.is_hyperbolic else NEUTRAL
    inside, outside, near = 0.0, math.inf, None
    h = 0.05 * guess
    while (outside == math.inf or outside - inside > relative * outside) and h > 1e-9 * guess:
        sampled = sampled_equilibrium(gamma, weights, gain, h, near=near)
        if sampled.is_stable(neutral):
            inside, near = h, sampled
            h = 0.5 * (inside + outside) if outside < math.inf else h + 0.05 * guess
        else:
            outside = h
            h = 0.5 * (inside + outside)
    return inside


def max_delay(gamma: Array, weights: Array, gain: Gain) -> float:
    """
    Return the delay [s] below which a formation is stable with continuous commands.

    Where it spins the answer is that of a loop sampled 500 times as fast, good to 0.2 %; at rest
    there is a closed form. The parameters are those of :func:`max_sample_time`.
    """
    there = _stable(gamma, weights, gain)
    guess = max_delay_at_rest(there.decaying)
    if not there.spins:
        return guess
    fine = guess / 500.0
    return (_max_delay_steps_spinning(gamma, weights, gain, fine, 500) + 0.5) * fine


def max_delay_steps(gamma: Array, weights: Array, gain: Gain, h: float) -> int:
    """
    Return the greatest number of whole steps that measurements may be late.

    :param h: the sample time [s]
    :returns: the number of steps; -1 if not even 0 is stable

    The other parameters are those of :func:`max_sample_time`.
    """
    there = _stable(gamma, weights, gain)
    if not there.spins:
        return max_delay_steps_at_rest(there.decaying, h)
    guess = max(1, int(max_delay_at_rest(there.decaying) / h))
    return _max_delay_steps_spinning(gamma, weights, gain, h, guess)


def delayed_equilibrium(gamma: Array, weights: Array, gain: Gain, h: float, delay_steps: int,
                        near: SampledEquilibrium | None = None) -> SampledEquilibrium:
    """
    Return the relative equilibrium of a late loop that continues the one without delay.

    :param near: one of a shorter delay to continue from

    The other parameters are those of :func:`sampled_equilibrium`.
    """
    if near is None:
        near = sampled_equilibrium(gamma, weights, gain, h)
    # It is followed in steps, lest another one be found.
    stride = max(1, delay_steps // 4)
    for d in (*range(near.delay_steps + stride, delay_steps, stride), delay_steps):
        if d > near.delay_steps:
            near = sampled_equilibrium(gamma, weights, gain, h, d, near)
    return near


def _max_delay_steps_spinning(gamma: Array, weights: Array, gain: Gain, h: float,
                              guess: int) -> int:
    def at(steps: int, near: SampledEquilibrium | None) -> SampledEquilibrium | None:
        """Return the equilibrium there if it is stable."""
        there = delayed_equilibrium(gamma, weights, gain, h, steps, near)
        return there if there.residual < 1e-9 and there.unstable_modes() == 0 else None

    inside = at(0, None)
    if inside is None:
        return -1
    outside = max(1, guess)
    while (further := at(outside, inside)) is not None:
        inside, outside = further, 2 * outside
    while outside - inside.delay_steps > 1:
        middle = (inside.delay_steps + outside) // 2
        there = at(middle, inside)
        if there is None:
            outside = middle
        else:
            inside = there
    return inside.delay_steps
