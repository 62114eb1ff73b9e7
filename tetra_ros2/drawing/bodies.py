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

"""Bodies with mass in the flat picture: a box with its wheels, a gimbal on its base."""

from collections.abc import Callable, Mapping, Sequence
import math
from typing import Any

from matplotlib.collections import LineCollection
from matplotlib.patches import Polygon
import numpy as np
from tetra_ros2.drawing import colors
from tetra_ros2.drawing.picture import LIGHT
from tetra_ros2.formation import rotation
from tetra_ros2.formation._types import Array, JointLimits

DISTANCE = 1.3
"""How far from the middle of the sphere a body is drawn, along where it points."""

REACH = 1.72
"""How far a picture with bodies goes."""

SIZE = 1.7
"""How large a metre is drawn: the sphere has the radius 1."""

ARC_RADIUS = 0.16
"""Of the arcs that show how far the joints of a gimbal can go [m]."""

AT_LIMIT = '#d1242f'
NEAR = 0.01
"""A joint this near to an end of its range is drawn as being there [rad]."""

PAN, TILT = 'pan', 'tilt'


def _box(sides: Sequence[float], middle: Sequence[float] = (0.0, 0.0, 0.0)) -> list[Array]:
    """Return the faces of a box, each as its corners, counted against the clock from outside."""
    faces = []
    for k in range(3):
        for sign in (1.0, -1.0):
            normal, u, v = (np.eye(3)[(k + m) % 3] for m in range(3))
            corners = [sign * normal + a * u + b * v
                       for a, b in ((-1, -1), (1, -1), (1, 1), (-1, 1))[::int(sign)]]
            faces.append(0.5 * np.array(sides) * np.array(corners) + np.array(middle))
    return faces


def _disc(axis: int, radius: float, begin: float, end: float, points: int = 18) -> list[Array]:
    """Return the faces of a cylinder along one of the axes."""
    turn = np.linspace(0.0, 2.0 * np.pi, points, endpoint=False)
    normal, u, v = (np.eye(3)[(axis + m) % 3] for m in range(3))
    rim = radius * (np.cos(turn)[:, None] * u + np.sin(turn)[:, None] * v)
    low, high = rim + begin * normal, rim + end * normal
    sides = [np.array([low[k - 1], low[k], high[k], high[k - 1]]) for k in range(points)]
    return [high, low[::-1], *sides]


_BOX = _box((0.16, 0.14, 0.12))
_WHEELS = [_disc(axis, 0.05, face, face + 0.024)
           for axis, face in enumerate((0.08, 0.07, 0.06))]
_HEAD = _box((0.12, 0.09, 0.09)) + _disc(0, 0.03, 0.06, 0.1)
_YOKE = (_box((0.04, 0.02, 0.16), (0.0, 0.07, -0.04))
         + _box((0.04, 0.02, 0.16), (0.0, -0.07, -0.04)) + _disc(2, 0.05, -0.16, -0.12))


def draw(axes: Any, see: Callable[[Array], Array], gamma: Array, attitudes: Array,
         joints: Mapping[int, tuple[Sequence[str], Array]],
         limits: Mapping[str, JointLimits]) -> None:
    """
    Draw bodies where they point, as they are turned.

    :param axes: matplotlib's
    :param see: a :class:`~tetra_ros2.drawing.picture.Camera`
    :param gamma: reduced attitudes, ``(n, 3)``
    :param attitudes: unit quaternions x y z w, body to world, ``(n, 4)``
    :param joints: for each agent, from 1, whose body has any: their names and positions [rad]
    :param limits: what the joints can do, by their names
    """
    for i, (names, positions) in sorted(
            joints.items(), key=lambda item: float(see(gamma[item[0] - 1])[2])):
        place, attitude = gamma[i - 1], attitudes[i - 1]
        depth = float(see(place)[2])
        middle = DISTANCE * place
        hidden = depth < 0.0 and float(np.hypot(*see(middle)[:2])) < 1.0
        faces: list[tuple[Array, str]] = []
        if tuple(names) == (PAN, TILT):
            base, turned = _frames(attitude, place, positions)
            faces += _placed(_HEAD, rotation.multiply(turned, _about(1, positions[1])), middle,
                             colors.agent(i))
            faces += _placed(_YOKE, turned, middle, colors.MUTED)
            _arcs(axes, see, middle, base, turned, positions, limits, i, 8.0 + depth)
        else:
            faces += _placed(_BOX, attitude, middle, colors.agent(i))
            for wheel in _WHEELS[:len(names)]:
                faces += _placed(wheel, attitude, middle, colors.MUTED)
        _faces(axes, see, faces, 0.3 if hidden else 1.0, 8.0 + depth)


def _about(axis: int, angle: float) -> Array:
    """Return the unit quaternion of a turn about one of the axes."""
    turn = np.zeros(4)
    turn[axis], turn[3] = math.sin(0.5 * angle), math.cos(0.5 * angle)
    return turn


def _frames(attitude: Array, place: Array, positions: Array) -> tuple[Array, Array]:
    """Return the attitudes of base and yoke of a gimbal, from where its body points."""
    axis = rotation.rotate(rotation.inverse(attitude), place)
    level = rotation.multiply(attitude, rotation.between(np.array([1.0, 0.0, 0.0]), axis))
    turned = rotation.multiply(level, _about(1, -positions[1]))
    return rotation.multiply(turned, _about(2, -positions[0])), turned


def _placed(faces: Sequence[Array], attitude: Array, middle: Array, color: str
            ) -> list[tuple[Array, str]]:
    return [(middle + SIZE * rotation.rotate(attitude, face), color) for face in faces]


def _faces(axes: Any, see: Callable[[Array], Array], faces: Sequence[tuple[Array, str]],
           opacity: float, order: float) -> None:
    """Draw the faces that are turned towards the eye, the nearest last."""
    shown = []
    for corners, color in faces:
        seen = see(corners)
        normal = np.cross(seen[1] - seen[0], seen[2] - seen[1])
        if normal[2] > 0.0:
            light = float(normal @ LIGHT) / float(np.linalg.norm(normal))
            shown.append((float(np.mean(seen[:, 2])), seen, color, light))
    for k, (_, seen, color, light) in enumerate(sorted(shown, key=lambda face: face[0])):
        share = 0.55 + 0.4 * max(light, -0.5)  # of the colour; the rest is black or white
        shade = [min(1.0, 0.25 * share + share * c) for c in colors.unit_rgb(color)]
        axes.add_patch(Polygon(seen[:, :2], closed=True, facecolor=shade, edgecolor=shade,
                               linewidth=0.3, alpha=opacity, zorder=order + 1e-4 * k))


def _arcs(axes: Any, see: Callable[[Array], Array], middle: Array, base: Array, turned: Array,
          positions: Array, limits: Mapping[str, JointLimits], i: int, order: float) -> None:
    """Draw how far the joints can go, in red for one that can go no further."""
    for k, (name, frame) in enumerate(((PAN, base), (TILT, turned))):
        limit = limits.get(name, JointLimits())
        if not math.isfinite(limit.high - limit.low):
            continue
        angles = np.linspace(limit.low, min(limit.high, limit.low + 2.0 * np.pi), 49)
        c, s, o = np.cos(angles), np.sin(angles), np.zeros_like(angles)
        points = ARC_RADIUS * np.stack([c, o, -s] if k else [c, s, o], axis=1)
        seen = see(middle + SIZE * rotation.rotate(frame, points))
        stuck = min(positions[k] - limit.low, limit.high - positions[k]) < NEAR
        axes.add_collection(LineCollection(
            [seen[:, :2]], colors=AT_LIMIT if stuck else colors.agent(i),
            linewidths=2.4 if stuck else 1.2, zorder=order + 0.5))
