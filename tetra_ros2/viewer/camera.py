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

"""Where the browsers' cameras stand: so far back that all that is drawn is in the picture."""

import contextlib
import math

import numpy as np
from numpy.typing import NDArray
from tetra_ros2.viewer.scene import CAMERA, FIELD_OF_VIEW
import viser

REACH = 1.3
"""Radius of what should be seen, of the sphere and of the labels about it."""

STRIDE = 0.1
"""Nobody wants to be moved back by less than this each time."""


class Cameras:
    """
    The cameras of all browsers.

    :param server: a ``viser.ViserServer``
    """

    def __init__(self, server: viser.ViserServer) -> None:
        self._server = server
        self._reach = REACH
        server.on_client_connect(self._watch_size)

    def make_room(self, reach: float) -> None:
        """
        Step back if it is needed to see what is drawn so far out.

        :param reach: distance from the middle of the sphere
        """
        if reach <= self._reach:
            return
        self._reach = STRIDE * math.ceil(reach / STRIDE)
        for client in self._server.get_clients().values():
            # What a browser says of its camera may be anything.
            with contextlib.suppress(ArithmeticError, TypeError, ValueError):
                needed = self._distance(client.camera)
                if 0.0 < np.linalg.norm(client.camera.position) < needed:
                    _place(client, client.camera.position, needed)

    def _watch_size(self, client: viser.ClientHandle) -> None:
        """Let a browser step back whenever its picture becomes so narrow that it cuts it off."""
        size = [0, 0]

        def step_back(camera: viser.CameraHandle) -> None:
            if size == [camera.image_width, camera.image_height]:
                return  # who turns it or comes closer wants to
            size[:] = camera.image_width, camera.image_height
            _place(client, np.array(CAMERA), self._distance(camera))

        client.camera.on_update(step_back)
        step_back(client.camera)

    def _distance(self, camera: viser.CameraHandle) -> float:
        """Return how far away a camera has to be."""
        aspect = camera.image_width / max(camera.image_height, 1)
        half = math.atan(math.tan(0.5 * FIELD_OF_VIEW) * min(aspect, 1.0))
        return max(float(np.linalg.norm(CAMERA)), self._reach / math.sin(half))


def _place(client: viser.ClientHandle, direction: NDArray[np.float64], distance: float) -> None:
    """Let a camera look at the middle of the sphere from that direction and distance."""
    with client.atomic():
        client.camera.position = tuple(direction * distance / np.linalg.norm(direction))
        client.camera.look_at = (0.0, 0.0, 0.0)  # which has moved along
