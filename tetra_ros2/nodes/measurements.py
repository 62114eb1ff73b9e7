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

"""What the plant and the sensors publish: the state, and what everybody sees of it."""

from collections.abc import Callable, Collection, Sequence
from typing import Protocol

from geometry_msgs.msg import PoseArray, Vector3Stamped
from tetra_ros2.formation._types import Quaternion, Vector
from tetra_ros2.formation.sensing import SeenBy
from tetra_ros2.formation.topology import Topology
from tetra_ros2.ros import qos
from tetra_ros2.ros.node import FormationNode, raw_publish
from tetra_ros2.wire import cdr, names

NOBODY: frozenset[int] = frozenset()
EVERYBODY = -1
"""All agents, as the bits of an integer."""

_Sensor = tuple[int, list[int], list[Callable[[bytes], None]],
                Callable[[bytes], tuple[bytes, Callable[..., bytes]]]]
"""Index of an agent, those of whom it sees, how to tell it of each of them, and the codec."""


class State(Protocol):
    """What is published of bodies."""

    @property
    def attitudes(self) -> Sequence[Quaternion]:
        """Return unit quaternions x y z w, body to world."""

    @property
    def reduced(self) -> Sequence[Vector]:
        """Return the reduced attitudes."""


class Measurements:
    """
    Publishes ``formation/attitudes`` and one measurement for each edge of the graph.

    :param node: the node
    :param topology: who sees whom
    """

    def __init__(self, node: FormationNode, topology: Topology) -> None:
        n = topology.n
        self._send_state = raw_publish(node.offer(
            PoseArray, names.ATTITUDES, qos.STATE, exclusive=True))
        self._state = cdr.pose_array(names.WORLD, n)
        # For each agent that sees anybody: its index, whom it sees, how to tell it, the codec.
        self._sensors: list[_Sensor] = []
        for i in range(1, n + 1):
            neighbors = [j for j, _ in topology.neighbors(i)]
            senders = [raw_publish(
                node.offer(Vector3Stamped, names.relative_attitude(i, j), qos.NEWEST))
                for j in neighbors]
            if neighbors:
                self._sensors.append((i - 1, [j - 1 for j in neighbors], senders,
                                      cdr.vector3_stamped(names.body_frame(i)).encoder))
        self.observers = [sensor[0] for sensor in self._sensors]
        """Indices, from 0, of the agents that see anybody."""
        self.others: list[list[int] | None] = [None] * n
        """For each agent, by indices, whom it sees; None for a blind one."""
        for i, seen, *_ in self._sensors:
            self.others[i] = seen

    def publish(self, stamp: int, bodies: State, seen_by: SeenBy,
                lost: Collection[int] = NOBODY) -> None:
        """
        Publish the state and what everybody sees of it, as of the time ``stamp`` [ns].

        :param bodies: the bodies
        :param seen_by: what body i sees of others, ``bodies.seen_by`` if the sensors are perfect
        :param lost: indices of bodies whose attitudes are not known: they see nothing, and nobody
            sees them
        """
        head = cdr.head(stamp)
        self.tell(head, seen_by, lost)
        # Last, as nobody's answer waits for it.
        state: list[float] = []
        for position, orientation in zip(bodies.reduced, bodies.attitudes):
            state += position
            state += orientation
        prefix, pack = self._state.encoder(head)
        self._send_state(pack(prefix, *state))

    def tell(self, head: bytes, seen_by: SeenBy, lost: Collection[int] = NOBODY,
             agents: int = EVERYBODY) -> None:
        """
        Publish what everybody sees.

        :param head: of the messages, with their stamp
        :param agents: bits of an integer: only what these see; by default all
        """
        sensors = self._sensors if agents == EVERYBODY and not lost else \
            self._sensors_of(agents, lost)
        for i, others, senders, encoder in sensors:
            prefix, pack = encoder(head)
            for send, (x, y, z) in zip(senders, seen_by(i, others)):
                send(pack(prefix, x, y, z))

    def _sensors_of(self, agents: int, lost: Collection[int]) -> list[_Sensor]:
        """Return the sensors of some agents, which tell nothing of bodies that are lost."""
        return [(i, others, [_keep if j in lost else send for j, send in zip(others, senders)],
                 encoder)
                for i, others, senders, encoder in self._sensors
                if agents >> i & 1 and i not in lost]


def _keep(_message: bytes) -> None:
    """Tell nobody."""
