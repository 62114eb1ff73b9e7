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

"""``tetra viewer --bag --html``: a recording as one page that plays in any browser by itself."""

from collections.abc import Callable, Iterator
import contextlib
import html
import io
from pathlib import Path

import numpy as np
from tetra_ros2.config.parameters import ConfigurationError
from tetra_ros2.recording.reader import Recording
from tetra_ros2.viewer.scene import CAMERA, Edge, Scene, TRAIL
from tetra_ros2.viewer.server import serve, stop
from tetra_ros2.viewer.skin import dress

PICTURES_PER_SECOND = 20.0

MOST_PICTURES = 1200
"""A longer recording has fewer pictures a second, so that the page stays small."""

GRAIN = 2.0 ** -13
"""Directions are rounded to multiples of this: nobody sees it, and it makes the page smaller."""

FURTHER = 1.15
"""How much further away the eye is than in the live page: this page does not know its shape."""

CAPTION = ('<div style="position:fixed;z-index:5;left:0;right:0;top:0;padding:0.6em 1em;'
           'font:14px system-ui,sans-serif;color:#24292f;pointer-events:none">{}</div>')


def write(recording: Recording, edges: tuple[Edge, ...], path: Path,
          progress: Callable[[float], None] | None = None) -> int:
    """
    Write a recording as one page, with its own time bar.

    :param recording: what to show
    :param edges: (i, j, weight) for each j that agent i sees, from 1; weight may be None
    :param path: to write to
    :param progress: called with how much is done, from 0 to 1
    :returns: the size of the page [bytes]
    :raises ConfigurationError: if it cannot be written
    """
    if path.is_dir():
        raise ConfigurationError('is a directory, expected the name of a file', source=path)
    new = not path.exists()
    with _naming(path):
        path.touch()  # before the work, not after it
    try:
        document = _make(recording, edges, progress)
    except BaseException:
        if new:
            path.unlink(missing_ok=True)
        raise
    with _naming(path):
        path.write_bytes(document)
    return len(document)


@contextlib.contextmanager
def _naming(path: Path) -> Iterator[None]:
    """Say which file it is that cannot be written."""
    try:
        yield
    except OSError as error:
        raise ConfigurationError(
            f'cannot be written to: {error.strerror}', source=path) from None


def _make(recording: Recording, edges: tuple[Edge, ...],
          progress: Callable[[float], None] | None) -> bytes:
    """Return the page."""
    duration = float(recording.times[-1])
    count = min(max(int(duration * PICTURES_PER_SECOND) + 1, 2), MOST_PICTURES)
    moments = np.linspace(0.0, duration, count)
    shown = np.searchsorted(recording.times, moments, side='right') - 1
    gamma = np.round(recording.gamma[shown] / GRAIN) * GRAIN
    # As if it had stood still before: then every trail is the one before, moved on by one.
    before = np.concatenate([np.repeat(gamma[:1], TRAIL, axis=0), gamma])
    server = serve('127.0.0.1', 0, read_only=True)
    try:
        scene = Scene(server)
        server.initial_camera.position = tuple(FURTHER * np.array(CAMERA))
        scene.draw(gamma[0], before[:TRAIL + 1], edges)
        serializer = server.get_scene_serializer()
        for k in range(1, count):
            serializer.insert_sleep(float(moments[k] - moments[k - 1]))
            scene.draw(gamma[k], before[k:k + TRAIL + 1], edges)
            if progress is not None:
                progress((k + 1) / count)
        with contextlib.redirect_stdout(io.StringIO()):
            page = serializer.as_html()
    finally:
        stop(server)
    caption = CAPTION.format(html.escape(
        f'{recording.path.name}: {recording.n} agents, {duration:.4g} s. '
        'Drag to turn, scroll to come closer, space to stop.'))
    return dress(page.encode()).replace(b'</body>', f'{caption}</body>'.encode(), 1)
