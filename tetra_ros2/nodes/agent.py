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

"""
One agent: it sees its neighbours, in its own body frame, and turns.

It knows its own pointing axis, its gain and its row of the weights. No absolute attitude reaches
this process, and no description of the formation that is to come of it.
"""

from collections.abc import Callable, Mapping, Sequence
from functools import partial
from pathlib import Path
import time
from typing import Any

from geometry_msgs.msg import TwistStamped, Vector3Stamped
from rclpy.duration import Duration
from rclpy.timer import Timer
from tetra_ros2.config.configuration import formation_from_parameters, gain_from_parameters
from tetra_ros2.config.parameters import ConfigurationError
from tetra_ros2.formation._types import Vector
from tetra_ros2.formation.checks import Rejected
from tetra_ros2.formation.controller import Controller
from tetra_ros2.ros import diagnostics, executor, parameters, qos
from tetra_ros2.ros.node import FormationNode, raw_publish
from tetra_ros2.wire import cdr, names

MARGIN = 0.1
"""How much further ahead than ``measurement_timeout`` a stamp may be [s]."""


class Agent(FormationNode):
    """
    The node ``agent_<i>``.

    :param i: which agent, from 1
    :param kwargs: what rclpy's Node takes beside its name
    :raises ConfigurationError: if a parameter is not valid, or there is no agent i
    """

    def __init__(self, i: int, **kwargs: Any) -> None:
        super().__init__(names.agent(i), **kwargs)
        values = parameters.declare(self, 'agent', self._accept, self._apply)
        formation = formation_from_parameters(values)
        topology = formation.topology
        if not 1 <= i <= topology.n:
            raise ConfigurationError(
                f'{i} is not valid, the topology has agents 1 to {topology.n}', key='--id')

        neighbors = topology.neighbors(i)
        self._neighbors = [j for j, _ in neighbors]
        self._controller = Controller(
            formation.pointing_axes[i - 1].tolist(), [weight for _, weight in neighbors],
            formation.gain, self._own_time)
        self._measurement = cdr.vector3_stamped(names.body_frame(i))
        self._encode = cdr.twist_stamped(names.body_frame(i)).encode
        self._before = 0, 0  # measurements and answers, until the last tick
        self._state: tuple[bytes, str] = diagnostics.WARN, 'waiting for measurements'
        self._newest = 0  # stamp of the newest measurement ever answered [ns]
        self.answers = self.partial_answers = self.stops = 0
        self._silent = False  # it holds still for a second publisher, or has closed
        self._closed = False
        # Silence is measured in the time that the formation lives in.
        self._clock_of_ticks = self.steady_clock
        self._now: Callable[[], float] = time.monotonic
        if self.get_parameter('use_sim_time').value:
            self._clock_of_ticks = self.get_clock()
            self._now = self._sim_time

        self._publisher = self.offer(
            TwistStamped, names.cmd_vel(i), qos.NEWEST, exclusive=True)
        self._send = raw_publish(self._publisher)
        for slot, j in enumerate(self._neighbors):
            self.listen(Vector3Stamped, names.relative_attitude(i, j),
                        self._receiver(slot, f'agent_{j}'), qos.NEWEST, guarded=False)
        self.report_health(self.assess)
        self._ticker: Timer | None = None
        self._apply(values)
        if not neighbors:
            self.get_logger().warning('this agent sees nobody and will never move')

    def _own_time(self) -> int:
        """Return the time of this node's clock [ns], which a true stamp is near in real time."""
        return self.get_clock().now().nanoseconds

    def _sim_time(self) -> float:
        return self.get_clock().now().nanoseconds / 1e9

    def close(self) -> None:
        """Stop the body, for good: the last command is zero."""
        # Nothing may be answered after the last command. The executor may have taken messages and
        # ticks before, and hand them on later.
        self._silent = self._closed = True
        if self._ticker is not None:
            self._ticker.cancel()
        while self.inputs:
            self.destroy_subscription(self.inputs.pop())
        self._stop()
        # The plant may listen with best effort; it has a time-out of its own for the worst case.
        self._publisher.wait_for_all_acked(Duration(seconds=0.5))

    def _accept(self, values: Mapping[str, Any]) -> None:
        formation_from_parameters(values)

    def _apply(self, values: Mapping[str, Any]) -> None:
        """Follow the parameters that may change at run time."""
        self._controller.gain = gain_from_parameters(values)
        self._timeout: float = values['measurement_timeout']
        self._controller.ahead = round(1e9 * (min(self._timeout, 1e6) + MARGIN))
        self._hold = values['on_publisher_conflict'] == 'hold'
        period = 1.0 / values['rate']
        if self._ticker is None or self._ticker.timer_period_ns != round(period * 1e9):
            if self._ticker is not None:
                self.destroy_timer(self._ticker)
            self._ticker = self.create_timer(period, self._on_tick, clock=self._clock_of_ticks)

    def _receiver(self, slot: int, source: str) -> Callable[[bytes], None]:
        """Return what hands the measurements of a neighbour to the law, and sends its answers."""
        # The busiest callback of an agent: it has at hand what it needs.
        decode, receive, now = self._measurement.decoder(), self._controller.receive, self._now
        send, encode = self._send, self._encode

        def on_measurement(message: bytes) -> None:
            try:
                stamp, seen = decode(message)
                rate = receive(slot, stamp, seen, now())
                if rate is None or self._silent:
                    return
                send(encode(stamp, 0.0, 0.0, 0.0, *rate))
                self._newest = stamp
                self.answers += 1
            except Rejected as rejection:
                self.health.reject(rejection, source)
            except Exception as error:  # whatever comes in may not end this node
                self.health.survive(error)

        return on_measurement

    @property
    def measurements(self) -> int:
        """Return how many measurements were taken."""
        return self._controller.received

    def _on_tick(self) -> None:
        """Answer with what there is, or stop, if no full set came since the last time."""
        if self._closed:
            return
        controller = self._controller
        now = controller.received, self.answers
        heard, answered = (a != b for a, b in zip(now, self._before))
        self._before = now
        newest = controller.stamp
        conflicts = self.publisher_conflicts() if self._hold else []
        self._silent = bool(conflicts)
        if conflicts:
            if newest:
                self._newest = newest
            self._stop()
            self._state = diagnostics.ERROR, \
                f'holding still, more than one publisher on {", ".join(conflicts)}'
            return
        if answered:
            self._state = diagnostics.OK, 'answering'
            return
        controller.forget(before=self._now() - self._timeout)
        if not self._neighbors:
            self._state = diagnostics.WARN, 'sees nobody'
        elif controller.complete:
            if heard:
                # As old as its oldest measurement: the answer is no newer than that.
                self._publish(controller.oldest_stamp, controller.angular_velocity())
                self._newest = newest
                self.partial_answers += 1
                self._state = diagnostics.WARN, 'answering to measurements of different times'
        else:
            unseen = ', '.join(names.agent(self._neighbors[s]) for s in controller.unseen())
            if self._newest:
                self._newest = newest or self._newest
                self._stop()
                self._state = diagnostics.ERROR, f'stopped, nothing heard of {unseen}'
            else:
                self._state = diagnostics.WARN, f'waiting for measurements of {unseen}'

    def _stop(self) -> None:
        """Command zero, if anything else was ever commanded."""
        # One nanosecond after the newest measurement: newer than every command so far, and the
        # answer to no measurement, for which a plant in lockstep could take it.
        if self._newest:
            self._publish(self._newest + 1, (0.0, 0.0, 0.0))
            self.stops += 1

    def _publish(self, stamp: int, rate: Vector) -> None:
        self._send(self._encode(stamp, 0.0, 0.0, 0.0, *rate))

    def assess(self) -> diagnostics.Assessment:
        """Return level, message and figures for the diagnostics."""
        now = self._now()
        rates = self.health.rates({
            'measurement rate [Hz]': self.measurements,
            'answer rate [Hz]': self.answers,
            'partial answer rate [Hz]': self.partial_answers,
        })
        values = {'measurements': self.measurements, 'answers': self.answers,
                  'partial answers': self.partial_answers, 'stops': self.stops, **rates}
        for j, heard_at in zip(self._neighbors, self._controller.heard_at):
            values[f'age of agent_{j} [s]'] = now - heard_at
        return *self._state, values


def main(i: int, config: str | Path | None = None, arguments: Sequence[str] = ()) -> int:
    """Run agent i until it is signalled; see :func:`tetra_ros2.ros.executor.run`."""
    return executor.run(partial(Agent, i), config, arguments)
