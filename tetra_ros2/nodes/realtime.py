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

"""The plant in real time: it steps on a timer, with the newest commands there are."""

from collections.abc import Mapping, Sequence
import math
import time
from typing import Any

from tetra_ros2.formation.checks import Rejected
from tetra_ros2.formation.simulation import period_of
from tetra_ros2.nodes.stepper import agents_of, Rate, Steppable, Stepper, STILL
from tetra_ros2.ros import diagnostics

CLOCK_TOLERANCE = 100_000_000
"""By how much the node's clock may leave the steady one in a step before it has been set [ns]."""

READ_TOGETHER, READINGS = 100_000, 10
"""How far apart two clocks may be read [ns], and how often to try."""

JUMP_TOLD = 1.5
"""For how long the diagnostics tell of a clock that was set [s]: for a report or two."""


class RealTime(Stepper):
    """
    The plant steps on a timer and applies the newest commands, whatever has come.

    A step lasts as long as it really was since the one before. That is measured on the steady
    clock, which nobody can set, or on ``/clock`` if the node uses it; stamps are of the node's
    clock. A command whose stamp is older than ``command_timeout`` counts as zero. So does one
    that answers no measurement yet made.

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
        self._duration: int | None = None  # how much of that there is to be [ns]
        self._timer: Any = None
        self._period = 0  # of it [ns]
        self._simulated: bool = plant.get_parameter('use_sim_time').value
        self._stepped_at = 0  # on the clock that steps are measured on [ns]
        self.clock_jumps = 0
        self._jumped_at = -math.inf  # on the steady clock [s]

    def configure(self, values: Mapping[str, Any]) -> None:
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
            create = self._plant.create_timer if self._simulated \
                else self._plant.create_steady_timer
            self._timer = create(period / 1e9, self._on_timer)

    def start(self) -> None:
        """Begin; the timer does the rest."""

    def stop(self) -> None:
        """Take no step any more."""
        self._timer.cancel()

    def pause(self, paused: bool) -> None:
        """Let the bodies rest, or go on; the sensors go on measuring."""
        self.paused = paused

    def run_until(self, stamp: int) -> None:
        """Go on; real time does not wait."""
        self.pause(False)

    def state_changed(self) -> None:
        """Publish the state; the commands so far were for another one."""
        self._plant.read_commands()
        self._forget_commands()
        # The next step begins here: from the last one on, it would be longer than the stamps say.
        self.stamp, self._stepped_at = self._read_clocks()
        self._plant.publish(self.stamp)

    def _read_clocks(self) -> tuple[int, int]:
        """
        Return the time of stamps, and that on the clock that steps are measured on [ns].

        Both are of one moment, even if something else gets the processor between two readings.
        Otherwise a step could be longer than the stamps say, and bodies would seem to leap.
        """
        clock = self._plant.get_clock()
        if self._simulated:
            now: int = clock.now().nanoseconds
            return now, now
        for _ in range(READINGS):
            begun = time.monotonic_ns()
            now = clock.now().nanoseconds
            here = time.monotonic_ns()
            if here - begun < READ_TOGETHER:
                break
        return now, here

    def _forget_commands(self) -> None:
        self._rates = [STILL] * len(self._rates)
        self._stamps = [0] * len(self._stamps)

    def command(self, i: int, stamp: int, rate: Rate) -> None:
        """
        Take the command of agent i as its answer to the measurements of a time.

        :param i: index of the agent, from 0
        :param stamp: time of the measurements [ns]
        :param rate: angular velocity (x, y, z) in the body frame [rad/s]
        :raises Rejected: if it is older than the one in use, or answers nothing yet measured
        """
        if stamp < self._stamps[i]:
            raise Rejected(Rejected.OLD_STAMP)
        if stamp > self.stamp + 1:  # a stop is one nanosecond younger than what it follows
            raise Rejected(Rejected.FUTURE_STAMP)
        self._stamps[i] = stamp
        self._rates[i] = rate

    def _on_timer(self) -> None:
        self._plant.read_commands()
        now, here = self._read_clocks()
        before, self.stamp = self.stamp, now
        elapsed, self._stepped_at = here - self._stepped_at, here
        if not before:
            self._forget_commands()
        elif elapsed <= 0:  # /clock was set back
            self.clock_shift += elapsed
            self._forget_commands()
        elif abs(now - before - elapsed) > CLOCK_TOLERANCE:  # the stamps so far say nothing now
            self.clock_jumps += 1
            self.clock_shift += now - before - elapsed
            self._jumped_at = time.monotonic()
            self._forget_commands()
        elif not self.paused:
            self._step(elapsed, before, now)
        self._plant.publish(now)

    def _step(self, elapsed: int, before: int, now: int) -> None:
        oldest = now - self._timeout
        held = self._plant.held_agents()
        rates = []
        self._silent = 0
        for i, stamp in enumerate(self._stamps):
            if stamp >= oldest and not held >> i & 1:
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

    def assess(self, health: diagnostics.Health) -> diagnostics.Assessment:
        """Return level, message and figures for the diagnostics."""
        rates = health.rates({'step rate [Hz]': self.steps})
        expected = self.steps * len(self._agents)
        values = {'mode': 'realtime', 'state': 'paused' if self.paused else 'running',
                  'steps': self.steps, **rates,
                  'deadline misses': self.late_steps, 'clock jumps': self.clock_jumps,
                  'commands not answering the previous step': expected - self.fresh_commands}
        for i in self._agents:
            age = (self.stamp - self._stamps[i]) / 1e9 if self._stamps[i] else math.inf
            values[f'age of command of agent_{i + 1} [s]'] = age
        silent = self._silent & sum(1 << i for i in self._agents)
        level, message = diagnostics.OK, 'paused' if self.paused else 'running'
        if silent and not self.paused:
            level, message = diagnostics.ERROR, \
                f'held still, no recent command: {agents_of(silent)}'
        if time.monotonic() - self._jumped_at < JUMP_TOLD:
            level, message = max(level, diagnostics.WARN), f'{message}; the clock was set'
        return level, message, values
