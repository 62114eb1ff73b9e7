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

"""``tetra viewer --bag``: a recording in a browser, with a time slider; no ROS in here."""

import argparse
from pathlib import Path
import signal
import threading
import time
from typing import Any

import numpy as np
from tetra_ros2 import signals
from tetra_ros2.drawing.theory import recognize, Theory
from tetra_ros2.recording import reader as recording
from tetra_ros2.recording.reader import Recording
from tetra_ros2.viewer import export
from tetra_ros2.viewer.history import History, WINDOW
from tetra_ros2.viewer.panel import FRAME_PERIOD, Page
from tetra_ros2.viewer.scene import Edge
from tetra_ros2.viewer.server import serve, stop
import viser

SPEEDS = {'¼': 0.25, '1': 1.0, '4': 4.0, '16': 16.0}


class Replay:
    """
    A recording that plays.

    :param page: a :class:`~tetra_ros2.viewer.panel.Page`
    :param loaded: a :class:`~tetra_ros2.recording.reader.Recording`
    """

    def __init__(self, page: Page, loaded: Recording) -> None:
        self._page, self._recording = page, loaded
        self._times = loaded.times
        self._end = float(self._times[-1])
        self._lock = threading.Lock()  # the buttons are pressed in the server's threads
        self._time = 0.0
        self._index: int | None = None  # of the state that is shown
        self._playing = True
        self._speed = 1.0
        # Nobody can press a button where all are locked: then it plays on and on.
        self._repeats = page.server.door.read_only
        page.know(_theory(loaded))
        page.edges = _edges(loaded)
        self._make_controls(page.server.gui)
        page.finish()

    def _make_controls(self, gui: viser.GuiApi) -> None:
        with gui.add_folder('recording', visible=not self._repeats):
            self._play = gui.add_button('Pause')
            # Fine enough for every pixel, and a number of steps that the slider can do.
            step = max(self._end / 2000.0, 1e-3)
            self._slider = gui.add_slider('time [s]', 0.0, self._end, step, 0.0)
            speed = gui.add_button_group('speed', tuple(SPEEDS))
        self._play.on_click(lambda _: self._toggle())
        self._slider.on_update(self._on_slider)
        speed.on_click(
            lambda _: setattr(self, '_speed', SPEEDS.get(speed.value, self._speed)))

    def _on_slider(self, event: viser.GuiEvent[Any]) -> None:
        if event.client is not None:  # a person's doing
            self.seek(float(self._slider.value))

    def _toggle(self) -> None:
        with self._lock:
            self._playing = not self._playing
            if self._playing and self._time >= self._end:
                self._time = 0.0

    def seek(self, moment: float) -> None:
        """Go to a time since the first state [s]."""
        with self._lock:
            self._time = min(max(moment, 0.0), self._end)

    def advance(self, elapsed: float) -> None:
        """Play so much further [s of wall time], and draw what is to be seen then."""
        with self._lock:
            if self._playing:
                self._time = min(self._time + elapsed * self._speed, self._end)
                self._playing = self._time < self._end or self._repeats
                if self._repeats and self._time >= self._end:
                    self._time = 0.0
            moment, playing = self._time, self._playing
        self._show(int(np.searchsorted(self._times, moment, side='right')) - 1)
        self._page.show(self._play, 'label', 'Pause' if playing else 'Play')
        self._page.show(self._slider, 'value', round(moment, 3))
        self._page.say(f'`{self._recording.path.name}`, {self._recording.n} agents, '
                       f'{"**playing**" if playing else "**paused**"}, '
                       f't = {moment:.2f} s of {self._end:.2f} s')
        self._page.draw()

    def _show(self, index: int) -> None:
        """Let the history be what it was at a state."""
        before, self._index = self._index, index
        stamps, gamma = self._recording.stamps, self._recording.gamma
        if before is None or not before <= index:
            self._page.history = History()
            self._page.history.fastest = self._page.theory.fastest
            before = int(np.searchsorted(self._times, self._times[index] - WINDOW)) - 1
        for k in range(before + 1, index + 1):
            if k == index or self._page.history.wants(stamps[k]):
                self._page.history.add(int(stamps[k]), gamma[k])
        self._page.history.started_at = int(stamps[0])


def _theory(loaded: Recording) -> Theory:
    """Return what a recording tells of the law."""
    law = loaded.law
    if law is None:
        return Theory(loaded.n)
    topology = recognize(law.rounded, law.gain, loaded.gamma[-1])
    return Theory(loaded.n, topology, law.gain, loaded.period)


def _edges(loaded: Recording) -> tuple[Edge, ...]:
    """Return who sees whom, with weights where the commands tell them."""
    if loaded.law is not None:
        return loaded.law.rounded.edges
    return tuple((i, j, None) for i, j in loaded.edges)


def write_page(arguments: argparse.Namespace) -> int:
    """
    Write a recording as a page that plays by itself.

    :param arguments: parsed arguments of ``tetra viewer``
    :returns: 0
    :raises ConfigurationError: if the recording cannot be read or the page not be written
    """
    signals.interrupt_once()  # it is work with an end, unlike all else that this command does
    path = Path(arguments.html)
    loaded = recording.load(arguments.bag, arguments.namespace or None)
    size = export.write(loaded, _edges(loaded), path)
    print(f'{path}: {size / 1e6:.2f} MB; open it in a browser')
    return 0


def run(arguments: argparse.Namespace) -> int:
    """
    Show a recording until a signal comes.

    :param arguments: parsed arguments of ``tetra viewer``
    :returns: 0
    :raises ConfigurationError: if the recording cannot be read or the port is taken
    """
    signalled = threading.Event()
    for number in signals.SIGNALS:
        signal.signal(number, lambda *_: signalled.set())
    loaded = recording.load(arguments.bag, arguments.namespace or None)
    page = Page(serve(arguments.host, arguments.port, arguments.read_only))
    replay = Replay(page, loaded)
    print(page.server.invitation, flush=True)
    last = time.monotonic()
    while not signalled.wait(FRAME_PERIOD):
        now = time.monotonic()
        replay.advance(now - last)
        last = now
    signals.ignore()
    stop(page.server)
    return 0
