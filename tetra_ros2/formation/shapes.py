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
The shapes that are known to come out, and the motion that is known to be left.

This is for those who watch a formation. An agent has no use for it and never imports it.
"""

from dataclasses import dataclass, field
from functools import lru_cache
import math

import numpy as np
from tetra_ros2.formation import law, measures, rotation, sphere, stability
from tetra_ros2.formation._types import Array
from tetra_ros2.formation.gain import Cosine, Gain
from tetra_ros2.formation.symmetry import AdmissibleAngles
from tetra_ros2.formation.topology import Topology

THETA_STAR = math.acos(-1.0 / 3.0)
"""Pairwise angle of the regular tetrahedron [rad]; eq:PF:OmegaT."""

_S2, _S3 = math.sqrt(2.0), math.sqrt(3.0)


@dataclass(frozen=True, eq=False)
class Shape:
    """A reference shape: its name and one copy of it, unit vectors of shape ``(n, 3)``."""

    name: str
    points: Array = field(repr=False)

    @property
    def angles(self) -> Array:
        """Return the pairwise angles [rad] in ascending order, ``(n (n - 1) / 2,)``."""
        return np.sort(measures.pairwise_angles(self.points))


ANTIPODAL = Shape('antipodal pair', np.array([[1.0, 0.0, 0.0], [-1.0, 0.0, 0.0]]))
TRIANGLE = Shape('equilateral triangle on a great circle', np.array([
    [1.0, 0.0, 0.0], [-0.5, _S3 / 2.0, 0.0], [-0.5, -_S3 / 2.0, 0.0]]))
TETRAHEDRON = Shape('regular tetrahedron', np.array([
    [0.0, 0.0, 1.0],
    [2.0 * _S2 / 3.0, 0.0, -1.0 / 3.0],
    [-_S2 / 3.0, _S2 / _S3, -1.0 / 3.0],
    [-_S2 / 3.0, -_S2 / _S3, -1.0 / 3.0]]))
OCTAHEDRON = Shape('regular octahedron', np.concatenate([np.eye(3), -np.eye(3)]))


def known_shape(topology: Topology) -> Shape | None:
    """
    Return the shape that a topology is known to lead to, or None.

    That is the shape it was made for, if it was made for one. Under uniform weights these are
    the antipodal pair, the triangle, the tetrahedron and the octahedron, for n = 2, 3, 4 and 6.
    Beyond that, the tetrahedron keeps its shape, if not its attitude, under every weighted graph
    of four with ``W(i, j) + W(j, i) = (S_i + S_j) / 3``, where S are the row sums: that is ``d
    cos(theta_ij) / dt = 0`` at the tetrahedron. The paper's Graph As:RF:weighedgraph is one of
    these.

    :param topology: a :class:`~tetra_ros2.formation.topology.Topology`
    """
    if topology.shape is not None:
        return topology.shape
    weights, n = topology.weights, topology.n
    if np.any(weights < 0.0) or not np.any(weights):
        return None
    if n == 4:
        row_sums = np.sum(weights, axis=1)
        balance = 3.0 * (weights + weights.T) - (row_sums[:, None] + row_sums[None, :])
        if np.allclose(balance[~np.eye(4, dtype=bool)], 0.0, atol=1e-12 * np.max(weights)):
            return TETRAHEDRON
        return None
    uniform = np.all(weights == weights[0, 1] * (1.0 - np.eye(n)))
    return {2: ANTIPODAL, 3: TRIANGLE, 6: OCTAHEDRON}.get(n) if uniform else None


@lru_cache(maxsize=32)
def admissible_angles(topology: Topology) -> AdmissibleAngles:
    """
    Return the matrices of pairwise angles that count as the shape of a topology.

    :param topology: one for which :func:`known_shape` is not None
    """
    shape = known_shape(topology)
    assert shape is not None
    # The automorphisms of a ring are the symmetries of what it forms, however long it is.
    weights = None if topology.kind == 'ring' else topology.weights
    return AdmissibleAngles(shape.points, weights)


MOST_AGENTS = 60
"""Beyond so many agents :func:`reservation` does not compute eigenvalues."""


def reservation(topology: Topology, gain: Gain) -> str | None:
    """
    Say why a gain is a bad choice for a topology although its shape is known, or return None.

    :param topology: a :class:`~tetra_ros2.formation.topology.Topology`
    :param gain: a :class:`~tetra_ros2.formation.gain.Gain`
    """
    shape = known_shape(topology)
    if shape is None:
        return None
    if shape is ANTIPODAL and gain.f(np.pi) < 1e-9 * gain.f(0.0):
        return ('f(pi) = 0: two agents approach the antipodal pair only algebraically, as '
                '1 / sqrt(t); the exponential gain gets there')
    if topology.kind == 'ring' and topology.n % 2 == 0 and gain.f(np.pi) < 1e-9 * gain.f(0.0):
        return (f'f(pi) = 0: a ring of {topology.n} approaches the {shape.name} only '
                'algebraically; the exponential gain gets there')
    if shape is OCTAHEDRON and isinstance(gain, Cosine):
        return ('the equilibria of six agents under the cosine gain are a continuum, of which the '
                'octahedron is but one; the exponential gain gets there')
    if topology.shape is None or topology.n > MOST_AGENTS:
        return None
    there = stability.transverse(shape.points, topology.weights, gain)
    scale = float(gain.f(0.0) * np.max(np.abs(topology.weights)))
    if there.residual > 1e-6 * scale:
        return (f'the {shape.name} is no formation of these weights under this gain: it changes '
                f'its shape at {there.residual:.3g} 1/s')
    growing, neutral, _ = there.inertia
    if growing or neutral:
        why = ('it is not stable' if growing else
               f'it is one of a continuum of {neutral} dimensions')
        return (f'the {shape.name} will not come out under this gain: {why}; see '
                'docs/polyhedra.md for the gains that lead to it')
    return None


def _laid_over(gamma: Array, topology: Topology) -> Array:
    """Return the ideal copy of a topology's shape nearest to the formation at hand, (n, 3)."""
    shape = known_shape(topology)
    assert shape is not None
    ideal = shape.points[list(admissible_angles(topology).nearest(gamma))]
    fits = [rotation.rotate(rotation.align(points, gamma)[None, :], points)
            for points in (ideal, -ideal)]  # the latter is the mirror image
    return min(fits, key=lambda points: float(np.sum((points - gamma)**2)))


def predicted_angular_velocity(gamma: Array, topology: Topology, gain: Gain) -> Array:
    """
    Return the angular velocity [rad/s] at which theory lets the formation at hand spin.

    The ideal shape of the same chirality is laid over ``gamma``, and the law evaluated there. For
    the rotating topology the result has the magnitude ``sqrt(3)/2 f(theta*)`` of the paper's last
    proposition. Its direction is ``+Gamma_k`` or ``-Gamma_k``: p and the chirality decide
    together, and which chirality comes out is up to the start; see :func:`predicted_sense`.

    :param gamma: reduced attitudes near the shape, ``(n, 3)``
    :param topology: a topology for which :func:`known_shape` is not None
    :param gain: a :class:`~tetra_ros2.formation.gain.Gain`
    :returns: in the world frame, ``(3,)``
    """
    ideal = _laid_over(np.asarray(gamma, dtype=float), topology)
    return measures.angular_velocity(ideal, law.velocity(ideal, topology.weights, gain))


def chirality(gamma: Array, topology: Topology) -> int:
    """
    Return the handedness of a formation: 1 or -1, and 0 where its shape has none.

    Four agents have that of :func:`~tetra_ros2.formation.measures.chirality`. With other numbers
    it is 1 if the agents lie as the points of the shape do, and -1 if they are their mirror image.
    It is 0 if the shape is flat, not known, or one whose agents may change places.

    :param gamma: reduced attitudes, ``(n, 3)``
    :param topology: a :class:`~tetra_ros2.formation.topology.Topology`
    """
    if topology.n == 4:
        return int(measures.chirality(gamma))
    shape = known_shape(topology)
    if shape is None or np.linalg.matrix_rank(shape.points, tol=1e-6) < 3:
        return 0
    if len(admissible_angles(topology).permutations) > 1:
        return 0
    return int(np.sign(np.linalg.det(shape.points.T @ gamma)))


def axis_direction(gamma: Array, topology: Topology) -> Array | None:
    """
    Return the axis that a topology turns its formation about, a unit vector in the world.

    The axis is fixed in the formation. In the mirror image it is mirrored with it, so that a
    vertex remains a vertex, and the sense about it is the other one. The axis of a ring is the
    normal about which its agents follow one another counter-clockwise, each after the one before.

    :param gamma: reduced attitudes, ``(n, 3)``
    :param topology: a :class:`~tetra_ros2.formation.topology.Topology`
    :returns: ``(3,)``, or None if the topology has no axis or the formation is degenerate
    """
    if topology.axis_agent is not None:
        return np.asarray(gamma[topology.axis_agent - 1])
    if topology.axis is None:
        return None
    if topology.kind == 'ring':
        vector = np.sum(np.cross(gamma, np.roll(gamma, -1, axis=0)), axis=0)
    else:
        shape = known_shape(topology)
        assert shape is not None
        # e as a sum of the P_i; the same sum of the Gamma_i lies to them as e to the P_i.
        vector = np.linalg.pinv(shape.points.T) @ topology.axis @ gamma
    return sphere.normalize(vector) if np.linalg.norm(vector) > 1e-9 else None


def predicted_sense(topology: Topology, chirality: float) -> int:
    """
    Return in which sense a rotating formation spins about Gamma_k: 1 is counter-clockwise.

    Counter-clockwise as seen from outside the sphere, looking down on Gamma_k. Each of the three
    others flees the one it sees. Seen from there, for k = 1 and chirality 1, the succession 2, 3,
    4 runs clockwise, and in the mirror image counter-clockwise: hence the product.

    :param topology: a rotating topology
    :raises ValueError: if it is another one
    :param chirality: 1 or -1; see :func:`~tetra_ros2.formation.measures.chirality`
    """
    if topology.axis_agent is None:
        raise ValueError('this topology has no agent on an axis')
    # (k, Suc, Suc Suc, Suc Suc Suc) is an even permutation of (1, 2, 3, 4) for odd k only.
    clockwise = chirality if topology.axis_agent % 2 == 1 else -chirality
    return int(clockwise if topology.direction == 1 else -clockwise)
