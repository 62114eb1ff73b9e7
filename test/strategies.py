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

"""What hypothesis draws: points, attitudes, gains and graphs; bytes for nodes."""

import math
import struct

from hypothesis import strategies as st
import numpy as np
from tetra_ros2.formation import gain as gains
from tetra_ros2.formation.topology import Topology

seeds = st.integers(0, 2**32 - 1)


def assert_close(actual, expected, atol):
    """Assert that two arrays differ by no more than ``atol`` anywhere, whatever their size."""
    np.testing.assert_allclose(actual, expected, rtol=0.0, atol=atol)


def vectors(longest=1.0, size=3):
    """Vectors with components up to ``longest``, ``(size,)``."""
    return st.lists(
        st.floats(-longest, longest), min_size=size, max_size=size).map(np.array)


def unit_vectors(size=3):
    """Return unit vectors; they shrink to basis vectors."""
    long_enough = vectors(size=size).filter(lambda x: np.linalg.norm(x) > 0.1)
    return long_enough.map(lambda x: x / np.linalg.norm(x))


def quaternions():
    """Return unit quaternions x y z w, ``(4,)``."""
    return unit_vectors(size=4)


def formations(n):
    """Reduced attitudes of ``n`` agents, ``(n, 3)``."""
    return st.lists(unit_vectors(), min_size=n, max_size=n).map(np.array)


def attitudes(n):
    """Return unit quaternions of ``n`` bodies, ``(n, 4)``."""
    return st.lists(quaternions(), min_size=n, max_size=n).map(np.array)


@st.composite
def tangents(draw, longest=1.0):
    """Return a point on the sphere and a tangent vector there, up to ``longest`` long."""
    x = draw(unit_vectors())
    y = draw(unit_vectors())
    normal = np.cross(x, y)
    length = np.linalg.norm(normal)
    if length < 1e-3:
        normal = np.cross(x, np.eye(3)[np.argmin(np.abs(x))])
        length = np.linalg.norm(normal)
    return x, draw(st.floats(0.0, longest)) * normal / length


_SHAPES = {
    gains.Cosine: st.just(1.0),
    gains.Exponential: st.floats(0.1, 5.0),
    gains.Gaussian: st.floats(0.1, 2.0),
    gains.Linear: st.floats(0.1, 1.0),
    gains.Rational: st.floats(0.1, 5.0),
}


def any_gain():
    """Gains of all families."""
    return st.one_of([
        st.builds(family, st.floats(0.1, 10.0), b) for family, b in _SHAPES.items()])


@st.composite
def any_weights(draw, n):
    """Weights of a digraph on ``n`` agents, signed, some of them zero, ``(n, n)``."""
    weight = st.one_of(st.just(0.0), st.floats(-2.0, 2.0))
    matrix = np.array(draw(st.lists(weight, min_size=n * n, max_size=n * n))).reshape(n, n)
    np.fill_diagonal(matrix, 0.0)
    return matrix


def any_topology(n):
    """Return custom topologies of ``n`` agents."""
    return any_weights(n).map(lambda weights: Topology('custom', weights))


STRANGE = (0.0, -0.0, 1.0, 1e-320, 1e300, -1e308, math.inf, -math.inf, math.nan)


@st.composite
def broken(draw, good):
    """Return bytes that were a good message once: cut, lengthened, or with other bytes in it."""
    message = bytearray(good)
    for _ in range(draw(st.integers(0, 3))):
        at = draw(st.integers(0, max(len(message) - 1, 0)))
        what = draw(st.binary(min_size=1, max_size=8))
        message[at:at + len(what)] = what
    numbers = max((len(message) - 4) // 8, 0)
    for at in draw(st.sets(st.integers(0, max(numbers - 1, 0)), max_size=min(numbers, 3))):
        if draw(st.booleans()):
            message[4 + 8 * at:12 + 8 * at] = struct.pack('<d', draw(st.sampled_from(STRANGE)))
    length = draw(st.one_of(st.just(len(message)), st.integers(0, len(message))))
    return bytes(message[:length]) + draw(st.one_of(st.just(b''), st.binary(max_size=40)))


def any_bytes(good):
    """Return bytes of every kind: random ones, and good messages that were tampered with."""
    return st.one_of(st.binary(max_size=300), broken(good))
