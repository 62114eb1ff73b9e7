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
What the paper prints and cannot mean: each with the computation that shows it.

What is printed is quoted from the paper's LaTeX, less its spacing commands. A check returns two
deviations, of the printed form and of the corrected one, from what they are to be. The first must
not be zero and the second must. ``docs/errata.md`` lists them all. To add one, write its check
below with the decorator ``erratum``, and its row there.
"""

from collections.abc import Callable, Sequence
import itertools
import math
from typing import Any, TypeAlias

import numpy as np
from numpy.typing import ArrayLike
from tetra_ros2.formation import coordinates, law, measures, rotation, shapes, sphere, stability
from tetra_ros2.formation import topology as topologies
from tetra_ros2.formation.gain import Gain
from tetra_ros2.paper.differences import out_of_plane
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
    :param printed: what is printed, in the paper's LaTeX
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


def _off_poles(gamma: np.ndarray) -> np.ndarray:
    good: np.ndarray = gamma[np.max(np.abs(gamma[..., 2]), axis=-1) < 0.95]
    return good


@erratum('erratum-angle-equation', 'eq:PF:ClosedSysRPY2',
         r'\dot{\phi}_i = \sum\limits_{j\in \mathcal{N}_i}{f(\theta_{ij})\left[ \sin(\phi_i) '
         r'\cos(\psi_j-\psi_i) - \cos(\phi_i) \sin(\phi_j) \right]}',
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
         r'$\psi_k=0$ when $\Gamma_{k}=[1,0,0]^T$',
         'psi_k is singular, and set to 0, at the poles, Gamma_k = [0, 0, 1] and [0, 0, -1]')
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
         r'$\gamma=0$ when $\Gamma_{1}=\Gamma_{2}$',
         'gamma is singular, and set to 0, at Gamma_1 = -Gamma_2 as well')
def _singular_gamma(system: SystemUnderTest) -> Pair:
    def spread(sign: float) -> float:
        first = sphere.random(system.rng, (1,))
        second = sphere.normalize(sign * first + 1e-9 * sphere.random(system.rng, (300,)))
        both = np.stack([np.broadcast_to(first, second.shape), second], axis=1)
        return float(np.ptp(coordinates.absolute(both)[:, 2]))

    # gamma is continuous where it is defined; here it takes every value in any neighbourhood.
    printed = spread(-1.0)
    return printed, np.minimum([spread(1.0) - 6.0, spread(-1.0) - 6.0], 0.0)


def _mirror(gamma: np.ndarray) -> np.ndarray:
    """Return the mirror images in the plane of Gamma_1 and Gamma_2, ``(..., 4, 3)``."""
    normal = sphere.normalize(np.cross(gamma[..., 0, :], gamma[..., 1, :]))[..., None, :]
    image: np.ndarray = gamma - 2.0 * np.sum(gamma * normal, axis=-1, keepdims=True) * normal
    return image


@erratum('erratum-diffeomorphism', 'Section 4.2, Remark on Phi',
         r'$\xi=\Phi(\mathbf{\Gamma})$ in (\ref{eq:SF:newCoorTrans}) is diffeomorphic everywhere '
         r'except on the boundary',
         'it is two-to-one: a formation and its mirror image in the plane of Gamma_1 and Gamma_2 '
         'have one xi; the chirality tells them apart, unless the four are on a small circle')
def _diffeomorphism(system: SystemUnderTest) -> Pair:
    gamma = sphere.random(system.rng, (300, 4))
    image, xi = _mirror(gamma), coordinates.transform(gamma)
    same = np.max(np.abs(np.exp(1j * coordinates.transform(image)) - np.exp(1j * xi)))
    # Injective it would be if a formation of the same xi were the same formation.
    apart = np.max(np.abs(image - gamma)) if same < 1e-9 else 0.0
    back = coordinates.inverse(xi, measures.chirality(gamma))
    circle = rotation.rotate(rotation.random(system.rng), coordinates.from_angles(
        0.6, system.rng.uniform(-np.pi, np.pi, 4)))
    # On a small circle the volume is zero, and yet the mirror image is another formation.
    volume = np.linalg.det(circle[1:] - circle[0])
    undecided = np.max(np.abs(_mirror(circle) - circle)) < 1e-3
    return apart, np.array([np.max(np.abs(back - gamma)), volume, undecided])


def _absolute_rates(points: np.ndarray, weights: np.ndarray, gain: Gain) -> np.ndarray:
    velocity = law.velocity(points, weights, gain)
    ahead, behind = (coordinates.absolute(sphere.exp(points, t * velocity))
                     for t in (1e-4, -1e-4))
    rates: np.ndarray = np.angle(np.exp(1j * (ahead - behind))) / 2e-4
    return rates


def _not_closed(system: SystemUnderTest, weights: np.ndarray) -> Pair:
    """Return how dxi_c/dt differs between formations of one xi, and of one chirality as well."""
    gamma = _off_poles(sphere.random(system.rng, (300, 4)))
    gamma = gamma[np.abs(np.sum(gamma[:, 0] * gamma[:, 1], axis=-1)) < 0.9]
    again = coordinates.inverse(coordinates.transform(gamma), measures.chirality(gamma))
    image, back, here = (_absolute_rates(points, weights, system.gains[0])
                         for points in (_mirror(gamma), again, gamma))
    return image - here, back - here


@erratum('erratum-xi-c-closed', 'eq:SF:newCorDynf2', r'\dot{\xi}_c= \hat{f}_c(\xi_c,\xi_s)',
         'dxi_c/dt is a function of xi_c, xi_s and the chirality')
def _xi_c_closed(system: SystemUnderTest) -> Pair:
    return _not_closed(system, system.complete.weights)


@erratum('erratum-xi-c-closed-weighted', 'eq:RF:newCorDynf2',
         r'\dot{\xi}_c= \widetilde{f}_c(\xi_c,\xi_s)',
         'dxi_c/dt is a function of xi_c, xi_s and the chirality under this graph, too')
def _xi_c_closed_weighted(system: SystemUnderTest) -> Pair:
    return _not_closed(system, system.rotating.weights)


@erratum('erratum-one-rotation', 'Thm:SF:ExistCM, before it',
         r'for any formation $\mathbf{\Gamma} \in \Omega_T$, we can transform it to '
         r'$\mathbf{\Gamma}^*$ by a rotational transformation',
         'by a rotation, or a rotation and a reflection: Omega_T has two components')
def _one_rotation(_system: SystemUnderTest) -> Pair:
    star = TETRAHEDRON
    image = stability.mirrored(star)
    turned = rotation.rotate(rotation.align(image, star)[None], image)
    reflected = rotation.rotate(rotation.align(-image, star)[None], -image)
    return turned - star, reflected - star


@erratum('erratum-coplanar-set', 'Thm:SFG:CoplaneUnStable, Omega_C',
         r'\Gamma_i= exp(\theta_i \widehat{u})\Gamma_1, \Gamma_1 \in \mathcal{S}^2, '
         r'u\in \mathcal{S}^2',
         'the same with u orthogonal to Gamma_1: else the four are on a small circle')
def _coplanar_set(system: SystemUnderTest) -> Pair:
    rng = system.rng
    first, u = sphere.random(rng, (2, 100))
    theta = rng.uniform(-np.pi, np.pi, (100, 4))

    def thickness(u: np.ndarray) -> np.ndarray:
        points = rotation.rotate(rotation.exp(theta[..., None] * u[:, None]), first[:, None])
        return np.linalg.svd(points, compute_uv=False)[:, 2]

    return thickness(u), thickness(sphere.normalize(sphere.project(first, u)))


@erratum('erratum-gaps', 'Thm:SFG:CoplaneUnStable, proof',
         r'Suppose $\theta_{i,i+1} \le \pi$, $\forall i \in \mathcal{V}$, otherwise a '
         r'contradiction can be obtained easily from the fact that ${\Gamma}^*$ is one equilibria',
         'consensus is an equilibrium, one of whose gaps is 2 pi; v^T A v = 16 a > 0 there')
def _gaps(system: SystemUnderTest) -> Pair:
    gain, weights = system.gains[0], system.complete.weights
    gamma = np.tile([1.0, 0.0, 0.0], (4, 1))
    speed = np.max(np.abs(law.velocity(gamma, weights, gain)))
    psi = np.sort(coordinates.angles(gamma)[1])
    gaps = np.append(np.diff(psi), 2.0 * np.pi - np.ptp(psi))
    v = np.array([1.0, 0.0, -1.0, 0.0])
    bend = v @ out_of_plane(gamma, weights, gain) @ v
    return np.max(gaps) - np.pi, np.array([speed, bend - 16.0 * gain.a])


@erratum('erratum-cross-set', 'Thm:SFG:CoplaneUnStable, proof, Omega_Cbar',
         r'\Omega_{\overline{C}}=\left\{ \mathbf{\Gamma} \in (\mathcal{S}^2)^4 : '
         r'\Gamma_i^T\Gamma_j \in \{0, -1\}, \forall i \neq j \right\}$, i.e. $\mathbf{\Gamma}^*$ '
         r'constructs a cross formation',
         'the coplanar ones of this set: it contains (e1, -e1, e2, e3), which is neither a cross '
         'nor coplanar')
def _cross_set(_system: SystemUnderTest) -> Pair:
    thickness, crosses = [], []
    for cosines in itertools.product((0.0, -1.0), repeat=6):
        values = np.linalg.eigvalsh(coordinates.cosine_matrix(np.array(cosines)))
        if values[0] > -1e-12 and values[0] < 1e-12:  # four vectors in space have this Gram matrix
            thickness.append(math.sqrt(max(values[1], 0.0)))
            if thickness[-1] < 1e-6:
                # A cross is two antipodal pairs, at right angles.
                crosses.append(sorted(cosines) == [-1.0, -1.0, 0.0, 0.0, 0.0, 0.0])
    return max(thickness), 1.0 - np.array(crosses)


@erratum('erratum-regularity', 'Thm:SF:stableEquiSet',
         r'if the function $f(\cdot)$ in control (\ref{eq:PF:Control}) is nonnegative and bounded '
         r'almost everywhere on $[0,\pi]$',
         'nonnegative and Lipschitz continuous: LaSalle needs solutions that depend continuously '
         'on the start; if f jumps, a solution can stay where the control is not zero')
def _regularity(system: SystemUnderTest) -> Pair:
    """Return the control where a solution stays: two agents in one place, one on either side."""
    edge = math.radians(130.0)

    def rate(alpha: float, gain: _Function) -> float:
        gamma = coordinates.from_angles(np.zeros(4), np.array([0.0, 0.0, alpha, -alpha]))
        east = np.array([-math.sin(alpha), math.cos(alpha), 0.0])
        return float(law.velocity(gamma, system.complete.weights, gain)[2] @ east)

    jump = _Function(lambda theta: np.where(theta < edge, 1.0, 0.5))
    below, above = rate(edge - 1e-9, jump), rate(edge + 1e-9, jump)
    # Both sides drive the solution to the edge, so that it stays there, where neither is zero.
    stays = min(below, -above)
    ramp = _Function(lambda theta: np.interp(theta, [edge - 0.05, edge + 0.05], [1.0, 0.5]))
    alpha = 2.0
    for _ in range(4000):
        alpha += 0.02 * rate(alpha, ramp)
    return max(stays, 0.0), rate(alpha, ramp)


class _Function(Gain):
    """A gain of any function, whether it satisfies an assumption or not."""

    function: Callable[[np.ndarray], np.ndarray]

    def __init__(self, function: Callable[[np.ndarray], np.ndarray]) -> None:
        object.__setattr__(self, 'function', function)

    def f(self, theta: Any, xp: Any = np) -> Any:
        """Return f at theta."""
        return self.function(np.asarray(theta))


@erratum('erratum-successor', 'As:RF:weighedgraph, Suc^k',
         r'(i+1)\, mod\, n, & if\; i+1 \neq k\\ (i+2)\, mod\, n, & if\; i+1 = k',
         'i mod n + 1, and once more if that is k; agents are 1..n')
def _successor(_system: SystemUnderTest) -> Pair:
    def printed(i: int, k: int) -> int:
        return (i + 1) % 4 if i + 1 != k else (i + 2) % 4

    def corrected(i: int, k: int) -> int:
        following = i % 4 + 1
        return following if following != k else following % 4 + 1

    def off(successor: Callable[[int, int], int]) -> int:
        """Return how many agents have a successor that is no agent, k, or themselves."""
        return sum(successor(i, k) not in {1, 2, 3, 4} - {i, k}
                   for i, k in itertools.permutations(range(1, 5), 2))

    agree = max(abs(topologies.rotating(k, 1).weights[i - 1, corrected(i, k) - 1] - 1.0)
                for i, k in itertools.permutations(range(1, 5), 2))
    return float(off(printed)), np.array([off(corrected), agree])


@erratum('erratum-derivative', 'eq:RF:SpeedDerive1',
         r'R_3\frac{\partial R_1}{\partial \phi_1}R_1\dot{\phi_1}',
         'R3 (dR2/dphi_1) R1 Gamma~_i dphi_1: R1 is a function of gamma; the two terms beside it '
         'lack their factor Gamma~_i, too')
def _derivative(system: SystemUnderTest) -> Pair:
    rng = system.rng
    xi_c, rates = rng.uniform(-1.0, 1.0, (2, 100, 3))
    shape = coordinates.normalized(sphere.random(rng, (100, 4)))
    phi, psi, gamma = np.moveaxis(xi_c, -1, 0)

    def difference(function: Callable[[Any], np.ndarray], x: Any) -> np.ndarray:
        slope: np.ndarray = (function(x + 1e-5) - function(x - 1e-5)) / 2e-5
        return slope

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
         r'\widetilde{\Gamma}_2=[-\frac{2\sqrt{2}}{3} ,0 ,-\frac{1}{3}]^T',
         'Gamma~_2 = [2 sqrt2/3, 0, -1/3]')
def _normalised(_system: SystemUnderTest) -> Pair:
    s2, s6 = math.sqrt(2.0), math.sqrt(6.0)
    points = np.array([[0.0, 0.0, 1.0], [2.0 * s2 / 3.0, 0.0, -1.0 / 3.0],
                       [-s2 / 3.0, s6 / 3.0, -1.0 / 3.0], [-s2 / 3.0, -s6 / 3.0, -1.0 / 3.0]])
    printed = points.copy()
    printed[1, 0] *= -1.0
    return [measures.pairwise_cosines(p) + 1.0 / 3.0 for p in (printed, points)]


@erratum('erratum-sense', 'Section 5, before the Proposition',
         r'\dot{\gamma}=-\frac{\sqrt{3}}{2}f(\theta^*)',
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


@erratum('erratum-period', 'Section 6', r'The period of this rotation is exactly $2\sqrt{3}\pi$',
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
         r'$f_1(\theta)=e^{-\theta}$ and $f_2(\theta)=\cos(\theta)+1$',
         'f1 = cos(theta) + 1, f2 = exp(-theta), as in the text; the period belongs to this f1')
def _captions(system: SystemUnderTest) -> Pair:
    # The period that the text reads off the figure tells which gain is f1.
    star, period = shapes.THETA_STAR, 2.0 * math.sqrt(3.0) * math.pi
    return [4.0 * math.pi / (math.sqrt(3.0) * f) - period
            for f in (math.exp(-star), system.gains[0].f(star))]


@erratum('erratum-exchange-sign', 'Appendix A.1',
         r'\lambda_i(\Lambda_n)=\lambda_{p(i)}(E_n)+\lambda_{q(i)}(J)',
         'lambda(E_n) - lambda(J), as Lambda_n = E_n - J')
def _exchange_sign(_system: SystemUnderTest) -> Pair:
    plus, minus = 0.0, 0.0
    for n in range(2, 12):
        ones, j = np.ones((n, n)), np.fliplr(np.eye(n))
        # The three commute: eigenvectors of a generic combination belong to each of them.
        vectors = np.linalg.eigh(ones + math.sqrt(2.0) * j)[1]
        of_ones, of_j, of_lambda = (
            np.sum(vectors * (matrix @ vectors), axis=0) for matrix in (ones, j, ones - j))
        plus = max(plus, np.max(np.abs(of_ones + of_j - of_lambda)))
        minus = max(minus, np.max(np.abs(of_ones - of_j - of_lambda)))
    return plus, minus


@erratum('erratum-constraint-row', 'Appendix A.2', r'A_E=[1,1,1,1]^T',
         'A_E = [1,1,1,1]: a row, as A_E X and [A_I^T A_E^T] are printed beside it')
def _constraint_row(_system: SystemUnderTest) -> Pair:
    x, a_i = np.zeros((4, 1)), np.vstack([-np.eye(4), np.eye(4)])

    def misfit(a_e: np.ndarray) -> int:
        """Return by how many rows or columns the two products are undefined."""
        return int(abs(a_e.shape[1] - x.shape[0]) + abs(a_i.T.shape[0] - a_e.T.shape[0]))

    row = np.ones((1, 4))
    return misfit(row.T), misfit(row)


@erratum('erratum-range', 'eq:SF:proofPoint', r'\psi^*_i=\frac{\pi}{4} + (i-1)\frac{\pi}{2}',
         'less 2 pi for i = 3, 4, as psi_i is in [-pi, pi)')
def _range(_system: SystemUnderTest) -> Pair:
    psi = np.pi / 4.0 + np.arange(4) * np.pi / 2.0
    wrapped = np.where(psi >= np.pi, psi - 2.0 * np.pi, psi)

    def outside(angle: np.ndarray) -> np.ndarray:
        return np.maximum(angle - np.pi, 0.0) + np.maximum(-np.pi - angle, 0.0)

    same = np.exp(1j * psi) - np.exp(1j * wrapped)
    return outside(psi), np.concatenate([outside(wrapped), np.abs(same)])
