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
The viewer: the running formation in a browser.

It relies on the topics, services and parameters of the contract and on nothing else. Who the
agents are it learns from the state, who sees whom from the names of topics, weights and gain from
the parameters of the agents, if they have any.
"""

from collections import deque
from collections.abc import Callable, Sequence
from copy import copy
from functools import partial
from pathlib import Path
import queue
import re
import time
from typing import Any

from diagnostic_msgs.msg import DiagnosticArray
from geometry_msgs.msg import PoseArray
import numpy as np
from rcl_interfaces.msg import Parameter as ParameterMessage
from rcl_interfaces.srv import GetParameters, SetParameters
from rclpy.client import Client
from rclpy.parameter import Parameter, parameter_value_to_python
from rclpy.qos import HistoryPolicy, QoSProfile, ReliabilityPolicy
from rclpy.qos_overriding_options import QoSOverridingOptions
from rclpy.serialization import deserialize_message
from rclpy.task import Future
from std_srvs.srv import SetBool, Trigger
from tetra_ros2.config.configuration import formation_from_parameters
from tetra_ros2.config.parameters import check_parameters, ConfigurationError, FORMATION
from tetra_ros2.drawing.theory import Theory
from tetra_ros2.formation import Formation
from tetra_ros2.formation import gain as gains
from tetra_ros2.formation._types import Array
from tetra_ros2.formation.checks import Rejected, require_unit
from tetra_ros2.formation.topology import Topology
from tetra_ros2.ros import diagnostics, executor, qos
from tetra_ros2.ros.node import FormationNode
from tetra_ros2.viewer.bodies import Bodies
from tetra_ros2.viewer.panel import Controls, FRAME_PERIOD, Page
from tetra_ros2.viewer.scene import MOST_AGENTS
from tetra_ros2.viewer.server import serve, stop
from tetra_ros2.wire import cdr, names
from visualization_msgs.msg import MarkerArray

LATEST = QoSProfile(
    history=HistoryPolicy.KEEP_LAST, depth=10, reliability=ReliabilityPolicy.BEST_EFFORT)
"""Who only looks may miss something, and must not keep the plant waiting."""

MOST_STATES = 12
"""States looked at for one picture; those between them nobody would see."""

SHARE = 0.02
"""
How much of the time may go into pictures while the plant, in this same process, runs as fast as it
can; what the web server makes of them costs as much again.
"""

LONGEST_PAUSE = 0.5
"""But a page that stands still for longer than this [s] seems broken."""

FAST = 1500.0
"""States per second from which on it does so: nobody asks for these to look at them."""

STATUS_PERIOD = 0.25
"""How often the line of status is written [s]."""

INQUIRY_PERIOD = 1.0
"""How often to look who is there and how they are set [s]."""

PATIENCE = 2.0
"""After how long without a state [s] the plant is taken to have gone."""

_PLANT_PARAMETERS = ('mode', 'rate', 'real_time_factor', 'measurement_delay')
_FORMATION_PARAMETERS = tuple(spec.name for spec in FORMATION)


class Viewer(FormationNode):
    """
    The node ``viewer``.

    :param host: address that the web server listens on
    :param port: its port; 0 for any that is free
    :param read_only: whether browsers may do nothing but look
    :param watch: called with a function that takes the bytes of every state, where somebody in
        this process has them already; by default the viewer subscribes for itself
    :param kwargs: what rclpy's Node takes beside its name
    :raises ConfigurationError: if the port is taken; see :func:`tetra_ros2.viewer.server.serve`
    """

    def __init__(self, *, host: str = '127.0.0.1', port: int = 8080, read_only: bool = False,
                 watch: Callable[[Callable[[bytes], object]], object] | None = None,
                 **kwargs: Any) -> None:
        super().__init__(names.VIEWER, **kwargs)
        self.exclusive_inputs = False  # everybody publishes diagnostics
        self.page = Page(serve(host, port, read_only))
        self._inbox: deque[bytes] = deque(maxlen=10000)
        # What the server's threads ask of this one.
        self._requests: queue.SimpleQueue[tuple[str, tuple[Any, ...]]] = queue.SimpleQueue()
        self._controls = Controls(self.page, _Actions(self._requests))
        self.page.finish()
        # How many agents there are, and how to decode their state.
        self._codec: tuple[int, Callable[[bytes], tuple[int, Sequence[float]]]] | None = None
        self._states = self._pictures = 0
        self._heard_at: float | None = None
        self._shares = watch is not None
        self._drawn_at = self._next_picture = self._next_status = 0.0
        self._plant_paused = False
        self.ended = False  # whether who runs the formation has said that this is all
        # Parameters of each node that answered, by the node's name.
        self._settings: dict[str, dict[str, Any]] = {}
        self._pending: dict[str, Future] = {}
        self._named_clients: dict[str, Client] = {}
        prefix = re.escape(self.resolve_topic_name('x')[:-1])
        self._edge = re.compile(prefix + names.relative_attitude(r'(\d+)', r'(\d+)'))
        self.report_health(self.assess)
        self.listen(DiagnosticArray, names.DIAGNOSTICS, self._on_diagnostics, qos.REPORTS)
        if watch is None:
            self.listen(PoseArray, names.ATTITUDES, lambda m: self._inbox.append(m), LATEST)
        else:
            watch(self._inbox.append)
        self._bodies = Bodies(self.page.server)
        self._news_of_bodies: bytes | None = None
        # Not one of the inputs, which the launcher waits for: kinematic bodies look like nothing.
        self.create_subscription(
            MarkerArray, names.BODIES, self._on_bodies, copy(qos.PICTURE), raw=True,
            qos_overriding_options=QoSOverridingOptions.with_default_policies())
        self.create_steady_timer(FRAME_PERIOD, self._refresh)
        self.create_steady_timer(INQUIRY_PERIOD, self._inquire)
        self._show_status()
        # Not in the log, which every node can read: it may hold the token.
        print(self.page.server.invitation, flush=True)

    def close(self) -> None:
        """Send the browsers away."""
        stop(self.page.server)

    def _refresh(self) -> None:
        """Do what was asked for, and draw what has come."""
        while not self._requests.empty():
            action, arguments = self._requests.get()
            getattr(self, action)(*arguments)
        begun = time.monotonic()
        if begun < self._next_picture:
            return
        rate = len(self._inbox) / (begun - self._drawn_at)
        self._drawn_at = begun
        if self._inbox:
            self._take_states()
        if begun >= self._next_status:
            self._next_status = begun + STATUS_PERIOD
            self._show_status()
        self.page.draw()
        self._draw_bodies(begun)
        self._pictures += self.page.watched
        if not self.page.watched:
            self._next_picture = begun + STATUS_PERIOD
        elif self._shares and rate > FAST:
            self._next_picture = begun + min((time.monotonic() - begun) / SHARE, LONGEST_PAUSE)

    def _on_bodies(self, message: bytes) -> None:
        self._news_of_bodies = message

    def _draw_bodies(self, now: float) -> None:
        message, self._news_of_bodies = self._news_of_bodies, None
        if message is not None and self.page.watched and not self._bodies.show(message, now):
            self.health.reject(Rejected(Rejected.MALFORMED), names.BODIES)
        self._bodies.forget(now)
        self.page.cameras.make_room(self._bodies.reach)

    def _take_states(self) -> None:
        messages = [self._inbox.popleft() for _ in range(len(self._inbox))]
        self._states += len(messages)
        step = -(-len(messages) // MOST_STATES)
        for message in messages[::-step][::-1]:
            try:
                stamp, gamma = self._decode(message)
            except Rejected as rejection:
                self.health.reject(rejection, names.ATTITUDES)
                continue
            self._heard_at = time.monotonic()
            self.page.history.add(stamp, gamma)

    def _decode(self, message: bytes) -> tuple[int, Array]:
        """Return stamp [ns] and reduced attitudes ``(n, 3)`` of a state of however many agents."""
        n = cdr.sequence_length(message)
        if self._codec is None or self._codec[0] != n:
            if not 1 < n <= 1000:
                raise Rejected(Rejected.MALFORMED)
            self._codec = n, cdr.pose_array(names.WORLD, n).decoder()
        stamp, numbers = self._codec[1](message)
        gamma = np.array(numbers).reshape(n, 7)[:, :3]
        for direction in gamma.tolist():
            require_unit(*direction)
        return stamp, gamma

    def _on_diagnostics(self, message: bytes) -> None:
        plant = self.resolve_service_name(names.PLANT)
        try:
            statuses = deserialize_message(message, DiagnosticArray).status
        except Exception:  # anybody may send anything, and DDS has no one error for that
            self.health.reject(Rejected(Rejected.MALFORMED), names.DIAGNOSTICS)
            return
        for status in statuses:
            if status.name == plant:
                state = {item.key: item.value for item in status.values}.get('state')
                self._plant_paused = (state or status.message).startswith('paused')
                self._controls.show_paused(self._plant_paused)

    def _show_status(self) -> None:
        history = self.page.history
        if self._heard_at is None:
            self.page.say(f'**waiting** for `{self.resolve_topic_name(names.ATTITUDES)}`')
            return
        state = '**paused**' if self._plant_paused else '**running**'
        silent = time.monotonic() - self._heard_at
        if self.ended and (self._plant_paused or silent > PATIENCE):
            state = '**the run has ended**'
        elif silent > PATIENCE:
            state = '**no states** for some time: is the plant gone?'
        if history.gamma is not None:
            self.page.say(f'{len(history.gamma)} agents, {state}, t = {self.page.elapsed:.1f} s')

    # Parameters of the others

    def _inquire(self) -> None:
        """Look who sees whom, and ask the agents and the plant how they are set."""
        found = (self._edge.fullmatch(topic) for topic, _ in self.get_topic_names_and_types())
        edges = sorted({(int(m[1]), int(m[2])) for m in found if m})
        weights = self._know()
        if weights is not None:
            # DDS remembers the topics of a plant that died, of more agents perhaps, for a while.
            edges = [(i, j) for i, j in edges if max(i, j) <= len(weights)]
        self.page.edges = tuple(
            (i, j, None if weights is None else float(weights[i - 1, j - 1])) for i, j in edges)
        if not self.page.watched:
            return
        n = 0 if self.page.history.gamma is None else len(self.page.history.gamma)
        self._ask(names.PLANT, _PLANT_PARAMETERS)
        for i in range(1, n + 1) if n <= MOST_AGENTS else ():
            self._ask(names.agent(i), _FORMATION_PARAMETERS)
        plant = self._settings.get(names.PLANT, {})
        self._controls.show_plant(
            self._client(SetBool, names.PAUSE).service_is_ready(),
            plant.get('mode') == 'lockstep' and 'real_time_factor' in plant)

    def _know(self) -> Array | None:
        """Put together what the agents say; return the weights, or None if that is not all."""
        history = self.page.history
        if history.gamma is None:
            return None
        n = len(history.gamma)
        if n > MOST_AGENTS:
            return None
        told = [self._formation(names.agent(i)) for i in range(1, n + 1)]
        formations = [f for f in told if f is not None and f.topology.n == n]
        if len(formations) < n:
            self.page.know(Theory(n))
            self._controls.show_gain(None)
            return None
        weights = np.stack([f.topology.weights[k] for k, f in enumerate(formations)])
        gain: gains.Gain | None = formations[0].gain
        if any(f.gain != gain or type(f.gain) is not type(gain) for f in formations):
            gain = None
        # What the agents are told of the shape they make is told with all of their weights.
        topology = formations[0].topology
        if not np.array_equal(topology.weights, weights):
            topology = Topology('custom', weights)
        self.page.know(Theory(n, topology, gain, self._sample_time()))
        self._controls.show_gain(gain)
        return weights

    def _sample_time(self) -> float | None:
        """Return how long a command is held [s], or None where delay makes it more than that."""
        plant = self._settings.get(names.PLANT, {})
        rate, delay = plant.get('rate'), plant.get('measurement_delay', 0.0)
        return 1.0 / rate if isinstance(rate, float) and rate > 0.0 and not delay else None

    def _formation(self, node: str) -> Formation | None:
        """Return the formation as a node is told of it, or None if it did not say."""
        settings = self._settings.get(node)
        if not settings or not set(_FORMATION_PARAMETERS) <= set(settings):
            return None
        kind = str(settings['gain.kind'])
        if gains.OWN.fullmatch(kind) and not gains.is_known(kind):
            return None  # what some node says must not choose what is imported here
        try:
            return formation_from_parameters(check_parameters('agent', settings))
        except ConfigurationError:
            return None  # somebody else's node, with parameters of the same names

    def _client(self, kind: type, name: str) -> Client:
        if name not in self._named_clients:
            self._named_clients[name] = self.create_client(kind, name)
        return self._named_clients[name]

    def _ask(self, node: str, parameters: Sequence[str]) -> None:
        """Ask a node for parameters, unless it still owes an answer."""
        client = self._client(GetParameters, f'{node}/get_parameters')
        pending = self._pending.get(node)
        if not client.service_is_ready():
            self._settings.pop(node, None)
            if pending is not None:
                client.remove_pending_request(self._pending.pop(node))
        elif pending is None or pending.done():
            self._pending[node] = future = client.call_async(
                GetParameters.Request(names=parameters))
            future.add_done_callback(partial(self._on_parameters, node, parameters))

    def _on_parameters(self, node: str, parameters: Sequence[str], future: Future) -> None:
        if future.cancelled() or future.exception() is not None:
            return
        values = dict(zip(parameters, map(parameter_value_to_python, future.result().values)))
        self._settings[node] = {k: v for k, v in values.items() if v is not None}

    # What people ask for; each of these runs in the executor's thread

    def pause(self, paused: bool) -> None:
        """Let the plant rest, or go on."""
        self._call(SetBool, names.PAUSE, SetBool.Request(data=paused),
                   lambda _: self._on_paused(paused))

    def _on_paused(self, paused: bool) -> None:
        self._plant_paused = paused
        self._controls.show_paused(paused)

    def reset(self) -> None:
        """Let the plant go back to its initial condition, as it understands that."""
        self._call(Trigger, names.RESET, Trigger.Request(),
                   self._on_reset)

    def _on_reset(self, response: Trigger.Response) -> None:
        self.page.restart()
        self.page.notify('started anew', response.message, 'green')

    def start_at_random(self) -> None:
        """Let the plant start anew at random."""
        self._call(Trigger, names.RANDOMIZE, Trigger.Request(), self._on_reset)

    def set_gain(self, a: float) -> None:
        """Give all agents this amplitude of the gain [rad/s], and all others who have one."""
        nodes = [node for node in self._settings if node != names.PLANT]
        for node in (*nodes, names.PLANT, names.MONITOR):
            self._set(node, Parameter('gain.a', value=float(a)))

    def set_speed(self, factor: float) -> None:
        """Let formation time pass so many times as fast as time; 0 for as fast as it can."""
        self._set(names.PLANT, Parameter('real_time_factor', value=float(factor)))

    def _set(self, node: str, parameter: Parameter,
             then: Callable[[], None] | None = None) -> None:
        message = ParameterMessage(name=parameter.name, value=parameter.get_parameter_value())

        def on_answer(response: SetParameters.Response) -> None:
            result = response.results[0]
            if not result.successful:
                self.page.notify(f'{node} does not take that', result.reason)
            elif then is not None:
                then()

        self._call(SetParameters, f'{node}/set_parameters',
                   SetParameters.Request(parameters=[message]), on_answer,
                   required=node != names.MONITOR)

    def _call(self, kind: type, name: str, request: Any, then: Callable[[Any], None],
              required: bool = True) -> None:
        """Call a service; nobody waits for the answer, and if there is none, somebody is told."""
        client = self._client(kind, name)
        if not client.service_is_ready():
            if required:
                self.page.notify('nobody is there', f'{client.srv_name} does not answer')
            return

        def on_done(future: Future) -> None:
            if future.exception() is not None:
                self.page.notify(f'{name} failed', str(future.exception()))
            else:
                then(future.result())

        client.call_async(request).add_done_callback(on_done)

    def assess(self) -> diagnostics.Assessment:
        """Return level, message and figures for the diagnostics."""
        values = {'browsers': len(self.page.server.get_clients()),
                  'port': self.page.server.get_port(),
                  **self.health.rates({'state rate [Hz]': self._states,
                                       'picture rate [Hz]': self._pictures})}
        if self._heard_at is None:
            return diagnostics.WARN, 'waiting for attitudes', values
        return diagnostics.OK, 'showing', values


class _Actions:
    """Puts what is asked for where the executor's thread finds it."""

    def __init__(self, requests: queue.SimpleQueue[tuple[str, tuple[Any, ...]]]) -> None:
        self._requests = requests

    def __getattr__(self, name: str) -> Callable[..., None]:
        return lambda *arguments: self._requests.put((name, arguments))


def main(host: str, port: int, read_only: bool = False, config: str | Path | None = None,
         arguments: Sequence[str] = ()) -> int:
    """Run the viewer until it is signalled; see :func:`tetra_ros2.ros.executor.run`."""
    executor.look_around()
    return executor.run(
        partial(Viewer, host=host, port=port, read_only=read_only), config, arguments)
