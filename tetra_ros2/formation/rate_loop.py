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
What a rate loop does to a formation: bodies that take time to turn as they are told.

A rate loop of bandwidth k between command and torque makes ``dw/dt = k (u - w)`` of a body with
angular velocity w under the command u, once it makes up for the gyroscopic torque. On the sphere
that is ``D(dGamma/dt)/dt = k (v(Gamma) - dGamma/dt)``, with the covariant derivative D and the
velocity v of the law: whether wheels turn the body or a gimbal.

At rest an eigenvalue lambda of the law becomes the two roots of ``s^2 + k s - k lambda = 0``. A
spinning formation is another matter: that it turns takes torque, torque takes a difference
between w and u, and so the shape itself shifts by about ``|W|^2 / k``. The eigenvalues of the
law at the unshifted shape say little about k; here the loop's own relative equilibrium is found
and linearised, with commands held over a step, late or not.
"""

from collections.abc import Callable
from dataclasses import dataclass
import math

import numpy as np
from numpy.typing import ArrayLike, NDArray
from tetra_ros2.formation import law, measures, rotation
from tetra_ros2.formation.gain import Gain
from tetra_ros2.formation.stability import complement, transverse

Array = NDArray[np.float64]

AXIS = np.array([1.0, 0.0, 0.0])
"""The pointing axis in the body frames used here; the motion of Gamma does not depend on it."""

STEP = 1e-5
"""Of central differences: their error of 1e-10 is far below what decides about stability."""

RESIDUAL = 1e-9
"""What may be left of a step at an equilibrium, in rad and rad/s."""

SLOWEST = 1e-3
"""A bandwidth below this, relative to the law's slowest rate, is none at all."""


def eigenvalues_at_rest(eigenvalues: ArrayLike, bandwidth: float) -> NDArray[np.complex128]:
    """
    Return the roots of ``s^2 + k s - k lambda = 0`` [1/s], ``(2 m,)``: without hold and delay.

    Real, negative lambda give two stable roots whatever k: a formation of symmetric weights at
    rest has no threshold.

    :param eigenvalues: of the law alone [1/s], ``(m,)``
    :param bandwidth: k [1/s]
    """
    values = np.asarray(eigenvalues, dtype=complex)
    root = np.sqrt(bandwidth * (bandwidth + 4.0 * values))
    # The product of the two is -k lambda; the sum of numbers of opposite signs is avoided.
    large = -0.5 * (bandwidth + np.where(root.real < 0.0, -root, root))
    return np.concatenate([large, -bandwidth * values / large])


def acceleration_bound(weights: ArrayLike, gain: Gain) -> float:
    """
    Return an angular acceleration that the law never asks of a body [rad/s^2].

    With limited torque a rate loop makes ``dw/dt = s k (u - w)``, where s in (0, 1] shrinks the
    torque and keeps its direction. So ``|w_i|`` never grows beyond the largest command V_i. The
    command then changes by no more than this bound, the sum over j of ``|W_ij| B (V_i + V_j)``,
    where B is the largest of f and ``|d(f sin)/dtheta|``. If the torque can do more than that, the
    difference between u and w shrinks while it is saturated: from rest a body is so once, for
    ``V_i`` over the difference of the two at most, and never again.

    :param weights: ``(n, n)``
    :param gain: the gain
    """
    theta = np.linspace(0.0, np.pi, 4001)
    f, sine, cosine = gain.f(theta), np.sin(theta), np.cos(theta)
    # At the ends the derivative of f may be infinite, while its product with the sine is not.
    slope = gain.derivative(theta[1:-1]) * sine[1:-1] + f[1:-1] * cosine[1:-1]
    steepest = max(float(np.max(f)), float(np.max(np.abs(slope))))
    size = np.abs(np.asarray(weights, dtype=float))
    fastest = np.sum(size, axis=1) * np.max(f * sine)
    return float(np.max(steepest * np.sum(size * (fastest[:, None] + fastest), axis=1)))


@dataclass(frozen=True, eq=False)
class RateLoopEquilibrium:
    """
    A relative equilibrium of bodies with a rate loop, and its linearisation.

    :param attitudes: unit quaternions at one instant, ``(n, 4)``, for bodies with the axis AXIS
    :param spin: angular velocity of the whole [rad/s], ``(3,)``
    :param rates: angular velocities of the bodies in their frames, y and z [rad/s], ``(n, 2)``
    :param residual: how far it is from a relative equilibrium [rad and rad/s]
    :param bandwidth: k [1/s]
    :param h: the sample time [s], 0 for commands that change all the time
    :param delay_steps: how old the measurements are
    :param matrix: what takes the state, less the symmetries, a step on; for ``h = 0`` that of
        ``dx/dt = A x``
    """

    attitudes: Array
    spin: Array
    rates: Array
    residual: float
    bandwidth: float
    h: float
    delay_steps: int
    matrix: Array

    @property
    def gamma(self) -> Array:
        """Return the reduced attitudes, ``(n, 3)``."""
        return rotation.rotate(self.attitudes, AXIS)

    @property
    def eigenvalues(self) -> NDArray[np.complex128]:
        """Return the eigenvalues of the shape [1/s], the slowest first."""
        values = np.linalg.eigvals(self.matrix).astype(complex)
        if self.h:
            values = np.log(np.where(values == 0.0, 1e-300, values)) / self.h
        return values[np.argsort(-values.real)]

    @property
    def slowest_rate(self) -> float:
        """Return how fast the slowest mode decays [1/s]; negative if it grows."""
        return float(-self.eigenvalues[0].real)

    def is_stable(self) -> bool:
        """Return whether this is an equilibrium, and every mode of the shape decays."""
        return self.residual < RESIDUAL and self.slowest_rate > 0.0

    @property
    def angular_acceleration(self) -> float:
        """
        Return the largest angular acceleration that the spin asks of a body [rad/s^2].

        The body rate of constant size turns about the pointing axis, in the body, at
        ``W . Gamma``. The torque is the inertia times that.
        """
        along = np.abs(self.gamma @ self.spin)
        return float(np.max(along * np.linalg.norm(self.rates, axis=-1)))


def _derivative(function: Callable[[Array], Array], x: Array) -> Array:
    """Return the matrix of central differences of a function of arrays ``(k, m)``."""
    change = STEP * np.eye(len(x))
    matrix: Array = (function(x + change) - function(x - change)).T / (2.0 * STEP)
    return matrix


def _commands(attitudes: Array, weights: Array, gain: Gain) -> Array:
    """Return what the law commands, y and z in the body frames, ``(..., n, 2)``."""
    gamma = rotation.rotate(attitudes, AXIS)
    seen = rotation.rotate(rotation.inverse(attitudes)[..., :, None, :], gamma[..., None, :, :])
    rates: Array = law.angular_velocity(AXIS, seen, weights, gain)
    return rates[..., 1:]


def _turned(rates: Array, angle: Array) -> Array:
    """Turn rates ``(..., n, 2)`` about the pointing axes through angles ``(..., n)``."""
    c, s = np.cos(angle), np.sin(angle)
    y, z = rates[..., 0], rates[..., 1]
    return np.stack([c * y - s * z, s * y + c * z], axis=-1)


def _whole(rates: Array) -> Array:
    """Return rates as vectors, ``(..., 3)``."""
    return np.concatenate([np.zeros((*rates.shape[:-1], 1)), rates], axis=-1)


def turn(attitudes: Array, rates: Array, commands: ArrayLike, bandwidth: float,
         h: float) -> tuple[Array, Array]:
    """
    Turn bodies for a time h under commands held constant.

    The rates have an exact solution; the attitudes follow by Magnus' expansion of fourth order,
    in steps short for the bandwidth.

    :param attitudes: unit quaternions, body to world, ``(..., n, 4)``
    :param rates: angular velocities in the body frames, y and z [rad/s], ``(..., n, 2)``
    :param commands: what is to become of them, ``(..., n, 2)``
    :param bandwidth: k [1/s]
    :param h: the time [s]
    :returns: attitudes and rates after that
    """
    commands = np.asarray(commands, dtype=float)
    count = max(1, math.ceil(4.0 * h * min(bandwidth, 40.0 / h)))
    dt = h / count
    full = math.exp(-bandwidth * dt)
    mean = -math.expm1(-bandwidth * dt) / (bandwidth * dt)
    for _ in range(count):
        left = rates - commands
        after = commands + full * left
        average = commands + mean * left
        # The commutator of w early and late, which differ along `left`: about the pointing axis.
        twist = (commands[..., 0] * left[..., 1] - commands[..., 1] * left[..., 0]) * (
            (full - 1.0) * dt * dt / 8.0)
        angle = np.concatenate([(twist * (2.0 / 3.0))[..., None], dt * average], axis=-1)
        attitudes = rotation.multiply(attitudes, rotation.exp(angle))
        rates = after
    return attitudes, rates


def rate_loop_equilibrium(gamma: ArrayLike, weights: Array, gain: Gain, bandwidth: float, *,
                          h: float = 0.0, delay_steps: int = 0,
                          near: RateLoopEquilibrium | None = None) -> RateLoopEquilibrium:
    """
    Return the relative equilibrium that a rate loop makes of one of the law.

    In it ``R_i(t) = exp(t W^) R_i exp(t r_i b^)``: the whole turns at W, and each body rolls
    about its own axis at r_i against it, since no command ever turns it about that.

    :param gamma: reduced attitudes of the law's relative equilibrium, ``(n, 3)``
    :param weights: ``(n, n)``
    :param gain: the gain
    :param bandwidth: k [1/s]
    :param h: the sample time [s], 0 for commands that change all the time
    :param delay_steps: how old the measurements are, in steps
    :param near: another one to start the search from
    """
    gamma = np.asarray(gamma, dtype=float)
    n = len(gamma)
    period = h or 1.0
    if near is None:
        base = rotation.between(AXIS, gamma)
        spin = measures.angular_velocity(gamma, law.velocity(gamma, weights, gain))
        rates = _commands(base, weights, gain)
    else:
        base, spin, rates, gamma = near.attitudes, near.spin, near.rates, near.gamma

    def advance(frames: Array, x: Array, rates: Array, commands: Array, spin: Array,
                roll: Array) -> Array:
        """Return where x and the rates are a step later, or how they change if h is 0."""
        bodies = rotation.multiply(frames, rotation.exp(x))
        if not h:
            against = rotation.rotate(rotation.inverse(bodies), spin[..., None, :])
            moved = _whole(rates) - roll[..., None] * AXIS - against
            turning = np.stack([-rates[..., 1], rates[..., 0]], axis=-1)
            changed = roll[..., None] * turning + bandwidth * (commands - rates)
        else:
            late = _turned(commands, delay_steps * h * roll)
            moved, changed = turn(rotation.exp(x), rates, late, bandwidth, h)
            backward = rotation.multiply(rotation.inverse(frames), rotation.multiply(
                rotation.exp(-h * spin)[..., None, :], frames))
            moved = rotation.multiply(moved, rotation.exp(-h * roll[..., None] * AXIS))
            moved = rotation.log(rotation.multiply(backward, moved))
            changed = _turned(changed, h * roll)
        return np.concatenate([moved.reshape(*x.shape[:-2], 3 * n),
                               changed.reshape(*x.shape[:-2], 2 * n)], axis=-1)

    def residual(z: Array) -> Array:
        lead = z.shape[:-1]
        x, w = z[..., :3 * n].reshape(*lead, n, 3), z[..., 3 * n:5 * n].reshape(*lead, n, 2)
        spin, roll = z[..., 5 * n:5 * n + 3], z[..., 5 * n + 3:]
        frames = rotation.multiply(base, rotation.exp(x))
        commands = _commands(frames, weights, gain)
        after = advance(frames, np.zeros_like(x), w, commands, spin, roll)
        if h:
            after[..., 3 * n:] -= z[..., 3 * n:5 * n]
        return after

    z = np.concatenate([np.zeros(3 * n), rates.ravel(), spin, -(gamma @ spin)])
    for _ in range(12):
        left = residual(z)
        if np.max(np.abs(left)) < 1e-13 * max(1.0, bandwidth * period):
            break
        z = z - np.linalg.pinv(_derivative(residual, z), rcond=1e-9) @ left
    spin, roll = z[5 * n:5 * n + 3], z[5 * n + 3:]
    rates = z[3 * n:5 * n].reshape(n, 2)
    frames = rotation.renormalize(
        rotation.multiply(base, rotation.exp(z[:3 * n].reshape(n, 3))))
    commands = _commands(frames, weights, gain)

    def by_state(state: Array) -> Array:
        return advance(frames, state[..., :3 * n].reshape(-1, n, 3),
                       state[..., 3 * n:].reshape(-1, n, 2), commands, spin, roll)

    def by_commands(u: Array) -> Array:
        return advance(frames, np.zeros((len(u), n, 3)), np.broadcast_to(rates, (len(u), n, 2)),
                       u.reshape(-1, n, 2), spin, roll)

    at_once = _derivative(by_state, np.concatenate([np.zeros(3 * n), rates.ravel()]))
    commanded = _derivative(lambda x: _commands(
        rotation.multiply(frames, rotation.exp(x.reshape(-1, n, 3))), weights, gain)
        .reshape(-1, 2 * n), np.zeros(3 * n))
    late_part = _derivative(by_commands, commands.ravel()) @ commanded
    matrix = _history(at_once, late_part, delay_steps)
    across = complement(_symmetries(frames, rates, spin, h, delay_steps))
    left = residual(z)
    return RateLoopEquilibrium(
        frames, spin, rates, float(np.max(np.abs(left)) / max(1.0, bandwidth * period)),
        bandwidth, h, delay_steps, across.T @ matrix @ across)


def _history(at_once: Array, late: Array, delay_steps: int) -> Array:
    """Return what takes (x, w, x a step ago, ...) a step on; the commands answer an old x."""
    m, k = len(at_once), late.shape[1]
    matrix = np.zeros((m + k * delay_steps,) * 2)
    matrix[:m, :m] = at_once
    if not delay_steps:
        matrix[:m, :k] += late
        return matrix
    matrix[:m, -k:] += late
    matrix[m:m + k, :k] = np.eye(k)
    matrix[m + k:, m:-k] = np.eye(k * (delay_steps - 1))
    return matrix


def _symmetries(frames: Array, rates: Array, spin: Array, h: float, delay_steps: int) -> Array:
    """Return the states that are the same formation: turned as a whole, bodies rolled."""
    n = len(frames)
    inverse = rotation.inverse(frames)

    def turned(back: int) -> Array:
        axes = rotation.rotate(rotation.exp(h * back * spin), np.eye(3))
        whole: Array = rotation.rotate(inverse[:, None, :], axes)
        columns: Array = whole.transpose(0, 2, 1).reshape(3 * n, 3)
        return columns

    own = np.zeros((n, 3, n))
    own[np.arange(n), :, np.arange(n)] = AXIS
    own_rates = np.zeros((n, 2, n))
    own_rates[np.arange(n), :, np.arange(n)] = np.stack([rates[:, 1], -rates[:, 0]], axis=-1)
    rolled = own.reshape(3 * n, n)
    now = np.concatenate([np.concatenate([turned(0), rolled], axis=1),
                          np.concatenate([np.zeros((2 * n, 3)), own_rates.reshape(2 * n, n)],
                                         axis=1)])
    before = [np.concatenate([turned(back), rolled], axis=1)
              for back in range(1, delay_steps + 1)]
    return np.concatenate([now, *before])


def min_bandwidth(gamma: ArrayLike, weights: Array, gain: Gain, *, h: float = 0.0,
                  delay_steps: int = 0, accuracy: float = 1e-4) -> float:
    """
    Return above which bandwidth of the rate loops a formation is stable [1/s].

    The equilibrium is followed from a fast loop down to slower ones, until it is lost or one of
    its modes grows.

    :param gamma: reduced attitudes of the law's relative equilibrium, ``(n, 3)``
    :param weights: ``(n, n)``
    :param gain: the gain
    :param h: the sample time [s], 0 for commands that change all the time
    :param delay_steps: how old the measurements are, in steps
    :param accuracy: relative
    :returns: 0 if it is stable however slow the loop; infinity if it is not however fast
    """
    gamma = np.asarray(gamma, dtype=float)
    values = transverse(gamma, weights, gain).eigenvalues
    scale = float(np.max(np.abs(values)))
    above = 100.0 * scale
    near = rate_loop_equilibrium(gamma, weights, gain, above, h=h, delay_steps=delay_steps)
    if not near.is_stable():
        return math.inf
    below, factor = None, 0.6
    while below is None or above - below > accuracy * above:
        k = factor * above if below is None else math.sqrt(above * below)
        if k < SLOWEST * float(np.min(np.abs(values.real))):
            return 0.0
        there = rate_loop_equilibrium(
            gamma, weights, gain, k, h=h, delay_steps=delay_steps, near=near)
        if there.is_stable():
            above, near = k, there
        else:
            below = k
    return above
