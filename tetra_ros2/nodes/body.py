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
The driver of one real body: it takes the commands of an agent, and tells the body's attitude.

Between the two stands a watchdog: silence, or a command too fast, holds the body, and the service
``body_<i>/stop`` holds it until it is released. A body that cannot be reached is reported, and
tried again until it is back.
"""

from collections.abc import Mapping, Sequence
from contextlib import suppress
from functools import partial
from pathlib import Path
import time
from typing import Any

from geometry_msgs.msg import PoseStamped, TwistStamped
from std_srvs.srv import SetBool
from tetra_ros2 import drivers
from tetra_ros2.config.parameters import ConfigurationError
from tetra_ros2.drivers.watchdog import STILL, TURNING, WAITING, Watchdog
from tetra_ros2.formation.checks import Rejected
from tetra_ros2.formation.tracking import unit_quaternion
from tetra_ros2.ros import diagnostics, executor, parameters, qos
from tetra_ros2.ros.node import FormationNode, raw_publish
from tetra_ros2.wire import cdr, names

RETRY = 0.5
"""How long to wait before a body that was lost is tried again [s]."""


class Body(FormationNode):
    """
    The node ``body_<i>``.

    :param i: whose body it drives, from 1
    :param kwargs: what rclpy's Node takes beside its name
    :raises ConfigurationError: if a parameter is not valid, or the body cannot be reached
    """

    def __init__(self, i: int, **kwargs: Any) -> None:
        if i < 1:
            raise ConfigurationError(f'{i} is not valid, expected an agent, from 1', key='--id')
        super().__init__(names.body(i), **kwargs)
        values = parameters.declare(self, 'body', self._accept, lambda _: None)
        self._i = i
        self._kind = drivers.find(values['driver'])
        self._options = drivers.options(values['driver_options'])
        try:
            self._driver: Any = drivers.make(self._kind, self._options, self)
        except OSError as error:
            raise ConfigurationError(' '.join(str(error).split()), key='driver') from None
        self.watchdog = Watchdog(values['command_timeout'], values['max_angular_velocity'])
        self._lost = ''  # why the body cannot be reached, if it cannot
        self._lost_at = 0.0
        self.losses = self.applied = self.poses = 0
        self._decode = cdr.twist_stamped(names.body_frame(i)).decoder()
        self._encode = cdr.StampedNumbers(names.WORLD, 7).encode
        self._send = raw_publish(self.offer(PoseStamped, names.pose(i), qos.NEWEST, True))
        self.listen(TwistStamped, names.cmd_vel(i), self._on_command, qos.COMMANDS)
        self.create_service(SetBool, names.stop(names.body(i)), self._on_stop)
        self.report_health(self.assess)
        self._period = 1.0 / values['rate']
        self._timer = self.create_steady_timer(self._period, self._on_timer)

    @staticmethod
    def _accept(values: Mapping[str, Any]) -> None:
        drivers.find(values['driver'])
        drivers.options(values['driver_options'])

    def close(self) -> None:
        """Hold the body, and let go of it."""
        self._timer.cancel()
        if self._driver is not None:
            with suppress(Exception):  # it may be out of reach already
                self._driver.apply(STILL, self._period)
            self._let_go()

    def _let_go(self) -> None:
        driver, self._driver = self._driver, None
        if driver is not None and hasattr(driver, 'close'):
            with suppress(Exception):  # it is lost already, or its node is at its end
                driver.close()

    def _on_command(self, message: bytes) -> None:
        try:
            stamp, (_, _, _, x, y, z) = self._decode(message)
            self.watchdog.command(stamp, (x, y, z), time.monotonic())
        except Rejected as rejection:
            self.health.reject(rejection, names.agent(self._i))

    def _on_stop(self, request: Any, response: Any) -> Any:
        self.watchdog.stopped = request.data
        if request.data:
            self._on_timer()  # at once
        self.get_logger().warning(f'emergency stop {"" if request.data else "released"}'.strip())
        response.success = True
        response.message = 'stopped' if request.data else 'released'
        return response

    def _on_timer(self) -> None:
        now = time.monotonic()
        if self._driver is None:
            if now - self._lost_at < RETRY:
                return
            self._lost_at = now
            try:
                self._driver = drivers.make(self._kind, self._options, self)
            except (OSError, ConfigurationError) as error:
                self._lost = str(error)
                return
            self._lost = ''
            self.get_logger().info('the body is back')
        try:
            rate, _ = self.watchdog.rate(now)
            self._driver.apply(rate, self._period)
            self.applied += 1
            if hasattr(self._driver, 'attitude'):
                attitude = self._driver.attitude()
                if attitude is not None:
                    self._tell(attitude)
        except OSError as error:
            self._lose(str(error), now)
        except Exception as error:  # a driver that fails may have left its body turning
            with suppress(Exception):
                self._driver.apply(STILL, self._period)
            self._lose(drivers.described(error), now)

    def _tell(self, attitude: Sequence[float]) -> None:
        """Publish what the driver says of the attitude, if it is one."""
        stamp = self.get_clock().now().nanoseconds
        try:
            unit = unit_quaternion(attitude)
        except Rejected as rejection:
            self.health.reject(rejection, 'attitude() of the driver')
            return
        self._send(self._encode(stamp, 0.0, 0.0, 0.0, *unit))
        self.poses += 1

    def _lose(self, reason: str, now: float) -> None:
        """Let go of a body that cannot be driven; it is tried again."""
        self._lost, self._lost_at = reason, now
        self.losses += 1
        self.get_logger().error(f'the body is lost: {reason}')
        self._let_go()

    def assess(self) -> diagnostics.Assessment:
        """Return level, message and figures for the diagnostics."""
        _, state = self.watchdog.rate(time.monotonic())
        values = {'driver': self._kind.__name__, 'losses': self.losses,
                  **self.health.rates({'apply rate [Hz]': self.applied,
                                       'pose rate [Hz]': self.poses})}
        if self._lost:
            return diagnostics.ERROR, f'the body is lost: {self._lost}; {state}', values
        if limits := getattr(self._driver, 'at_limit', ()):
            return diagnostics.WARN, f'{state}; at a limit: {", ".join(limits)}', values
        level = {TURNING: diagnostics.OK, WAITING: diagnostics.WARN}.get(state, diagnostics.ERROR)
        return level, state, values


def main(i: int, config: str | Path | None = None, arguments: Sequence[str] = ()) -> int:
    """Drive body i until it is signalled; see :func:`tetra_ros2.ros.executor.run`."""
    return executor.run(partial(Body, i), config, arguments)
