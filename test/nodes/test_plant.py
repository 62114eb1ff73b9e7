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

from geometry_msgs.msg import TwistStamped, Vector3Stamped
from harness import nanoseconds
from node_bench import Bench
import pytest
from rclpy.parameter import Parameter
from std_srvs.srv import SetBool, Trigger
from tetra_ros2.config.parameters import ConfigurationError
from tetra_ros2.nodes.plant import Plant
from tetra_ros2.ros import diagnostics
from tetra_ros2.wire import cdr

REST = [0.0, 0.0, 0.0, 1.0]
SEEN = 'agent_1/relative_attitude/agent_2'


@pytest.mark.parametrize('delay', [0.0, 0.02])
def test_after_a_reset_the_sensors_look_at_the_bodies_of_now(probe, delay):
    probe.listen(Vector3Stamped, SEEN)
    codecs = [cdr.twist_stamped(f'agent_{i}') for i in (1, 2)]
    # Noise that changes nothing makes even those without delay sensors of their own.
    with Bench(probe, Plant, topology__n=2, initial_attitudes=2 * REST, measurement_delay=delay,
               measurement_noise=1e-15) as bench:
        plant, stepper = bench.node, bench.node.stepper
        speakers = [bench.publisher(TwistStamped, f'agent_{i}/cmd_vel') for i in (1, 2)]
        bench.wait_for(lambda: plant.count_subscribers(SEEN), 'the probe')

        def seen_at(stamp):
            """Return the height of what agent 1 saw at a time: agent 2 turns upwards."""
            return bench.wait_for(lambda: [
                m.vector for m in probe.received[SEEN]
                if nanoseconds(m.header.stamp) == stamp], 'the measurement')[0].z

        def step():
            """Let agent 2 turn by 0.01 rad, about its second axis."""
            steps = stepper.steps
            for speaker, codec, rate in zip(speakers, codecs, (0.0, -1.0)):
                speaker.publish(codec.encode(stepper.stamp, 0, 0, 0, 0, rate, 0))
            bench.wait_for(lambda: stepper.steps > steps, 'a step')

        late = round(delay * 100)
        for _ in range(2):
            for k in range(6):
                assert seen_at(stepper.stamp) == pytest.approx(
                    0.01 * max(k - late, 0), abs=1e-4), 'late by as much as it is to be'
                step()
            plant.reset()


def test_it_looks_for_a_second_commander_only_where_that_is_wished_for(probe, monkeypatch):
    made = []
    create = Plant.create_steady_timer
    monkeypatch.setattr(Plant, 'create_steady_timer', lambda self, period, callback: made.append(
        (callback.__name__, period)) or create(self, period, callback))

    def looks():
        return [period for name, period in made if name == '_look_for_conflicts']

    with Bench(probe, Plant) as bench:
        bench.node.set_parameters([Parameter('rate', value=50.0)])
        assert looks() == []
        for _ in range(2):
            bench.node.set_parameters([Parameter('on_publisher_conflict', value='hold')])
        assert looks() == [0.05]
        bench.node._held = 0b11
        bench.node.set_parameters([Parameter('rate', value=60.0)])
        assert bench.node.held_agents() == 0b11
        bench.node.set_parameters([Parameter('on_publisher_conflict', value='report')])
        assert bench.node.held_agents() == 0


@pytest.mark.parametrize(('timeout', 'accepted'), [(0.0, True), (0.02, True), (0.0199, False)])
def test_in_real_time_commands_live_for_two_periods_at_least(probe, timeout, accepted):
    given = {'mode': 'realtime', 'rate': 100.0, 'command_timeout': timeout}
    if accepted:
        with Bench(probe, Plant, **given):
            pass
    else:
        with pytest.raises(ConfigurationError, match=r'two periods, 0\.02 s at 100 Hz'):
            Bench(probe, Plant, **given)


def test_a_plant_draws_a_seed_says_which_and_draws_the_same_from_it(probe):
    with Bench(probe, Plant) as bench:
        seed, attitudes = bench.node.seed, bench.node.bodies.attitudes
        assert 0 <= seed < 2**31
        assert bench.node.start_description == f'seed {seed}'
    with Bench(probe, Plant, seed=seed) as bench:
        assert bench.node.bodies.attitudes == attitudes
        bench.node.randomize()
        assert bench.node.bodies.attitudes != attitudes
        bench.node.reset()
        assert bench.node.bodies.attitudes == attitudes
    with Bench(probe, Plant, initial_attitudes=4 * REST) as bench:
        assert bench.node.start_description == 'given attitudes'
        assert bench.node.bodies.attitudes == [tuple(REST)] * 4


def test_its_services_do_what_they_say(probe):
    with Bench(probe, Plant, initial_attitudes=4 * REST) as bench:
        node = bench.node
        for ask, said in ((node._on_reset, 'back to the initial attitudes'),
                          (node._on_randomize, 'at new random attitudes')):
            response = ask(Trigger.Request(), Trigger.Response())
            assert (response.success, response.message) == (True, said)
        for data, said in ((True, 'paused'), (False, 'running')):
            response = node._on_pause(SetBool.Request(data=data), SetBool.Response())
            assert (response.success, response.message) == (True, said)
            assert node.stepper.paused is data
        for data, said in ((True, 'stopped'), (False, 'released')):
            response = node._on_stop(SetBool.Request(data=data), SetBool.Response())
            assert (response.success, response.message) == (True, said)
            level, message, _ = node.assess()
            assert message.startswith('emergency stop') is data
            assert (level == diagnostics.ERROR) is data
        node._held = 0b10
        level, message, _ = node.assess()
        assert (level, message.partition(';')[0]) == (
            diagnostics.ERROR, 'held still, more than one publisher: agent_2')


def test_a_command_that_is_none_is_counted_and_what_else_is_raised_survived(probe, monkeypatch):
    with Bench(probe, Plant, initial_attitudes=4 * REST) as bench:
        node, taken = bench.node, []
        encode = cdr.twist_stamped('agent_2').encode
        monkeypatch.setattr(node.stepper, 'command', lambda *given: taken.append(given))
        receive = node._receiver(2)
        receive(encode(5, 0.0, 0.0, 0.0, 0.1, 0.2, 0.3))
        assert taken == [(1, 5, (0.1, 0.2, 0.3))]
        receive(encode(6, 0.0, 0.0, 0.0, float('nan'), 0.0, 0.0))
        receive(b'')
        assert sum(node.health.rejected.values()) == 2
        assert all('agent_2' in reason for reason in node.health.rejected)
        node._on_stop(SetBool.Request(data=True), SetBool.Response())
        receive(encode(7, 0.0, 0.0, 0.0, 0.1, 0.2, 0.3))
        assert taken[1:] == [(1, 7, (0.0, 0.0, 0.0))], 'the emergency stop'
        monkeypatch.setattr(node.stepper, 'command', lambda *given: 1 / 0)
        node._receiver(2)(encode(8, 0.0, 0.0, 0.0, 0.1, 0.2, 0.3))
        assert node.health.exceptions == 1


def test_a_real_time_factor_next_to_nothing_stands_still_and_raises_nothing(probe):
    with Bench(probe, Plant) as bench:
        result, = bench.node.set_parameters([Parameter('real_time_factor', value=1e-70)])
        assert result.successful
        assert not bench.node.health.exceptions
