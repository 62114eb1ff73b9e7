# Copyright 2026 The tetra_ros2 authors
# SPDX-License-Identifier: Apache-2.0

"""What the nodes of a formation have in common."""

from rclpy.node import Node
from rclpy.qos_overriding_options import QoSOverridingOptions

from tetra_ros2.ros.diagnostics import Health


class FormationNode(Node):
    """
    A node that can name its own topics, and reports on ``diagnostics``.

    A subclass offers ``assess()`` for :class:`~tetra_ros2.ros.diagnostics.Health`, and calls
    :meth:`report_health` when it can answer it.

    :param args: the node's name, and what rclpy's Node takes beside it
    """

    def __init__(self, *args, **kwargs):
        super().__init__(*args, **kwargs)
        self.inputs = []  # subscriptions
        self.outputs = []  # publishers
        self.health = None

    def listen(self, message_type, topic, callback, profile):
        """Subscribe to the bytes of a topic, with quality of service open to overrides."""
        self.inputs.append(self.create_subscription(
            message_type, topic, callback, profile, raw=True,
            qos_overriding_options=QoSOverridingOptions.with_default_policies()))

    def offer(self, message_type, topic, profile):
        """Return a publisher, with quality of service open to overrides."""
        publisher = self.create_publisher(
            message_type, topic, profile,
            qos_overriding_options=QoSOverridingOptions.with_default_policies())
        self.outputs.append(publisher)
        return publisher

    def report_health(self):
        """Begin to report on ``diagnostics``."""
        self.health = Health(self, self.assess)

    def close(self):
        """Do what is to be done while the node can still publish."""
