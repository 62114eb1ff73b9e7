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

"""The formations of the paper, held together by real nodes over DDS, all in this process."""

import math
import time

from harness import nanoseconds
import numpy as np
import pytest
from rcl_interfaces.msg import Parameter, ParameterType, ParameterValue
from rcl_interfaces.srv import SetParameters
from std_msgs.msg import Float64, Float64MultiArray
from std_srvs.srv import SetBool, Trigger
from tetra_ros2 import report
from tetra_ros2.formation import gain as gains
from tetra_ros2.formation import measures, rotation, shapes, simulation
from tetra_ros2.launcher import Launcher

STEPS = 2000


def start_of(seed, n):
    """Return the initial attitudes that a plant draws for a seed."""
    return rotation.random(np.random.default_rng(seed), (n,))


def twin(formation, seed):
    """Return the loop without a network that a formation must equal."""
    return simulation.SampledLoop(
        start_of(seed, formation.topology.n), formation.pointing_axes, formation.topology,
        formation.gain)


def spin_rate(gain):
    return math.sqrt(3.0) / 2.0 * gain.f(shapes.THETA_STAR, math)


def test_complete_graph_forms_a_tetrahedron_at_rest():
    with Launcher('complete') as formation:
        assert formation.run_for(30.0)
        summary = formation.summary()
    assert summary.formed
    assert summary.shape == 'regular tetrahedron'
    assert summary.error < 1e-6
    assert summary.duration == 30.0
    assert summary.measured.rate < 1e-9
    assert summary.predicted.rate < 1e-9


@pytest.mark.parametrize('gain', [
    {'gain.kind': 'cosine', 'gain.a': 1.0}, {'gain.kind': 'exponential', 'gain.a': 4.0}])
def test_rotating_graph_spins_at_the_predicted_rate(gain):
    with Launcher('rotating', parameters={**gain, 'plant:rate': 200.0}) as formation:
        formation.run_for(40.0)
        summary = formation.summary()
        rate = spin_rate(formation.formation.gain)
    assert summary.formed
    assert summary.predicted.rate == pytest.approx(rate, rel=1e-12)
    assert summary.measured.rate == pytest.approx(rate, rel=1e-3)
    assert summary.measured.period == pytest.approx(2.0 * math.pi / rate, rel=1e-3)
    assert summary.axis_drift < 1e-9


@pytest.mark.parametrize('p', [0, 1])
@pytest.mark.parametrize('k', [1, 2, 3, 4])
def test_every_axis_and_direction_spins_in_the_predicted_sense(k, p):
    senses = {}
    for seed in range(12):
        with Launcher('rotating', seed=seed,
                      parameters={'topology.k': k, 'topology.p': p}) as formation:
            formation.run_for(20.0)
            summary = formation.summary()
            sense = shapes.predicted_sense(formation.formation.topology, summary.chirality)
        assert summary.formed
        assert summary.measured.axis == k
        assert summary.measured.rate == pytest.approx(spin_rate(gains.Cosine()), rel=1e-3)
        assert summary.measured.sense == summary.predicted.sense == sense
        assert summary.axis_drift < 1e-4
        senses[summary.chirality] = sense
        if len(senses) == 2:
            break
    assert senses[1] == -senses[-1], 'both chiralities come out of a dozen starts'


@pytest.mark.parametrize('config', ['complete', 'rotating'])
def test_lockstep_equals_the_simulation_to_the_last_bit(config):
    with Launcher(config, seed=3) as formation:
        formation.run_for(STEPS * 0.01)
        loop = twin(formation.formation, 3)
        loop.advance(0.01, STEPS)
        assert formation.plant.stepper.steps == STEPS
        assert formation.attitudes.tolist() == [list(q) for q in loop.bodies.attitudes]
        batched = simulation.simulate(
            start_of(3, 4), formation.formation.pointing_axes,
            formation.formation.topology.weights, formation.formation.gain, 0.01, STEPS)
        np.testing.assert_allclose(formation.attitudes, batched, rtol=0.0, atol=1e-12)


def test_two_runs_of_one_seed_are_the_same_to_the_last_bit():
    runs = []
    for _ in range(2):
        with Launcher('rotating', seed=11) as formation:
            formation.run_for(20.0)
            runs.append(formation.attitudes)
    assert runs[0].tobytes() == runs[1].tobytes()


def test_stopping_in_between_changes_nothing():
    with Launcher('complete', seed=5) as formation:
        for _ in range(10):
            formation.run_for(0.5)
        loop = twin(formation.formation, 5)
        loop.advance(0.01, 500)
        assert formation.attitudes.tolist() == [list(q) for q in loop.bodies.attitudes]


def test_bodies_with_different_pointing_axes_form_all_the_same():
    axes = [0.0, 0.0, 1.0, 0.0, -1.0, 0.0, 0.6, 0.8, 0.0, -1.0, 2.0, -3.0]
    with Launcher('complete', parameters={'pointing_axis': axes}) as formation:
        formation.run_for(15.0)
        assert formation.error < 1e-6
        np.testing.assert_allclose(
            rotation.rotate(formation.attitudes, formation.formation.pointing_axes),
            formation.reduced_attitudes, atol=1e-12)


@pytest.mark.parametrize(('n', 'shape'), [
    (2, 'antipodal pair'),
    (3, 'equilateral triangle on a great circle'),
    (6, 'regular octahedron'),
])
def test_other_numbers_of_agents_form_their_own_shapes(n, shape):
    parameters = {'topology.n': n, 'gain.kind': 'exponential', 'gain.a': 10.0}
    with Launcher('complete', parameters=parameters) as formation:
        formation.run_for(30.0)
        summary = formation.summary()
    assert summary.formed
    assert summary.shape == shape
    assert summary.error < 1e-4


def test_any_weighted_graph_runs_and_one_without_a_known_shape_says_so(probe):
    parameters = {'topology.kind': 'custom', 'topology.n': 3,
                  'topology.edges': ['1 2 0.5', '2 1', '3 1', '3 2 0.25']}
    with Launcher('complete', parameters=parameters) as formation:
        assert 'formation/error' not in dict(probe.node.get_topic_names_and_types())
        formation.run_for(60.0)
        summary = formation.summary()
    assert summary.shape is None
    assert summary.formed, 'the shape comes to rest'


def test_two_namespaces_in_one_domain_do_not_touch_each_other():
    with Launcher('complete', seed=1, namespace='a') as a, \
            Launcher('rotating', seed=2, namespace='b/c') as b:
        for _ in range(5):
            a.run_for(1.0)
            b.run_for(1.0)
        for formation, seed in ((a, 1), (b, 2)):
            loop = twin(formation.formation, seed)
            loop.advance(0.01, 500)
            assert formation.attitudes.tolist() == [list(q) for q in loop.bodies.attitudes]
            assert not any(node.health.rejected for node in formation.nodes)


def test_a_second_formation_in_the_same_namespace_is_refused_or_reported(probe):
    from tetra_ros2.config.parameters import ConfigurationError
    with Launcher('complete') as first:
        try:
            with Launcher('complete', parameters={'real_time_factor': 1.0}) as second:
                # DDS may take seconds to show the one to the other, topic by topic.
                spin_while(second, probe, lambda: '/formation/attitudes' in
                           second.monitor.publisher_conflicts(), 'the conflict')
                second.monitor.health.report()
                assert 'more than one publisher' in second.monitor.health.message
        except ConfigurationError as error:
            assert 'somebody else' in str(error)
        assert first.run_for(1.0)


def test_a_formation_that_finds_another_one_at_its_start_is_refused(monkeypatch):
    from tetra_ros2 import launcher
    from tetra_ros2.config.parameters import ConfigurationError
    monkeypatch.setattr(launcher, 'FAREWELL_TIMEOUT', 0.2)
    monkeypatch.setattr(Launcher, '_links', lambda self: ([], [], ['/clock']))
    with pytest.raises(ConfigurationError, match='somebody else is on /clock'), \
            Launcher('complete'):
        pass


def test_real_time_forms_too_and_keeps_the_time():
    parameters = {'gain.a': 5.0, 'plant:rate': 200.0}
    for _ in range(3):
        with Launcher('complete', mode='realtime', parameters=parameters) as formation:
            begun = time.monotonic()
            formation.run_for(4.0)
            wall_time = time.monotonic() - begun
            summary = formation.summary()
        if summary.error < 1e-6:
            break  # otherwise the machine may have been busy, and bodies held still meanwhile
    assert summary.formed
    assert summary.error < 1e-6
    assert wall_time == pytest.approx(4.0, abs=0.5)


def test_lockstep_keeps_a_pace_if_told_to():
    with Launcher('complete', parameters={'real_time_factor': 4.0}) as formation:
        for _ in range(5):  # slower on a busy machine, but not each time
            begun = time.monotonic()
            formation.run_for(4.0)
            took = time.monotonic() - begun
            assert took > 0.95, 'never faster'
            if took < 3.0:
                break
        assert took < 3.0


def test_run_until_stops_at_the_condition_or_at_the_timeout():
    with Launcher('complete') as formation:
        assert formation.run_until(lambda: formation.error < 1e-3, timeout=30.0)
        assert formation.error < 1e-3
        assert formation.time < 10.0
        before = formation.time
        assert not formation.run_until(lambda: False, timeout=1.0)
        assert formation.time == pytest.approx(before + 1.0)


def test_the_monitor_publishes_cosines_and_error(probe):
    probe.listen(Float64MultiArray, 'formation/cosines')
    probe.listen(Float64, 'formation/error')
    with Launcher('complete') as formation:
        watched = [p for p in formation.monitor.outputs
                   if p.topic_name in ('/formation/cosines', '/formation/error')]
        probe.wait_for(lambda: all(p.get_subscription_count() for p in watched), 'the monitor')
        formation.run_for(5.0)
        count = formation.monitor.observer.count
        probe.wait_for(lambda: all(len(probe.received[topic]) == count for topic in (
            'formation/cosines', 'formation/error')), 'all of them')
        assert probe.received['formation/error'][-1].data == formation.error
        gamma = formation.reduced_attitudes
    cosines = probe.received['formation/cosines'][-1]
    np.testing.assert_allclose(cosines.data, measures.pairwise_cosines(gamma), atol=1e-15)
    labels = [dimension.label for dimension in cosines.layout.dim]
    assert labels[1:] == ['1 2', '1 3', '1 4', '2 3', '2 4', '3 4']
    assert formation.error == pytest.approx(
        float(measures.shape_error(gamma, shapes.TETRAHEDRON.angles)), abs=1e-15)


def spin_while(formation, probe, condition, what):
    """Spin a launcher and a probe until a condition holds."""
    from rclpy.task import Future
    from tetra_ros2.ros.executor import spin_some
    never = Future(executor=formation.executor)

    def step():
        spin_some(formation.executor, never, timeout=0.01)
        return condition()

    return probe.wait_for(step, what)


def call(formation, probe, service_type, name, request):
    client = probe.node.create_client(service_type, name)
    spin_while(formation, probe, client.service_is_ready, name)
    future = client.call_async(request)
    spin_while(formation, probe, future.done, name)
    return future.result()


@pytest.mark.parametrize('mode', ['lockstep', 'realtime'])
def test_pause_and_reset_services(probe, mode):
    with Launcher('complete', mode=mode, seed=4, parameters={
            'real_time_factor': 1.0, 'plant:rate': 50.0}) as formation:
        observer = formation.monitor.observer
        spin_while(formation, probe, lambda: observer.count > 10, 'ten samples')
        assert call(formation, probe, SetBool, 'plant/pause', SetBool.Request(data=True)).success
        paused, answers = formation.plant.bodies.attitudes[:], formation.agents[1].measurements
        spin_while(formation, probe, lambda: formation.agents[1].measurements > answers + 9,
                   'measurements go on while the bodies rest')
        assert formation.plant.bodies.attitudes == paused
        assert call(formation, probe, SetBool, 'plant/pause', SetBool.Request(data=False)).success
        spin_while(formation, probe, lambda: formation.plant.bodies.attitudes != paused, 'motion')
        stamp = formation.plant.stepper.stamp
        assert call(formation, probe, Trigger, 'plant/reset', Trigger.Request()).success
        assert formation.plant.stepper.stamp >= stamp, 'a reset does not turn time back'
        rng = np.random.default_rng(4)
        first, second = (rotation.random(rng, (4,)) for _ in range(2))

        def distance(start):
            return np.abs(formation.plant.bodies.attitudes - start).max()

        assert distance(first) < 0.5 < distance(second), 'the start of the seed again'
        assert call(formation, probe, Trigger, 'plant/randomize', Trigger.Request()).success
        assert distance(second) < 0.5 < distance(first), 'the next one'


def set_parameter(formation, probe, node, name, value):
    kinds = {float: 'double', int: 'integer', str: 'string'}
    kind = kinds[type(value)]
    parameter = Parameter(name=name, value=ParameterValue(
        type=getattr(ParameterType, f'PARAMETER_{kind.upper()}'), **{f'{kind}_value': value}))
    response = call(formation, probe, SetParameters, f'{node}/set_parameters',
                    SetParameters.Request(parameters=[parameter]))
    return response.results[0]


def test_gain_and_rate_change_at_run_time_and_what_cannot_is_refused(probe):
    with Launcher('complete') as formation:
        formation.run_for(0.5)
        assert set_parameter(formation, probe, 'agent_1', 'gain.a', 2.5).successful
        assert set_parameter(formation, probe, 'agent_1', 'gain.kind', 'exponential').successful
        assert formation.agents[1]._controller.gain == gains.Exponential(2.5)
        assert set_parameter(formation, probe, 'plant', 'rate', 50).successful
        stamps = []
        formation.monitor.observer.tolerance = 0.0
        before = formation.plant.stepper.stamp
        formation.run_for(0.1)
        stamps.append(formation.plant.stepper.stamp - before)
        assert stamps == [100_000_000]
        for name, value, hint in (
                ('gain.a', -1.0, '-1.0'),
                ('gain.kind', 'cosin', "did you mean 'cosine'"),
                ('topology.kind', 'rotating', ''),
                ('gain.a', 'much', "'much' is not valid")):
            result = set_parameter(formation, probe, 'agent_1', name, value)
            assert not result.successful
            assert hint in result.reason
        assert formation.agents[1]._controller.gain == gains.Exponential(2.5)


def test_measurements_have_the_stamp_of_the_state_and_commands_that_of_the_measurements(probe):
    from geometry_msgs.msg import PoseArray, TwistStamped, Vector3Stamped
    topics = {'formation/attitudes': PoseArray, 'agent_2/cmd_vel': TwistStamped,
              'agent_2/relative_attitude/agent_4': Vector3Stamped}
    for topic, message_type in topics.items():
        probe.listen(message_type, topic)
    with Launcher('complete', parameters={'real_time_factor': 1.0}) as formation:
        spin_while(formation, probe, lambda: min(
            len(probe.received[topic]) for topic in topics) > 20, 'twenty of each')
    states = {nanoseconds(m.header.stamp): m for m in probe.received['formation/attitudes']}
    seen = {nanoseconds(m.header.stamp): m
            for m in probe.received['agent_2/relative_attitude/agent_4']}
    common = sorted(set(states) & set(seen))
    assert len(common) > 10
    for stamp in common:
        own, other = (states[stamp].poses[i] for i in (1, 3))
        q = np.array([own.orientation.x, own.orientation.y, own.orientation.z, own.orientation.w])
        gamma = np.array([other.position.x, other.position.y, other.position.z])
        vector = seen[stamp].vector
        np.testing.assert_allclose([vector.x, vector.y, vector.z],
                                   rotation.rotate(rotation.inverse(q), gamma), atol=1e-12)
        assert seen[stamp].header.frame_id == 'agent_2'
        assert states[stamp].header.frame_id == 'world'
    commands = probe.received['agent_2/cmd_vel']
    assert {m.header.frame_id for m in commands} == {'agent_2'}
    assert sum(nanoseconds(m.header.stamp) in states for m in commands) > 10
    assert all((m.twist.linear.x, m.twist.linear.y, m.twist.linear.z) == (0.0, 0.0, 0.0)
               for m in commands)


@pytest.mark.parametrize('mode', ['lockstep', 'realtime'])
@pytest.mark.parametrize('service', ['plant/reset', 'plant/randomize'])
def test_after_a_new_start_everything_is_said_anew(probe, mode, service):
    with Launcher('complete', mode=mode, seed=4, parameters={
            'plant:real_time_factor': 1.0, 'gain.a': 4.0}) as formation:
        assert formation.run_until(lambda: formation.error < 1e-3, timeout=20.0)
        starts = 0
        for _ in range(5):
            starts += 1
            before = formation.time
            assert call(formation, probe, Trigger, service, Trigger.Request()).success
            formation.run_for(0.05)
            summary = formation.summary()
            if summary.duration < 0.3:
                break  # otherwise the machine is so busy that it may have formed again
        assert summary.duration < formation.time - before + 1e-6
        assert not summary.formed
        assert summary.measured is None or summary.measured.rate < 30.0, 'the leap is no spin'
        assert formation.time > before, 'formation time itself goes on'
        took = dict(report.describe(summary, formation, 2.0 * formation.time))['time']
        assert took.startswith(f'{summary.duration:.2f} s since the last start; ')
        assert took.endswith('0.5 times real time'), took
        assert formation.run_until(lambda: formation.error < 1e-3, timeout=20.0)
        assert formation.monitor.observer.restarts == starts


def test_who_is_left_out_is_waited_for_as_long_as_it_takes(processes, monkeypatch):
    """The plant of another process comes after what is given up for one's own nodes."""
    from tetra_ros2 import launcher
    monkeypatch.setattr(launcher, 'DISCOVERY_TIMEOUT', 0.5)
    monkeypatch.setattr(launcher, 'AWAITED_PERIOD', 0.2)
    started = []

    class Late(Launcher):

        def _links(self):
            found = super()._links()
            if found[1] and time.monotonic() - begun > 1.0 and not started:
                started.append(processes.tetra('plant', '--config', 'complete'))
            return found

    begun = time.monotonic()
    with Late('complete', without=['plant']) as formation:
        assert started
        assert formation.run_until(lambda: formation.error < 1e-3, timeout=30.0)
