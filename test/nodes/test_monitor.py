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

"""What the monitor makes of the states that it sees."""

from types import SimpleNamespace

from geometry_msgs.msg import PoseArray
from node_bench import Bench
import numpy as np
import pytest
from rclpy.parameter import Parameter
from rclpy.task import Future
from std_msgs.msg import Float64, Float64MultiArray
from tetra_ros2.formation import gain
from tetra_ros2.nodes.monitor import Monitor
from tetra_ros2.ros import diagnostics
from tetra_ros2.wire import cdr, names

TETRAHEDRON = np.array([[1, 1, 1], [1, -1, -1], [-1, 1, -1], [-1, -1, 1]]) / np.sqrt(3.0)
REST = [0.0, 0.0, 0.0, 1.0]
encode = cdr.pose_array('world', 4).encode


def state(stamp, gamma=TETRAHEDRON):
    return encode(stamp, *(x for direction in gamma for x in [*direction, *REST]))


def leaning(angle):
    """Return a tetrahedron one axis of which is off by an angle [rad]."""
    gamma = TETRAHEDRON.copy()
    aside = np.array([0.0, 1.0, -1.0]) / np.sqrt(2.0)
    gamma[0] = np.cos(angle) * gamma[0] + np.sin(angle) * aside
    return gamma


def test_the_tolerance_can_be_changed_while_it_runs(probe):
    with Bench(probe, Monitor) as bench:
        publisher = bench.publisher(PoseArray, 'formation/attitudes')

        def formed(stamp):
            publisher.publish(state(stamp, leaning(0.01)))
            bench.wait_for(lambda: bench.node.observer.stamp == stamp, 'it')
            return bench.node.observer.formed_at is not None

        assert not formed(1)
        result, = bench.node.set_parameters([Parameter('tolerance', value=0.1)])
        assert result.successful
        assert formed(2)
        bench.node.set_parameters([Parameter('tolerance', value=1e-3)])
        assert not formed(3)


def test_a_plant_that_was_started_again_is_believed_at_the_third_old_stamp_in_a_row(probe):
    with Bench(probe, Monitor) as bench:
        publisher = bench.publisher(PoseArray, 'formation/attitudes')

        def show(stamp):
            before = bench.node.observer, bench.node.observer.count, \
                bench.node.health.rejected.total()
            publisher.publish(state(stamp))
            bench.wait_for(lambda: before != (
                bench.node.observer, bench.node.observer.count,
                bench.node.health.rejected.total()), 'any effect')

        for stamp in (100, 200, 7, 8, 300, 9, 10):
            show(stamp)
        assert bench.node.observer.stamp == 300, 'never three old ones in a row'
        for stamp in (11, 12):
            show(stamp)
        assert bench.node.observer.stamp == 12
        assert bench.node.observer.count == 1


@pytest.mark.parametrize(('edges', 'largest'), [
    (['2 1', '3 1', '4 1', '1 2'], 1.0),  # all look at one
    (['1 2', '1 3', '1 4', '2 1', '3 1', '4 1 -5'], 5.0)])
def test_an_unknown_shape_is_at_rest_measured_by_what_the_law_can_command(probe, edges, largest):
    """The law of agent i is no faster than f(0) times the sum of its weights' sizes."""
    with Bench(probe, Monitor, topology__kind='custom', topology__edges=edges,
               gain__a=0.7) as bench:
        assert bench.node.observer.fastest == pytest.approx(
            largest * float(gain.Cosine(0.7).f(0.0)))


def test_a_gain_that_is_changed_while_it_runs_changes_the_scale_of_what_is_at_rest(probe):
    with Bench(probe, Monitor) as bench:
        before = bench.node.observer.fastest
        bench.node.set_parameters([Parameter('gain.a', value=2.5)])
        assert bench.node.observer.fastest == pytest.approx(2.5 * before)


@pytest.mark.parametrize('period', [0.01, 0.4])
def test_a_plant_that_falls_silent_is_missed_however_often_it_used_to_speak(
        probe, monkeypatch, period):
    now = 100.0
    monkeypatch.setattr('tetra_ros2.nodes.monitor.time', SimpleNamespace(monotonic=lambda: now))
    with Bench(probe, Monitor) as bench:
        publisher = bench.publisher(PoseArray, 'formation/attitudes')
        for stamp in range(1, 6):
            now += period
            publisher.publish(state(stamp))
            bench.wait_for(lambda s=stamp: bench.node.observer.stamp == s, 'it')
        now += 2.5 * period
        assert bench.node.assess()[1] == 'formed: regular tetrahedron'
        now += max(0.5, period)
        level, message, _ = bench.node.assess()
        assert 'no attitudes for' in message
        assert level != b'\0'


def test_somebody_else_who_says_how_large_the_error_is_is_reported(probe):
    with Bench(probe, Monitor) as bench:
        for kind, topic in ((Float64, names.ERROR), (Float64MultiArray, names.COSINES)):
            other = probe.node.create_publisher(kind, topic, 1)
            bench.wait_for(
                lambda t=topic: f'/{t}' in bench.node.publisher_conflicts(), 'a conflict')
            probe.node.destroy_publisher(other)
            bench.wait_for(lambda: not bench.node.publisher_conflicts(), 'its end')


def test_who_waits_for_a_time_is_told_at_the_first_sample_then_or_later(probe):
    with Bench(probe, Monitor) as bench:
        monitor = bench.node
        future = Future()
        monitor.notify(100, future)
        for stamp in (98, 99):
            monitor._on_attitudes(state(stamp))
        assert not future.done()
        for stamp in (101, 102):
            monitor._on_attitudes(state(stamp))
        assert future.result() == 101


@pytest.fixture
def said(monkeypatch):
    """Return what a monitor says, in a world in which no time passes."""
    lines = []
    monkeypatch.setattr('tetra_ros2.nodes.monitor.time', SimpleNamespace(monotonic=lambda: 9.0))
    monkeypatch.setattr(Monitor, 'get_logger', lambda self: SimpleNamespace(
        info=lines.append, warning=lines.append))
    return lines


def test_it_is_said_once_that_it_has_formed_when_it_has_stayed_so_for_a_while(probe, said):
    with Bench(probe, Monitor, tolerance=0.1) as bench:
        monitor = bench.node

        def show(seconds, angle=0.0):
            monitor._on_attitudes(state(round(1e9 * seconds), leaning(angle)))

        show(1.0, 0.3)
        show(2.0)
        show(2.49)
        assert said == []
        assert monitor.assess()[1] == 'formed: regular tetrahedron'
        show(2.51)
        assert said == ['formed: regular tetrahedron, after 1.00 s']
        show(3.0)
        assert len(said) == 1


def test_it_is_not_said_again_while_the_error_swings_about_the_tolerance(probe, said):
    with Bench(probe, Monitor, tolerance=0.01) as bench:
        monitor = bench.node

        def show(stamps, angle=0.0):
            for stamp in stamps:
                monitor._on_attitudes(state(stamp * 10**8, leaning(angle)))

        show(range(10, 20))
        assert len(said) == 1
        for begin in range(100, 1000, 100):
            show(range(begin, begin + 10), 0.08)
            assert monitor.assess()[1] == 'forming: regular tetrahedron'
            show(range(begin + 10, begin + 12), 0.3)  # for a moment only
            show(range(begin + 12, begin + 30))
        assert len(said) == 1
        show(range(1000, 1010), 0.3)
        assert len(said) == 1, 'it is lost, and nobody says that it has formed'
        show(range(1010, 1015))
        assert len(said) == 1
        show(range(1015, 1030))
        assert said[1:] == ['formed: regular tetrahedron, after 100.00 s']


def test_it_is_said_anew_when_the_formation_or_the_plant_was_started_anew(probe, said):
    with Bench(probe, Monitor, tolerance=0.01) as bench:
        monitor = bench.node

        def show(stamps, gamma=TETRAHEDRON):
            for stamp in stamps:
                monitor._on_attitudes(state(stamp * 10**7, gamma))

        show(range(1000, 1100))
        show(range(1100, 1110), TETRAHEDRON[::-1])  # farther than the law could take them
        show(range(1110, 1200))
        assert said == ['formed: regular tetrahedron, after 0.00 s'] * 2
        show(range(100))  # another plant, whose clock begins anew
        assert len(said) == 3


def test_its_health_tells_the_error_and_the_times(probe, monkeypatch):
    monkeypatch.setattr('tetra_ros2.nodes.monitor.time', SimpleNamespace(monotonic=lambda: 9.0))
    with Bench(probe, Monitor, tolerance=0.1) as bench:
        monitor = bench.node
        assert monitor.assess()[:2] == (diagnostics.WARN, 'waiting for attitudes')
        assert (monitor._look(), monitor._poses()) == (None, None)
        for k, angle in enumerate([0.3, 0.3, 0.05]):
            monitor._on_attitudes(state(10**9 * (k + 1), leaning(angle)))
        level, message, values = monitor.assess()
        assert (level, message) == (diagnostics.OK, 'formed: regular tetrahedron')
        assert values['attitudes'] == 3
        assert values['formation time [s]'] == values['time to form [s]'] == 2.0
        assert 0.0 < values['formation error [rad]'] < 0.1
        stamp, gamma = monitor._look()
        assert stamp == 3 * 10**9
        assert gamma == pytest.approx(leaning(0.05))
        assert monitor._poses()[1] == pytest.approx(np.array([REST] * 4))


def test_its_cosines_are_labelled_with_the_pairs(probe):
    with Bench(probe, Monitor) as bench:
        message = bench.node._cosines_message()
        whole, *pairs = message.layout.dim
        assert (whole.label, whole.size, whole.stride) == ('cos(theta_ij) for i < j', 6, 6)
        assert [d.label for d in pairs] == ['1 2', '1 3', '1 4', '2 3', '2 4', '3 4']
        assert {(d.size, d.stride) for d in pairs} == {(1, 1)}
        assert len(message.data) == 6


def test_whoever_watches_is_handed_each_good_state_repeated_or_not(probe):
    with Bench(probe, Monitor) as bench:
        seen = []
        bench.node.watch(seen.append)
        for stamp in (1, 1, 0, 2):
            bench.node._on_attitudes(state(stamp))
        assert seen == [state(1), state(1), state(2)]
        assert bench.node.observer.count == 2
