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

"""The plant in lockstep: it waits for all answers, and then steps."""

from collections.abc import Mapping, Sequence
import time
from typing import Any

from rosgraph_msgs.msg import Clock as ClockMessage
from tetra_ros2.formation.checks import Rejected
from tetra_ros2.formation.simulation import period_of
from tetra_ros2.nodes.stepper import agents_of, Rate, Steppable, Stepper, STILL
from tetra_ros2.ros import diagnostics, qos
from tetra_ros2.ros.node import raw_publish
from tetra_ros2.wire import cdr, names

SHORTEST_PATIENCE = 2e-3
"""How long to wait for answers at least before measurements are repeated [s]."""

FIRST_PATIENCE = 40e-3
"""How long to wait for them before it is known how long they take [s]."""

TOO_SOON = 0.5
"""After what part of the shortest time that answers ever took, none can be there yet."""

QUICKEST = 0.2e-3
"""Within which time nobody answers but in this process, where nothing is lost [s]."""

LENGTHENING = 1.05
"""By how much the patience grows with each answer that was taken for lost and came."""

WATCH_PERIOD = 20e-3
"""How often to look whether anything was lost [s], where nothing is: looking costs."""

LONGEST_PACE = 1e9
"""Between two steps [s]; a timer counts nanoseconds in 64 bits."""

ALERT = 1.0
"""For how long to look more often after something was lost [s]."""

TOLD = 0.5
"""Of whom the plant has waited for longer than this [s] is told in the diagnostics."""

OFTEN = 100
"""How often they are repeated in a step before that happens once in ``republish_period`` only."""


class RoundTrip:
    """
    How long answers take, learnt from those that came, as TCP learns it (RFC 6298).

    :ivar patience: after which time an answer is probably lost [s]
    """

    def __init__(self) -> None:
        self.patience = FIRST_PATIENCE
        self._mean: float | None = None
        self._deviation = 0.0
        self._shortest = 0.0

    def take(self, seconds: float) -> None:
        """Take how long the last answer took of those before anything of a step was repeated."""
        if self._mean is None:
            self._mean, self._deviation, self._shortest = seconds, 0.5 * seconds, seconds
        else:
            if seconds < self._shortest:
                self._shortest = seconds
            self._deviation += 0.25 * (abs(seconds - self._mean) - self._deviation)
            self._mean += 0.125 * (seconds - self._mean)
        self.patience = max(SHORTEST_PATIENCE, self._mean + 4.0 * self._deviation)

    def was_needed(self, seconds: float, since_before: float) -> bool:
        """
        Return whether the last repetition before the last answer to a step was needed.

        Nobody knows which one the answer answers, so that nothing can be learnt from it; but for
        one that came too soon to answer the last. Then the patience grows. Else whoever has
        become slower than that would be sent everything twice for good.

        :param seconds: how long after the last repetition it came
        :param since_before: how long after what was sent before that
        """
        if seconds >= max(QUICKEST, TOO_SOON * self._shortest):
            return True
        self.patience = min(LENGTHENING * self.patience, since_before)
        return False

    def lengthen(self) -> None:
        """
        Take note that an answer that was taken for lost came after all.

        As long as every step was repeated, nothing could be learnt. Later it means little: where
        messages are lost, an agent may answer a repetition as well as what it repeats.
        """
        if self._mean is None:
            self.patience *= LENGTHENING


class Lockstep(Stepper):
    """
    The plant waits for all commands that answer step k, and only then takes the step.

    While it waits, it repeats the measurements of those whose answers are missing, each time after
    a while that it learns from the answers, as TCP does. Who has been sent them very often, or has
    never answered, gets them once in ``republish_period``, when the state goes out again too. Who
    joined late, or lost a message, costs time and nothing else. An agent that falls silent for
    ``command_timeout`` is held still and not waited for until it answers again; one that has
    never answered is waited for. The stamp of the first measurements is one period: to ROS, a
    stamp of zero means no time at all.

    :param plant: the node
    :param agents: indices, from 0, of the agents that have anything to answer
    """

    DEFAULT_TIMEOUT = 30.0
    reads_commands = False  # a command may be what it has waited for

    def __init__(self, plant: Steppable, agents: Sequence[int]) -> None:
        super().__init__(plant, agents)
        self.late = self.repetitions = 0
        self.states_repeated = 0  # the repetitions that went to everybody, with the state
        self._plant = plant
        self._everybody = sum(1 << i for i in agents)  # agents are bits of integers here
        self._missing = 0  # whose answer is still to come
        self._known = 0  # who has ever answered
        self._absent = 0  # who is not waited for
        self._absent_since = 0
        self._rates = [STILL] * len(plant.bodies.axes)
        self._still = tuple(self._rates)
        self._due = True  # whether the pace allows the next step
        self._waiting_since = time.monotonic()
        self._last_stamp: int | None = None
        self._pace: float | None = None  # between two steps [s]
        self._round_trip = RoundTrip()
        self._repeated = 0  # how often this step was repeated
        self._repeated_at = self._sent_before = 0.0  # the last time, and what came before that
        self._heard_at = 0.0  # the last answer before anything of its step was repeated
        self._lost_at = -ALERT  # when it last turned out that something had been lost
        self._watchdog: Any = None
        self._rapid: Any = None
        self._pacer: Any = None
        self._send_time = raw_publish(
            plant.offer(ClockMessage, names.CLOCK, qos.NEWEST, exclusive=True))

    def configure(self, values: Mapping[str, Any]) -> None:
        """Take the parameters, at the start and whenever they change."""
        self._period = period_of(values['rate'])
        self._h = self._period / 1e9
        self._timeout = values['command_timeout'] or self.DEFAULT_TIMEOUT
        if self._watchdog is None:
            self._last_stamp = round(values['duration'] * 1e9) + self._period \
                if values['duration'] else None
            self._longest = values['republish_period']
            self._watchdog = self._plant.create_steady_timer(
                min(WATCH_PERIOD, self._longest), self._on_watchdog)
        # With nobody to wait for, something else must set the pace.
        factor = values['real_time_factor'] or (0.0 if self._everybody else 100.0)
        # As long as a timer can be, if the factor is next to nothing.
        pace = min(self._h / factor, LONGEST_PACE) if factor else None
        if pace != self._pace:
            self._pace = pace
            self._due = True
            if self._pacer is not None:
                self._plant.destroy_timer(self._pacer)
            self._pacer = None if pace is None else self._plant.create_steady_timer(
                pace, self._on_due)

    def start(self) -> None:
        """Publish the state at hand and wait for the answers."""
        self._begin_step()

    def stop(self) -> None:
        """Take no step any more."""
        self.paused = True

    def pause(self, paused: bool) -> None:
        """Stop, or go on."""
        self.paused = paused
        self._advance()

    def run_until(self, stamp: int) -> None:
        """Go on, and pause at the first step at or after a stamp [ns]."""
        self._last_stamp = stamp
        self.pause(False)

    def state_changed(self) -> None:
        """Let the state count as that of a step of its own."""
        self._begin_step()

    def command(self, i: int, stamp: int, rate: Rate) -> None:
        """
        Take the command of agent i as its answer to the measurements of a time.

        :param i: index of the agent, from 0
        :param stamp: time of the measurements [ns]
        :param rate: angular velocity (x, y, z) in the body frame [rad/s]
        :raises Rejected: if there have been no such measurements yet
        """
        bit = 1 << i
        self._known |= bit
        if stamp == self.stamp:
            self._absent &= ~bit
            self._rates[i] = rate
            if self._missing == bit:  # the last one
                self._missing = 0
                # To learn takes time: it is done seldom as long as nothing is lost.
                if self._repeated or self._rapid is not None or not self.steps & 7:
                    self._learn(time.monotonic())
                self._advance()
            else:
                # Who answers again, as what is paused is repeated, teaches nothing.
                self._missing &= ~bit
                if self._rapid is not None and self._missing and not self._repeated:
                    self._heard_at = time.monotonic()
        elif stamp > self.stamp + 1:  # a stop is one nanosecond younger than what it follows
            raise Rejected(Rejected.FUTURE_STAMP)
        else:
            self.late += 1  # the answer to a repetition, a partial answer, or a stop
            if stamp == self.stamp - self._period and self._round_trip.patience < self._longest:
                self._round_trip.lengthen()
            if stamp > self._absent_since:
                self._absent &= ~bit  # it is back, and waited for from the next step on

    def _learn(self, now: float) -> None:
        """Take note of how long the answers to this step took, as of now [s]."""
        if not self._repeated:
            self._round_trip.take(now - self._waiting_since)
        elif self._round_trip.was_needed(now - self._repeated_at, now - self._sent_before):
            self._lost_at = now

    def _begin_step(self) -> None:
        self.stamp += self._period
        self._rates[:] = self._still
        self._missing = self._everybody & ~self._absent
        self._waiting_since = time.monotonic()
        self._repeated = 0
        self._publish()

    def _publish(self) -> None:
        self._send_time(cdr.head(self.stamp))
        self._plant.publish(self.stamp)

    def _advance(self) -> None:
        """Take the step if there is nothing left to wait for."""
        if self._missing or self.paused or not self._due or self._plant.held_agents():
            return
        if self._last_stamp is not None and self.stamp >= self._last_stamp:
            self.paused, self._last_stamp = True, None
            return
        self._due = self._pacer is None
        self._plant.bodies.step(self._h, self._rates)
        self.steps += 1
        self._begin_step()

    def _on_due(self) -> None:
        self._due = True
        self._advance()

    def _on_watchdog(self) -> None:
        """Look after the step at hand, and more often for a while once something was lost."""
        self._look()
        losing = time.monotonic() - self._lost_at < ALERT
        if losing and self._rapid is None:
            self._rapid = self._plant.create_steady_timer(0.25 * SHORTEST_PATIENCE, self._look)
        elif not losing and self._rapid is not None:
            self._plant.destroy_timer(self._rapid)
            self._rapid = None

    def _look(self) -> None:
        """Repeat the measurements, or give up on those who do not answer."""
        now = time.monotonic()
        waited = now - self._waiting_since
        if not self.stamp or waited < self._round_trip.patience:
            return
        silent = self._missing & self._known
        if silent and waited > self._timeout and not self.paused:
            self._absent |= silent
            self._absent_since = self.stamp
            self._missing &= ~silent
        if not (self._missing or self.paused or not self._due):
            self._advance()
            return
        sent_at = max(self._repeated_at, self._waiting_since)
        since = now - sent_at
        often = self._repeated < OFTEN and self._missing & self._known and not self.paused
        if not self._repeated and self._heard_at > self._waiting_since:
            # Where much is lost, a step without a repetition is too rare to learn from.
            self._round_trip.take(self._heard_at - self._waiting_since)
            self._heard_at = 0.0
        if since >= self._longest:
            self.states_repeated += 1
            self._publish()
        elif often and since >= self._round_trip.patience:
            self._plant.repeat(self.stamp, self._missing)
        else:
            return
        self._sent_before, self._repeated_at = sent_at, now
        self._repeated += 1
        self.repetitions += 1

    def assess(self, health: diagnostics.Health) -> diagnostics.Assessment:
        """Return level, message and figures for the diagnostics."""
        rates = health.rates({'step rate [Hz]': self.steps})
        waited = time.monotonic() - self._waiting_since
        state = 'paused' if self.paused else 'waiting' if self._missing and waited > TOLD \
            else 'running'
        values = {'mode': 'lockstep', 'state': state, 'formation time [s]': self.stamp / 1e9,
                  'steps': self.steps, **rates,
                  'patience [s]': self._round_trip.patience,
                  'repetitions': self.repetitions, 'late commands': self.late}
        if self._absent:
            absent = agents_of(self._absent)
            return diagnostics.ERROR, f'held still, not answering: {absent}', values
        if self.paused:
            return diagnostics.OK, 'paused', values
        if self._missing and waited > TOLD:
            return diagnostics.WARN, f'waiting for {agents_of(self._missing)}', values
        return diagnostics.OK, 'running', values
