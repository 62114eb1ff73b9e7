# Copyright 2026 The tetra_ros2 authors
# SPDX-License-Identifier: Apache-2.0

"""The plant in real time: it steps on a timer, with the newest commands there are."""

from collections.abc import Sequence
import math

from tetra_ros2.formation.checks import Rejected
from tetra_ros2.nodes.stepper import agents_of, period_of, Steppable, Stepper, STILL
from tetra_ros2.ros import diagnostics

FUTURE_TOLERANCE = 500_000_000
"""How far ahead of the measurements the stamp of a command may be in real time [ns]."""


class RealTime(Stepper):
    """
    The plant steps on a timer and applies the newest commands, whatever has come.

    A step lasts as long as it really was, on the node's clock, since the one before. A command
    whose stamp is older than ``command_timeout`` counts as zero.

    :param plant: the node
    :param agents: indices, from 0, of the agents that have anything to answer
    """

    DEFAULT_TIMEOUT = 0.5
    reads_commands = True  # it is time enough to read the commands when the next step is due

    def __init__(self, plant: Steppable, agents: Sequence[int]) -> None:
        super().__init__(plant, agents)
        self.late_steps = self.fresh_commands = 0
        self._plant = plant
        self._agents = agents
        self._rates = [STILL] * len(plant.bodies.axes)
        self._stamps = [0] * len(self._rates)
        self._silent = 0
        self._elapsed = 0  # formation time in which the bodies were not paused [ns]
        self._duration = self._timer = None

    def configure(self, values):
        """Take the parameters, at the start and whenever they change."""
        period = period_of(values['rate'])
        timeout = values['command_timeout'] or max(self.DEFAULT_TIMEOUT, 3.0 * period / 1e9)
        self._timeout = round(min(timeout, 1e9) * 1e9)
        if self._timer is None:
            self._duration = round(values['duration'] * 1e9) or None
        elif period != self._period:
            self._plant.destroy_timer(self._timer)
            self._timer = None
        if self._timer is None:
            self._period = period
            self._timer = self._plant.create_timer(period / 1e9, self._on_timer)

    def start(self):
        """Begin; the timer does the rest."""

    def stop(self):
        """Take no step any more."""
        self._timer.cancel()

    def pause(self, paused):
        """Let the bodies rest, or go on; the sensors go on measuring."""
        self.paused = paused

    def run_until(self, stamp):
        """Go on; real time does not wait."""
        self.pause(False)

    def state_changed(self):
        """Publish the state; the commands so far were for another one."""
        self._plant.read_commands()
        self._forget_commands()
        self.stamp = self._plant.get_clock().now().nanoseconds
        self._plant.publish(self.stamp)

    def _forget_commands(self):
        self._rates = [STILL] * len(self._rates)
        self._stamps = [0] * len(self._stamps)

    def command(self, i, stamp, rate):
        """
        Take the command of agent i as its answer to the measurements of a time.

        :param i: index of the agent, from 0
        :param stamp: time of the measurements [ns]
        :param rate: angular velocity (x, y, z) in the body frame [rad/s]
        :raises Rejected: if it is older than the one in use, or far from the future
        """
        if stamp < self._stamps[i]:
            raise Rejected(Rejected.OLD_STAMP)
        if stamp > self.stamp + FUTURE_TOLERANCE:
            raise Rejected(Rejected.FUTURE_STAMP)
        self._stamps[i] = stamp
        self._rates[i] = rate

    def _on_timer(self):
        self._plant.read_commands()
        now = self._plant.get_clock().now().nanoseconds
        before, self.stamp = self.stamp, now
        elapsed = now - before
        if not before or elapsed <= 0:  # the first time, or the clock was set back
            self._forget_commands()
        elif not self.paused:
            oldest = now - self._timeout
            rates = []
            self._silent = 0
            for i, stamp in enumerate(self._stamps):
                if stamp >= oldest:
                    rates.append(self._rates[i])
                    self.fresh_commands += stamp >= before
                else:
                    rates.append(STILL)
                    self._silent |= 1 << i
            self._plant.bodies.step(elapsed / 1e9, rates)
            self.steps += 1
            self.late_steps += elapsed > 1.5 * self._period
            self._elapsed += elapsed
            if self._duration is not None and self._elapsed >= self._duration:
                self.paused, self._duration = True, None
        self._plant.publish(now)

    def assess(self, health):
        """Return level, message and figures for the diagnostics."""
        rates = health.rates({'step rate [Hz]': self.steps})
        expected = self.steps * len(self._agents)
        values = {'mode': 'realtime', 'steps': self.steps, **rates,
                  'deadline misses': self.late_steps,
                  'commands not answering the previous step': expected - self.fresh_commands}
        for i in self._agents:
            age = (self.stamp - self._stamps[i]) / 1e9 if self._stamps[i] else math.inf
            values[f'age of command of agent_{i + 1} [s]'] = age
        silent = self._silent & sum(1 << i for i in self._agents)
        if self.paused:
            return diagnostics.OK, 'paused', values
        if silent:
            return diagnostics.ERROR, f'held still, no recent command: {agents_of(silent)}', values
        return diagnostics.OK, 'running', values
