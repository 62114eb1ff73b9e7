# Copyright 2026 The tetra_ros2 authors
# SPDX-License-Identifier: Apache-2.0

"""What the plant and the sensors publish: the state, and what everybody sees of it."""

from collections.abc import Callable, Collection, Sequence
from typing import Any

from geometry_msgs.msg import PoseArray, Vector3Stamped
from tetra_ros2.formation.bodies import RigidBodies
from tetra_ros2.formation.topology import Topology
from tetra_ros2.ros import qos
from tetra_ros2.ros.node import FormationNode, raw_publish
from tetra_ros2.wire import cdr, names

NOBODY: frozenset[int] = frozenset()


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
        self._sensors: list[tuple[int, list[int], list[Callable[[bytes], None]], Any]] = []
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

    def publish(self, stamp: int, bodies: RigidBodies,
                seen_by: Callable[[int, Sequence[int]], Any],
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
        self._send_state(prefix + pack(*state))

    def tell(self, head: bytes, seen_by: Callable[[int, Sequence[int]], Any],
             lost: Collection[int] = NOBODY, agents: int = -1) -> None:
        """
        Publish what everybody sees.

        :param head: of the messages, with their stamp
        :param agents: bits of an integer: only what these see; by default all
        """
        for i, others, senders, encoder in self._sensors:
            if i in lost or not agents >> i & 1:
                continue
            prefix, pack = encoder(head)
            if lost:
                for j, send, (x, y, z) in zip(others, senders, seen_by(i, others)):
                    if j not in lost:
                        send(prefix + pack(x, y, z))
                continue
            for send, (x, y, z) in zip(senders, seen_by(i, others)):
                send(prefix + pack(x, y, z))
