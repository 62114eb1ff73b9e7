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

"""All that is drawn is in the picture, of bodies with mass too: without a browser."""

import itertools
import math
import time

from harness import DEADLINE
import msgspec
import numpy as np
import pytest
from rclpy.serialization import serialize_message
from tetra_ros2.formation import rotation
from tetra_ros2.physics.bodies import Part
from tetra_ros2.ros.body_markers import DISTANCE, make_body_markers
from tetra_ros2.viewer import server as servers
from tetra_ros2.viewer.bodies import Bodies
from tetra_ros2.viewer.camera import Cameras, REACH
from tetra_ros2.viewer.scene import FIELD_OF_VIEW
import viser
from websockets.sync.client import connect

POINTS = ((0.3, 0.0, 0.0), (0.0, 0.25, 0.0), (-0.3, 0.0, 0.1))
UP = np.array([0.0, 0.0, 1.0])


def hull(part):
    """Return points of a part of a body among which are its farthest, ``(k, 3)``."""
    size = np.array(part.size)
    if part.kind == 'arc':
        points = np.array(part.points)
    elif part.kind == 'box':
        points = 0.5 * size * list(itertools.product((-1, 1), repeat=3))
    elif part.kind == 'cylinder':
        turn = np.linspace(0.0, 2.0 * np.pi, 60)
        rim = 0.5 * size[0] * np.stack([np.cos(turn), np.sin(turn), 0.0 * turn], axis=-1)
        points = np.concatenate([rim + 0.5 * size[2] * UP, rim - 0.5 * size[2] * UP])
    else:
        points = np.random.default_rng(3).standard_normal((400, 3))
        points *= 0.5 * max(size) / np.linalg.norm(points, axis=1, keepdims=True)
    return np.array(part.position) + rotation.rotate(np.array(part.attitude), points)


class Camera:
    """What a browser of some size would show, as its server knows it."""

    def __init__(self, server, width, height, **message):
        self._socket = connect(f'ws://127.0.0.1:{server.get_port()}/', max_size=None,
                               subprotocols=[f'viser-v{viser.__version__}'])
        self._socket.send(msgspec.msgpack.encode({
            'type': 'ViewerCameraMessage', 'wxyz': [1.0, 0.0, 0.0, 0.0],
            'position': [3.0, 1.6, 1.5], 'fov': FIELD_OF_VIEW, 'near': 0.1, 'far': 100.0,
            'image_height': height, 'image_width': width, 'look_at': [0.0, 0.0, 0.0],
            'up_direction': [0.0, 0.0, 1.0], **message}))
        deadline = time.monotonic() + DEADLINE
        # viser has what is to be done for a new browser done in another thread.
        while not (server.get_clients() and server.placed):
            assert time.monotonic() < deadline, 'no browser'
            time.sleep(0.01)
        client, = server.get_clients().values()
        self.handle = client.camera

    def shows(self, points):
        """Return whether points are in the picture, ``(k, 3)``."""
        eye = np.array(self.handle.position)
        ahead = (np.array(self.handle.look_at) - eye) / np.linalg.norm(self.handle.look_at - eye)
        right = np.cross(ahead, UP) / np.linalg.norm(np.cross(ahead, UP))
        arm = points - eye
        half = math.tan(0.5 * FIELD_OF_VIEW) * (arm @ ahead)
        aspect = self.handle.image_width / self.handle.image_height
        return bool(np.all(np.abs(arm @ right) < half * aspect)
                    and np.all(np.abs(arm @ np.cross(right, ahead)) < half))

    def close(self):
        self._socket.close()


@pytest.fixture
def site(monkeypatch):
    server = servers.serve('127.0.0.1', 0)
    server.placed, watch = [], Cameras._watch_size

    def note(self, client):
        try:
            watch(self, client)
        finally:
            server.placed.append(client)

    monkeypatch.setattr(Cameras, '_watch_size', note)
    yield server, Bodies(server), Cameras(server)
    servers.stop(server)


@pytest.fixture
def look(site):
    cameras = []

    def open_(*args, **kwargs):
        cameras.append(Camera(site[0], *args, **kwargs))
        return cameras[-1]

    yield open_
    for camera in cameras:
        camera.close()


@pytest.mark.parametrize(('width', 'height'), [(790, 800), (412, 600), (390, 460), (1500, 1080)])
def test_bodies_beyond_the_sphere_are_in_the_picture_however_they_are_turned(
        site, look, width, height):
    _, bodies, cameras = site
    camera = look(width, height)
    rng = np.random.default_rng(1)
    for _ in range(20):
        gamma = rng.standard_normal(3)
        gamma /= np.linalg.norm(gamma)
        parts = []
        for kind in ('box', 'cylinder', 'sphere', 'arc'):
            turn = rng.standard_normal(4)
            parts.append(Part(
                0, kind, (0.2, 0.2, 0.5) if kind != 'arc' else (0.3,) * 3,
                tuple(0.2 * rng.uniform(-1.0, 1.0, 3)), tuple(turn / np.linalg.norm(turn)),
                POINTS if kind == 'arc' else ()))
        assert bodies.show(serialize_message(
            make_body_markers(1, [tuple(gamma)], parts)), time.monotonic())
        cameras.make_room(bodies.reach)
        for part in parts:
            points = DISTANCE * gamma + hull(part)
            assert np.max(np.linalg.norm(points, axis=1)) <= bodies.reach
            assert camera.shows(points)
    bodies.forget(math.inf)
    assert bodies.reach == 0.0


def test_who_came_closer_or_turned_it_is_left_alone_until_something_is_farther_out(site, look):
    _, _, cameras = site
    camera = look(800, 800)
    cameras.make_room(REACH)
    camera.handle.position = (0.0, 1.0, 0.5)
    for reach in (0.0, REACH):
        cameras.make_room(reach)
        assert np.linalg.norm(camera.handle.position) == pytest.approx(math.hypot(1.0, 0.5))
    cameras.make_room(1.62)
    x, y, z = camera.handle.position
    assert (x, y / z) == pytest.approx((0.0, 2.0)), 'from the same side'
    far = camera.handle.position
    cameras.make_room(1.63)  # too little to move back for
    assert np.array_equal(far, camera.handle.position)


@pytest.mark.parametrize('wrong', [
    {'image_width': 0}, {'position': [0.0, 0.0, 0.0]}, {'position': 'here'}, {'position': []},
    {'look_at': [3.0, 1.6, 1.5]}, {'up_direction': [0.0, 0.0, 0.0]}], ids=str)
def test_a_browser_that_says_nonsense_of_its_camera_disturbs_nobody(site, look, wrong):
    _, _, cameras = site
    look(800, 600, **wrong)
    cameras.make_room(2.0)
