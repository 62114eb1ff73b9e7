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
from std_msgs.msg import Float64, Float64MultiArray
from tetra_ros2.formation import gain
from tetra_ros2.nodes.monitor import Monitor
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
