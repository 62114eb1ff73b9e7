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

"""Section 3: the tetrahedron, the control, and the closed loop."""

import itertools
import math

import numpy as np
from tetra_ros2.formation import bodies, controller, coordinates, law, rotation, sphere
from tetra_ros2.paper.formations import THIRD
from tetra_ros2.paper.registry import claim, Result, vanishes
from tetra_ros2.paper.system import SystemUnderTest


@claim('theta-star', 'eq:PF:OmegaT', 'four equal pairwise angles are theta* = arccos(-1/3)',
       'the determinant of the Gram matrix over one common cosine has one root inside (-1, 1)')
def _theta_star(_system: SystemUnderTest) -> Result:
    c = np.linspace(-0.999, 0.999, 40001)
    determinant = np.linalg.det(coordinates.cosine_matrix(np.repeat(c[:, None], 6, axis=1)))
    root = np.flatnonzero(np.diff(np.sign(determinant)))
    crossing = float(np.interp(
        0.0, determinant[root[0]:root[0] + 2], c[root[0]:root[0] + 2])) if len(root) else math.nan
    return Result(THIRD, crossing, 1e-7, len(root) == 1 and abs(crossing - THIRD) < 1e-7,
                  f'{len(root)} sign change of the determinant')


@claim('intrinsic', 'Rmk:PF:Control', 'the control only takes relative information',
       'every agent told y_ij in a body frame of its own commands R_i^T omega_i')
def _intrinsic(system: SystemUnderTest) -> Result:
    rng, worst = system.rng, 0.0
    for topology, gain in itertools.product((system.complete, system.rotating), system.gains):
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
                assert answer is not None  # the round is complete
                worst = max(worst, np.max(np.abs(
                    rotation.rotate(attitudes[i], answer) - expected[i])))
    return vanishes(worst, 1e-12)


@claim('closed-loop', 'eq:PF:ClosedSystem', 'dGamma_i/dt = Gamma_i^ sum f Gamma_i^ Gamma_j',
       'the law as commanded, into the kinematics, against the equation; both gains')
def _closed_loop(system: SystemUnderTest) -> Result:
    gamma = sphere.random(system.rng, (1000, 4))
    worst = 0.0
    for gain in system.gains:
        commanded = np.cross(
            law.world_angular_velocity(gamma, system.complete.weights, gain), gamma)
        theta = np.arccos(np.clip(gamma @ np.swapaxes(gamma, -1, -2), -1.0, 1.0))
        cross = np.cross(gamma[:, :, None], gamma[:, None])
        equation = np.cross(gamma, np.sum(
            ((1.0 - np.eye(4)) * gain.f(theta))[..., None] * cross, axis=-2))
        worst = max(worst, np.max(np.abs(commanded - equation)))
    return vanishes(worst, 1e-9)


@claim('rotational-invariance', 'Thm:PF:rotationalInvariant',
       'a rotated formation obeys the same equation',
       'velocity(Q Gamma) = Q velocity(Gamma) at random formations and rotations')
def _rotational_invariance(system: SystemUnderTest) -> Result:
    rng = system.rng
    gamma = sphere.random(rng, (1000, 4))
    turn = rotation.random(rng, (1000,))[:, None]
    worst = 0.0
    for topology, gain in itertools.product((system.complete, system.rotating), system.gains):
        here = law.velocity(gamma, topology.weights, gain)
        there = law.velocity(rotation.rotate(turn, gamma), topology.weights, gain)
        worst = max(worst, np.max(np.abs(there - rotation.rotate(turn, here))))
    return vanishes(worst, 1e-12)


@claim('angles', 'eq:PF:ClosedSysRPY1', 'the closed loop in roll-pitch-yaw angles',
       'chain rule on the law, random points, both gains; the printed form lacks a cosine')
def _angles(system: SystemUnderTest) -> Result:
    gamma = sphere.random(system.rng, (2000, 4))
    gamma = gamma[np.max(np.abs(gamma[..., 2]), axis=1) < 0.99]
    phi, psi = coordinates.angles(gamma)
    worst = 0.0
    for gain in system.gains:
        velocity = law.velocity(gamma, system.complete.weights, gain)
        phi_rate, psi_rate = coordinates.angle_velocity(phi, psi, 1.0 - np.eye(4), gain)
        worst = max(worst, np.max(np.abs(velocity[..., 2] / np.cos(phi) - phi_rate)),
                    np.max(np.abs((np.cos(psi) * velocity[..., 1] - np.sin(psi)
                                   * velocity[..., 0]) / np.cos(phi) - psi_rate)))
    return vanishes(worst, 1e-9)
