# Copyright 2026 The tetra_ros2 authors
# SPDX-License-Identifier: Apache-2.0

from geometry_msgs.msg import PoseArray
from node_bench import Bench
from rclpy.qos import HistoryPolicy, QoSProfile, ReliabilityPolicy

from tetra_ros2.nodes.monitor import Monitor
from tetra_ros2.wire import cdr

COUNT = 300
ENOUGH = QoSProfile(
    history=HistoryPolicy.KEEP_LAST, depth=COUNT, reliability=ReliabilityPolicy.RELIABLE)


def test_whoever_watches_gets_every_state_even_if_it_was_busy_meanwhile(probe):
    encode = cdr.pose_array('world', 2).encode
    direction = [1.0, 0.0, 0.0, 0.0, 0.0, 0.0, 1.0]
    with Bench(probe, Monitor, topology__n=2) as bench:
        publisher = probe.node.create_publisher(PoseArray, 'formation/attitudes', ENOUGH)
        bench.wait_for(lambda: publisher.get_subscription_count()
                       and bench.node.inputs[0].get_publisher_count(), 'both ends')
        for k in range(1, COUNT + 1):  # the monitor's executor does not spin meanwhile
            publisher.publish(encode(k, *direction, *direction))
        bench.wait_for(lambda: bench.node.observer.stamp == COUNT, 'the last one')
        assert bench.node.observer.count == COUNT
