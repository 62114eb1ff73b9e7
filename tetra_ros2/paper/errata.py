# Copyright 2026 The tetra_ros2 authors
# SPDX-License-Identifier: Apache-2.0

"""
What the paper prints and cannot mean: each with the computation that shows it.

A check returns two deviations, of the printed form and of the corrected one, from what they are
to be; the first must not be zero and the second must. ``docs/errata.md`` lists them all. To
add one, write its check below with the decorator ``erratum``, and its row there.
"""

from collections.abc import Callable, Sequence
import itertools
import math
from typing import TypeAlias

import numpy as np
from numpy.typing import ArrayLike

from tetra_ros2.formation import coordinates, law, measures, rotation, shapes, sphere, stability
from tetra_ros2.formation import topology as topologies
from tetra_ros2.paper.differences import derivative
from tetra_ros2.paper.formations import TETRAHEDRON
from tetra_ros2.paper.registry import Claim, claim, CLAIMS, Result
from tetra_ros2.paper.system import SystemUnderTest

HOLDS = 1e-6
"""A corrected form is off by less than this; a printed one by more than a thousand times that."""

Pair: TypeAlias = Sequence[ArrayLike]
Deviations: TypeAlias = Callable[[SystemUnderTest], Pair]

ERRATA: dict[str, Claim] = {}
"""Each is a claim, too: that the corrected form holds where the printed one fails."""


def erratum(key: str, label: str, printed: str,
            corrected: str) -> Callable[[Deviations], Deviations]:
    """
    Register a check of what is printed and of what holds.

    :param key: its name on the command line
    :param label: where it stands
    :param printed: what is printed
    :param corrected: what holds
    """
    def register(deviations: Deviations) -> Deviations:
        def check(system: SystemUnderTest) -> Result:
            printed_off, corrected_off = (
                float(np.max(np.abs(value))) for value in deviations(system))
            return Result(0.0, corrected_off, HOLDS,
                          corrected_off < HOLDS and printed_off > 1000.0 * HOLDS,
                          f'the printed form is off by {printed_off:.3g}')
        claim(key, label, corrected, f'printed: {printed}')(check)
        ERRATA[key] = CLAIMS[key]
        return deviations
    return register


def _off_poles(gamma):
    return gamma[np.max(np.abs(gamma[..., 2]), axis=-1) < 0.95]


@erratum('erratum-angle-equation', 'eq:PF:ClosedSysRPY2',
          'dphi_i = sum f [sin(phi_i) cos(psi_j - psi_i) - ...]',
          'dphi_i = sum f [sin(phi_i) cos(phi_j) cos(psi_j - psi_i) - cos(phi_i) sin(phi_j)]')
def _angle_equation(system: SystemUnderTest) -> Pair:
    gamma = _off_poles(sphere.random(system.rng, (500, 4)))
    phi, psi = coordinates.angles(gamma)
    weights, gain = system.complete.weights, system.gains[0]
    true = law.velocity(gamma, weights, gain)[..., 2] / np.cos(phi)
    f = (1.0 - np.eye(4)) * gain.f(sphere.geodesic_distance(gamma[:, :, None], gamma[:, None]))
    i, j = phi[..., :, None], phi[..., None, :]
    ahead = np.cos(psi[..., None, :] - psi[..., :, None])
    printed = np.sum(f * (np.sin(i) * ahead - np.cos(i) * np.sin(j)), axis=-1)
    corrected = np.sum(f * (np.sin(i) * np.cos(j) * ahead - np.cos(i) * np.sin(j)), axis=-1)
    return printed - true, corrected - true


@erratum('erratum-singular-psi', 'eq:SF:newCoorTransPara, singular cases',
          'psi_k is undefined, and set to 0, at Gamma_k = [1, 0, 0]',
          'that is at the poles, Gamma_k = [0, 0, 1] and [0, 0, -1]')
def _singular_psi(system: SystemUnderTest) -> Pair:
    around = system.rng.uniform(-np.pi, np.pi, 200)
    circle = 1e-9 * np.stack([np.cos(around), np.sin(around)], axis=-1)
    near_x = np.concatenate([np.ones((200, 1)), circle], axis=1)
    near_pole = np.concatenate([circle, np.ones((200, 1))], axis=1)
    # At a singular point psi takes any value nearby. The printed point is a regular one, the
    # corrected one is singular: compare the spread of psi there with the whole circle.
    spread = [np.ptp(coordinates.angles(sphere.normalize(points))[1])
              for points in (near_x, near_pole)]
    pole = coordinates.angles(coordinates.NORTH)[1]
    return spread[0] - 2.0 * np.pi, np.array([min(0.0, spread[1] - 6.0), pole])


@erratum('erratum-singular-gamma', 'eq:SF:newCoorTransPara, singular cases',
          'gamma is undefined at Gamma_1 = Gamma_2',
          'it is so at Gamma_1 = -Gamma_2 as well')
def _singular_gamma(system: SystemUnderTest) -> Pair:
    def spread(sign):
        first = sphere.random(system.rng, (1,))
        second = sphere.normalize(sign * first + 1e-9 * sphere.random(system.rng, (300,)))
        both = np.stack([np.broadcast_to(first, second.shape), second], axis=1)
        return np.ptp(coordinates.absolute(both)[:, 2])

    # gamma is continuous where it is defined; here it takes every value in any neighbourhood.
    printed = spread(-1.0)
    return printed, np.minimum([spread(1.0) - 6.0, spread(-1.0) - 6.0], 0.0)


@erratum('erratum-diffeomorphism', 'Section 4.2, Remark on Phi',
          'Phi is diffeomorphic everywhere except on the boundary',
          'it is two-to-one: a formation and its mirror image in the plane of Gamma_1 and Gamma_2 '
          'have one xi; with the chirality it can be inverted')
def _diffeomorphism(system: SystemUnderTest) -> Pair:
    gamma = sphere.random(system.rng, (300, 4))
    xi, handed = coordinates.transform(gamma), measures.chirality(gamma)
    image = coordinates.inverse(xi, -handed)
    same_xi = np.max(np.abs(coordinates.transform(image) - xi)[:, :6])
    volume = np.abs(np.linalg.det(gamma[:, 1:] - gamma[:, :1]))
    back = coordinates.inverse(xi, handed)
    apart = np.max(np.abs(image - gamma)) if same_xi < 1e-9 else 0.0
    return apart, (back - gamma)[volume > 0.05]


@erratum('erratum-xi-c-closed', 'eq:SF:newCorDynf2, eq:RF:newCorDynf2',
          'dxi_c/dt is a function of xi_c and xi_s',
          'it is one of xi_c, xi_s and the chirality')
def _xi_c_closed(system: SystemUnderTest) -> Pair:
    gamma = _off_poles(sphere.random(system.rng, (300, 4)))
    image = coordinates.inverse(coordinates.transform(gamma), -measures.chirality(gamma))
    again = coordinates.inverse(coordinates.transform(gamma), measures.chirality(gamma))
    clear = np.abs(np.linalg.det(gamma[:, 1:] - gamma[:, :1])) > 0.3

    def twist(points):
        velocity = law.velocity(points, system.rotating.weights, system.gains[0])
        ahead, behind = (coordinates.absolute(sphere.exp(points, t * velocity))
                         for t in (1e-4, -1e-4))
        return (np.angle(np.exp(1j * (ahead - behind))) / 2e-4)[clear]

    return twist(image) - twist(gamma), twist(again) - twist(gamma)


@erratum('erratum-one-rotation', 'Thm:SF:ExistCM, before it',
          'every Gamma in Omega_T is transformed to Gamma* by a rotation',
          'by a rotation, or a rotation and a reflection: Omega_T has two components')
def _one_rotation(_system: SystemUnderTest) -> Pair:
    star = TETRAHEDRON
    image = stability.mirrored(star)
    turned = rotation.rotate(rotation.align(image, star)[None], image)
    reflected = rotation.rotate(rotation.align(-image, star)[None], -image)
    return turned - star, reflected - star


@erratum('erratum-coplanar-set', 'Thm:SFG:CoplaneUnStable, Omega_C',
          'Gamma_i = exp(theta_i u^) Gamma_1 for any u, Gamma_1 (also small circles)',
          'the same with u orthogonal to Gamma_1')
def _coplanar_set(system: SystemUnderTest) -> Pair:
    rng = system.rng
    first, u = sphere.random(rng, (2, 100))
    theta = rng.uniform(-np.pi, np.pi, (100, 4))

    def thickness(u):
        points = rotation.rotate(rotation.exp(theta[..., None] * u[:, None]), first[:, None])
        return np.linalg.svd(points, compute_uv=False)[:, 2]

    return thickness(u), thickness(sphere.normalize(sphere.project(first, u)))


@erratum('erratum-gaps', 'Thm:SFG:CoplaneUnStable, proof',
          'theta_{i,i+1} <= pi for all i, so sum theta_{i,i+1} = 2 pi, as else there is no '
          'equilibrium', 'consensus is one, with sum theta = 0; v^T A v = 16 a > 0 there')
def _gaps(system: SystemUnderTest) -> Pair:
    gain = system.gains[0]
    gamma = np.tile([1.0, 0.0, 0.0], (4, 1))
    weights = system.complete.weights
    speed = np.max(np.abs(law.velocity(gamma, weights, gain)))
    psi = np.zeros(4)
    matrix = derivative(lambda phi: law.velocity(
        coordinates.from_angles(phi, psi), weights, gain)[..., 2] / np.cos(phi), np.zeros(4), 1e-3)
    v = np.array([1.0, 0.0, -1.0, 0.0])
    around = np.sum(sphere.geodesic_distance(gamma, np.roll(gamma, -1, axis=0)))
    return around - 2.0 * np.pi, np.array([speed, v @ matrix @ v - 16.0 * gain.a])


@erratum('erratum-a-psi', 'Thm:SFG:CoplaneUnStable, proof',
          'A_psi, the matrix of the phi equation eq:SFG:ClosedSysRPY2, is meant by its name',
          'it is A_phi: at the cross the psi equation has {0, -2a, -2a, -4a}, the phi equation '
          '{2a, -2a, 0, 0}')
def _a_psi(system: SystemUnderTest) -> Pair:
    gain = system.gains[0]
    psi = -np.pi + np.arange(1, 5) * np.pi / 2.0
    gamma = coordinates.from_angles(np.zeros(4), psi)
    matrix = stability.angle_linearization(gamma, system.complete.weights, gain)
    along = np.sort(np.linalg.eigvals(matrix[1::2, 1::2]).real)
    across = np.sort(np.linalg.eigvals(matrix[0::2, 0::2]).real)
    claimed = np.array([-2.0, 0.0, 0.0, 2.0]) * gain.a
    return along - claimed, np.concatenate(
        [across - claimed, along - np.array([-4.0, -2.0, -2.0, 0.0]) * gain.a])


@erratum('erratum-successor', 'As:RF:weighedgraph, Suc^k',
          'Suc^k(i) = (i + 1) mod n, or (i + 2) mod n where i + 1 = k',
          'i mod n + 1, and once more if that is k; agents are 1..n')
def _successor(_system: SystemUnderTest) -> Pair:
    def printed(i, k):
        return (i + 1) % 4 if i + 1 != k else (i + 2) % 4

    def corrected(i, k):
        following = i % 4 + 1
        return following if following != k else following % 4 + 1

    def off(successor):
        """Return how many agents have a successor that is no agent, k, or themselves."""
        return sum(successor(i, k) not in {1, 2, 3, 4} - {i, k}
                   for i, k in itertools.permutations(range(1, 5), 2))

    agree = max(abs(topologies.rotating(k, 1).weights[i - 1, corrected(i, k) - 1] - 1.0)
                for i, k in itertools.permutations(range(1, 5), 2))
    return float(off(printed)), np.array([off(corrected), agree])


@erratum('erratum-neighbours', 'Section 2 and As:RF:weighedgraph',
          'N_i = {j: (j, i) in E} beside the weight W(i, j) of the edge (i, j)',
          'N_i = {j: (i, j) in E}: taken the other way round p = 1 spins as p = 0 does')
def _neighbours(system: SystemUnderTest) -> Pair:
    gain = system.gains[0]
    spin = -math.sqrt(3.0) / 2.0 * gain.f(shapes.THETA_STAR)

    def about_first(weights):
        velocity = law.velocity(TETRAHEDRON, weights, gain)
        return measures.angular_velocity(TETRAHEDRON, velocity) @ TETRAHEDRON[0]

    weights = system.rotating.weights
    return about_first(weights.T) - spin, about_first(weights) - spin


@erratum('erratum-derivative', 'eq:RF:SpeedDerive1',
          'R3 (dR1/dphi_1) R1 dphi_1, and the last three terms without Gamma~_i',
          'R3 (dR2/dphi_1) R1 dphi_1, all of it times Gamma~_i')
def _derivative(system: SystemUnderTest) -> Pair:
    rng = system.rng
    xi_c, rates = rng.uniform(-1.0, 1.0, (2, 100, 3))
    shape = coordinates.normalized(sphere.random(rng, (100, 4)))
    phi, psi, gamma = np.moveaxis(xi_c, -1, 0)

    def difference(function, x):
        return (function(x + 1e-5) - function(x - 1e-5)) / 2e-5

    true = difference(lambda t: shape @ np.swapaxes(
        coordinates.attitude(xi_c + t * rates), -1, -2), 0.0)
    r1, r2, r3 = coordinates.about_z(gamma), coordinates.tilt(phi), coordinates.about_z(psi)
    by_phi, by_psi, by_gamma = (rates[:, i, None, None] for i in range(3))
    about_gamma = r3 @ r2 @ difference(coordinates.about_z, gamma) * by_gamma
    about_psi = difference(coordinates.about_z, psi) @ r2 @ r1 * by_psi
    corrected = about_gamma + r3 @ difference(coordinates.tilt, phi) @ r1 * by_phi + about_psi
    printed = about_gamma + about_psi  # R1 does not depend on phi_1: its derivative is zero
    return [np.max(np.abs(shape @ np.swapaxes(m, -1, -2) - true)) for m in (printed, corrected)]


@erratum('erratum-normalised', 'Section 5, normalised tetrahedron',
          'Gamma~_2 = [-2 sqrt2/3, 0, -1/3]', 'Gamma~_2 = [2 sqrt2/3, 0, -1/3]')
def _normalised(_system: SystemUnderTest) -> Pair:
    s2, s6 = math.sqrt(2.0), math.sqrt(6.0)
    points = np.array([[0.0, 0.0, 1.0], [2.0 * s2 / 3.0, 0.0, -1.0 / 3.0],
                       [-s2 / 3.0, s6 / 3.0, -1.0 / 3.0], [-s2 / 3.0, -s6 / 3.0, -1.0 / 3.0]])
    printed = points.copy()
    printed[1, 0] *= -1.0
    return [measures.pairwise_cosines(p) + 1.0 / 3.0 for p in (printed, points)]


@erratum('erratum-sense', 'Section 5, before the Proposition',
          'dgamma/dt = -sqrt(3)/2 f(theta*)',
          'so for the chirality printed; +sqrt(3)/2 f(theta*) for its mirror image')
def _sense(system: SystemUnderTest) -> Pair:
    gain = system.gains[0]
    rate = math.sqrt(3.0) / 2.0 * gain.f(shapes.THETA_STAR)
    rates = []
    for points in (TETRAHEDRON, stability.mirrored(TETRAHEDRON)):
        velocity = law.velocity(points, system.rotating.weights, gain)
        # Gamma_1 is at the pole: there, the angle gamma is the longitude of Gamma_2.
        rates.append(np.cross(points[1], velocity[1])[2] / (1.0 - points[1, 2] ** 2))
    return rates[1] + rate, np.array([rates[0] + rate, rates[1] - rate])


@erratum('erratum-period', 'Section 6', 'the period is 2 sqrt(3) pi in both cases',
          'it is 4 pi / (sqrt(3) f(theta*)): 2 sqrt(3) pi = 10.88 s with f1, 49.03 s with f2')
def _period(system: SystemUnderTest) -> Pair:
    periods = []
    for gain in system.gains:
        velocity = law.velocity(TETRAHEDRON, system.rotating.weights, gain)
        spin = np.linalg.norm(measures.angular_velocity(TETRAHEDRON, velocity))
        periods.append(2.0 * np.pi / spin)
    general = [4.0 * np.pi / (math.sqrt(3.0) * gain.f(shapes.THETA_STAR))
               for gain in system.gains]
    return np.array(periods) - 2.0 * math.sqrt(3.0) * np.pi, \
        np.array([*(np.array(periods) - general), periods[0] - 2.0 * math.sqrt(3.0) * np.pi])


@erratum('erratum-captions', 'Fig:Sim:SF and Fig:Sim:RF, captions',
          'f1 = exp(-theta), f2 = cos(theta) + 1', 'f1 = cos(theta) + 1, f2 = exp(-theta), as in '
          'the text and in the period that belongs to f1')
def _captions(system: SystemUnderTest) -> Pair:
    # The period that the text reads off the figure tells which gain is f1.
    star, period = shapes.THETA_STAR, 2.0 * math.sqrt(3.0) * math.pi
    return [4.0 * math.pi / (math.sqrt(3.0) * f) - period
            for f in (math.exp(-star), system.gains[0].f(star))]


@erratum('erratum-exchange-spectrum', 'Appendix A.1',
          'J has the eigenvalues (-1)^i, i = 1..6', '(-1)^(i+1), i = 1..n: +1 once more than -1 '
          'for odd n')
def _exchange_spectrum(_system: SystemUnderTest) -> Pair:
    def off(exponent):
        worst = 0.0
        for n in range(2, 12):
            claimed = np.sort((-1.0) ** (np.arange(1, n + 1) + exponent))
            worst = max(worst, np.max(np.abs(
                np.linalg.eigvalsh(np.fliplr(np.eye(n))) - claimed)))
        return worst
    return off(0), off(1)


@erratum('erratum-sixth-eigenvalue', 'Thm:SF:CMDetile, proof',
          'the spectrum of the formation has six eigenvalues, -8F among them',
          'five: -8F belongs to the direction that leaves the surface of the Gram identity')
def _sixth(system: SystemUnderTest) -> Pair:
    gain, weights = system.gains[0], system.complete.weights
    matrix = coordinates.cosine_jacobian(np.full(6, -1.0 / 3.0), weights, gain)
    out = np.ones(6) / math.sqrt(6.0)
    slope = derivative(lambda q: measures.pairwise_cosines(sphere.exp(TETRAHEDRON, np.einsum(
        'iap,kip->kia', stability.tangent_basis(TETRAHEDRON), q.reshape(-1, 4, 2)))), np.zeros(8))
    eigen = np.max(np.abs(matrix @ out + 8.0 * gain.of_cosine(-1.0 / 3.0) * out))
    real = stability.transverse(TETRAHEDRON, weights, gain).eigenvalues
    nearest = np.min(np.abs(real + 8.0 * gain.of_cosine(-1.0 / 3.0)))
    return nearest, np.array([eigen, np.max(np.abs(out @ slope))])


@erratum('erratum-range', 'eq:SF:proofPoint', 'psi*_i = pi/4 + (i-1) pi/2 with psi in [-pi, pi)',
          'less 2 pi for i = 3, 4')
def _range(_system: SystemUnderTest) -> Pair:
    psi = np.pi / 4.0 + np.arange(4) * np.pi / 2.0
    wrapped = np.where(psi >= np.pi, psi - 2.0 * np.pi, psi)

    def outside(angle):
        return np.maximum(angle - np.pi, 0.0) + np.maximum(-np.pi - angle, 0.0)

    same = np.exp(1j * psi) - np.exp(1j * wrapped)
    return outside(psi), np.concatenate([outside(wrapped), np.abs(same)])
