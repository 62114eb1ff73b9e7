# Copyright 2026 The tetra_ros2 authors
# SPDX-License-Identifier: Apache-2.0

"""
One agent: it sees its neighbours, in its own body frame, and turns.

It knows its own pointing axis, its gain and its row of the weights. No absolute attitude reaches
this process, and no description of the formation that is to come of it.
"""

from functools import partial
import time

from geometry_msgs.msg import TwistStamped, Vector3Stamped
from rclpy.clock import Clock
from rclpy.clock_type import ClockType
from rclpy.duration import Duration

from tetra_ros2.configuration import Formation, gain_from_parameters
from tetra_ros2.formation.checks import Rejected
from tetra_ros2.formation.controller import Controller
from tetra_ros2.parameters import ConfigurationError
from tetra_ros2.ros import cdr, diagnostics, executor, names, parameters, qos
from tetra_ros2.ros.node import FormationNode


class Agent(FormationNode):
    """
    The node ``agent_<i>``.

    :param i: which agent, from 1
    :param kwargs: what rclpy's Node takes beside its name
    :raises ConfigurationError: if a parameter is not valid, or there is no agent i
    """

    def __init__(self, i, **kwargs):
        super().__init__(names.agent(i), **kwargs)
        values = parameters.declare(self, 'agent', self._accept, self._apply)
        formation = Formation.from_parameters(values)
        topology = formation.topology
        if not 1 <= i <= topology.n:
            raise ConfigurationError(
                f'{i} is not valid, the topology has agents 1 to {topology.n}', key='--id')

        neighbors = topology.neighbors(i)
        self._neighbors = [j for j, _ in neighbors]
        self._controller = Controller(
            formation.axes[i - 1].tolist(), [weight for _, weight in neighbors], formation.gain)
        self._timeout = values['measurement_timeout']
        self._measurement = cdr.vector3_stamped(names.body_frame(i))
        self._command = cdr.twist_stamped(names.body_frame(i))
        self._heard = self._answered = False  # since the last tick
        self._state = 'waiting for measurements'
        self._stop_stamp = None
        self.measurements = self.answers = self.partial_answers = 0

        self._publisher = self.offer(TwistStamped, names.cmd_vel(i), qos.NEWEST)
        for slot, j in enumerate(self._neighbors):
            self.listen(Vector3Stamped, names.relative_attitude(i, j),
                        partial(self._on_measurement, slot), qos.NEWEST)
        self.report_health()
        self._ticker = None
        self._apply(values)
        if not neighbors:
            self.get_logger().warning('this agent sees nobody and will never move')

    def close(self):
        """Stop the body, for good: the last command is zero."""
        self._ticker.cancel()
        while self.inputs:  # nothing may be answered after the last command
            self.destroy_subscription(self.inputs.pop())
        self._stop()
        self._publisher.wait_for_all_acked(Duration(seconds=0.5))

    def _accept(self, values):
        Formation.from_parameters(values)

    def _apply(self, values):
        """Follow the parameters that may change at run time."""
        self._controller.gain = gain_from_parameters(values)
        self._timeout = values['measurement_timeout']
        if self._ticker is not None:
            self.destroy_timer(self._ticker)
        self._ticker = self.create_timer(
            1.0 / values['rate'], self._on_tick, clock=Clock(clock_type=ClockType.STEADY_TIME))

    def _on_measurement(self, slot, message):
        """Hand a measurement to the law, and publish the answer if there is one."""
        try:
            stamp, seen = self._measurement.decode(message)
            rate = self._controller.receive(slot, stamp, seen, time.monotonic())
        except Rejected as rejection:
            self.health.reject(rejection, f'agent_{self._neighbors[slot]}')
            return
        self.measurements += 1
        self._heard = True
        if rate is not None:
            self._publish(stamp, rate)
            self.answers += 1
            self._answered = True

    def _on_tick(self):
        """Answer with what there is, or stop, if no full set came since the last time."""
        heard, answered = self._heard, self._answered
        self._heard = self._answered = False
        heard_at, stamp = self._controller.oldest()
        if answered:
            self._state = 'answering'
        elif not self._neighbors:
            self._state = 'sees nobody'
        elif time.monotonic() - heard_at > self._timeout:
            self._stop()
        elif heard:
            # The stamp is that of the oldest measurement in it: the answer is no newer than that.
            self._publish(stamp, self._controller.angular_velocity())
            self.partial_answers += 1
            self._state = 'answering to measurements of different times'

    def _stop(self):
        """Command zero, and forget what was seen."""
        # One nanosecond after the newest measurement: newer than every command so far, and the
        # answer to no measurement, for which a plant in lockstep could take it.
        if self._controller.stamp:
            self._stop_stamp = self._controller.stamp + 1
            silent = [f'agent_{j}' for j, heard_at in zip(
                self._neighbors, self._controller.heard_at)
                if time.monotonic() - heard_at > self._timeout]
            self._state = f'stopped, nothing heard of {", ".join(silent)}'
            self._controller.forget()
        if self._stop_stamp is not None:
            self._publish(self._stop_stamp, (0.0, 0.0, 0.0))

    def _publish(self, stamp, rate):
        self._publisher.publish(self._command.encode(stamp, 0.0, 0.0, 0.0, *rate))

    def assess(self):
        """Return level, message and figures for the diagnostics."""
        now = time.monotonic()
        rates = self.health.rates({
            'measurement rate [Hz]': self.measurements,
            'answer rate [Hz]': self.answers,
            'partial answer rate [Hz]': self.partial_answers,
        })
        values = {'measurements': self.measurements, 'answers': self.answers,
                  'partial answers': self.partial_answers, **rates}
        for j, heard_at in zip(self._neighbors, self._controller.heard_at):
            age = now - heard_at
            values[f'age of agent_{j} [s]'] = age
        level, message = diagnostics.OK, self._state
        if self._state.startswith('stopped'):
            level = diagnostics.ERROR
        elif self._state != 'answering':
            level = diagnostics.WARN
        topic = self._publisher.topic_name
        publishers = self.count_publishers(topic)
        values['publishers on cmd_vel'] = publishers
        if publishers > 1:
            level = max(level, diagnostics.WARN)
            message = f'{message}; {diagnostics.crowded([topic])}'
        return level, message, values


def main(i, config=None, arguments=()):
    """Run agent i until it is signalled; see :func:`tetra_ros2.ros.executor.run`."""
    return executor.run(partial(Agent, i), config, arguments)
