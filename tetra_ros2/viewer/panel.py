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

"""The page: scene, panel and charts, and what is shown in them when."""

import math
import time
from typing import Any

from tetra_ros2.drawing import colors
from tetra_ros2.drawing.theory import table, Theory
from tetra_ros2.viewer.camera import Cameras
from tetra_ros2.viewer.charts import Charts, MOST_VALUES
from tetra_ros2.viewer.history import History
from tetra_ros2.viewer.scene import Edge, MOST_AGENTS, Scene
from tetra_ros2.viewer.server import Server
import viser

FRAME_PERIOD = 1.0 / 30.0
"""How often the scene is drawn [s]."""

CHART_PERIOD = 0.5
"""How often charts and numbers are drawn [s]; a person reads no faster."""

BROWSERS = 6
"""So many browsers are served at full pace; more of them share it."""

TRAIL = 3.0
"""How far the trails reach back [s]."""

SPEEDS = {'¼': 0.25, '1': 1.0, '4': 4.0, '10': 10.0, 'max': 0.0}
"""Seconds of formation time per second; 0, as the plant has it, for as fast as it goes."""

GAINS = (1e-3, 1e3)
"""Between which values the page sets the gain [rad/s]."""

RESET, RANDOM = 'Reset', 'New random start'


class Page:
    """
    What all browsers see; one for all of them, so that they see the same.

    :param server: a :class:`~tetra_ros2.viewer.server.Server`
    """

    def __init__(self, server: Server) -> None:
        self.server = server
        self.history = History()
        self.theory = Theory(0)
        self.edges: tuple[Edge, ...] = ()
        self._known_at = -math.inf  # since when theory has been what it is [s]
        self._scene = Scene(server)
        self.cameras = Cameras(server)
        self._status = server.gui.add_markdown('')
        self._legend = server.gui.add_html('')
        self._shown: dict[Any, Any] = {}
        self._charts_at = self._scene_at = 0.0
        self._drawn: Any = None

    @property
    def watched(self) -> bool:
        """Return whether there is a browser."""
        return bool(self.server.get_clients())

    @property
    def period(self) -> float:
        """Return how often to draw the scene [s]: seldom for very many browsers."""
        return FRAME_PERIOD * max(1.0, len(self.server.get_clients()) / BROWSERS)

    def finish(self) -> None:
        """Put in what comes below the controls: numbers and charts."""
        gui = self.server.gui
        self._arrows = gui.add_checkbox('arrows: who sees whom', True, visible=False)
        self._arrows.on_update(self._show_arrows)
        with gui.add_folder('theory and measurement'):
            self._table = gui.add_markdown('')
        self._charts = Charts(gui, gui.add_folder('charts'))

    def _show_arrows(self, event: viser.GuiEvent[Any]) -> None:
        if event.client is not None:  # a person's doing
            self._scene.show_edges = bool(self._arrows.value)
            self._drawn = None

    def know(self, theory: Theory) -> None:
        """Take what is known of the law; measurements of a decay begin anew where it changes."""
        if theory.agrees_with(self.theory):
            return
        if self.theory.known and self.history.stamp is not None:
            self._known_at = self.elapsed
        self.theory = theory
        self.history.fastest = theory.fastest

    @property
    def elapsed(self) -> float:
        """Return the formation time since the first state [s]."""
        history = self.history
        if history.stamp is None or history.started_at is None:
            return 0.0
        return (history.stamp - history.started_at) / 1e9

    def restart(self) -> None:
        """Forget what was seen: the formation starts anew."""
        self.history.restart()
        self._known_at = -math.inf

    def say(self, text: str) -> None:
        """Show a line of status, in Markdown."""
        self.show(self._status, 'content', text)

    def show(self, handle: Any, attribute: str, value: Any) -> None:
        """Set an attribute of a handle if it is news."""
        key = (id(handle), attribute)
        if self._shown.get(key) != value:
            self._shown[key] = value
            setattr(handle, attribute, value)

    def forget(self, handle: Any, attribute: str) -> None:
        """Set an attribute next time, whatever it was: a browser changed it."""
        self._shown.pop((id(handle), attribute), None)

    def notify(self, title: str, body: str, color: Any = 'red') -> None:
        """Show a message in every browser."""
        for client in self.server.get_clients().values():
            client.add_notification(title, body, color=color, auto_close_seconds=6.0)

    def draw(self) -> None:
        """Draw what is new, if there is somebody to see it."""
        history = self.history
        if history.stamp is None or history.gamma is None or not self.watched:
            return
        n = len(history.gamma)
        if self.theory.n != n:
            self.theory = Theory(n)
        edges = tuple(edge for edge in self.edges if max(edge[:2]) <= n)
        news, now = (history.stamp, edges), time.monotonic()
        if news != self._drawn and now - self._scene_at >= 0.9 * self.period:
            self._drawn, self._scene_at = news, now
            self._scene.draw(history.gamma, history.trail(TRAIL), edges)
            self.show(self._arrows, 'visible', bool(edges))
            self.show(self._arrows, 'value', not self._scene.hidden_edges)
        if now - self._charts_at >= CHART_PERIOD:
            self._charts_at = now
            self._draw_numbers(n)

    def _draw_numbers(self, n: int) -> None:
        self.show(self._legend, 'content', _legend(n))
        if n > MOST_AGENTS:
            self._charts.hide()
            self.show(self._table, 'content', f'More than {MOST_AGENTS} agents: only where they '
                      'point is drawn, without faces, names, numbers or charts.')
            return
        times, gamma = self.history.samples()
        if self._known_at > times[-1]:  # the plant was started anew
            self._known_at = -math.inf
        stride = -(-len(times) * n * (n - 1) // (2 * MOST_VALUES))
        times, gamma = times[::-stride][::-1], gamma[::-stride][::-1]
        rates = self.theory.rates
        self.show(self._table, 'content', table(self.theory, times, gamma, self._known_at))
        key = (self.history.stamp, rates, n)
        if self._shown.get('charts') != key:
            self._shown['charts'] = key
            self._charts.draw(
                times, gamma, self.theory.error(gamma), self.theory.shape, rates[1])


def _legend(n: int) -> str:
    """Return the agents' names in their colours, as HTML."""
    if n > MOST_AGENTS:
        return ''
    dots = ''.join(
        f'<span style="white-space:nowrap;display:inline-block;min-width:5.2em">'
        f'<span style="display:inline-block;width:0.75em;height:0.75em;'
        f'border-radius:{"50%" if colors.marker(i) % 3 == 0 else "0"};'
        f'{"transform:rotate(45deg);" if colors.marker(i) % 3 == 2 else ""}'
        f'background:{colors.agent(i)};margin-right:0.3em"></span>agent {i}</span>'
        for i in range(1, n + 1))
    return f'<div style="padding:0 1em 0.4em;font-size:0.85em;line-height:1.7">{dots}</div>'


class Controls:
    """
    The buttons for a running formation.

    :param page: a :class:`Page`
    :param actions: what is to be done when somebody presses one: an object with ``pause(bool)``,
        ``reset()``, ``start_at_random()``, ``set_gain(a)`` and ``set_speed(factor)``, called
        from any thread
    """

    def __init__(self, page: Page, actions: Any) -> None:
        # Without hints: they would lie over the buttons beside.
        gui = page.server.gui
        self._page, self._actions = page, actions
        self.paused = False
        locked = page.server.door.read_only
        with gui.add_folder('control', visible=not locked):
            self._pause = gui.add_button('Pause')
            self._start = gui.add_button_group('start anew', (RESET, RANDOM))
            self._gain = gui.add_number(
                'gain a [rad/s]', 1.0, min=GAINS[0], max=GAINS[1], step=0.1, disabled=True)
            self._speed = gui.add_button_group('speed', tuple(SPEEDS), visible=False)
        self._pause.on_click(lambda _: actions.pause(not self.paused))
        # What a button is called comes from the browser, and may be anything.
        self._start.on_click(lambda _: {
            RESET: actions.reset, RANDOM: actions.start_at_random}.get(
                self._start.value, lambda: None)())
        self._speed.on_click(lambda _: self._set_speed())
        self._gain.on_update(self._set_gain)

    def _set_speed(self) -> None:
        if self._speed.value in SPEEDS:
            self._actions.set_speed(SPEEDS[self._speed.value])

    def _set_gain(self, event: viser.GuiEvent[Any]) -> None:
        if event.client is None:
            return  # set from here, to follow what others do; only a person's counts
        value = float(self._gain.value)
        if GAINS[0] <= value <= GAINS[1]:
            self._actions.set_gain(value)
            return
        self._page.notify('The gain stays as it is', f'It takes a number from {GAINS[0]:g} to '
                          f'{GAINS[1]:g} rad/s: with a gain of zero nothing would move.')
        self._page.forget(self._gain, 'value')

    def show_paused(self, paused: bool) -> None:
        """Follow the plant's own word on whether it is paused."""
        self.paused = paused
        self._page.show(self._pause, 'label', 'Go on' if paused else 'Pause')

    def show_gain(self, gain: Any) -> None:
        """Follow the gain, or None where it is not known."""
        self._page.show(self._gain, 'disabled', gain is None)
        if gain is not None:
            self._page.show(self._gain, 'value', gain.a)

    def show_plant(self, reachable: bool, has_speed: bool) -> None:
        """Offer what the plant offers."""
        self._page.show(self._pause, 'disabled', not reachable)
        self._page.show(self._start, 'visible', reachable)
        self._page.show(self._speed, 'visible', has_speed)
