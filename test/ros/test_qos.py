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

from geometry_msgs.msg import PoseArray, Vector3Stamped
from node_bench import Bench
import pytest
from rclpy.qos import HistoryPolicy, qos_profile_sensor_data, QoSProfile, ReliabilityPolicy
from tetra_ros2.nodes.agent import Agent
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


SEEN = 'agent_1/relative_attitude/agent_2'
RELIABILITY = f'qos_overrides./{SEEN}.subscription.reliability'


def measure(probe, bench, publisher, condition, what):
    """Go on measuring until a condition holds."""
    encode = cdr.vector3_stamped('agent_1').encode
    stamps = iter(range(1, 10**6))

    def spoken():
        publisher.publish(encode(next(stamps), 0.0, 1.0, 0.0))
        return condition()

    bench.wait_for(spoken, what)


@pytest.mark.parametrize('first', ['driver', 'agent'])
def test_an_agent_understands_a_driver_that_offers_best_effort(probe, first):
    def driver():
        return probe.node.create_publisher(Vector3Stamped, SEEN, qos_profile_sensor_data)

    publisher = driver() if first == 'driver' else None
    with Bench(probe, Agent, 1, topology__n=2) as bench:
        publisher = publisher or driver()
        measure(probe, bench, publisher, lambda: bench.node.answers > 3, 'answers')
        assert len(bench.node.inputs) == 1
        probe.node.destroy_publisher(publisher)
        answers = bench.node.answers
        reliable = probe.node.create_publisher(Vector3Stamped, SEEN, 1)
        bench.wait_for(lambda: not bench.node.publisher_conflicts(), 'the end of the first')
        bench.node._controller.forget()
        measure(probe, bench, reliable, lambda: bench.node.answers > answers + 3, 'more answers')
        assert not bench.node.health.exceptions


def test_what_does_not_fit_as_the_user_wants_it_is_named(probe, capfd):
    publisher = probe.node.create_publisher(Vector3Stamped, SEEN, qos_profile_sensor_data)
    with Bench(probe, Agent, 1, topology__n=2, **{RELIABILITY: 'reliable'}) as bench:
        said = ''

        def named():
            nonlocal said
            said += capfd.readouterr().err
            return 'does not fit, the last in its reliability' in said

        bench.wait_for(named, 'the warning')
        assert f'/{SEEN}' in said
        assert publisher
