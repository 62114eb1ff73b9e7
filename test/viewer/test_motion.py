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

"""In motion, axis, solid and label stay together: measured in the pixels of a real browser."""

import itertools
import threading
import time

from browser import CHEAP_PICTURES, dismiss, has_hue, open_page, pixels, until
import numpy as np
import pytest
from tetra_ros2.drawing import colors
from tetra_ros2.formation import rotation, shapes
from tetra_ros2.viewer import server as servers
from tetra_ros2.viewer.scene import LABEL_HEIGHT, Scene

RATE = 2.5
"""How fast it turns [rad/s]: two degrees behind are five pixels."""

SOLID = '#00e000'
AXIS = np.array([0.45, 0.2, 0.87]) / np.linalg.norm([0.45, 0.2, 0.87])

pytestmark = pytest.mark.timeout(300)


class Turning:
    """A tetrahedron that turns before the browser's eyes, and changes its shape as it does."""

    def __init__(self, period):
        self.server = servers.serve('127.0.0.1', 0)
        self.scene = Scene(self.server)
        self._period, self._ended = period, threading.Event()
        self._thread = threading.Thread(target=self._run)

    def __enter__(self):
        self._thread.start()
        return self

    def __exit__(self, *_):
        self._ended.set()
        self._thread.join()
        servers.stop(self.server)

    def _run(self):
        begun = time.monotonic()
        while not self._ended.wait(self._period):
            t = time.monotonic() - begun
            gamma = rotation.rotate(rotation.exp(RATE * t * AXIS), shapes.TETRAHEDRON.points)
            gamma = gamma + 0.2 * np.sin(0.7 * t) * AXIS
            gamma /= np.linalg.norm(gamma, axis=1, keepdims=True)
            self.scene.draw(gamma, gamma[None], ())


def middle_of(mask, around, radius):
    """Return the middle of the marked pixels near a place, x and y, or None."""
    y, x = np.nonzero(mask)
    near = np.hypot(x - around[0], y - around[1]) < radius
    return np.array([x[near].mean(), y[near].mean()]) if np.any(near) else None


def measure(image):
    """Return for each agent seen well how far solid and label are from its tip [px]."""
    center = np.array([image.shape[1], image.shape[0]]) / 2.0
    y, x = np.mgrid[:image.shape[0], :image.shape[1]]
    arm = np.stack([x, y], axis=-1) - center
    distance = np.linalg.norm(arm, axis=-1)
    angle = np.arctan2(arm[..., 1], arm[..., 0])
    solid = has_hue(image, colors.rgb(SOLID), 15.0, 0.08) & (distance > 40.0)
    ink = (np.max(image, axis=-1) < 140) & (np.ptp(image, axis=-1) < 25)
    tips = {}
    for i in range(1, 5):
        mask = has_hue(image, colors.rgb(colors.agent(i)), 8.0, 0.35)
        if np.count_nonzero(mask) > 100:
            reach = np.max(distance[mask])
            tips[i] = np.array([x[mask & (distance > reach - 13.0)].mean(),
                                y[mask & (distance > reach - 13.0)].mean()])
    found = []
    for i, tip in tips.items():
        others = [np.linalg.norm(tip - other) for j, other in tips.items() if j != i]
        out = tip - center
        if np.linalg.norm(out) < 120.0 or min(others, default=0.0) < 110.0:
            continue  # it points at the eye, or is behind another
        off = np.abs((angle - np.arctan2(out[1], out[0]) + np.pi) % (2.0 * np.pi) - np.pi)
        corner = solid & (off < 0.5)
        far = corner & (distance > np.max(distance[corner]) - 2.0)
        label = middle_of(ink, center + LABEL_HEIGHT * out, 50.0)
        found.append((np.linalg.norm([x[far].mean() - tip[0], y[far].mean() - tip[1]]),
                      np.inf if label is None else np.linalg.norm(
                          label - center - LABEL_HEIGHT * out)))
    return found


@pytest.mark.parametrize(('period', 'slow'), [(1 / 30, True), (0.2, False)], ids=[
    'in a browser that draws 5 pictures a second', 'with 5 states a second'])
def test_axis_solid_and_label_stay_together_in_motion(chromium, monkeypatch, period, slow):
    monkeypatch.setattr(colors, 'FACE', SOLID)
    context = chromium.new_context(viewport={'width': 640, 'height': 560})
    if slow:
        context.add_init_script(CHEAP_PICTURES)
    try:
        with Turning(period) as turning:
            turning.server.gui.main_panel.float()  # and out of the picture's way
            page = open_page(context, turning.server.address)
            page.get_by_text('tetra_ros2').first.wait_for()
            page.locator('canvas').first.wait_for()
            dismiss(page)
            page.add_style_tag(content='[class*=mantine-Paper] { opacity: 0 }')
            until(page, lambda: (seen := measure(pixels(page))) and np.all(np.isfinite(seen)),
                  'axes with labels')
            pictures, found = [], []
            while len(pictures) < 9 or (len(found) <= 10 and len(pictures) < 40):
                pictures.append(pixels(page))
                found += measure(pictures[-1])
                page.wait_for_timeout(60)
            pixels(page, f'motion_{period:.2f}_{slow}')
    finally:
        context.close()
    assert np.mean([np.any(a != b) for a, b in itertools.pairwise(pictures)]) > 0.7
    assert len(found) > 10, 'tips that can be seen'
    corner, label = np.quantile(found, 0.8, axis=0)  # here and there one is half hidden
    print(f'{len(found)} tips: solid {corner:.1f} px away, label {label:.1f}')
    assert corner < 13.0, 'the tip is a ball of 8 pixels in radius'
    assert label < 13.0
