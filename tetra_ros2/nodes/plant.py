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
The plant: n rigid bodies that turn as they are told, and the sensors on them.

The node owns the topics and the state. When to step is left to one of two steppers,
:class:`~tetra_ros2.nodes.lockstep.Lockstep` and :class:`~tetra_ros2.nodes.realtime.RealTime`.
"""

from collections.abc import Callable, Collection, Mapping, Sequence
from pathlib import Path
import secrets
from typing import Any

from geometry_msgs.msg import TwistStamped
import numpy as np
from rclpy.subscription import Subscription
from rclpy.timer import Timer
from std_srvs.srv import SetBool, Trigger
from tetra_ros2.config.bodies import check_bodies
from tetra_ros2.config.configuration import formation_from_parameters, initial_attitudes
from tetra_ros2.config.parameters import ConfigurationError
from tetra_ros2.formation._types import Array
from tetra_ros2.formation.checks import Rejected, require_rate
from tetra_ros2.formation.sensing import delay_in_steps, SeenBy, Sensors
from tetra_ros2.nodes.lockstep import Lockstep
from tetra_ros2.nodes.measurements import Measurements, NOBODY
from tetra_ros2.nodes.realtime import RealTime
from tetra_ros2.nodes.stepper import agents_of, Stepper
from tetra_ros2.nodes.vehicles import PartlyElsewhere, STILL, Vehicles
from tetra_ros2.ros import diagnostics, executor, parameters, qos
from tetra_ros2.ros.node import FormationNode
from tetra_ros2.wire import cdr, names

CONFLICT_PERIOD = 0.05
"""How often to look for a second publisher, where one holds a body still [s]."""


class Plant(FormationNode):
    """
    The node ``plant``.

    :param start: whether time begins at once; otherwise with a call of ``stepper.start()``
    :param kwargs: what rclpy's Node takes beside its name
    :raises ConfigurationError: if a parameter is not valid
    """

    def __init__(self, *, start: bool = True, **kwargs: Any) -> None:
        super().__init__(names.PLANT, **kwargs)
        values = parameters.declare(self, 'plant', self._accept, self._apply)
        self.formation = formation_from_parameters(values)
        self._topology = topology = self.formation.topology
        n = topology.n

        self.seed: int = values['seed']
        self._given_attitudes = initial_attitudes(values, n)
        if self._given_attitudes is None and self.seed < 0:
            self.seed = secrets.randbelow(2**31)
        self._vehicles = Vehicles(self, {**values, 'seed': self.seed}, self.formation)
        if self._given_attitudes is None:
            self.get_logger().info(f'random initial attitudes of seed {self.seed}')
        self._rng = np.random.default_rng(max(self.seed, 0))
        self._start = self._vehicles.draw(self._rng) if self._given_attitudes is None \
            else self._given_attitudes
        self.bodies = self._vehicles.make(self._start)
        self.stopped = False  # by the emergency stop, until it is released

        self._measurements = Measurements(self, topology)
        self._held = 0
        self._conflict_timer: Timer | None = None
        self._command_inputs: list[Subscription] = []
        # For each agent: what gives its next command, and what takes it.
        self._commands: list[tuple[Callable[[], tuple[bytes, Any] | None],
                                   Callable[[bytes], None]]] = []
        self._imperfect = self._make_imperfect_sensors(values)
        self.mode: str = values['mode']
        stepper = {'lockstep': Lockstep, 'realtime': RealTime}[self.mode]
        self.stepper: Stepper = stepper(self, self._measurements.observers)
        for i in range(1, n + 1):
            on_command = self._receiver(i)
            subscription = self.listen(TwistStamped, names.cmd_vel(i), on_command, qos.COMMANDS,
                                       guarded=False)
            self._command_inputs.append(subscription)
            if self.stepper.reads_commands:
                self._commands.append((self.queue(subscription), on_command))
        self.create_service(Trigger, names.RESET, self._on_reset)
        self.create_service(Trigger, names.RANDOMIZE, self._on_randomize)
        self.create_service(SetBool, names.PAUSE, self._on_pause)
        self.create_service(SetBool, names.stop(names.PLANT), self._on_stop)
        self.report_health(self.assess)
        if topology.agents_without_neighbors:
            alone = ', '.join(map(str, topology.agents_without_neighbors))
            self.get_logger().warning(f'agents that see nobody, and are not waited for: {alone}')

        self._apply(values)
        if start:
            self.stepper.start()

    def _make_imperfect_sensors(self, values: Mapping[str, Any]) -> Sensors | None:
        """Return sensors with the faults that were asked for, or None if none were."""
        noise, loss = values['measurement_noise'], values['measurement_loss']
        delay = delay_in_steps(values['measurement_delay'], 1.0 / values['rate'])
        if not (noise or delay or loss):
            return None
        return Sensors(self.bodies.seen_by, self._measurements.others, noise=noise, delay=delay,
                       loss=loss, seed=max(self.seed, 0))

    @property
    def start_description(self) -> str:
        """Return in words where the bodies start."""
        return f'seed {self.seed}' if self._given_attitudes is None else 'given attitudes'

    def close(self) -> None:
        """Let time stand still."""
        self.stepper.stop()

    def _accept(self, values: Mapping[str, Any]) -> None:
        formation = formation_from_parameters(values)
        initial_attitudes(values, formation.topology.n)
        check_bodies(values)
        timeout, rate = values['command_timeout'], values['rate']
        if values['mode'] == 'realtime' and 0.0 < timeout < 2.0 / rate:
            raise ConfigurationError(
                f'{timeout} is not valid, expected at least two periods, {2.0 / rate:g} s at '
                f'{rate:g} Hz', key='command_timeout')

    def _apply(self, values: Mapping[str, Any]) -> None:
        """Follow the parameters that may change at run time."""
        self.rate: float = values['rate']
        self._max_angular_velocity: float = values['max_angular_velocity']
        self._hold = values['on_publisher_conflict'] == 'hold'
        if self._conflict_timer is None and self._hold:
            self._conflict_timer = self.create_steady_timer(
                CONFLICT_PERIOD, self._look_for_conflicts)
        if not self._hold:
            self._held = 0
        self.stepper.configure(values)

    def publish(self, stamp: int) -> None:
        """Publish the state and what everybody sees of it, as of the time ``stamp`` [ns]."""
        bodies, sensors = self.bodies, self._imperfect
        lost: Collection[int] = NOBODY
        if isinstance(bodies, PartlyElsewhere):
            bodies.look()
            lost = bodies.lost
        seen_by: SeenBy = bodies.seen_by
        if sensors is not None:
            sensors.sample(stamp)
            seen_by = sensors.seen_by
        self._measurements.publish(stamp, bodies, seen_by, lost)
        self._vehicles.tell(stamp)

    def repeat(self, stamp: int, agents: int) -> None:
        """Publish what these agents, bits of an integer, see once more."""
        sensors = self.bodies if self._imperfect is None else self._imperfect
        lost = self.bodies.lost if isinstance(self.bodies, PartlyElsewhere) else NOBODY
        self._measurements.tell(cdr.head(stamp), sensors.seen_by, lost, agents)

    def read_commands(self) -> None:
        """
        Take the commands that have come, if the plant reads them itself.

        It does in real time, where they count only when the next step is due: it is not woken
        for each of them.
        """
        for take, on_command in self._commands:
            while (taken := take()) is not None:
                on_command(taken[0])

    def _receiver(self, i: int) -> Callable[[bytes], None]:
        """Return what hands the commands of agent i to the stepper."""
        decode, command = cdr.twist_stamped(names.body_frame(i)).decoder(), self.stepper.command

        def on_command(message: bytes) -> None:
            try:
                stamp, (_, _, _, x, y, z) = decode(message)
                require_rate(x, y, z, self._max_angular_velocity)
                command(i - 1, stamp, STILL if self.stopped else (x, y, z))
            except Rejected as rejection:
                self.health.reject(rejection, names.agent(i))
            except Exception as error:  # whatever comes in may not end this node
                self.health.survive(error)

        return on_command

    def _on_reset(self, _request: Trigger.Request, response: Trigger.Response) -> Trigger.Response:
        self.reset()
        response.success = True
        response.message = 'back to the initial attitudes'
        return response

    def _on_randomize(self, _request: Trigger.Request,
                      response: Trigger.Response) -> Trigger.Response:
        self.randomize()
        response.success = True
        response.message = 'at new random attitudes'
        return response

    def reset(self) -> None:
        """Go back to the initial attitudes; time goes on."""
        self._place(self._start)

    def randomize(self) -> None:
        """Go to new random attitudes; time goes on."""
        self._place(self._vehicles.draw(self._rng))

    def _place(self, attitudes: Array) -> None:
        self.bodies = self._vehicles.make(attitudes)
        if self._imperfect is not None:
            self._imperfect.restart(self.bodies.seen_by)
        self.stepper.state_changed()

    def _on_pause(self, request: SetBool.Request, response: SetBool.Response) -> SetBool.Response:
        self.stepper.pause(request.data)
        response.success = True
        response.message = 'paused' if request.data else 'running'
        return response

    def _on_stop(self, request: SetBool.Request, response: SetBool.Response) -> SetBool.Response:
        self.stopped = request.data
        if self.stopped:
            self.stepper.state_changed()  # what was commanded before counts no more
            self.get_logger().error('emergency stop: all bodies are held until it is released')
        else:
            self.get_logger().warning('emergency stop released')
        response.success = True
        response.message = 'stopped' if self.stopped else 'released'
        return response

    def held_agents(self) -> int:
        """Return the agents, as bits, whose bodies are held still for a publisher conflict."""
        return self._held

    def _look_for_conflicts(self) -> None:
        """Hold the bodies that more than one node commands, if that is wished for."""
        if self._hold:
            self._held = sum(1 << i for i, commands in enumerate(self._command_inputs)
                             if commands.get_publisher_count() > 1)

    def assess(self) -> diagnostics.Assessment:
        """Return level, message and figures for the diagnostics."""
        level, message, values = self.stepper.assess(self.health)
        trouble, figures = self._vehicles.assess()
        values.update(figures)
        if trouble:
            level, message = max(level, diagnostics.WARN), f'{message}; {trouble}'
        if self.stopped:
            level, message = diagnostics.ERROR, f'emergency stop; {message}'
        if self._held:
            level = diagnostics.ERROR
            message = f'held still, more than one publisher: {agents_of(self._held)}; {message}'
        return level, message, values


def main(config: str | Path | None = None, arguments: Sequence[str] = ()) -> int:
    """Run the plant until it is signalled; see :func:`tetra_ros2.ros.executor.run`."""
    return executor.run(Plant, config, arguments)
