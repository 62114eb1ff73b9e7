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

"""Topologies whose weights are made for a shape: the Platonic solids, rings, given points."""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from tetra_ros2.formation import measures, polyhedra, rings, sphere
from tetra_ros2.formation.shapes import Shape
from tetra_ros2.formation.topology import Topology

AXES = polyhedra.AXES


def number_of_vertices(solid: str) -> int:
    """Return how many agents a Platonic solid needs."""
    return len(polyhedra.SOLIDS[solid])


def polyhedron(name: str, class_weights: Sequence[float] = (), axis: str | np.ndarray = 'vertex',
               spin: float = 0.0) -> Topology:
    """
    Return the graph under which agents form a Platonic solid, at rest or turning.

    :param name: one of :data:`~tetra_ros2.formation.polyhedra.SOLIDS`
    :param class_weights: S_c of each class of distance, nearest first; empty for those recommended
    :param axis: vertex, edge, face, or a vector in the frame of the solid's vertices
    :param spin: from -1 to 1, as a share of the largest spin without a negative weight; greater
        than 0 is counter-clockwise about the axis, and the other way in the mirror image
    :raises ValueError: if the weights are not as many as the classes, or all zero; if the axis has
        no direction; if the spin is out of range
    """
    points = polyhedra.SOLIDS[name]
    strengths = np.array(class_weights or polyhedra.CLASS_WEIGHTS[name], dtype=float)
    classes = len(polyhedra.distance_classes(points).angles)
    if len(strengths) != classes:
        raise ValueError(f'{len(strengths)} weights are not valid, the {name} has {classes} '
                         'classes of distance')
    if not np.any(strengths):
        raise ValueError('at least one class must have a weight')
    if not -1.0 <= spin <= 1.0:
        raise ValueError(f'spin must be from -1 to 1, not {spin!r}')
    direction = polyhedra.axis_direction(points, axis)
    shape = Shape(f'regular {name}' if name != 'cube' else name, points)
    weights = polyhedra.weights(points, strengths, direction, spin)
    if spin == 0.0:
        return Topology('polyhedron', weights, shape=shape)
    along = points @ direction
    agent = int(np.argmax(along)) + 1 if np.max(along) > 1.0 - 1e-12 else None
    if agent is not None:
        words = f'the direction of agent_{agent}'
    elif isinstance(axis, str):
        *first, last = polyhedra.axis_agents(points, axis)
        words = f'the middle of agents {", ".join(map(str, first))} and {last}'
    else:
        words = f'the axis [{", ".join(f"{x:.4g}" for x in direction)}] of the {name}'
    return Topology('polyhedron', weights, axis_agent=agent, shape=shape, axis=direction,
                    axis_name=words)


def ring(n: int, spin: float = 0.0) -> Topology:
    """
    Return the graph in which every agent sees the one before it and the one after it.

    :param n: number of agents, at least 2
    :param spin: from -1 to 1; greater than 0 turns the star of an odd number in the order of the
        agents
    :raises ValueError: if n or the spin is out of range
    """
    if n < 2:
        raise ValueError(f'a ring has at least 2 agents, not {n}')
    if not -1.0 <= spin <= 1.0:
        raise ValueError(f'spin must be from -1 to 1, not {spin!r}')
    turns = n % 2 == 1 and spin != 0.0
    return Topology(
        'ring', rings.weights(n, spin), shape=Shape(rings.name(n), rings.points(n)),
        axis=np.array([0.0, 0.0, 1.0]) if turns else None,
        axis_name='the normal of its plane, in the order of the agents' if turns else None)


def directions(numbers: Sequence[float]) -> np.ndarray:
    """
    Return numbers, three for each direction, as unit vectors, ``(n, 3)``.

    :raises ValueError: if they are not a multiple of three, or a direction is zero
    """
    if len(numbers) % 3:
        raise ValueError(f'{len(numbers)} numbers are not valid, expected 3 for each agent')
    points = np.array(numbers, dtype=float).reshape(-1, 3)
    for index, point in enumerate(points):
        try:
            sphere.normalize(point)
        except ValueError as error:
            raise ValueError(
                f'{point.tolist()} of agent {index + 1} is not valid: {error}') from None
    return sphere.normalize(points)


def given(topology: Topology, points: np.ndarray) -> Topology:
    """
    Return a graph that is known to have been made for given points.

    :param topology: any topology
    :param points: the directions, unit vectors, ``(n, 3)``
    :raises ValueError: if there are not n of them
    """
    if points.shape != (topology.n, 3):
        raise ValueError(f'{points.size} numbers are not valid, expected {3 * topology.n} for '
                         f'{topology.n} agents')
    return replace(topology, shape=Shape(name(points), points))


def name(points: np.ndarray) -> str:
    """Return the name of the shape that unit vectors have, or what it was made from."""
    n, angles = len(points), np.sort(measures.pairwise_angles(points))
    for solid, vertices in polyhedra.SOLIDS.items():
        if len(vertices) == n and np.allclose(
                np.sort(measures.pairwise_angles(vertices)), angles, rtol=0.0, atol=1e-5):
            return f'regular {solid}' if solid != 'cube' else solid
    return f'formation of {n} given directions'
