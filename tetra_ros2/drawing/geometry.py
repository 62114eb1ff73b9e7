# Copyright 2026 The tetra_ros2 authors
# SPDX-License-Identifier: Apache-2.0

"""The solid that a formation spans, and the lines on the sphere under it."""

import itertools

import numpy as np

FLAT = 1e-6
"""A triple of points with less than twice this area [rad^2] is no face."""


def faces(gamma):
    """
    Return the faces of the convex hull of points on the sphere, as triangles.

    No point on a sphere lies inside the hull, so that a triple is a face if and only if all
    other points are on one side of it. For four agents these are the faces of the tetrahedron
    that they span, regular or not; for three, the one triangle.

    :param gamma: unit vectors, ``(n, 3)``
    :returns: indices from 0, counter-clockwise as seen from outside, ``(m, 3)``
    """
    gamma = np.asarray(gamma, dtype=float)
    if len(gamma) < 3:
        return np.empty((0, 3), dtype=int)
    triples = np.array(list(itertools.combinations(range(len(gamma)), 3)))
    a, b, c = (gamma[triples[:, k]] for k in range(3))
    normals = np.cross(b - a, c - a)
    lengths = np.linalg.norm(normals, axis=1)
    heights = normals @ gamma.T - np.sum(normals * a, axis=1, keepdims=True)
    slack = 1e-9
    outside = np.all(heights <= slack, axis=1)
    inside = np.all(heights >= -slack, axis=1)
    kept = (outside | inside) & (lengths > FLAT)
    flipped = np.where(outside[:, None], triples, triples[:, ::-1])
    return flipped[kept]


def graticule(step=30.0, points=73):
    """
    Return meridians and parallels of the unit sphere as polylines.

    :param step: angle between two of them [deg]
    :param points: of each line
    :returns: ``(lines, points, 3)``
    """
    turn = np.linspace(0.0, 2.0 * np.pi, points)
    lines = []
    for latitude in np.radians(np.arange(-90.0 + step, 90.0 - 1e-9, step)):
        lines.append(np.stack([np.cos(latitude) * np.cos(turn), np.cos(latitude) * np.sin(turn),
                               np.full(points, np.sin(latitude))], axis=-1))
    for longitude in np.radians(np.arange(0.0, 180.0 - 1e-9, step)):
        lines.append(np.stack([np.cos(turn) * np.cos(longitude), np.cos(turn) * np.sin(longitude),
                               np.sin(turn)], axis=-1))
    return np.array(lines)


def along_arc(start, end, points):
    """
    Return points on the great circle from one unit vector to another.

    :param start: ``(..., 3)``
    :param end: ``(..., 3)``
    :param points: how many, both ends among them
    :returns: ``(..., points, 3)``
    """
    fraction = np.linspace(0.0, 1.0, points)[:, None]
    start, end = np.asarray(start)[..., None, :], np.asarray(end)[..., None, :]
    cross = np.linalg.norm(np.cross(start, end), axis=-1, keepdims=True)
    theta = np.arctan2(cross, np.sum(start * end, axis=-1, keepdims=True))
    # Where the two ends are opposite or the same, the chord does as well as any circle.
    with np.errstate(divide='ignore', invalid='ignore'):
        arc = (np.sin((1.0 - fraction) * theta) * start + np.sin(fraction * theta) * end) / cross
    return np.where(cross > 1e-6, arc, (1.0 - fraction) * start + fraction * end)
