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

"""The formation as it is meant to run: every node a process, started and ended by hand."""

import os
from pathlib import Path
import random
import signal
import subprocess
import sys
import time

from geometry_msgs.msg import TwistStamped
from harness import DEADLINE, interrupt, nanoseconds, Probe, values
import numpy as np
import pytest
from tetra_ros2.config import configuration
from tetra_ros2.formation import measures, rotation, shapes, simulation
from tetra_ros2.launcher import Launcher
from tetra_ros2.ros.executor import SPIN_PERIOD
import yaml

EXAMPLES = Path(__file__).parents[2] / 'examples'


def expected_attitudes(config, seed, steps):
    """Return the attitudes after so many undisturbed steps, without a network."""
    formation = configuration.load(config).formation()
    n = formation.topology.n
    loop = simulation.SampledLoop(rotation.random(np.random.default_rng(seed), (n,)),
                                  formation.pointing_axes, formation.topology, formation.gain)
    loop.advance(0.01, steps)
    return [list(q) for q in loop.bodies.attitudes]


def start_all(processes, config, order_seed, *plant_arguments):
    """Start six processes in an order of chance; return them by name."""
    commands = {f'agent_{i}': ('agent', '--id', i, '--config', config) for i in range(1, 5)}
    commands['monitor'] = ('monitor', '--config', config)
    commands['plant'] = ('plant', '--config', config, '--ros-args', *plant_arguments)
    names = list(commands)
    random.Random(order_seed).shuffle(names)
    return {name: processes.tetra(*commands[name]) for name in names}


@pytest.mark.parametrize('config', ['complete', 'rotating'])
def test_six_processes_in_lockstep_equal_the_simulation_to_the_last_bit(
        processes, probe, config):
    probe.listen_to_attitudes()
    started = start_all(processes, config, 1, '-p', 'duration:=20.0', '-p', 'seed:=6')
    probe.wait_for(lambda: probe.stamp() >= 20.01e9, 'the last step')
    assert probe.stamp() == 20_010_000_000
    assert probe.attitudes().tolist() == expected_attitudes(config, 6, 2000)
    for process in started.values():
        status, output = interrupt(process)
        assert status == 0, output
        assert 'Traceback' not in output


@pytest.mark.parametrize('config', ['complete', 'rotating'])
def test_six_processes_in_real_time_form(processes, probe, config):
    probe.listen_to_attitudes()
    start_all(processes, config, 2, '-p', 'mode:=realtime', '-p', 'rate:=200')

    def formed():
        if not probe.received['formation/attitudes']:
            return False
        error = measures.shape_error(probe.reduced_attitudes(), shapes.TETRAHEDRON.angles)
        return error < 2e-3

    probe.wait_for(formed, 'the tetrahedron')


def test_killing_an_agent_in_lockstep_and_starting_it_again_loses_nothing(processes, probe):
    probe.listen_to_attitudes()
    started = start_all(processes, 'rotating', 3, '-p', 'duration:=12.0', '-p', 'seed:=8',
                        '-p', 'real_time_factor:=6.0')
    for victim, at in (('agent_2', 3e9), ('agent_3', 6e9)):
        probe.wait_for(lambda at=at: probe.stamp() > at, f'{at / 1e9} s')
        how = signal.SIGKILL if victim == 'agent_2' else signal.SIGTERM
        started[victim].send_signal(how)
        started[victim].communicate(timeout=DEADLINE)
        processes.tetra('agent', '--id', victim[-1], '--config', 'rotating')
    probe.wait_for(lambda: probe.stamp() >= 12.01e9, 'the last step')
    assert probe.attitudes().tolist() == expected_attitudes('rotating', 8, 1200)


def test_an_agent_that_stays_silent_is_held_still_until_it_is_back(processes, probe):
    probe.listen_to_attitudes()
    started = start_all(processes, 'complete', 4, '-p', 'command_timeout:=0.5',
                        '-p', 'real_time_factor:=1.0')
    probe.wait_for(lambda: probe.stamp() > 0.2e9, 'the start')
    started['agent_4'].kill()
    # On a busy machine others may be late, too; and what was before the report may be yet to come.
    status = probe.wait_for_health(
        '/plant', lambda s: 'held still' in s.message and 'agent_4' in s.message, 'the report')
    reported = float(values(status)['formation time [s]']) * 1e9
    probe.wait_for(lambda: probe.stamp() > reported, 'a state after that')
    still = probe.attitudes()[3].tolist()
    stamp = probe.stamp()
    probe.wait_for(lambda: probe.stamp() > stamp + 0.2e9, 'time goes on without it')
    assert probe.attitudes()[3].tolist() == still
    processes.tetra('agent', '--id', 4, '--config', 'complete')
    probe.wait_for_health('/plant', lambda s: s.message.startswith('running'), 'its return')
    probe.wait_for(lambda: probe.attitudes()[3].tolist() != still, 'its motion')


def test_the_plant_may_be_started_again(processes, probe):
    probe.listen_to_attitudes()
    started = start_all(processes, 'complete', 5, '-p', 'duration:=2.0')
    probe.wait_for(lambda: probe.stamp() >= 2.01e9, 'the end of the first run')
    interrupt(started['plant'])
    probe.received['formation/attitudes'].clear()
    processes.tetra('plant', '--config', 'complete', '--ros-args', '-p', 'duration:=1.0')
    probe.wait_for(lambda: probe.received['formation/attitudes'] and probe.stamp() == 1.01e9,
                   'the end of the second run, whose time began anew')
    assert probe.attitudes().tolist() == expected_attitudes('complete', 7, 100)


def test_an_agent_that_is_stopped_commands_zero_last(processes, probe):
    probe.listen(TwistStamped, 'agent_1/cmd_vel')
    started = start_all(processes, 'complete', 6, '-p', 'real_time_factor:=1.0')
    probe.wait_for(lambda: len(probe.received['agent_1/cmd_vel']) > 10, 'commands')
    status, output = interrupt(started['agent_1'])
    assert status == 0, output
    last = probe.wait_for(
        lambda: (m := probe.received['agent_1/cmd_vel'][-1]).twist.angular.x
        == m.twist.angular.y == m.twist.angular.z == 0.0 and m, 'the last command')
    stamps = [nanoseconds(m.header.stamp) for m in probe.received['agent_1/cmd_vel']]
    assert nanoseconds(last.header.stamp) == stamps[-1] == max(stamps)


def test_a_second_agent_of_the_same_number_is_reported(processes, probe):
    start_all(processes, 'complete', 7)
    processes.tetra('agent', '--id', 1, '--config', 'complete')
    # On a busy machine it may hear of nobody for a moment, which is an error of its own.
    status = probe.wait_for_health(
        '/agent_1', lambda s: 'more than one publisher' in s.message
        and 'nothing heard of' not in s.message, 'the report of the agent')
    assert status.level == b'\x01'
    assert values(status)['publisher conflicts'] == '1'
    status = probe.wait_for_health(
        '/plant', lambda s: 'more than one publisher' in s.message, 'the report of the plant')
    assert '/agent_1/cmd_vel' in status.message


def test_the_graph_of_nodes_shows_what_the_paper_promises(processes, probe):
    start_all(processes, 'rotating', 8)
    topology = configuration.load('rotating').formation().topology
    own = {'/rosout', '/parameter_events'}  # what rclpy makes for every node
    edges = 0
    for i in range(1, 5):
        inputs = {f'/agent_{i}/relative_attitude/agent_{j}' for j, _ in topology.neighbors(i)}
        edges += len(inputs)

        def endpoints(i=i):
            if f'agent_{i}' not in probe.node.get_node_names():
                return None
            found = probe.node.get_subscriber_names_and_types_by_node(f'agent_{i}', '/')
            offered = probe.node.get_publisher_names_and_types_by_node(f'agent_{i}', '/')
            return {name for name, _ in found}, {name for name, _ in offered} - own

        probe.wait_for(lambda e=endpoints, s=inputs, i=i: e() == (
            s, {f'/agent_{i}/cmd_vel', '/diagnostics'}), f'the endpoints of agent {i}')
    assert edges == 9
    probe.wait_for(lambda: sum(
        'relative_attitude' in name for name, _ in probe.node.get_topic_names_and_types()) == 9,
        'nine topics of measurements and no more')


def test_nothing_in_the_process_of_an_agent_knows_attitudes_or_shapes():
    code = ('import sys, tetra_ros2.nodes.agent; '
            'print(*[m for m in sys.modules if m.startswith("tetra_ros2")])')
    loaded = set(subprocess.run([sys.executable, '-c', code], capture_output=True, text=True,
                                check=True).stdout.split())
    assert 'tetra_ros2.formation.controller' in loaded
    for module in ('shapes', 'observer', 'bodies', 'measures', 'simulation', 'summary',
                   'rotation'):
        assert f'tetra_ros2.formation.{module}' not in loaded


def test_an_agent_by_somebody_else_takes_the_place_of_agent_3(processes):
    processes.python(EXAMPLES / 'own_agent.py')
    with Launcher('rotating', without=['agent_3']) as formation:
        formation.run_for(20.0)
        summary = formation.summary()
    assert summary.formed
    assert summary.measured.rate == pytest.approx(summary.predicted.rate, rel=1e-3)


def test_a_plant_by_somebody_else_does_as_well(processes):
    processes.python(EXAMPLES / 'own_plant.py')
    with Launcher('complete', without=['plant'], parameters={'gain.a': 4.0}) as formation:
        formation.run_for(5.0)
        summary = formation.summary()
    assert summary.formed, summary


def test_two_namespaces_of_processes_do_not_touch_each_other(processes):
    with Probe('red') as red, Probe('blue') as blue:
        for probe, config in ((red, 'complete'), (blue, 'rotating')):
            probe.listen_to_attitudes()
            for i in range(1, 5):
                processes.tetra('agent', '--id', i, '--config', config,
                                '--namespace', probe.node.get_namespace())
            processes.tetra('plant', '--config', config, '--ros-args',
                            '-r', f'__ns:={probe.node.get_namespace()}', '-p', 'duration:=3.0')
        for probe, config in ((red, 'complete'), (blue, 'rotating')):
            probe.wait_for(lambda p=probe: p.stamp() >= 3.01e9, f'the end of {config}')
            assert probe.attitudes().tolist() == expected_attitudes(config, 7, 300)


def test_nothing_of_all_this_leaves_the_machine():
    assert os.environ['ROS_AUTOMATIC_DISCOVERY_RANGE'] == 'LOCALHOST'


WITHOUT_EVENTS = """
import sys
sys.modules['rclpy.experimental.events_executor'] = None
from tetra_ros2.cli import main
from tetra_ros2.ros import executor
assert executor.EventsExecutor.__name__ == 'SingleThreadedExecutor'
sys.exit(main(sys.argv[1:]))
"""


def test_an_rclpy_without_the_events_executor_will_do(tmp_path, processes, probe):
    launcher = processes.python(
        '-c', WITHOUT_EVENTS, 'launcher', '--config', 'complete', '--duration', '6', '--seed',
        '7', '--record', tmp_path / 'bag')
    output, _ = launcher.communicate(timeout=DEADLINE)
    assert launcher.returncode == 0, output
    assert 'a regular tetrahedron' in output
    counts = {t['topic_metadata']['name']: t['message_count'] for t in yaml.safe_load(
        (tmp_path / 'bag' / 'metadata.yaml').read_text())[
            'rosbag2_bagfile_information']['topics_with_message_count']}
    assert counts['/formation/error'] == 601
    assert counts['/agent_1/cmd_vel'] >= 600
    monitor = processes.python('-c', WITHOUT_EVENTS, 'monitor', '--config', 'complete')
    probe.wait_for_health('/monitor', lambda s: 'waiting' in s.message, 'the monitor')
    begun = time.monotonic()
    status, output = interrupt(monitor)
    assert status == 0, output
    assert time.monotonic() - begun < 0.5 * SPIN_PERIOD, 'a signal is not waited for that long'
