# Copyright 2026 The tetra_ros2 authors
# SPDX-License-Identifier: Apache-2.0

"""The page: scene, panel and charts, and what is shown in them when."""

import time

from tetra_ros2.drawing import colors
from tetra_ros2.drawing.theory import table, Theory
from tetra_ros2.viewer.charts import Charts
from tetra_ros2.viewer.history import History
from tetra_ros2.viewer.scene import Scene

FRAME_PERIOD = 1.0 / 30.0
"""How often the scene is drawn [s]."""

CHART_PERIOD = 0.25
"""How often charts and numbers are drawn [s]; a person reads no faster."""

TRAIL = 3.0
"""How far the trails reach back [s]."""

SPEEDS = {'¼': 0.25, '1': 1.0, '4': 4.0, '10': 10.0, 'max': 0.0}
"""Seconds of formation time per second; 0, as the plant has it, for as fast as it goes."""


RESET, RANDOM = 'Reset', 'New random start'


class Page:
    """
    What all browsers see; one for all of them, so that they see the same.

    :param server: a ``viser.ViserServer``
    """

    def __init__(self, server):
        self.server = server
        self.history = History()
        self.theory = Theory(0)
        self.edges = ()
        self._scene = Scene(server)
        self._status = server.gui.add_markdown('')
        self._legend = server.gui.add_html('')
        self._shown = {}
        self._charts_at = 0.0
        self._drawn = None

    @property
    def address(self):
        """Return the address to open in a browser."""
        return self.server.address

    @property
    def watched(self):
        """Return whether there is a browser."""
        return bool(self.server.get_clients())

    def finish(self):
        """Put in what comes below the controls: numbers and charts."""
        with self.server.gui.add_folder('theory and measurement'):
            self._table = self.server.gui.add_markdown('')
        gui = self.server.gui
        self._charts = Charts(gui, gui.add_folder('charts'))

    def say(self, text):
        """Show a line of status, in Markdown."""
        self.show(self._status, 'content', text)

    def show(self, handle, attribute, value):
        """Set an attribute of a handle if it is news."""
        key = (id(handle), attribute)
        if self._shown.get(key) != value:
            self._shown[key] = value
            setattr(handle, attribute, value)

    def notify(self, title, body, color='red'):
        """Show a message in every browser."""
        for client in self.server.get_clients().values():
            client.add_notification(title, body, color=color, auto_close_seconds=6.0)

    def draw(self):
        """Draw what is new, if there is somebody to see it."""
        history = self.history
        if history.stamp is None or not self.watched:
            return
        n = len(history.gamma)
        if self.theory.n != n:
            self.theory = Theory(n)
        edges = tuple(edge for edge in self.edges if max(edge[:2]) <= n)
        news = (history.stamp, edges)
        if news != self._drawn:
            self._drawn = news
            self._scene.draw(history.gamma, history.trail(TRAIL), edges)
        now = time.monotonic()
        if now - self._charts_at >= CHART_PERIOD:
            self._charts_at = now
            self._draw_numbers(n)

    def _draw_numbers(self, n):
        self.show(self._legend, 'content', _legend(n))
        times, gamma = self.history.samples()
        error, rates = self.theory.error(gamma), self.theory.rates(gamma[-1])
        self.show(self._table, 'content', table(self.theory, times, gamma, error, rates))
        key = (self.history.stamp, rates, n)
        if self._shown.get('charts') != key:
            self._shown['charts'] = key
            self._charts.draw(times, gamma, error, self.theory.shape, rates[1])


def _legend(n):
    """Return the agents' names in their colours, as HTML."""
    dots = ''.join(
        f'<span style="white-space:nowrap;margin-right:0.9em">'
        f'<span style="display:inline-block;width:0.75em;height:0.75em;border-radius:50%;'
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

    def __init__(self, page, actions):
        gui = page.server.gui
        self._page = page
        self.paused = False
        with gui.add_folder('control'):
            self._pause = gui.add_button('Pause', hint='stop the bodies, or let them go on')
            self._start = gui.add_button_group(
                'start', (RESET, RANDOM), hint='reset: back to the initial attitudes, or to new '
                'random ones where none were given')
            self._gain = gui.add_number(
                'gain a [rad/s]', 1.0, min=1e-3, max=1e3, step=0.1, disabled=True,
                hint='of all agents; they have to have this parameter')
            self._speed = gui.add_button_group(
                'speed', tuple(SPEEDS), visible=False,
                hint='seconds of formation time per second')
        self._pause.on_click(lambda _: actions.pause(not self.paused))
        self._start.on_click(lambda _: {RESET: actions.reset, RANDOM: actions.start_at_random}[
            self._start.value]())
        self._speed.on_click(lambda _: actions.set_speed(SPEEDS[self._speed.value]))
        # The value is set from here too, to follow what others do; only a person's counts.
        self._gain.on_update(
            lambda event: event.client is not None and actions.set_gain(self._gain.value))

    def show_paused(self, paused):
        """Follow the plant's own word on whether it is paused."""
        self.paused = paused
        self._page.show(self._pause, 'label', 'Go on' if paused else 'Pause')

    def show_gain(self, gain):
        """Follow the gain, or None where it is not known."""
        self._page.show(self._gain, 'disabled', gain is None)
        if gain is not None:
            self._page.show(self._gain, 'value', gain.a)

    def show_plant(self, reachable, has_speed):
        """Offer what the plant offers."""
        self._page.show(self._pause, 'disabled', not reachable)
        self._page.show(self._start, 'visible', reachable)
        self._page.show(self._speed, 'visible', has_speed)
