# Copyright 2026 The tetra_ros2 authors
# SPDX-License-Identifier: Apache-2.0

"""
Every claim of the paper, as a check that can fail.

A check is given a :class:`Subject`, the law that is to be what the paper says it is, and returns
a :class:`Finding`: what the paper predicts, what was measured, and how far apart the two may be.
Nothing is compared with a number of this package's own making: the closed forms are the
paper's, and what they are held against is computed from the law, from random points, from
simulation, or from a run of the real nodes.

To add a claim, write its check below with the decorator ``claim``.
"""

from collections.abc import Callable
from dataclasses import dataclass, field
from functools import cached_property
import itertools
import math

import numpy as np

from tetra_ros2.formation import (
    batch,
    bodies,
    controller,
    coordinates,
    law,
    measures,
    rotation,
    shapes,
    sphere,
    stability,
)
from tetra_ros2.formation import gain as gains
from tetra_ros2.formation import topology as topologies
from tetra_ros2.paper import runs
from tetra_ros2.study.confidence import lower_bound

THIRD = -1.0 / 3.0
TETRAHEDRON = shapes.TETRAHEDRON.points
RELATIVE = 1e-9
"""How well a spectrum must agree with its closed form."""


def proof_point():
    """Return the tetrahedron at which the paper linearises, ``(4, 3)``; eq:SF:proofPoint."""
    i = np.arange(4)
    return coordinates.from_angles(
        (-1.0) ** i * np.arcsin(np.sqrt(3.0) / 3.0), np.pi / 4.0 + i * np.pi / 2.0)


@dataclass(frozen=True)
class Subject:
    """
    What is put to the test.

    :param complete: the topology of Graph As:SF:completegraph
    :param rotating: that of Graph As:RF:weighedgraph with k = 1, p = 1
    :param gains: the paper's two, f1 and f2; the first is that of As:SFG:f
    :param seed: of all that is random
    :param effort: how much more than usual to do
    """

    complete: topologies.Topology = field(default_factory=topologies.complete)
    rotating: topologies.Topology = field(default_factory=topologies.rotating)
    gains: tuple = (gains.Cosine(), gains.Exponential())
    seed: int = 0
    effort: float = 1.0

    @property
    def rng(self):
        """Return a generator that is the same for every check."""
        return np.random.default_rng(self.seed)

    def times(self, count):
        """Return how many random points or starts to take, where usually one takes ``count``."""
        return max(1, round(count * self.effort))

    @cached_property
    def families(self):
        """Return the gains under test and some of the other families that satisfy As:SF:f."""
        return (*self.gains, gains.Gaussian(1.5, 0.8), gains.Linear(2.0, 0.9),
                gains.Rational(0.7, 1.3))

    @cached_property
    def _runs(self):
        return {}

    def run(self, graph, gain, seed=0):
        """Return a run of the real nodes, long enough to form and to come very close."""
        key = graph, gain, seed
        if key not in self._runs:
            quick = isinstance(gain, gains.Cosine)
            self._runs[key] = runs.run_nodes(
                getattr(self, graph), gain, 14.0 if quick else 75.0,
                rate=400.0 if quick else 100.0, seed=self.seed + seed)
        return self._runs[key]

    @cached_property
    def equilibria(self):
        """Return what Newton's method finds, complete graph and first gain; and the lost."""
        return stability.find_equilibria(
            self.rng, self.complete.weights, self.gains[0], self.times(300))


@dataclass(frozen=True)
class Finding:
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

    def __post_init__(self):
        """Turn numpy's scalars into Python's, which print and serialise as such."""
        for name in ('predicted', 'measured', 'tolerance', 'passed'):
            value = getattr(self, name)
            object.__setattr__(self, name, getattr(value, 'item', lambda value=value: value)())


def equal(predicted, measured, tolerance, note=''):
    """Return the finding that two numbers are to be the same; NaN never is."""
    passed = bool(abs(measured - predicted) <= tolerance)
    return Finding(float(predicted), float(measured), tolerance, passed, note)


def vanishes(deviation, tolerance, note=''):
    """Return the finding that a deviation, or the largest of many, is to be zero."""
    return equal(0.0, np.max(np.abs(deviation)), tolerance, note)


def negative(values, note=''):
    """Return the finding that the largest real part is to be below zero."""
    worst = float(np.max(np.real(values)))
    return Finding('< 0', worst, 0.0, worst < 0.0, note)


def same_spectrum(measured, predicted, note=''):
    """Return the finding that two sets of eigenvalues agree, relative to the largest."""
    measured, left = np.asarray(measured, complex), list(np.asarray(predicted, complex))
    scale = np.max(np.abs(left))
    worst = 0.0 if len(measured) == len(left) else math.inf
    for value in measured[:len(left)]:
        nearest = int(np.argmin([abs(value - other) for other in left]))
        worst = max(worst, abs(value - left.pop(nearest)) / scale)
    return equal(0.0, worst, RELATIVE, note)


@dataclass(frozen=True)
class Claim:
    """
    A claim of the paper.

    :param key: its name on the command line
    :param label: where it stands in the paper: a label, or a section
    :param says: what it says
    :param how: how it is checked here
    :param check: takes a :class:`Subject`, returns a :class:`Finding`
    :param nodes: whether that runs the real nodes
    """

    key: str
    label: str
    says: str
    how: str
    check: Callable
    nodes: bool = False


CLAIMS = {}


def claim(key, label, says, how, nodes=False, **fixed):
    """Register a check under a key; ``fixed`` goes to it as keyword arguments."""
    def register(check):
        if key in CLAIMS:
            raise ValueError(f'there are two claims {key}')
        CLAIMS[key] = Claim(
            key, label, says, how, lambda subject: check(subject, **fixed), nodes)
        return check
    return register


def derivative(function, x, step=4e-3):
    """Return the matrix of sixth-order central differences; exact to 1e-12 on smooth maps."""
    change = step * np.eye(len(x))
    total = 0.0
    for k, factor in ((1, 45.0), (2, -9.0), (3, 1.0)):
        total = total + factor * (function(x + k * change) - function(x - k * change))
    return total.T / (60.0 * step)


def differentiated_law(gamma, weights, gain, spin=0.0):
    """
    Return the linearisation that differences of the law itself give, ``(2 n, 2 n)``.

    That is slower and less exact than :func:`tetra_ros2.formation.stability.linearization`, and
    owes nothing to it.

    :param gamma: where, ``(n, 3)``: at rest, or at rest in a frame that turns with ``spin``
    """
    bases = stability.tangent_basis(gamma)

    def in_tangent(q):
        q = q.reshape(-1, len(gamma), 2)
        moved = sphere.exp(gamma, np.einsum('iap,kip->kia', bases, q))
        velocity = law.velocity(moved, weights, gain) - np.cross(spin, moved) \
            if np.any(spin) else law.velocity(moved, weights, gain)
        return np.einsum('iap,kia->kip', bases, velocity).reshape(len(q), -1)

    return derivative(in_tangent, np.zeros(2 * len(gamma))), bases


def transverse_spectrum(gamma, weights, gain):
    """Return the eigenvalues of :func:`differentiated_law` less those of the rotations."""
    velocity = law.velocity(gamma, weights, gain)
    spin = measures.angular_velocity(gamma, velocity)
    matrix, bases = differentiated_law(gamma, weights, gain, spin)
    across = stability.complement(stability.rotations(gamma, bases))
    return np.linalg.eigvals(across.T @ matrix @ across)


def random_tetrahedra(rng, count):
    """Return tetrahedra of both chiralities at random attitudes, ``(count, 4, 3)``."""
    turned = rotation.rotate(rotation.random(rng, (count,))[:, None, :], TETRAHEDRON)
    turned[1::2] = stability.mirrored(turned[1::2])
    return turned


# ---------------------------------------------------------------- geometry and matrices

@claim('geodesic', 'Section 2.1', 'Gamma_j = exp(theta_ij k_ij^) Gamma_i',
       'identity at random pairs')
def _geodesic(subject):
    x, y = sphere.random(subject.rng, (2, 10000))
    cross = np.cross(x, y)
    theta = np.arccos(np.clip(np.sum(x * y, axis=-1), -1.0, 1.0))
    k = cross / np.sin(theta)[:, None]
    return vanishes(rotation.rotate(rotation.exp(theta[:, None] * k), x) - y, 1e-9)


@claim('kinematics', 'eq:pre:DGamma', 'dGamma_i/dt = omega_i^ Gamma_i, and Gamma stays unit',
       'difference quotient of R b under R <- R exp(h w^), random attitudes')
def _kinematics(subject):
    rng = subject.rng
    attitudes, axis = rotation.random(rng, (1000,)), sphere.random(rng)
    w = rng.standard_normal((1000, 3))
    gamma = rotation.rotate(attitudes, axis)

    def after(h):
        return rotation.rotate(rotation.multiply(rotation.exp(h * w), attitudes), axis)

    rate = (after(1e-5) - after(-1e-5)) / 2e-5
    return vanishes(rate - np.einsum('kij,kj->ki', sphere.hat(w), gamma), 1e-8)


@claim('cosine-formula', 'Thm:PR:cosine',
       'cos(ij) = cos(ik) cos(jk) + sin(ik) sin(jk) k_ik . k_jk', 'identity at random triples')
def _cosine_formula(subject):
    gi, gj, gk = sphere.random(subject.rng, (3, 100000))

    def angle_and_normal(a, b):
        theta = np.arccos(np.clip(np.sum(a * b, axis=-1), -1.0, 1.0))
        return theta, np.cross(a, b) / np.sin(theta)[:, None]

    (ik, k_ik), (jk, k_jk) = angle_and_normal(gi, gk), angle_and_normal(gj, gk)
    right = np.cos(ik) * np.cos(jk) + np.sin(ik) * np.sin(jk) * np.sum(k_ik * k_jk, axis=-1)
    return vanishes(np.sum(gi * gj, axis=-1) - right, 1e-11)


@claim('simultaneous', 'Thm:pre:simuDiagonalize',
       'diagonalisable A, B: simultaneously so if and only if AB = BA',
       'random commuting and not commuting pairs; the eigenvectors of A + B on both')
def _simultaneous(subject):
    rng, worst, least = subject.rng, 0.0, math.inf
    for _ in range(50):
        p = rng.standard_normal((6, 6)) + 3.0 * np.eye(6)
        a, b = (p @ np.diag(rng.standard_normal(6)) @ np.linalg.inv(p) for _ in range(2))
        other = rng.standard_normal((6, 6))
        for matrix, commutes in ((b, True), (other + other.T, False)):
            vectors = np.linalg.eig(a + matrix)[1]
            left = 0.0
            for m in (a, matrix):
                turned = np.linalg.solve(vectors, m @ vectors)
                left = max(left, np.max(np.abs(turned - np.diag(np.diag(turned)))))
            worst, least = (max(worst, left), least) if commutes else (worst, min(least, left))
    return Finding(0.0, worst, 1e-6, worst < 1e-6 and least > 1e-3,
                   f'not commuting: {least:.2g} is left off the diagonal at least')


@claim('exchange-commutes', 'Thm:PR:AJCommutative',
       'A symmetric and persymmetric commutes with the exchange matrix J; J^T J = I',
       'random matrices of 2 to 9 rows')
def _exchange(subject):
    worst = 0.0
    for n in range(2, 10):
        j = np.fliplr(np.eye(n))
        a = subject.rng.standard_normal((n, n))
        a = a + a.T
        a = a + j @ a.T @ j
        worst = max(worst, np.max(np.abs(a @ j - j @ a)), np.max(np.abs(j.T @ j - np.eye(n))))
    return vanishes(worst, 1e-13)


def _lambda_matrix(n):
    return np.ones((n, n)) - np.fliplr(np.eye(n))


@claim('lambda-even', 'Thm:PR:lambdaMatrix', 'Lambda_n has n - 1 and (-1)^i, i = 2..n; n even',
       'eigenvalues for n = 2, 4, ..., 40', parity=0)
@claim('lambda-odd', 'Thm:PR:lambdaMatrix', 'Lambda_n has n - 1 and (-1)^i, i = 2..n; n odd',
       'eigenvalues for n = 3, 5, ..., 41', parity=1)
def _lambda(subject, parity):
    worst = 0.0
    for n in range(2 + parity, 42, 2):
        claimed = np.sort([n - 1.0, *((-1.0) ** np.arange(2, n + 1))])
        worst = max(worst, np.max(np.abs(np.linalg.eigvalsh(_lambda_matrix(n)) - claimed)))
    return vanishes(worst, 1e-11)


@claim('theta-star', 'eq:PF:OmegaT', 'four equal pairwise angles are theta* = arccos(-1/3)',
       'the determinant of the Gram matrix over one common cosine has one root inside (-1, 1)')
def _theta_star(_subject):
    c = np.linspace(-0.999, 0.999, 40001)
    determinant = np.linalg.det(coordinates.cosine_matrix(np.repeat(c[:, None], 6, axis=1)))
    root = np.flatnonzero(np.diff(np.sign(determinant)))
    crossing = float(np.interp(
        0.0, determinant[root[0]:root[0] + 2], c[root[0]:root[0] + 2])) if len(root) else math.nan
    return Finding(THIRD, crossing, 1e-7, len(root) == 1 and abs(crossing - THIRD) < 1e-7,
                   f'{len(root)} sign change of the determinant')


@claim('double-hat', 'Section 5', 'Gamma_i^ Gamma_i^ Gamma_j = cos(theta_ij) Gamma_i - Gamma_j',
       'identity at random pairs')
def _double_hat(subject):
    x, y = sphere.random(subject.rng, (2, 10000))
    left = np.cross(x, np.cross(x, y))
    return vanishes(left - (np.sum(x * y, axis=-1, keepdims=True) * x - y), 1e-14)


# ------------------------------------------------------------------------ the law

@claim('intrinsic', 'Rmk:PF:Control', 'the control only takes relative information',
       'every agent told y_ij in a body frame of its own commands R_i^T omega_i')
def _intrinsic(subject):
    rng, worst = subject.rng, 0.0
    for topology, gain in itertools.product((subject.complete, subject.rotating), subject.gains):
        for _ in range(10):
            attitudes, axes = rotation.random(rng, (4,)), sphere.random(rng, (4,))
            plant = bodies.RigidBodies(attitudes, axes)
            gamma = rotation.rotate(attitudes, axes)
            expected = -np.sum(
                (topology.weights * gain.f(sphere.geodesic_distance(gamma[:, None], gamma)))
                [..., None] * np.cross(gamma[:, None], gamma), axis=1)
            for i in range(4):
                neighbors = topology.neighbors(i + 1)
                agent = controller.Controller(axes[i], [w for _, w in neighbors], gain)
                answer = None
                for slot, seen in enumerate(plant.seen_by(i, [j - 1 for j, _ in neighbors])):
                    answer = agent.receive(slot, 1, seen, 0.0)
                worst = max(worst, np.max(np.abs(
                    rotation.rotate(attitudes[i], answer) - expected[i])))
    return vanishes(worst, 1e-12)


@claim('closed-loop', 'eq:PF:ClosedSystem', 'dGamma_i/dt = Gamma_i^ sum f Gamma_i^ Gamma_j',
       'the law as commanded, into the kinematics, against the equation; both gains')
def _closed_loop(subject):
    gamma = sphere.random(subject.rng, (1000, 4))
    worst = 0.0
    for gain in subject.gains:
        commanded = np.cross(
            law.world_angular_velocity(gamma, subject.complete.weights, gain), gamma)
        theta = np.arccos(np.clip(gamma @ np.swapaxes(gamma, -1, -2), -1.0, 1.0))
        cross = np.cross(gamma[:, :, None], gamma[:, None])
        equation = np.cross(gamma, np.sum(
            ((1.0 - np.eye(4)) * gain.f(theta))[..., None] * cross, axis=-2))
        worst = max(worst, np.max(np.abs(commanded - equation)))
    return vanishes(worst, 1e-9)


@claim('rotational-invariance', 'Thm:PF:rotationalInvariant',
       'a rotated formation obeys the same equation',
       'velocity(Q Gamma) = Q velocity(Gamma) at random formations and rotations')
def _rotational_invariance(subject):
    rng = subject.rng
    gamma = sphere.random(rng, (1000, 4))
    turn = rotation.random(rng, (1000,))[:, None]
    worst = 0.0
    for topology, gain in itertools.product((subject.complete, subject.rotating), subject.gains):
        here = law.velocity(gamma, topology.weights, gain)
        there = law.velocity(rotation.rotate(turn, gamma), topology.weights, gain)
        worst = max(worst, np.max(np.abs(there - rotation.rotate(turn, here))))
    return vanishes(worst, 1e-12)


@claim('angles', 'eq:PF:ClosedSysRPY1', 'the closed loop in roll-pitch-yaw angles',
       'chain rule on the law, random points, both gains; the printed form lacks a cosine')
def _angles(subject):
    gamma = sphere.random(subject.rng, (2000, 4))
    gamma = gamma[np.max(np.abs(gamma[..., 2]), axis=1) < 0.99]
    phi, psi = coordinates.angles(gamma)
    worst = 0.0
    for gain in subject.gains:
        velocity = law.velocity(gamma, subject.complete.weights, gain)
        phi_rate, psi_rate = coordinates.angle_velocity(phi, psi, 1.0 - np.eye(4), gain)
        worst = max(worst, np.max(np.abs(velocity[..., 2] / np.cos(phi) - phi_rate)),
                    np.max(np.abs((np.cos(psi) * velocity[..., 1] - np.sin(psi)
                                   * velocity[..., 0]) / np.cos(phi) - psi_rate)))
    return vanishes(worst, 1e-9)


# ------------------------------------------------------------ stationary formation

@claim('lyapunov', 'Thm:SF:stableEquiSet', "V' = -2 sum |omega_i|^2 along the closed loop",
       'difference quotient of V along the flow at random formations, both gains')
def _lyapunov(subject):
    gamma = sphere.random(subject.rng, (500, 4))
    weights, worst = subject.complete.weights, 0.0
    full = 1.0 - np.eye(4)
    for gain in subject.gains:
        velocity = law.velocity(gamma, weights, gain)

        def along(t, velocity=velocity, gain=gain):
            return stability.lyapunov(sphere.exp(gamma, t * velocity), full, gain)

        rate = (8.0 * (along(1e-3) - along(-1e-3)) - (along(2e-3) - along(-2e-3))) / 0.012
        speed = np.sum(law.world_angular_velocity(gamma, weights, gain) ** 2, axis=(-2, -1))
        worst = max(worst, np.max(np.abs(rate + 2.0 * speed)))
    return vanishes(worst, 1e-6)


def _end_speeds(subject, topology, gain, starts, duration):
    gamma = sphere.random(subject.rng, (starts, 4))
    h = 0.02 / max(gain.f(0.0), 1e-3)
    value = stability.lyapunov(gamma, 1.0 - np.eye(4), gain)
    rise = -math.inf
    for k in range(int(duration / 0.02)):
        velocity = law.velocity(gamma, topology.weights, gain)
        middle = sphere.exp(gamma, 0.5 * h * velocity)
        gamma = sphere.normalize(gamma + h * law.velocity(middle, topology.weights, gain))
        if k % 50 == 49:
            before, value = value, stability.lyapunov(gamma, 1.0 - np.eye(4), gain)
            rise = max(rise, np.max(value - before))
    return np.max(np.abs(law.velocity(gamma, topology.weights, gain))), rise


@claim('omega-attracts', 'Thm:SF:stableEquiSet', 'every trajectory approaches the equilibria',
       'speed left after a long time from random starts, and the largest rise of V on the way')
def _omega_attracts(subject):
    speed, rise = 0.0, -math.inf
    for gain, duration in zip(subject.gains, (30.0, 90.0)):
        left, up = _end_speeds(subject, subject.complete, gain, subject.times(80), duration)
        speed, rise = max(speed, left), max(rise, up)
    return Finding(0.0, float(speed), 1e-5, bool(speed < 1e-5 and rise < 1e-12),
                   f'V rises by {max(rise, 0.0):.1g} at most')


class _Polynomial:
    """A gain that satisfies no assumption."""

    def __init__(self, coefficients):
        self.coefficients = coefficients

    def f(self, theta):
        return np.polynomial.polynomial.polyval(np.asarray(theta), self.coefficients)


@claim('omega-t-in-omega', 'Rmk:SF:OmegaTinEqm', 'Omega_T is in Omega whatever the gain',
       'speed at random tetrahedra under 200 random gains, rising and falling and negative')
def _omega_t(subject):
    rng, worst = subject.rng, 0.0
    gamma = random_tetrahedra(rng, 50)
    for _ in range(200):
        gain = _Polynomial(rng.standard_normal(5))
        speed = law.velocity(gamma, subject.complete.weights, gain)
        worst = max(worst, np.max(np.abs(speed)) / abs(gain.f(shapes.THETA_STAR)))
    return vanishes(worst, 1e-11)


@claim('assumption', 'As:SF:f', "f1 and f2 are bounded, f > 0 and f' < 0 on (0, pi)",
       'both at 10001 points')
def _assumption(subject):
    found = [gains.violation(gain, 10001) for gain in subject.gains]
    broken = [text for text in found if text]
    return Finding('holds', 'holds' if not broken else 'violated', '-', not broken,
                   '; '.join(broken))


@claim('proof-spectrum', 'eq:SF:proofEigen',
       "at eq:SF:proofPoint: 2 sqrt2 f' (2), (4 sqrt2/3) f' - (8/3) f (3), 0 (3)",
       'differences of the law in RPY coordinates, five gains, relative')
def _proof_spectrum(subject):
    return _worst(same_spectrum(
        np.linalg.eigvals(_angle_matrix(subject.complete.weights, gain)),
        stability.complete_spectrum(gain)) for gain in subject.families)


def _worst(findings):
    """Return the finding with the largest deviation; one that did not pass before all others."""
    return max(findings, key=lambda finding: (not finding.passed, finding.measured))


def _angle_matrix(weights, gain):
    """Return A_zeta at the proof point from differences of the law, order phi_1, psi_1, ..."""
    phi, psi = coordinates.angles(proof_point())

    def rates(x):
        gamma = coordinates.from_angles(x[:, 0::2], x[:, 1::2])
        velocity = law.velocity(gamma, weights, gain)
        p, s = x[:, 0::2], x[:, 1::2]
        phi_rate = velocity[..., 2] / np.cos(p)
        psi_rate = (np.cos(s) * velocity[..., 1] - np.sin(s) * velocity[..., 0]) / np.cos(p)
        return np.stack([phi_rate, psi_rate], axis=-1).reshape(len(x), -1)

    return derivative(rates, np.stack([phi, psi], axis=-1).ravel())


class _Slope:
    """A gain with a given value and a given slope at theta*, to tell A1 from A2."""

    def __init__(self, value, slope):
        self.value, self.slope = value, slope

    def f(self, theta):
        return self.value + self.slope * (np.asarray(theta) - shapes.THETA_STAR)


@claim('commuting-split', 'Section 4.2', "A_zeta = A1 f + A2 f', and A1 A2 = A2 A1",
       'A1 and A2 from gains with f = 1 or slope 1 alone at theta*; then the two gains')
def _commuting(subject):
    weights = subject.complete.weights
    a1, a2 = _angle_matrix(weights, _Slope(1.0, 0.0)), _angle_matrix(weights, _Slope(0.0, 1.0))
    left = np.max(np.abs(a1 @ a2 - a2 @ a1))
    for gain in subject.gains:
        split = gain.f(shapes.THETA_STAR) * a1 + gain.derivative(shapes.THETA_STAR) * a2
        left = max(left, np.max(np.abs(split - _angle_matrix(weights, gain))))
    # f on its own, without slope: the paper's three -8/3; the slope on its own: 2 sqrt2 twice.
    values = np.sort(np.linalg.eigvals(a1).real), np.sort(np.linalg.eigvals(a2).real)
    left = max(left, np.max(np.abs(values[0] - np.array([-8 / 3] * 3 + [0.0] * 5))),
               np.max(np.abs(values[1] - np.array(
                   [0.0] * 3 + [4 * math.sqrt(2) / 3] * 3 + [2 * math.sqrt(2)] * 2))))
    return vanishes(left, 1e-9)


@claim('centre-manifold', 'Thm:SF:ExistCM',
       'a centre manifold of dimension 3 at every tetrahedron, the rest is stable',
       'inertia of the linearisation at random tetrahedra of both chiralities, both gains')
def _centre(subject):
    odd = set()
    for gain in subject.gains:
        for gamma in random_tetrahedra(subject.rng, 6):
            matrix, _ = differentiated_law(gamma, subject.complete.weights, gain)
            values = np.linalg.eigvals(matrix)
            values = np.where(np.abs(values) < 1e-7 * np.max(np.abs(values)), 0.0, values)
            odd.add(stability.inertia(values))
    shown = ' and '.join(str(i) for i in sorted(odd))
    return Finding('(0, 3, 5)', shown, '-', odd == {(0, 3, 5)}, 'positive, zero, negative')


@claim('centre-is-omega-t', 'Thm:SF:CMDetile', 'the centre manifold is Omega_T',
       'sine of the angle between the kernel of the linearisation and the tangent of Omega_T')
def _centre_is_omega_t(subject):
    worst = 0.0
    for gain in subject.gains:
        for gamma in random_tetrahedra(subject.rng, 6):
            matrix, bases = differentiated_law(gamma, subject.complete.weights, gain)
            tangent = np.linalg.qr(stability.rotations(gamma, bases))[0]
            kernel = np.linalg.svd(matrix)[2][-3:].T
            worst = max(worst, np.linalg.norm(kernel - tangent @ (tangent.T @ kernel), 2))
    return vanishes(worst, 1e-9)


@claim('xi-round-trip', 'eq:SF:newCoorTransPara',
       'Gamma from xi = Phi(Gamma) and back, where the chirality is known',
       'random formations, and the singular cases at the poles and at Gamma_2 = +-Gamma_1')
def _round_trip(subject):
    gamma = sphere.random(subject.rng, (5000, 4))
    north = coordinates.NORTH
    gamma[0, 0], gamma[1, 0], gamma[2, 1], gamma[3, 1] = north, -north, north, -north
    gamma[4, 1], gamma[5, 1] = gamma[4, 0], -gamma[5, 0]
    back = coordinates.inverse(coordinates.transform(gamma), measures.chirality(gamma))
    # Cosines hold only half of the digits of the angles of nearly coincident agents.
    return vanishes(measures.pairwise_cosines(back) - measures.pairwise_cosines(gamma), 1e-9,
                    f'attitudes, away from the singular: '
                    f'{np.max(np.abs(back[6:] - gamma[6:])):.1g}')


@claim('normalising', 'eq:SF:rotMatrix', 'Gamma_j = R3(psi_1) R2(phi_1) R1(gamma) Gamma~_j',
       'Gamma~_1 = [0,0,1], Gamma~_2 = [sin theta_12, 0, cos theta_12] at random formations')
def _normalising(subject):
    gamma = sphere.random(subject.rng, (5000, 4))
    c12 = np.sum(gamma[:, 0] * gamma[:, 1], axis=-1)
    first = np.broadcast_to(coordinates.NORTH, (5000, 3))
    second = np.stack([np.sqrt(1.0 - c12**2), np.zeros(5000), c12], axis=-1)
    turned = np.stack([first, second], axis=1) @ np.swapaxes(
        coordinates.attitude(coordinates.absolute(gamma)), -1, -2)
    return vanishes(turned - gamma[:, :2], 1e-12)


@claim('local-diffeomorphism', 'Section 4.2, Remark',
       'Phi is a local diffeomorphism off the boundary (not one to one: a mirror image has the '
       'same xi)', 'least singular value of its derivative at random formations; the mirror image')
def _diffeomorphism(subject):
    gamma = sphere.random(subject.rng, (200, 4))
    volume = np.abs(np.linalg.det(gamma[:, 1:] - gamma[:, :1]))
    gamma = gamma[(volume > 0.2) & (np.abs(gamma[:, 0, 2]) < 0.95)]
    gamma = gamma[np.abs(np.sum(gamma[:, 0] * gamma[:, 1], axis=-1)) < 0.95]
    ranks, apart = set(), 0.0
    for points in gamma[:20]:
        bases = stability.tangent_basis(points)

        def moved(q, points=points, bases=bases):
            step = np.einsum('iap,kip->kia', bases, q.reshape(-1, 4, 2))
            xi = coordinates.transform(sphere.exp(points, step))
            xi[:, 7:] = np.angle(np.exp(1j * (xi[:, 7:] - coordinates.transform(points)[7:])))
            return xi

        ranks.add(int(np.linalg.matrix_rank(derivative(moved, np.zeros(8)), tol=1e-4)))
        xi = coordinates.transform(points)
        image = coordinates.inverse(xi, -measures.chirality(points))
        apart = max(apart, np.max(np.abs(coordinates.transform(image) - xi)))
    return Finding(8, ', '.join(map(str, sorted(ranks))), f'{apart:.1g}',
                   ranks == {8} and apart < 1e-6, 'the tolerance is what xi of the mirror image '
                   'differs by')


@claim('gram-identity', 'Section 4.2, Lemma', 'the identity among the six cosines',
       'at random formations')
def _gram(subject):
    cosines = measures.pairwise_cosines(sphere.random(subject.rng, (100000, 4)))
    return equal(1.0, 1.0 + np.max(np.abs(coordinates.gram_identity(cosines) - 1.0)), 1e-12)


@claim('eight-degrees', 'Section 4.2', 'the nine coordinates xi have eight degrees of freedom',
       'rank of the derivative of the six cosines: 5, and of the three angles on top of it: 8')
def _eight(subject):
    ranks = set()
    for points in sphere.random(subject.rng, (20, 4)):
        bases = stability.tangent_basis(points)

        def cosines(q, points=points, bases=bases):
            return measures.pairwise_cosines(sphere.exp(
                points, np.einsum('iap,kip->kia', bases, q.reshape(-1, 4, 2))))

        kept = np.linalg.matrix_rank(derivative(cosines, np.zeros(8)), tol=1e-6)
        turned = np.linalg.matrix_rank(stability.rotations(points, bases), tol=1e-6)
        ranks.add((int(kept), int(kept + turned)))
    shown = ' and '.join(str(r) for r in sorted(ranks))
    return Finding('(5, 8)', shown, '-', ranks == {(5, 8)})


def _cosine_rates(gamma, weights, gain):
    """Return d cos(theta_ij) / dt by the chain rule on the law, ``(..., 6)``."""
    velocity = law.velocity(gamma, weights, gain)
    i, j = np.triu_indices(4, k=1)
    return np.sum(velocity[..., i, :] * gamma[..., j, :]
                  + gamma[..., i, :] * velocity[..., j, :], axis=-1)


@claim('triangular', 'eq:SF:newCorDynf1Detial', 'dxi_s/dt = h(xi_s) F(xi_s), of xi_s alone',
       'chain rule on the law at random formations, both gains')
def _triangular(subject):
    gamma = sphere.random(subject.rng, (5000, 4))
    xi_s, worst = measures.pairwise_cosines(gamma), 0.0
    for gain in subject.gains:
        closed = np.einsum('kij,kj->ki', coordinates.h(xi_s), gain.f(np.arccos(xi_s)))
        worst = max(worst, np.max(np.abs(
            closed - _cosine_rates(gamma, subject.complete.weights, gain))))
    return vanishes(worst, 1e-9)


@claim('triangular-weighted', 'eq:RF:newCorDynf1', 'so it is under the weighted graph',
       'chain rule on the law at random formations, both gains, against Graph As:RF:weighedgraph')
def _triangular_weighted(subject):
    gamma = sphere.random(subject.rng, (5000, 4))
    xi_s, worst = measures.pairwise_cosines(gamma), 0.0
    for gain in subject.gains:
        closed = coordinates.cosine_velocity(xi_s, topologies.rotating().weights, gain)
        worst = max(worst, np.max(np.abs(
            closed - _cosine_rates(gamma, subject.rotating.weights, gain))))
    return vanishes(worst, 1e-9)


@claim('omega-t-is-a-point', 'Rmk:SF:maniToPoint',
       'all of Omega_T is one equilibrium of the xi_s dynamics, all cosines -1/3',
       'random tetrahedra of both chiralities: their cosines, and the rates of these')
def _point(subject):
    gamma = random_tetrahedra(subject.rng, 200)
    rates = [_cosine_rates(gamma, subject.complete.weights, gain) for gain in subject.gains]
    return vanishes(np.concatenate([measures.pairwise_cosines(gamma) - THIRD, *rates]), 1e-13)


def _cosine_matrix_of(weights, gain):
    """Return the linearisation of the xi_s dynamics at xi_s*, from differences."""
    return derivative(lambda xi: coordinates.cosine_velocity(xi, weights, gain),
                      np.full(6, THIRD))


@claim('xi-split', 'eq:SF:proofLinear6',
       'A1 = (xi-1) Lambda + (7 xi+1) I, A2 = (xi^2-xi) Lambda + (xi^2+xi-2) I',
       'differences of the xi_s dynamics at xi_s*, F and its slope taken apart')
def _xi_split(subject):
    x, big = THIRD, _lambda_matrix(6)
    a1 = (x - 1.0) * big + (7.0 * x + 1.0) * np.eye(6)
    a2 = (x * x - x) * big + (x * x + x - 2.0) * np.eye(6)
    worst = 0.0
    for gain in subject.gains:
        f, slope = gain.of_cosine(x), gain.of_cosine_derivative(x)
        found = _cosine_matrix_of(subject.complete.weights, gain)
        worst = max(worst, np.max(np.abs(found - f * a1 - slope * a2)))
    return vanishes(worst, 1e-10)


@claim('xi-spectrum', 'Thm:SF:CMDetile',
       "xi_s: -8F, -(8/3)F' (2), -(8/3)F - (16/9)F' (3)",
       'differences of the xi_s dynamics, five gains, relative')
def _xi_spectrum(subject):
    return _worst(same_spectrum(
        np.linalg.eigvals(_cosine_matrix_of(subject.complete.weights, gain)),
        stability.complete_cosine_spectrum(gain),
        '-8F leaves the Gram surface: no formation moves that way')
        for gain in subject.families)


@claim('locally-exponential', 'Thm:SF:CMDetile', 'Omega_T is locally exponentially stable',
       'largest transverse eigenvalue of the differentiated law, five gains')
def _locally_exponential(subject):
    return negative([np.max(transverse_spectrum(
        TETRAHEDRON, subject.complete.weights, gain).real) for gain in subject.families])


def _rate(subject, graph, which):
    gain = subject.gains[which]
    predicted = {'complete': stability.complete_spectrum(gain)[:5],
                 'rotating': stability.rotating_spectrum(gain)}[graph]
    slowest = -float(np.max(predicted.real))
    measured = runs.decay_rate(subject.run(graph, gain), getattr(subject, graph), gain)
    return equal(slowest, measured, 0.01 * slowest, '1/s; tolerance 1 %')


claim('rate-complete-f1', 'Thm:SF:CMDetile', "slowest rate -max(2 sqrt2 f', ...), complete, f1",
      'slowest mode in a run of the nodes', nodes=True, graph='complete', which=0)(_rate)
claim('rate-complete-f2', 'Thm:SF:CMDetile', "slowest rate -max(2 sqrt2 f', ...), complete, f2",
      'slowest mode in a run of the nodes', nodes=True, graph='complete', which=1)(_rate)


@claim('stationary', 'Section 4.2, end', 'the formation reached is stationary',
       'speed of the formation at the end of runs of the nodes, both gains', nodes=True)
def _stationary(subject):
    speeds = []
    for gain in subject.gains:
        run = subject.run('complete', gain)
        speeds.append(np.max(np.abs(run.gamma[-1] - run.gamma[-2])) / run.h)
    return vanishes(speeds, 1e-6, 'rad/s')


# ------------------------------------------------------------- almost global stability

@claim('inequality', 'Thm:SFG:Inequality',
       'four angles of sum 2 pi: sum cos^2 + cos >= 0, zero only at pi/2',
       'least value at random points after descent; distance from pi/2 where it is below 1e-3')
def _inequality(subject):
    rng = subject.rng
    x = rng.dirichlet(np.ones(4), subject.times(40000)) * 2.0 * np.pi
    x = x[np.max(x, axis=1) <= np.pi]

    def value(x):
        return np.sum(np.cos(x) ** 2 + np.cos(x), axis=1)

    # Descend along the constraint as well, or the least values are never seen.
    low = x[np.argsort(value(x))[:2000]]
    for _ in range(300):
        slope = -np.sin(2.0 * low) - np.sin(low)
        low = np.clip(low - 0.05 * (slope - np.mean(slope, axis=1, keepdims=True)), 0.0, np.pi)
        low *= 2.0 * np.pi / np.sum(low, axis=1, keepdims=True)
    everything = np.concatenate([x, low[np.max(low, axis=1) <= np.pi]])
    values = value(everything)
    least = float(np.min(values))
    off = np.max(np.abs(everything[values < 1e-3] - 0.5 * np.pi), initial=0.0)
    return Finding('>= 0', least, 1e-12, least >= -1e-12 and off < 0.05,
                   f'within {off:.2g} rad of (pi/2, ...) where below 1e-3')


@claim('kkt-points', 'Appendix A.2',
       'the KKT points are (0, 2pi/3 x3), (0, 0, pi, pi), (pi/2 x4); G = 5/4, 4, 0',
       'projected gradient and multipliers there; none of lower value from 2000 starts')
def _kkt(_subject):
    left = 0.0
    for x, value in (((0.0, *[2.0 * np.pi / 3.0] * 3), 1.25), ((0.0, 0.0, np.pi, np.pi), 4.0),
                     ([0.5 * np.pi] * 4, 0.0)):
        x = np.array(x)
        left = max(left, abs(np.sum(np.cos(x) ** 2 + np.cos(x)) - value),
                   abs(np.sum(x) - 2.0 * np.pi))
        slope = -np.sin(2.0 * x) - np.sin(x)
        inside = (x > 0.0) & (x < np.pi)
        common = np.mean(slope[inside]) if np.any(inside) else 0.0
        left = max(left, np.max(np.abs(slope[inside] - common), initial=0.0),
                   np.max(common - slope[x == 0.0], initial=0.0),
                   np.max(slope[x == np.pi] - common, initial=0.0))
    return vanishes(left, 1e-12)


def _coplanar(rng, count):
    """Return formations on the equator, ``(count, 4, 3)``, and their longitudes."""
    psi = rng.uniform(-np.pi, np.pi, (count, 4))
    return coordinates.from_angles(np.zeros_like(psi), psi), psi


@claim('coplanar-decouples', 'eq:SFG:ClosedSysRPY1',
       'on the equator the linearised angles phi and psi are decoupled, as given',
       'differences of the angle dynamics at random coplanar formations, both gains')
def _decouples(subject):
    worst = 0.0
    for gain in subject.gains:
        for gamma, psi in zip(*_coplanar(subject.rng, 20)):
            theta = sphere.geodesic_distance(gamma[:, None], gamma)
            # The derivatives of the law jump at 0 and pi; differences need room.
            if np.min(np.minimum(theta, np.pi - theta)[~np.eye(4, dtype=bool)]) < 0.05:
                continue

            def rates(x, gain=gain):
                points = coordinates.from_angles(x[:, :4], x[:, 4:])
                velocity = law.velocity(points, subject.complete.weights, gain)
                p, s = x[:, :4], x[:, 4:]
                return np.concatenate([velocity[..., 2] / np.cos(p), (
                    np.cos(s) * velocity[..., 1] - np.sin(s) * velocity[..., 0]) / np.cos(p)], 1)

            found = derivative(rates, np.concatenate([np.zeros(4), psi]))
            f = (1.0 - np.eye(4)) * gain.f(theta)
            slope = (1.0 - np.eye(4)) * gain.derivative(theta)
            along = f * np.cos(theta) + slope * np.sin(theta)
            claimed = np.zeros((8, 8))
            claimed[:4, :4] = np.diag(np.sum(f * np.cos(theta), axis=1)) - f
            claimed[4:, 4:] = np.diag(np.sum(along, axis=1)) - along
            worst = max(worst, np.max(np.abs(found - claimed)))
    return vanishes(worst, 1e-7)


@claim('coplanar-form', 'eq:SFG:vAv',
       'v^T A v = a sum cos^2 + cos over the cycle + 2 a (1 + cos(theta_13))^2, v = [1,0,-1,0]',
       'A of the law at random coplanar formations in cyclic order, first gain')
def _coplanar_form(subject):
    gain, worst = subject.gains[0], 0.0
    a = gain.a
    for _, psi in zip(*_coplanar(subject.rng, 200)):
        gamma = coordinates.from_angles(np.zeros(4), np.sort(psi))
        matrix = _out_of_plane(gamma, subject.complete.weights, gain)
        v = np.array([1.0, 0.0, -1.0, 0.0])
        c = gamma @ gamma.T
        cycle = c[[0, 1, 2, 3], [1, 2, 3, 0]]
        claimed = a * np.sum(cycle**2 + cycle) + 2.0 * a * (c[0, 2] + 1.0) ** 2
        worst = max(worst, abs(v @ matrix @ v - claimed))
    return vanishes(worst, 1e-9)


def _out_of_plane(gamma, weights, gain):
    """Return the system matrix of phi on the equator, from differences of the law, ``(4, 4)``."""
    psi = np.arctan2(gamma[:, 1], gamma[:, 0])
    return derivative(
        lambda phi: law.velocity(coordinates.from_angles(phi, psi), weights, gain)[..., 2]
        / np.cos(phi), np.zeros(4), 1e-3)


@claim('coplanar-unstable', 'Thm:SFG:CoplaneUnStable', 'every coplanar equilibrium is unstable',
       "the smallest of their largest eigenvalues; equilibria found by Newton's method")
def _coplanar_unstable(subject):
    found, _ = subject.equilibria
    flat = [e for e in found if stability.is_coplanar(e.gamma, 1e-5)]
    kinds = ', '.join(sorted({e.kind for e in flat}))
    least = min((float(np.max(e.eigenvalues.real)) for e in flat), default=math.nan)
    return Finding('> 0', least, 0.0, least > 1e-6, kinds)


@claim('cross', 'Thm:SFG:CoplaneUnStable', "the cross's A has the eigenvalues {2a, -2a, 0, 0}",
       'differences of the law at the cross, first gain')
def _cross(subject):
    gain = subject.gains[0]
    gamma = coordinates.from_angles(np.zeros(4), -np.pi + np.arange(1, 5) * np.pi / 2.0)
    found = np.linalg.eigvals(_out_of_plane(gamma, subject.complete.weights, gain))
    return vanishes(np.sort(found.real) - np.array([-2.0, 0.0, 0.0, 2.0]) * gain.a, 1e-9)


@claim('decomposition', 'Thm:SF:Equilibria', 'Omega = Omega_T + coplanar equilibria',
       "equilibria found by Newton's method that are neither, first gain")
def _decomposition(subject):
    found, lost = subject.equilibria
    strange = sum(e.found for e in found
                  if e.kind != 'tetrahedron' and not stability.is_coplanar(e.gamma, 1e-5))
    total = sum(e.found for e in found)
    tetrahedra = sum(e.found for e in found if e.kind == 'tetrahedron')
    return Finding(0, strange, 0, strange == 0 and tetrahedra > 0 and total > lost,
                   f'{total} equilibria from {total + lost} starts, {tetrahedra} tetrahedra')


@claim('polynomial-system', 'Thm:SF:Equilibria', 'its only positive solution is f_ij = 2a/3',
       "Newton's method on the six equations from random positive starts")
def _polynomials(subject):
    a = getattr(subject.gains[0], 'a', 1.0)
    rng = subject.rng
    f = rng.uniform(0.02, 2.0 * a, (subject.times(3000), 6))

    def equations(f):
        f12, f13, f14, f23, f24, f34 = np.moveaxis(f, -1, 0)
        c = coordinates.cosine_matrix(f / a - 1.0)
        factors = np.stack([f12 * f13, f12 * f23, f13 * f23, f14 * f23], axis=-1)
        return np.concatenate([np.stack([f12 * f34 - f13 * f24, f12 * f34 - f14 * f23], axis=-1),
                               np.einsum('...ij,...j->...i', c, factors)], axis=-1)

    for _ in range(60):
        left = equations(f)
        slope = np.stack([(equations(f + 1e-6 * e) - equations(f - 1e-6 * e)) / 2e-6
                          for e in np.eye(6)], axis=-1)
        step = -np.einsum('...ij,...j->...i', np.linalg.pinv(slope, rcond=1e-12), left)
        size = np.max(np.abs(step), axis=-1, keepdims=True)
        f = f + step * np.minimum(1.0, 0.3 * a / np.maximum(size, 1e-300))
    solved = f[(np.max(np.abs(equations(f)), axis=-1) < 1e-12) & np.all(f > 1e-3 * a, axis=-1)]
    # f = 2a is theta = 0 and beyond; the lemma's f comes from angles.
    solved = solved[np.all(solved <= 2.0 * a, axis=-1)]
    return vanishes(solved - 2.0 * a / 3.0 if len(solved) else math.nan, 1e-6,
                    f'{len(solved)} solutions with 0 < f_ij <= 2a')


def _forms(subject, graph, which, starts):
    topology, gain = getattr(subject, graph), subject.gains[which]
    gamma = sphere.random(subject.rng, (subject.times(starts), 4))
    # Compiling takes longer than the few starts of the quick check do without.
    follow = batch.run if subject.effort <= 1.0 else batch.fastest(gain, 4)
    h = 0.05
    formed, _ = follow(gamma, topology.weights, gain, shapes.TETRAHEDRON.angles, 0.02, h,
                       round((60.0 if which == 0 else 150.0) / h), 20)
    count = int(np.sum(formed != batch.NEVER))
    bound = lower_bound(count, len(gamma))
    return Finding(len(gamma), count, 0, count == len(gamma),
                   f'so the chance to form is above {bound:.4%} with 95 % confidence')


claim('almost-global', 'Section 4.3, Theorem', 'almost every start forms; complete graph, f1',
      'uniform random starts that formed, of how many', graph='complete', which=0,
      starts=3000)(_forms)
claim('almost-global-f2', 'Section 6', 'f2, for which it is not proven, forms as well',
      'uniform random starts that formed, of how many', graph='complete', which=1,
      starts=600)(_forms)


@claim('disjoint-equilibria', 'Section 4.1', 'there are other equilibria besides Omega_T',
       "kinds of equilibrium found by Newton's method, first gain")
def _disjoint(subject):
    kinds = sorted({e.kind for e in subject.equilibria[0]})
    return Finding('> 1', len(kinds), 0, len(kinds) > 1, ', '.join(kinds))


# -------------------------------------------------------------------- rotating formation

@claim('weighted-graph', 'As:RF:weighedgraph',
       'weights 1/2 to and from k, p to the successor and 1 - p to the predecessor skipping k',
       'against the definition, all k and p; one agent sees all, the others form a cycle')
def _weighted_graph(subject):
    worst = np.max(np.abs(subject.rotating.weights - _defined_weights(1, 1)))
    for k, p in itertools.product((1, 2, 3, 4), (0, 1)):
        weights = topologies.rotating(k, p).weights
        worst = max(worst, np.max(np.abs(weights - _defined_weights(k, p))))
        others = [i for i in range(4) if i != k - 1]
        cycle = weights[np.ix_(others, others)]
        worst = max(worst, np.max(np.abs(np.linalg.matrix_power(cycle, 3) - np.eye(3))),
                    np.max(np.abs(np.sum(cycle, axis=0) - 1.0)), abs(np.trace(cycle @ cycle)))
    return vanishes(worst, 1e-15)


def _defined_weights(k, p):
    """Return W of As:RF:weighedgraph from its own words, with the modulo counting from 1."""
    def successor(i):
        following = i % 4 + 1
        return following if following != k else following % 4 + 1

    weights = np.zeros((4, 4))
    for i, j in itertools.permutations(range(1, 5), 2):
        if k in (i, j):
            weights[i - 1, j - 1] = 0.5
        elif j == successor(i):
            weights[i - 1, j - 1] = p
        elif i == successor(j):
            weights[i - 1, j - 1] = 1 - p
    return weights


@claim('omega-t-invariant', 'thm:RF:LocalStable', 'Omega_T is invariant under the weighted graph',
       'rates of the cosines at random tetrahedra, both gains')
def _invariant(subject):
    gamma = random_tetrahedra(subject.rng, 200)
    return vanishes([np.max(np.abs(_cosine_rates(gamma, subject.rotating.weights, gain)))
                     for gain in subject.gains], 1e-13)


def _hurwitz(subject, which):
    gain = subject.gains[which]
    found = transverse_spectrum(TETRAHEDRON, subject.rotating.weights, gain)
    agreement = same_spectrum(found, stability.rotating_spectrum(gain))
    worst = float(np.max(found.real))
    return Finding('< 0', worst, 0.0, worst < 0.0 and agreement.passed,
                   f'1/s; {agreement.measured:.1g} relative from the closed form')


claim('hurwitz-f1', 'thm:RF:LocalStable', 'the xi_s dynamics are Hurwitz; f1',
      'spectrum of the differentiated law in the turning frame', which=0)(_hurwitz)
claim('hurwitz-f2', 'thm:RF:LocalStable', 'the xi_s dynamics are Hurwitz; f2',
      'spectrum of the differentiated law in the turning frame', which=1)(_hurwitz)


@claim('hurwitz-any', 'thm:RF:LocalStable', 'so they are for every gain of As:SF:f',
       "largest real part over the spectral radius, F'/F from 1e-3 to 1e3")
def _hurwitz_any(subject):
    worst = -math.inf
    for ratio in np.geomspace(1e-3, 1e3, 61):
        gain = _Slope(1.0, -ratio * math.sin(shapes.THETA_STAR))
        values = transverse_spectrum(TETRAHEDRON, subject.rotating.weights, gain)
        worst = max(worst, float(np.max(values.real) / np.max(np.abs(values))))
    return negative(worst)


claim('rate-rotating-f1', 'thm:RF:LocalStable', 'exponential convergence, rotating graph, f1',
      'slowest mode in a run of the nodes', nodes=True, graph='rotating', which=0)(_rate)
claim('rate-rotating-f2', 'thm:RF:LocalStable', 'exponential convergence, rotating graph, f2',
      'slowest mode in a run of the nodes', nodes=True, graph='rotating', which=1)(_rate)


@claim('three-equations', 'Section 5',
       'on Omega_T: dphi_1 = dpsi_1 = 0 and sqrt3 f + 2 dgamma + 2 dpsi_1 sin(phi_1) = 0 (for '
       'the printed chirality)', 'derivative of xi_c along the law, random tetrahedra, both gains')
def _three_equations(subject):
    gamma = random_tetrahedra(subject.rng, 100)
    gamma = gamma[np.abs(gamma[:, 0, 2]) < 0.95]
    handed = measures.chirality(gamma) * measures.chirality(TETRAHEDRON)
    worst = 0.0
    for gain in subject.gains:
        velocity = law.velocity(gamma, subject.rotating.weights, gain)
        ahead, behind = (coordinates.absolute(sphere.exp(gamma, t * velocity))
                         for t in (1e-4, -1e-4))
        rates = np.angle(np.exp(1j * (ahead - behind))) / 2e-4
        phi = coordinates.absolute(gamma)[:, 0]
        third = handed * math.sqrt(3.0) * gain.f(shapes.THETA_STAR) \
            + 2.0 * rates[:, 2] + 2.0 * rates[:, 1] * np.sin(phi)
        worst = max(worst, np.max(np.abs(rates[:, :2])), np.max(np.abs(third)))
    return vanishes(worst, 1e-6)


@claim('at-rest', 'Section 5, Proposition', 'Gamma_1 remains stationary',
       'its speed at the end of runs of the nodes, both gains', nodes=True)
def _at_rest(subject):
    speeds = []
    for gain in subject.gains:
        run = subject.run('rotating', gain)
        speeds.append(np.linalg.norm(run.gamma[-1, 0] - run.gamma[-2, 0]) / run.h)
    return vanishes(speeds, 1e-6, 'rad/s')


def _spin_vector(run):
    """Return the angular velocity of a run's formation over its last sample times [rad/s]."""
    return measures.mean_angular_velocity(run.gamma[-101], run.gamma[-1], 100 * run.h)


def _spin(subject, which):
    gain = subject.gains[which]
    predicted = math.sqrt(3.0) / 2.0 * gain.f(shapes.THETA_STAR)
    measured = float(np.linalg.norm(_spin_vector(subject.run('rotating', gain))))
    return equal(predicted, measured, 1e-3 * predicted, 'rad/s; tolerance 1e-3 relative')


claim('spin-f1', 'Section 5, Proposition', 'the formation spins at sqrt(3)/2 f(theta*); f1',
      'angular velocity at the end of a run of the nodes', nodes=True, which=0)(_spin)
claim('spin-f2', 'Section 5, Proposition', 'the formation spins at sqrt(3)/2 f(theta*); f2',
      'angular velocity at the end of a run of the nodes', nodes=True, which=1)(_spin)


@claim('sense', 'Section 5, Proposition',
       'it turns clockwise about Gamma_1 for the chirality printed, the other way for its mirror',
       'sense of rotation in runs of the nodes that end in either chirality', nodes=True)
def _sense(subject):
    wrong, seen = 0, set()
    gain = subject.gains[0]
    for seed in range(8):
        run = subject.run('rotating', gain, seed)
        handed = int(measures.chirality(run.gamma[-1]) * measures.chirality(TETRAHEDRON))
        seen.add(handed)
        wrong += int(np.sign(_spin_vector(run) @ run.gamma[-1, 0]) != -handed)
        if len(seen) == 2:
            break
    return Finding(0, wrong, 0, wrong == 0 and len(seen) == 2,
                   f'{len(seen)} chiralities seen in {seed + 1} runs')


@claim('period', 'Section 6', 'one turn takes 2 sqrt(3) pi, with f1',
       'from the spin at the end of a run of the nodes', nodes=True)
def _period(subject):
    spin = np.linalg.norm(_spin_vector(subject.run('rotating', subject.gains[0])))
    predicted = 2.0 * math.sqrt(3.0) * math.pi
    return equal(predicted, 2.0 * math.pi / spin, 1e-3 * predicted, 's; not so with f2')


def _figure(subject, graph):
    worst = max(float(measures.shape_error(subject.run(graph, gain).gamma[-1],
                                           shapes.TETRAHEDRON.angles)) for gain in subject.gains)
    return vanishes(worst, 1e-3, 'rad; what sampling leaves of it under the rotating graph')


claim('figure-stationary', 'Fig:Sim:SF', 'both gains lead to the regular tetrahedron',
      'largest angle error at the end of runs of the nodes, complete graph', nodes=True,
      graph='complete')(_figure)
claim('figure-rotating', 'Fig:Sim:RF', 'both gains lead to the regular tetrahedron',
      'largest angle error at the end of runs of the nodes, rotating graph', nodes=True,
      graph='rotating')(_figure)
claim('rotating-forms', 'Section 6', 'the rotating formation comes from random starts',
      'uniform random starts that formed, of how many; f1', graph='rotating', which=0,
      starts=1000)(_forms)
