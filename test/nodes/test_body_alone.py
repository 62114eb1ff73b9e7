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

"""The driver's node, with a driver that writes down what it is told, on a clock of the test's."""

from types import SimpleNamespace
from typing import ClassVar

from geometry_msgs.msg import PoseStamped
from node_bench import Bench
import pytest
from std_srvs.srv import SetBool
from tetra_ros2.config.parameters import ConfigurationError
from tetra_ros2.nodes import body
from tetra_ros2.nodes.body import Body
from tetra_ros2.ros import diagnostics
from tetra_ros2.wire import cdr

STILL, TURN = (0.0, 0.0, 0.0), (0.1, -0.2, 0.3)
encode = cdr.twist_stamped('agent_4').encode


class Obedient:
    """A driver that does as it is told, as long as it can be reached."""

    made: ClassVar[list] = []
    reached: ClassVar[bool] = True

    def __init__(self):
        self.reach()
        self.applied = []
        self.closed = False
        self.where = (0.0, 0.6, 0.0, 0.8)
        self.at_limit = ()
        Obedient.made.append(self)

    @staticmethod
    def reach():
        if not Obedient.reached:
            raise OSError('unplugged')

    def apply(self, rate, dt):
        self.reach()
        self.applied.append((rate, dt))

    def attitude(self):
        return self.where

    def close(self):
        self.closed = True


class Blind:
    """A driver that has nothing but the one method a driver must have."""

    def apply(self, rate, dt):
        pass


@pytest.fixture
def clock(monkeypatch):
    time = SimpleNamespace(now=100.0)
    time.monotonic = lambda: time.now
    monkeypatch.setattr(body, 'time', time)
    monkeypatch.setattr(Obedient, 'made', [])
    monkeypatch.setattr(Obedient, 'reached', True)
    return time


@pytest.fixture
def bench(probe, clock):
    # The timer is not to fire by itself: the test does.
    with Bench(probe, Body, 4, driver=f'{__name__}:Obedient', rate=0.01,
               command_timeout=0.5, max_angular_velocity=2.0) as made:
        yield made


def command(node, stamp, rate=TURN):
    node._on_command(encode(stamp, 0.0, 0.0, 0.0, *rate))
    node._on_timer()


def test_it_does_what_was_commanded_as_long_as_the_command_is_recent(bench, clock):
    node, driver = bench.node, Obedient.made[0]
    node._on_timer()
    command(node, 1)
    clock.now += 0.49
    node._on_timer()
    clock.now += 0.02
    node._on_timer()
    assert driver.applied == [(rate, 100.0) for rate in (STILL, TURN, TURN, STILL)]
    assert node.applied == 4


def test_a_command_too_fast_or_too_old_is_counted_and_a_fast_one_holds_the_body(bench):
    node, driver = bench.node, Obedient.made[0]
    command(node, 5)
    command(node, 4, (0.5, 0.0, 0.0))
    command(node, 6, (0.0, 2.1, 0.0))
    assert [rate for rate, _ in driver.applied] == [TURN, TURN, STILL]
    assert dict(node.health.rejected) == {
        'old stamp (agent_4)': 1, 'faster than max_angular_velocity (agent_4)': 1}


def test_it_tells_where_the_body_is_if_the_driver_knows(probe, bench):
    node, driver = bench.node, Obedient.made[0]
    probe.listen(PoseStamped, 'agent_4/pose')
    received = probe.received['agent_4/pose']
    bench.wait_for(lambda: node._on_timer() or received, 'a pose')
    pose = received[0]
    assert pose.header.frame_id == 'world'
    q, p = pose.pose.orientation, pose.pose.position
    assert (q.x, q.y, q.z, q.w) == pytest.approx(driver.where)
    assert (p.x, p.y, p.z) == STILL
    assert abs(node.get_clock().now().nanoseconds / 1e9 - pose.header.stamp.sec) < 60.0
    told = node.poses
    driver.where = None
    node._on_timer()
    assert node.poses == told


def test_a_driver_that_fails_is_told_to_hold_the_body_and_let_go(bench, clock, monkeypatch):
    node, driver = bench.node, Obedient.made[0]

    def apply(rate, dt):
        driver.applied.append((rate, dt))
        raise ValueError('out of range')

    monkeypatch.setattr(driver, 'apply', apply)
    command(node, 1)
    assert [rate for rate, _ in driver.applied] == [TURN, STILL]
    assert driver.closed
    level, message, values = node.assess()
    assert level == diagnostics.ERROR
    assert 'the body is lost: ValueError: out of range' in message
    assert values['losses'] == 1


def test_a_body_out_of_reach_is_reported_and_tried_again_every_half_second(bench, clock):
    node, driver = bench.node, Obedient.made[0]
    command(node, 1)
    Obedient.reached = False
    node._on_timer()
    assert driver.closed
    assert node.losses == 1
    level, message, values = node.assess()
    assert (level, message) == (
        diagnostics.ERROR, 'the body is lost: unplugged; turning as commanded')
    assert values['losses'] == 1
    for _ in range(3):  # a failed attempt is no new loss, and puts the next one off as well
        clock.now += 0.45
        node._on_timer()
        assert node.assess()[0] == diagnostics.ERROR
        clock.now += 0.1
        node._on_timer()
    assert (node.losses, len(Obedient.made)) == (1, 1)
    Obedient.reached = True
    clock.now += 0.45
    node._on_timer()
    assert len(Obedient.made) == 1, 'too early'
    clock.now += 0.1
    command(node, 2)
    assert Obedient.made[1].applied == [(TURN, 100.0)]
    assert node.assess()[:2] == (diagnostics.OK, 'turning as commanded')


def test_the_emergency_stop_holds_the_body_at_once_and_until_it_is_released(bench):
    node, driver = bench.node, Obedient.made[0]
    command(node, 1)

    def stop(data):
        response = node._on_stop(SetBool.Request(data=data), SetBool.Response())
        assert response.success
        return response.message

    assert stop(True) == 'stopped'
    assert driver.applied[-1] == (STILL, 100.0)
    command(node, 2)
    assert driver.applied[-1] == (STILL, 100.0)
    assert node.assess()[:2] == (diagnostics.ERROR, 'emergency stop')
    before = len(driver.applied)
    assert stop(False) == 'released'
    assert len(driver.applied) == before, 'a release moves nothing by itself'
    command(node, 3)
    assert driver.applied[-1] == (TURN, 100.0)


def test_its_health_says_what_the_body_does_and_of_which_kind_it_is(bench, clock):
    node, driver = bench.node, Obedient.made[0]
    assert node.assess()[:2] == (diagnostics.WARN, 'held, no command yet')
    command(node, 1)
    level, message, values = node.assess()
    assert (level, message) == (diagnostics.OK, 'turning as commanded')
    assert values['driver'] == 'Obedient'
    assert values['apply rate [Hz]'] > 0.0
    driver.at_limit = ('pan', 'tilt')
    assert node.assess()[:2] == (
        diagnostics.WARN, 'turning as commanded; at a limit: pan, tilt')
    driver.at_limit = ()
    clock.now += 0.6
    assert node.assess()[:2] == (diagnostics.ERROR, 'held, no recent command')


@pytest.mark.parametrize('reached', [True, False])
def test_at_its_end_the_body_is_held_and_let_go(probe, clock, reached):
    with Bench(probe, Body, 4, driver=f'{__name__}:Obedient', rate=0.01) as bench:
        command(bench.node, 1)
        Obedient.reached = reached
    driver, = Obedient.made
    assert driver.closed
    assert driver.applied[-1] == ((STILL if reached else TURN), 100.0)


def test_a_driver_that_knows_no_attitude_and_cannot_be_closed_will_do(probe, clock):
    with Bench(probe, Body, 1, driver=f'{__name__}:Blind', rate=0.01) as bench:
        command(bench.node, 1)
        assert (bench.node.applied, bench.node.poses) == (1, 0)


def test_a_body_of_nobody_or_out_of_reach_is_refused(probe, clock):
    with pytest.raises(ConfigurationError, match='--id: 0 is not valid'):
        Bench(probe, Body, 0, driver=f'{__name__}:Obedient')
    Obedient.reached = False
    with pytest.raises(ConfigurationError, match='driver: unplugged'):
        Bench(probe, Body, 1, driver=f'{__name__}:Obedient')
