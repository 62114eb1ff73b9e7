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

"""Section 5: the formation that spins."""

import itertools
import math

import numpy as np
from tetra_ros2.formation import coordinates, law, measures, shapes, sphere, stability
from tetra_ros2.formation import topology as topologies
from tetra_ros2.paper.claims._common import rate_of_run
from tetra_ros2.paper.differences import cosine_rates, FixedSlope, transverse_spectrum
from tetra_ros2.paper.formations import random_tetrahedra, TETRAHEDRON
from tetra_ros2.paper.registry import claim, equal, negative, Result, same_spectrum, vanishes
from tetra_ros2.paper.system import SystemUnderTest


@claim('weighted-graph', 'As:RF:weighedgraph',
       'weights 1/2 to and from k, p to the successor and 1 - p to the predecessor skipping k',
       'against the definition, all k and p; one agent sees all, the others form a cycle')
def _weighted_graph(system: SystemUnderTest) -> Result:
    worst = np.max(np.abs(system.rotating.weights - _defined_weights(1, 1)))
    for k, p in itertools.product((1, 2, 3, 4), (0, 1)):
        weights = topologies.rotating(k, p).weights
        worst = max(worst, np.max(np.abs(weights - _defined_weights(k, p))))
        others = [i for i in range(4) if i != k - 1]
        cycle = weights[np.ix_(others, others)]
        worst = max(worst, np.max(np.abs(np.linalg.matrix_power(cycle, 3) - np.eye(3))),
                    np.max(np.abs(np.sum(cycle, axis=0) - 1.0)), abs(np.trace(cycle @ cycle)))
    return vanishes(worst, 1e-15)


def _defined_weights(k: int, p: int) -> np.ndarray:
    """Return W of As:RF:weighedgraph from its own words, with the modulo counting from 1."""
    def successor(i: int) -> int:
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


@claim('triangular-weighted', 'eq:RF:newCorDynf1', 'so it is under the weighted graph',
       'chain rule on the law at random formations, both gains, against Graph As:RF:weighedgraph')
def _triangular_weighted(system: SystemUnderTest) -> Result:
    gamma = sphere.random(system.rng, (5000, 4))
    xi_s, worst = measures.pairwise_cosines(gamma), 0.0
    for gain in system.gains:
        closed = coordinates.cosine_velocity(xi_s, topologies.rotating().weights, gain)
        worst = max(worst, np.max(np.abs(
            closed - cosine_rates(gamma, system.rotating.weights, gain))))
    return vanishes(worst, 1e-9)


@claim('omega-t-invariant', 'thm:RF:LocalStable', 'Omega_T is invariant under the weighted graph',
       'rates of the cosines at random tetrahedra, both gains')
def _invariant(system: SystemUnderTest) -> Result:
    gamma = random_tetrahedra(system.rng, 200)
    return vanishes([np.max(np.abs(cosine_rates(gamma, system.rotating.weights, gain)))
                     for gain in system.gains], 1e-13)


def _hurwitz(system: SystemUnderTest, which: int) -> Result:
    gain = system.gains[which]
    found = transverse_spectrum(TETRAHEDRON, system.rotating.weights, gain)
    agreement = same_spectrum(found, stability.rotating_spectrum(gain))
    worst = float(np.max(found.real))
    return Result('< 0', worst, 0.0, worst < 0.0 and agreement.passed,
                  f'1/s; {agreement.measured:.1g} relative from the closed form')


claim('hurwitz-f1', 'thm:RF:LocalStable', 'the xi_s dynamics are Hurwitz; f1',
      'spectrum of the differentiated law in the turning frame', which=0)(_hurwitz)


claim('hurwitz-f2', 'thm:RF:LocalStable', 'the xi_s dynamics are Hurwitz; f2',
      'spectrum of the differentiated law in the turning frame', which=1)(_hurwitz)


@claim('hurwitz-any', 'thm:RF:LocalStable', 'so they are for every gain of As:SF:f',
       "largest real part over the spectral radius, F'/F from 1e-3 to 1e3")
def _hurwitz_any(system: SystemUnderTest) -> Result:
    worst = -math.inf
    for ratio in np.geomspace(1e-3, 1e3, 61):
        gain = FixedSlope(1.0, -ratio * math.sin(shapes.THETA_STAR))
        values = transverse_spectrum(TETRAHEDRON, system.rotating.weights, gain)
        worst = max(worst, float(np.max(values.real) / np.max(np.abs(values))))
    return negative(worst)


claim('rate-rotating-f1', 'thm:RF:LocalStable', 'exponential convergence, rotating graph, f1',
      'slowest mode in a run of the nodes', nodes=True, graph='rotating', which=0)(
          rate_of_run)


claim('rate-rotating-f2', 'thm:RF:LocalStable', 'exponential convergence, rotating graph, f2',
      'slowest mode in a run of the nodes', nodes=True, graph='rotating', which=1)(
          rate_of_run)


@claim('double-hat', 'Section 5', 'Gamma_i^ Gamma_i^ Gamma_j = cos(theta_ij) Gamma_i - Gamma_j',
       'identity at random pairs')
def _double_hat(system: SystemUnderTest) -> Result:
    x, y = sphere.random(system.rng, (2, 10000))
    left = np.cross(x, np.cross(x, y))
    return vanishes(left - (np.sum(x * y, axis=-1, keepdims=True) * x - y), 1e-14)


@claim('three-equations', 'Section 5',
       'on Omega_T: dphi_1 = dpsi_1 = 0 and sqrt3 f + 2 dgamma + 2 dpsi_1 sin(phi_1) = 0 (for '
       'the printed chirality)', 'derivative of xi_c along the law, random tetrahedra, both gains')
def _three_equations(system: SystemUnderTest) -> Result:
    gamma = random_tetrahedra(system.rng, 100)
    gamma = gamma[np.abs(gamma[:, 0, 2]) < 0.95]
    handed = measures.chirality(gamma) * measures.chirality(TETRAHEDRON)
    worst = 0.0
    for gain in system.gains:
        velocity = law.velocity(gamma, system.rotating.weights, gain)
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
def _at_rest(system: SystemUnderTest) -> Result:
    speeds = []
    for gain in system.gains:
        run = system.run('rotating', gain)
        speeds.append(np.linalg.norm(run.gamma[-1, 0] - run.gamma[-2, 0]) / run.h)
    return vanishes(speeds, 1e-6, 'rad/s')


def _spin(system: SystemUnderTest, which: int) -> Result:
    gain = system.gains[which]
    predicted = math.sqrt(3.0) / 2.0 * gain.f(shapes.THETA_STAR)
    measured = float(np.linalg.norm(system.run('rotating', gain).angular_velocity()))
    return equal(predicted, measured, 1e-3 * predicted, 'rad/s; tolerance 1e-3 relative')


claim('spin-f1', 'Section 5, Proposition', 'the formation spins at sqrt(3)/2 f(theta*); f1',
      'angular velocity at the end of a run of the nodes', nodes=True, which=0)(_spin)


claim('spin-f2', 'Section 5, Proposition', 'the formation spins at sqrt(3)/2 f(theta*); f2',
      'angular velocity at the end of a run of the nodes', nodes=True, which=1)(_spin)


@claim('sense', 'Section 5, Proposition',
       'it turns clockwise about Gamma_1 for the chirality printed, the other way for its mirror',
       'sense of rotation in runs of the nodes that end in either chirality', nodes=True)
def _sense(system: SystemUnderTest) -> Result:
    wrong, seen = 0, set()
    gain = system.gains[0]
    for seed in range(8):
        run = system.run('rotating', gain, seed)
        handed = int(measures.chirality(run.gamma[-1]) * measures.chirality(TETRAHEDRON))
        seen.add(handed)
        wrong += int(np.sign(run.angular_velocity() @ run.gamma[-1, 0]) != -handed)
        if len(seen) == 2:
            break
    return Result(0, wrong, 0, wrong == 0 and len(seen) == 2,
                  f'{len(seen)} chiralities seen in {seed + 1} runs')
