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
The monitor: it watches the attitudes, and says how far the formation is.

Unlike an agent it sees absolute attitudes and knows what is to come out; nobody listens to it
but people.
"""

from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
import time
from typing import Any

from geometry_msgs.msg import PoseArray
import numpy as np
from rclpy.serialization import serialize_message
from rclpy.task import Future
from std_msgs.msg import Float64, Float64MultiArray, MultiArrayDimension
from tetra_ros2.config.configuration import formation_from_parameters
from tetra_ros2.formation import shapes
from tetra_ros2.formation._types import Array
from tetra_ros2.formation.checks import Rejected
from tetra_ros2.formation.observer import Observer
from tetra_ros2.ros import diagnostics, executor, parameters, qos
from tetra_ros2.ros.markers import Markers
from tetra_ros2.ros.node import FormationNode, raw_publish
from tetra_ros2.ros.tf import State, Transforms
from tetra_ros2.wire import cdr, names

HOLD = 500_000_000
"""For how long it has to have formed, or to be lost, before that counts on the console [ns]."""

LOST = 10.0
"""
How many times the tolerance the error of a lost formation is. On a busy machine the error swings
about the tolerance, which is not worth a line each time.
"""

SILENCE = 0.5
"""After how long without a state the plant is missed [s]; longer where states are rarer."""

PATIENCE = 3
"""After how many old stamps in a row the plant is taken to have been started anew."""


class Monitor(FormationNode):
    """
    The node ``monitor``.

    :param kwargs: what rclpy's Node takes beside its name
    :raises ConfigurationError: if a parameter is not valid
    """

    def __init__(self, **kwargs: Any) -> None:
        super().__init__(names.MONITOR, **kwargs)
        values = parameters.declare(self, 'monitor', formation_from_parameters, self._apply)
        self.formation = formation = formation_from_parameters(values)
        self.observer = self._make_observer(values['tolerance'])
        self._old = 0  # how many old stamps in a row
        self._heard_at = self._interval = 0.0  # of the last state, on the steady clock [s]
        self._awaited: tuple[int, Future] | None = None
        self._told: int | None = None  # of which run it was said that it has formed
        self._lost_at: int | None = None  # since when it seems lost [ns]
        self._watchers: list[Callable[[bytes], object]] = []
        self._decode = cdr.pose_array(names.WORLD, formation.topology.n).decoder()
        self._send_cosines = raw_publish(
            self.offer(Float64MultiArray, names.COSINES, qos.STATE, exclusive=True))
        self._encode_cosines = cdr.trailing_numbers(
            serialize_message(self._cosines_message()), len(self.observer.pairs))
        if self.observer.shape is not None:
            self._send_error = raw_publish(
                self.offer(Float64, names.ERROR, qos.STATE, exclusive=True))
            self._encode_error = cdr.trailing_numbers(serialize_message(Float64()), 1)
        self._markers = Markers(self, self._look)
        self._transforms = Transforms(self, self._poses) if values['publish_tf'] else None
        self.report_health(self.assess)
        if reservation := shapes.reservation(formation.topology, formation.gain):
            self.get_logger().warning(reservation)
        self.listen(PoseArray, names.ATTITUDES, self._on_attitudes, qos.STATE)

    def _cosines_message(self) -> Float64MultiArray:
        """Return a message of cosines: one labelled dimension for each pair of agents."""
        message = Float64MultiArray()
        count = len(self.observer.pairs)
        message.data = [0.0] * count
        # A dimension of size 1 for each pair says which is which; the last stride is 1.
        message.layout.dim = [
            MultiArrayDimension(label='cos(theta_ij) for i < j', size=count, stride=count),
            *(MultiArrayDimension(label=f'{i} {j}', size=1, stride=1)
              for i, j in self.observer.pairs)]
        return message

    def _look(self) -> tuple[int, Array] | None:
        """Return the stamp and the reduced attitudes of the last state, or None."""
        observer = self.observer
        return None if observer.stamp is None else (observer.stamp, observer.reduced_attitudes)

    def _poses(self) -> State | None:
        """Return stamp, attitudes and reduced attitudes of the last state, or None."""
        observer = self.observer
        return None if observer.stamp is None else (
            observer.stamp, observer.attitudes, observer.reduced_attitudes)

    def _make_observer(self, tolerance: float) -> Observer:
        return Observer(self.formation.topology, tolerance, self._fastest())

    def _fastest(self) -> float:
        """Return the fastest rate that the law can command [rad/s]."""
        topology, gain = self.formation.topology, self.formation.gain
        return float(gain.f(0.0) * np.abs(topology.weights).sum(axis=1).max())

    def _apply(self, values: Mapping[str, Any]) -> None:
        self.observer.tolerance = values['tolerance']
        self.formation = formation_from_parameters(values)
        self.observer.fastest = self._fastest()

    def _on_attitudes(self, message: bytes) -> None:
        observer = self.observer
        try:
            stamp, poses = self._decode(message)
            new = observer.observe(stamp, poses)
        except Rejected as rejection:
            self.health.reject(rejection, names.ATTITUDES)
            self._old += str(rejection) == Rejected.OLD_STAMP
            if self._old >= PATIENCE:
                self._old = 0
                self.observer = self._make_observer(observer.tolerance)
                self._told = None
            return
        self._old = 0
        now = time.monotonic()
        self._interval, self._heard_at = now - self._heard_at, now
        for tell in self._watchers:
            tell(message)
        if not new:
            return
        self._send_cosines(self._encode_cosines(*observer.cosines))
        if observer.shape is not None:
            self._send_error(self._encode_error(observer.error))
        self._tell_formed(stamp)
        if self._awaited is not None and stamp >= self._awaited[0] \
                and not self._awaited[1].done():
            self._awaited[1].set_result(stamp)

    def _tell_formed(self, stamp: int) -> None:
        """Say on the console that it has formed; once, unless it is lost or placed anew."""
        observer = self.observer
        if self._told != observer.restarts:
            if observer.formed_at is None or observer.shape is None \
                    or stamp - observer.formed_at < HOLD:
                return
            self._told, self._lost_at = observer.restarts, None
            self.get_logger().info(f'formed: {observer.shape.name}, after '
                                   f'{observer.time_to_form:.2f} s')
        elif observer.error < LOST * observer.tolerance:
            self._lost_at = None
        elif self._lost_at is None:
            self._lost_at = stamp
        elif stamp - self._lost_at >= HOLD:
            self._told = None

    def watch(self, tell: Callable[[bytes], object]) -> None:
        """Call a function, a quick one, with the bytes of every good state, repeated or not."""
        self._watchers.append(tell)

    def notify(self, stamp: int, future: Future) -> None:
        """Complete a future with the first sample at or after a stamp [ns]."""
        self._awaited = (stamp, future)

    def assess(self) -> diagnostics.Assessment:
        """Return level, message and figures for the diagnostics."""
        observer = self.observer
        rates = self.health.rates({'attitude rate [Hz]': observer.count})
        values: dict[str, Any] = {'attitudes': observer.count, **rates}
        if not observer.count:
            return diagnostics.WARN, 'waiting for attitudes', values
        values['formation time [s]'] = observer.elapsed
        level, message = diagnostics.OK, self._describe(values)
        silent = time.monotonic() - self._heard_at
        if silent > max(SILENCE, 3.0 * self._interval):
            level, message = diagnostics.WARN, f'{message}; no attitudes for {silent:.1f} s'
        return level, message, values

    def _describe(self, values: dict[str, Any]) -> str:
        """Say in words how the formation is, and add the figures."""
        observer = self.observer
        if observer.shape is None:
            values['change of shape [rad/s]'] = observer.error
            return 'watching a formation of no known shape'
        values['formation error [rad]'] = observer.error
        if observer.formed_at is None:
            return f'forming: {observer.shape.name}'
        values['time to form [s]'] = observer.time_to_form
        return f'formed: {observer.shape.name}'


def main(config: str | Path | None = None, arguments: Sequence[str] = ()) -> int:
    """Run the monitor until it is signalled; see :func:`tetra_ros2.ros.executor.run`."""
    return executor.run(Monitor, config, arguments)
