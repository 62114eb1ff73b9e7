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

"""When the plant steps, for how long and with which commands: on a clock that the test turns."""

from types import SimpleNamespace

from hypothesis import given
from hypothesis import strategies as st
import pytest
from tetra_ros2.formation.checks import Rejected
from tetra_ros2.nodes import lockstep, realtime
from tetra_ros2.nodes.lockstep import Lockstep, RoundTrip
from tetra_ros2.nodes.realtime import RealTime
from tetra_ros2.nodes.stepper import agents_of, Stepper
from tetra_ros2.ros import diagnostics

PERIOD = 10_000_000
HEALTH = SimpleNamespace(rates=lambda counts: counts)
STILL, TURN = (0.0, 0.0, 0.0), (0.0, 0.0, 1.0)
VALUES = {'rate': 100.0, 'command_timeout': 0.0, 'duration': 0.0, 'republish_period': 0.1,
          'real_time_factor': 0.0}


class Clocks:
    """The clock of the node and the steady one."""

    def __init__(self):
        self.node = 1_700_000_000 * 10**9
        self.steady = 10_000_000  # the machine has just been started
        self.delays = []  # how long others have the processor when the node's was read [ns]

    def advance(self, nanoseconds):
        self.node += nanoseconds
        self.steady += nanoseconds

    def now(self):
        now = SimpleNamespace(nanoseconds=self.node)
        self.advance(self.delays.pop() if self.delays else 0)
        return now

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
        self.repeated = []  # to whom, as bits
        self.timers = []
        self.periods = {}  # of the timers [s]
        self.held = 0
        self._clocks = clocks

    def _step(self, h, rates):
        self.stepped.append((h, list(rates)))

    def publish(self, stamp):
        self.published.append(stamp)

    def repeat(self, stamp, agents):
        self.published.append(stamp)
        self.repeated.append(agents)

    def read_commands(self):
        pass

    def held_agents(self):
        return self.held

    def create_steady_timer(self, period, callback):
        self.timers.append(callback)
        self.periods[callback.__name__] = period
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


def begin(kind, clocks, agents=(0, 1), **values):
    plant = Plant(clocks)
    stepper = kind(plant, agents)
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


def test_a_stepper_that_lacks_a_method_is_none():
    wanted = {'configure', 'start', 'stop', 'pause', 'run_until', 'state_changed', 'command',
              'assess'}
    for name in wanted:
        methods = {other: lambda *_: None for other in wanted - {name}}
        with pytest.raises(TypeError, match=name):
            type('Lacking', (Stepper,), methods)(None, ())


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


def test_in_lockstep_who_answers_the_step_at_hand_is_back_at_once(clocks):
    plant, stepper = begin(Lockstep, clocks)
    answer(stepper)
    give_up(clocks, plant, stepper)
    answered = stepper.stamp
    stepper.command(1, answered, TURN)
    stepper.command(0, answered, TURN)
    assert plant.stepped[-1][1] == [TURN, TURN], 'its command counts'
    stepper.command(0, stepper.stamp, TURN)
    assert stepper.stamp == answered + PERIOD, 'it is waited for again'


@pytest.mark.parametrize('answering', [(), (0,), (1,)])
def test_in_lockstep_who_has_never_answered_is_waited_for(clocks, answering):
    plant, stepper = begin(Lockstep, clocks)
    for i in answering:
        stepper.command(i, stepper.stamp, TURN)
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


@pytest.mark.parametrize('anew', [False, True])
def test_in_real_time_a_step_is_as_long_as_its_stamps_say_whoever_comes_in_between(clocks, anew):
    plant, stepper = begin(RealTime, clocks)
    plant.tick()
    for _ in range(3):
        clocks.advance(PERIOD)
        clocks.delays = [40_000_000, 90_000, 30_000_000]
        stepper.state_changed() if anew else plant.tick()
        clocks.advance(PERIOD)
        before = stepper.stamp
        clocks.delays = [20_000_000] * 3
        plant.tick()
        h, _ = plant.stepped[-1]
        assert h == pytest.approx((stepper.stamp - before) / 1e9, abs=1e-4)


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


def test_before_any_answer_came_nobody_knows_that_one_came_too_soon():
    trip = RoundTrip()
    assert trip.was_needed(1.01 * lockstep.QUICKEST, 1.0)
    assert trip.patience == lockstep.FIRST_PATIENCE
    assert not trip.was_needed(0.99 * lockstep.QUICKEST, 1.0)


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


def test_in_lockstep_where_much_is_lost_it_learns_from_the_last_answer_before_a_repetition(
        clocks, monkeypatch):
    plant, stepper = begin(Lockstep, clocks)
    hiccup(clocks, plant, stepper, 1.0)
    plant.tick()
    answer(stepper)
    learnt = []
    monkeypatch.setattr(stepper._round_trip, 'take', learnt.append)
    clocks.advance(700_000)
    stepper.command(0, stepper.stamp, TURN)  # agent 2 is silent
    clocks.advance(50_000_000)
    stepper._look()
    assert learnt == [pytest.approx(0.0007)]
    assert plant.repeated[-1] == 0b10
    clocks.advance(50_000_000)
    stepper._look()
    assert len(learnt) == 1, 'once is enough'


def test_in_lockstep_who_has_not_answered_is_sent_the_measurements_again_and_nobody_else(clocks):
    plant, stepper = begin(Lockstep, clocks)
    for _ in range(50):
        clocks.advance(1_000_000)
        answer(stepper)
    patience = stepper._round_trip.patience
    assert patience == 2e-3
    stepper.command(0, stepper.stamp, TURN)
    clocks.advance(round(0.9e9 * patience))
    plant.tick()
    assert plant.repeated == [], 'it has not waited long enough'
    clocks.advance(round(0.2e9 * patience))
    plant.tick()
    assert plant.repeated == [0b10]
    plant.tick()
    assert plant.repeated == [0b10], 'not at once again'
    assert stepper.repetitions == 1
    clocks.advance(1_000_000)
    answer(stepper)
    assert stepper._round_trip.patience == patience, 'nobody knows which one was answered'
    stepper._on_watchdog()
    assert stepper._look in plant.timers, 'it looks more often for a while'
    assert plant.periods['_look'] == pytest.approx(0.5e-3)
    clocks.advance(1_100_000_000)
    answer(stepper)
    stepper._on_watchdog()
    assert stepper._look not in plant.timers


def test_in_lockstep_after_many_repetitions_the_state_goes_out_too_once_in_a_while(clocks):
    plant, stepper = begin(Lockstep, clocks, republish_period=2.0)
    answer(stepper)
    state = len(plant.published) - len(plant.repeated)
    while len(plant.repeated) < 100:
        clocks.advance(50_000_000)
        plant.tick()
    assert len(plant.published) - len(plant.repeated) == state
    clocks.advance(1_500_000_000)
    plant.tick()
    assert len(plant.repeated) == 100
    assert len(plant.published) - len(plant.repeated) == state
    clocks.advance(600_000_000)
    plant.tick()
    assert len(plant.published) - len(plant.repeated) == state + 1


def test_in_lockstep_a_paused_plant_waits_for_nobody_and_gives_up_nobody(clocks):
    plant, stepper = begin(Lockstep, clocks)
    answer(stepper)
    stepper.pause(True)
    answer(stepper)
    steps = stepper.steps
    clocks.advance(100 * 10**9)
    plant.tick()
    assert stepper.steps == steps
    assert stepper.assess(HEALTH)[:2] == (diagnostics.OK, 'paused')
    stepper.pause(False)
    assert stepper.steps == steps + 1, 'all had answered'


def test_in_lockstep_who_answers_a_paused_plant_again_makes_it_look_for_no_loss(clocks):
    plant, stepper = begin(Lockstep, clocks)
    answer(stepper)
    stepper.pause(True)
    answer(stepper)
    before, patience = plant.timers[:], stepper._round_trip.patience
    for _ in range(3):
        clocks.advance(200_000_000)
        plant.tick()
        clocks.advance(1_000_000)
        answer(stepper)
    assert stepper.repetitions == 3
    plant.tick()
    assert plant.timers == before, 'two thousand times a second'
    assert stepper._round_trip.patience == patience


def test_in_lockstep_bodies_that_are_held_for_a_conflict_hold_the_time(clocks):
    plant, stepper = begin(Lockstep, clocks)
    plant.held = 0b1
    answer(stepper)
    assert not plant.stepped
    plant.held = 0
    clocks.advance(10**9)
    plant.tick()
    assert len(plant.stepped) == 1


@pytest.mark.parametrize('factor', [0.5, 2.0])
def test_in_lockstep_a_pace_lets_no_step_come_early(clocks, factor):
    plant, stepper = begin(Lockstep, clocks, real_time_factor=factor)
    assert plant.periods['_on_due'] == pytest.approx(PERIOD / 1e9 / factor)
    answer(stepper)
    assert len(plant.stepped) == 1
    answer(stepper)
    assert len(plant.stepped) == 1, 'all have answered, and it is not time'
    stepper._on_due()
    assert len(plant.stepped) == 2
    stepper._on_due()
    assert len(plant.stepped) == 2, 'it is time, and nobody has answered'
    answer(stepper)
    assert len(plant.stepped) == 3
    answer(stepper)
    stepper.configure(VALUES)  # without a pace
    assert stepper._on_due not in plant.timers
    stepper._advance()
    assert len(plant.stepped) == 4


def test_in_lockstep_with_nobody_to_wait_for_time_goes_a_hundred_times_as_fast(clocks):
    plant, stepper = begin(Lockstep, clocks, agents=())
    assert plant.periods['_on_due'] == pytest.approx(PERIOD / 1e9 / 100.0)
    for _ in range(5):
        stepper._on_due()
    assert [rates for _, rates in plant.stepped] == [[STILL, STILL]] * 5


def test_in_lockstep_it_is_said_for_whom_it_waits_and_who_is_held_still(clocks):
    plant, stepper = begin(Lockstep, clocks)
    answer(stepper)
    level, message, values = stepper.assess(HEALTH)
    assert (level, message) == (diagnostics.OK, 'running')
    assert values['state'] == 'running'
    assert values['steps'] == values['step rate [Hz]'] == 1
    assert values['formation time [s]'] == pytest.approx(2 * PERIOD / 1e9)
    clocks.advance(round(lockstep.TOLD * 1e9))
    stepper.command(0, stepper.stamp, TURN)
    level, message, values = stepper.assess(HEALTH)
    assert (level, message) == (diagnostics.OK, 'running')
    assert values['state'] == 'running'
    clocks.advance(1_000_000)
    level, message, values = stepper.assess(HEALTH)
    assert (level, message) == (diagnostics.WARN, 'waiting for agent_2')
    assert values['state'] == 'waiting'
    clocks.advance(30 * 10**9)
    plant.tick()
    assert stepper.assess(HEALTH)[:2] == (
        diagnostics.ERROR, 'held still, not answering: agent_2')
    stepper.command(0, stepper.stamp, TURN)
    stepper.command(1, stepper.stamp - PERIOD, TURN)
    level, message, values = stepper.assess(HEALTH)
    assert (level, message) == (diagnostics.OK, 'running')
    assert values['late commands'] == 1


def test_in_lockstep_it_runs_until_the_first_step_at_or_after_a_time(clocks):
    plant, stepper = begin(Lockstep, clocks)
    stepper.run_until(3 * PERIOD - 1)
    for _ in range(6):
        answer(stepper)
    assert stepper.stamp == 3 * PERIOD
    assert stepper.paused
    stepper.run_until(5 * PERIOD)
    for _ in range(6):
        answer(stepper)
    assert stepper.stamp == 5 * PERIOD
    stepper.stop()
    stepper.pause(True)
    assert len(plant.stepped) == 4


@pytest.mark.parametrize(('seconds', 'patience'), [
    # RFC 6298: the mean and four times the deviation, which begins with half of the first.
    ([0.02], 0.02 + 4 * 0.01),
    ([0.02, 0.04], (0.02 + 0.125 * 0.02) + 4 * (0.01 + 0.25 * (0.02 - 0.01))),
    ([0.0004], 2e-3)])
def test_the_patience_is_that_of_tcp(seconds, patience):
    trip = RoundTrip()
    for value in seconds:
        trip.take(value)
    assert trip.patience == pytest.approx(patience, rel=1e-12)


@pytest.mark.parametrize(('jump', 'jumps'), [
    (90_000_000, 0), (-90_000_000, 0), (110_000_000, 1), (-110_000_000, 1), (-10**12, 1)])
def test_in_real_time_a_clock_that_was_set_is_noticed_and_the_commands_forgotten(
        clocks, jump, jumps):
    plant, stepper = begin(RealTime, clocks, command_timeout=100.0)
    plant.tick()
    answer(stepper)
    clocks.advance(PERIOD)
    clocks.node += jump
    plant.tick()
    assert stepper.clock_jumps == jumps
    assert len(plant.stepped) == 1 - jumps, 'a step of a length that nobody knows is not taken'
    clocks.advance(PERIOD)
    plant.tick()
    assert plant.stepped[-1] == (PERIOD / 1e9, [STILL if jumps else TURN] * 2)


def test_in_real_time_an_older_command_does_not_replace_a_newer_one(clocks):
    plant, stepper = begin(RealTime, clocks)
    plant.tick()
    answer(stepper)
    with pytest.raises(Rejected, match=Rejected.OLD_STAMP):
        stepper.command(0, stepper.stamp - 1, STILL)
    clocks.advance(PERIOD)
    plant.tick()
    assert plant.stepped == [(PERIOD / 1e9, [TURN, TURN])]


def test_in_real_time_its_health_tells_who_is_silent_and_how_late_steps_are(clocks):
    plant, stepper = begin(RealTime, clocks)
    plant.tick()
    assert stepper.assess(HEALTH)[2]['age of command of agent_1 [s]'] == float('inf')
    stamp = stepper.stamp
    for _ in range(3):
        stepper.command(0, stepper.stamp, TURN)
        clocks.advance(PERIOD)
        plant.tick()
    level, message, values = stepper.assess(HEALTH)
    assert (level, message) == (diagnostics.ERROR, 'held still, no recent command: agent_2')
    assert values['age of command of agent_1 [s]'] == PERIOD / 1e9
    assert values['commands not answering the previous step'] == 3
    assert values['steps'] == values['step rate [Hz]'] == 3
    assert values['deadline misses'] == 0
    stepper.command(1, stamp, TURN)  # late, and good enough
    clocks.advance(16 * PERIOD // 10)
    plant.tick()
    level, message, values = stepper.assess(HEALTH)
    assert (level, message) == (diagnostics.OK, 'running')
    assert values['deadline misses'] == 1
    stepper.pause(True)
    assert stepper.assess(HEALTH)[:2] == (diagnostics.OK, 'paused')
    assert stepper.assess(HEALTH)[2]['state'] == 'paused'


def test_in_real_time_a_held_body_rests_and_the_others_go_on(clocks):
    plant, stepper = begin(RealTime, clocks)
    plant.tick()
    answer(stepper)
    plant.held = 0b10
    clocks.advance(PERIOD)
    plant.tick()
    assert plant.stepped == [(PERIOD / 1e9, [TURN, STILL])]


def test_in_real_time_a_new_rate_makes_a_new_timer_and_the_same_one_does_not(clocks):
    plant, stepper = begin(RealTime, clocks)
    plant.timers.append('another')
    stepper.configure(VALUES)
    assert plant.timers[0] != 'another'
    stepper.configure(VALUES | {'rate': 50.0})
    assert plant.timers[0] == 'another'
    assert plant.periods['_on_timer'] == pytest.approx(0.02)


@pytest.mark.parametrize(('rate', 'given', 'timeout'), [
    (100.0, 0.0, 0.5), (2.0, 0.0, 1.5), (100.0, 0.05, 0.05), (100.0, 1e300, 1e9)])
def test_in_real_time_a_command_lives_half_a_second_or_three_periods(clocks, rate, given, timeout):
    _, stepper = begin(RealTime, clocks, rate=rate, command_timeout=given)
    assert stepper._timeout == round(timeout * 1e9)


def test_after_a_reset_in_real_time_the_next_step_begins_there(clocks):
    plant, stepper = begin(RealTime, clocks)
    plant.tick()
    answer(stepper)
    clocks.advance(7_000_000)
    stepper.state_changed()
    assert plant.published[-1] == clocks.node
    clocks.advance(3_000_000)
    plant.tick()
    assert plant.stepped == [(3e-3, [STILL, STILL])], 'what was commanded was for another state'


def test_agents_are_named_by_their_bits():
    assert agents_of(0) == ''
    assert agents_of(0b1011) == 'agent_1, agent_2, agent_4'


@pytest.mark.parametrize('jump', [-3600, -60, -1, 1, 3600])
def test_in_real_time_a_clock_that_was_set_is_reported_for_a_report_or_two(clocks, jump):
    plant, stepper = begin(RealTime, clocks)
    for _ in range(3):
        clocks.advance(PERIOD)
        plant.tick()
    assert 'clock' not in stepper.assess(HEALTH)[1]
    clocks.node += jump * 10**9
    reports = []
    for _ in range(4):
        for _ in range(100):
            clocks.advance(PERIOD)
            plant.tick()
            answer(stepper)
        reports.append(stepper.assess(HEALTH))
    told = ['the clock was set' in message for _, message, _ in reports]
    assert told in ([True, False, False, False], [True, True, False, False])
    assert reports[0][0] != reports[-1][0], 'it is a warning'
    assert reports[-1][2]['clock jumps'] == 1


def test_in_lockstep_who_is_waited_for_is_told_so_soon_that_a_report_comes_within_two_seconds(
        clocks):
    _, stepper = begin(Lockstep, clocks)
    answer(stepper)
    stepper.command(0, stepper.stamp, TURN)
    clocks.advance(900_000_000)
    _, message, values = stepper.assess(HEALTH)
    assert message == 'waiting for agent_2'
    assert values['state'] == 'waiting'
