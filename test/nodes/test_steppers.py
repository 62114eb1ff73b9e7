# Copyright 2026 The tetra_ros2 authors
# SPDX-License-Identifier: Apache-2.0

"""When the plant steps, for how long and with which commands: on a clock that the test turns."""

from types import SimpleNamespace

from hypothesis import given
from hypothesis import strategies as st
import pytest
from tetra_ros2.formation.checks import Rejected
from tetra_ros2.nodes import lockstep, realtime
from tetra_ros2.nodes.lockstep import Lockstep, RoundTrip
from tetra_ros2.nodes.realtime import RealTime

PERIOD = 10_000_000
STILL, TURN = (0.0, 0.0, 0.0), (0.0, 0.0, 1.0)
VALUES = {'rate': 100.0, 'command_timeout': 0.0, 'duration': 0.0, 'republish_period': 0.1,
          'real_time_factor': 0.0}


class Clocks:
    """The clock of the node and the steady one."""

    def __init__(self):
        self.node = 1_700_000_000 * 10**9
        self.steady = 5 * 10**9

    def advance(self, nanoseconds):
        self.node += nanoseconds
        self.steady += nanoseconds

    def now(self):
        return SimpleNamespace(nanoseconds=self.node)

    def monotonic(self):
        return self.steady / 1e9

    def monotonic_ns(self):
        return self.steady


class Plant:
    """What a stepper needs of the plant, and a record of what it made of it."""

    def __init__(self, clocks, n=2):
        self.bodies = SimpleNamespace(axes=[(1.0, 0.0, 0.0)] * n, step=self._step)
        self.stepped = []  # for each step how long it was [s], and how fast all bodies turned
        self.published = []
        self.timers = []
        self._clocks = clocks

    def _step(self, h, rates):
        self.stepped.append((h, list(rates)))

    def publish(self, stamp):
        self.published.append(stamp)

    def repeat(self, stamp, agents):
        self.published.append(stamp)

    def read_commands(self):
        pass

    def held_agents(self):
        return 0

    def create_steady_timer(self, period, callback):
        self.timers.append(callback)
        return callback

    create_timer = create_steady_timer

    def destroy_timer(self, timer):
        self.timers.remove(timer)

    def get_parameter(self, name):
        assert name == 'use_sim_time'
        return SimpleNamespace(value=False)

    def get_clock(self):
        return self._clocks

    def offer(self, *arguments, **options):
        return SimpleNamespace(handle=None, publish=lambda message: None)

    def tick(self):
        for timer in self.timers[:]:
            timer()


def begin(kind, clocks, **values):
    plant = Plant(clocks)
    stepper = kind(plant, [0, 1])
    stepper.configure(VALUES | values)
    stepper.start()
    return plant, stepper


@pytest.fixture
def clocks(monkeypatch):
    both = Clocks()
    monkeypatch.setattr(lockstep, 'time', both)
    monkeypatch.setattr(realtime, 'time', both, raising=False)
    return both


def answer(stepper, rate=TURN):
    stamp = stepper.stamp
    for i in range(2):
        stepper.command(i, stamp, rate)


@pytest.mark.parametrize('steps', [1, 2, 10])
def test_in_lockstep_the_bodies_move_for_the_whole_duration_and_no_longer(clocks, steps):
    plant, stepper = begin(Lockstep, clocks, duration=steps * PERIOD / 1e9)
    for _ in range(steps + 5):
        answer(stepper)
    assert plant.stepped == [(PERIOD / 1e9, [TURN, TURN])] * steps
    assert stepper.paused


@pytest.mark.parametrize('kind', [Lockstep, RealTime])
def test_a_stop_is_taken_and_what_is_later_is_refused(clocks, kind):
    """A stop is one nanosecond younger than the newest measurement, so nothing later is true."""
    plant, stepper = begin(kind, clocks)
    plant.tick()
    stepper.command(0, stepper.stamp + 1, STILL)
    for later in (2, PERIOD, 400_000_000, 5 * 10**9):
        with pytest.raises(Rejected, match=Rejected.FUTURE_STAMP):
            stepper.command(0, stepper.stamp + later, TURN)
    assert not any(rate == TURN for _, rates in plant.stepped for rate in rates)


def test_in_lockstep_a_stop_answers_no_measurement(clocks):
    plant, stepper = begin(Lockstep, clocks)
    for i in range(2):
        stepper.command(i, stepper.stamp + 1, STILL)
        stepper.command(i, stepper.stamp - 1, STILL)
    assert not plant.stepped
    answer(stepper)
    assert plant.stepped == [(PERIOD / 1e9, [TURN, TURN])]


def give_up(clocks, plant, stepper):
    """Let agent 2 be silent for too long."""
    stepper.command(0, stepper.stamp, TURN)
    steps = stepper.steps
    clocks.advance(31 * 10**9)
    plant.tick()
    assert stepper.steps == steps + 1
    assert plant.stepped[-1][1] == [TURN, STILL], 'it is held still'


def test_in_lockstep_who_fell_silent_is_waited_for_again_once_it_answers_something_newer(clocks):
    plant, stepper = begin(Lockstep, clocks)
    answer(stepper)
    given_up = stepper.stamp
    give_up(clocks, plant, stepper)

    stepper.command(1, given_up, TURN)  # an answer that was long on its way says nothing of now
    stepper.command(0, stepper.stamp, TURN)
    assert plant.stepped[-1][1] == [TURN, STILL]

    stepper.command(1, stepper.stamp - PERIOD, TURN)
    steps = stepper.steps
    stepper.command(0, stepper.stamp, TURN)
    assert stepper.steps == steps + 1, 'this step does not wait for it'
    stepper.command(0, stepper.stamp, TURN)
    assert stepper.steps == steps + 1, 'the next one does'
    stepper.command(1, stepper.stamp, TURN)
    assert plant.stepped[-1][1] == [TURN, TURN]


def test_in_lockstep_who_has_never_answered_is_waited_for(clocks):
    plant, stepper = begin(Lockstep, clocks)
    stepper.command(0, stepper.stamp, TURN)
    for _ in range(10):
        clocks.advance(100 * 10**9)
        plant.tick()
    assert not plant.stepped
    assert len(plant.published) > 5, 'it is sent the measurements again'
    assert set(plant.published) == {stepper.stamp}


@given(st.lists(st.integers(1, 50_000_000), min_size=1, max_size=20))
def test_in_real_time_a_step_lasts_as_long_as_it_really_was(passed):
    clocks = Clocks()
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(realtime, 'time', clocks, raising=False)
        plant, stepper = begin(RealTime, clocks, command_timeout=100.0)
        plant.tick()
        for elapsed in passed:
            answer(stepper)
            clocks.advance(elapsed)
            plant.tick()
    assert [h for h, _ in plant.stepped] == [elapsed / 1e9 for elapsed in passed]
    assert all(rates == [TURN, TURN] for _, rates in plant.stepped)


def test_in_real_time_nothing_moves_while_time_stands_still(clocks):
    plant, stepper = begin(RealTime, clocks)
    plant.tick()
    answer(stepper)
    for _ in range(3):
        plant.tick()
    assert not plant.stepped
    assert stepper.steps == 0


def test_in_real_time_the_bodies_pause_when_their_duration_is_over(clocks):
    plant, stepper = begin(RealTime, clocks, duration=0.1)
    plant.tick()
    for _ in range(20):
        clocks.advance(PERIOD)
        plant.tick()
    assert stepper.paused
    assert len(plant.stepped) == 10


def test_in_real_time_a_command_counts_until_it_is_as_old_as_its_time_out(clocks):
    plant, stepper = begin(RealTime, clocks, command_timeout=0.05)
    plant.tick()
    answer(stepper)
    for _ in range(7):
        clocks.advance(PERIOD)
        plant.tick()
    assert [rates[0] for _, rates in plant.stepped] == 5 * [TURN] + 2 * [STILL]


def test_the_patience_grows_until_an_answer_is_quick_enough_and_then_follows_the_answers():
    trip = RoundTrip()
    for _ in range(100):
        trip.lengthen()
    assert trip.patience > 1.0, 'a network that is slow, and no answer was ever unambiguous'
    for _ in range(200):
        trip.take(0.02)
    assert trip.patience == pytest.approx(0.02, rel=0.01)
    trip.lengthen()
    assert trip.patience == pytest.approx(0.02, rel=0.01)


def test_an_answer_that_comes_too_soon_after_a_repetition_tells_that_it_was_not_needed():
    """Else who has become slower than the patience would be sent everything twice for good."""
    trip = RoundTrip()
    for _ in range(50):
        trip.take(0.0005)
    assert trip.patience == lockstep.SHORTEST_PATIENCE
    assert trip.was_needed(0.0004, 0.0024), 'it may answer either'
    assert trip.patience == lockstep.SHORTEST_PATIENCE
    for _ in range(40):
        assert not trip.was_needed(0.0001, 0.0041)
    assert trip.patience == 0.0041, 'as long as this one took, and no longer'


def hiccup(clocks, plant, stepper, milliseconds):
    """Let a step be repeated, after many that were not, and answered so long after that."""
    for _ in range(50):
        clocks.advance(1_000_000)
        answer(stepper)
    clocks.advance(5_000_000)
    plant.tick()
    clocks.advance(round(milliseconds * 1e6))
    answer(stepper)


def test_in_lockstep_it_is_looked_more_often_only_where_something_was_lost(clocks):
    plant, stepper = begin(Lockstep, clocks)
    watchdog = len(plant.timers)
    hiccup(clocks, plant, stepper, 0.1)
    plant.tick()
    assert stepper.repetitions == 1
    assert len(plant.timers) == watchdog, 'this process was busy, and the answer there already'
    hiccup(clocks, plant, stepper, 1.0)
    plant.tick()
    assert stepper.repetitions == 2
    assert len(plant.timers) == watchdog + 1
    clocks.advance(round(lockstep.ALERT * 1e9))
    answer(stepper)
    plant.tick()
    plant.tick()
    assert len(plant.timers) == watchdog
