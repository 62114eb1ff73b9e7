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

"""What anybody may expect of a ROS 2 node: clocks, remapping, described parameters."""

from harness import run
from node_bench import Bench
import pytest
from rosgraph_msgs.msg import Clock
from tetra_ros2.config.parameters import PARAMETERS
from tetra_ros2.launcher import Launcher
from tetra_ros2.nodes.agent import Agent
from tetra_ros2.nodes.monitor import Monitor
from tetra_ros2.nodes.plant import Plant


def test_a_plant_in_real_time_follows_the_clock_of_others(probe):
    with Bench(probe, Plant, mode='realtime', seed=1, use_sim_time=True, rate=100.0) as bench:
        clock = probe.node.create_publisher(Clock, '/clock', 10)
        bench.wait_for(lambda: clock.get_subscription_count() > 0, 'the plant on /clock')
        time = Clock()

        def advance_to(milliseconds):
            time.clock.sec, rest = divmod(milliseconds, 1000)
            time.clock.nanosec = rest * 1_000_000
            clock.publish(time)
            return bench.node.get_clock().now().nanoseconds == milliseconds * 1_000_000

        bench.wait_for(lambda: advance_to(5000), 'the first time')
        for milliseconds in range(5010, 5310, 10):
            bench.wait_for(lambda t=milliseconds: advance_to(t), f'{milliseconds} ms')
        bench.wait_for(lambda: bench.node.stepper.stamp >= 5_290_000_000, 'the last step')
        assert bench.node.stepper.stamp <= 5_300_000_000
        steps = bench.node.stepper.steps
        assert 15 <= steps <= 31, 'one step a period of that clock'
        before = bench.node.stepper.stamp
        bench.wait_for(lambda: advance_to(5300), 'the same time again')
        assert bench.node.stepper.stamp == before or bench.node.stepper.stamp == 5_300_000_000


def test_topics_can_be_remapped(probe):
    with Launcher('complete', ros_arguments=[
            '-r', 'agent_1/cmd_vel:=thruster/cmd', '-r', 'formation/error:=/error']) as formation:
        formation.run_for(1.0)
        topics = {p.topic_name for node in formation.nodes for p in node.outputs}
    assert '/thruster/cmd' in topics
    assert '/error' in topics
    assert '/agent_1/cmd_vel' not in topics


@pytest.mark.parametrize(('kind', 'node_type', 'arguments'), [
    ('agent', Agent, (1,)), ('plant', Plant, ()), ('monitor', Monitor, ())])
def test_parameters_are_described_with_their_ranges(probe, kind, node_type, arguments):
    with Bench(probe, node_type, *arguments) as bench:
        for spec in PARAMETERS[kind]:
            descriptor = bench.node.describe_parameter(spec.name)
            assert descriptor.description == spec.description
            assert descriptor.additional_constraints == spec.expected
            assert descriptor.read_only == (not spec.dynamic)
        rate = bench.node.describe_parameter('gain.a')
        assert rate.floating_point_range[0].from_value == 1e-9
        n = bench.node.describe_parameter('topology.n')
        assert (n.integer_range[0].from_value, n.integer_range[0].to_value) == (0, 1000)


@pytest.mark.parametrize(('n', 'hint'), [(2, 'algebraically'), (6, 'continuum')])
def test_a_gain_that_is_no_help_is_said_to_be(n, hint):
    _, _, errors = run('launcher', '--duration', '1', '--ros-args', '-p', f'topology.n:={n}')
    assert hint in errors
    _, _, errors = run('launcher', '--duration', '1', '--ros-args', '-p', f'topology.n:={n}',
                       '-p', 'gain.kind:=exponential')
    assert hint not in errors
