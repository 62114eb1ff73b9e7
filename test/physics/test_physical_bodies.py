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

"""Bodies with mass: laws of nature, the rate loop, limits, and files of one's own."""

import math

import numpy as np
import pytest
from tetra_ros2.formation import gain, gimbal, measures, rate_loop, rotation, shapes, simulation
from tetra_ros2.formation import topology as topologies

mujoco = pytest.importorskip('mujoco')

from tetra_ros2.physics import models  # noqa: E402
from tetra_ros2.physics.bodies import make_bodies  # noqa: E402
from tetra_ros2.physics.settings import (  # noqa: E402
    BodyError,
    Gimbal,
    Physics,
    RateLoop,
    Wheels,
)

AXES = np.tile([1.0, 0.0, 0.0], (4, 1))
THETA = math.acos(-1.0 / 3.0)


def random_attitudes(seed=0, n=4):
    return rotation.random(np.random.default_rng(seed), (n,))


def pointing_up_to(tilt, seed=0, n=4):
    """Return random attitudes within the default limits of a gimbal."""
    rng = np.random.default_rng(seed)
    kept = []
    while len(kept) < n:
        attitude = rotation.random(rng)
        if abs(rotation.rotate(attitude, [1.0, 0.0, 0.0])[2]) < math.sin(tilt):
            kept.append(attitude)
    return np.array(kept)


def formation(physics, topology, attitudes, gain_function=None):
    bodies = make_bodies(attitudes, AXES[:len(attitudes)], physics)
    loop = simulation.SampledLoop(
        attitudes, AXES[:len(attitudes)], topology, gain_function or gain.Cosine())
    loop.bodies = bodies
    return loop, bodies


def error(bodies):
    angles = measures.pairwise_angles(np.array(bodies.reduced))
    return float(np.max(np.abs(angles - THETA)))


def test_free_bodies_with_wheels_conserve_momentum_to_1e_9_over_1e5_steps():
    # No torque at all, and the body tumbling with its wheels at speed.
    bodies = make_bodies(random_attitudes(n=2), AXES[:2], Physics('wheels'))
    bodies._velocities[:, 3:6] = [[1.0, -0.7, 0.5], [0.2, 2.0, -1.0]]
    bodies._velocities[:, 6:9] = [[30.0, -50.0, 40.0], [0.0, 0.0, 0.0]]
    before = bodies.angular_momentum()
    bodies._model.opt.timestep = 1e-3
    mujoco.mj_step(bodies._model, bodies._data, 100_000)
    drift = np.linalg.norm(bodies.angular_momentum() - before, axis=1)
    assert np.all(drift < 1e-9 * np.linalg.norm(before, axis=1))


def test_what_the_wheels_take_the_box_gives_and_nothing_is_lost():
    bodies = make_bodies(random_attitudes(1, 1), AXES[:1], Physics('wheels'))
    bodies._velocities[:, 3:6] = [[0.3, -0.2, 0.1]]
    before = bodies.angular_momentum()
    rng = np.random.default_rng(0)
    for _ in range(200):  # 2000 steps of the physics, under torques all the time
        bodies.step(0.01, rng.standard_normal((1, 3)))
    assert np.linalg.norm(bodies.angular_momentum() - before) < 1e-11


@pytest.mark.parametrize('feedforward', [True, False])
def test_the_rate_loop_has_the_bandwidth_that_it_is_said_to_have(feedforward):
    physics = Physics('wheels', loop=RateLoop(5.0, feedforward), rate=2000.0,
                      wheels=Wheels(torque_limit=10.0, speed_limit=1e5))
    bodies = make_bodies(random_attitudes(2), AXES, physics)
    commands = np.random.default_rng(0).standard_normal((4, 3))
    bodies.step(0.2, commands)
    # At rest to begin with, box and wheels have no momentum: there is nothing to make up for.
    expected = commands * -math.expm1(-5.0 * 0.2)
    assert np.max(np.abs(bodies._velocities[:, 3:6] - expected)) < 2e-3


def test_wheels_turn_as_the_theory_of_the_rate_loop_has_it():
    attitudes = random_attitudes(3)
    physics = Physics('wheels', loop=RateLoop(4.0), rate=1000.0,
                      wheels=Wheels(torque_limit=10.0, speed_limit=1e5))
    bodies = make_bodies(attitudes, AXES, physics)
    rates = np.zeros((4, 2))
    rng = np.random.default_rng(1)
    for _ in range(30):
        commands = rng.standard_normal((4, 2))
        bodies.step(0.05, np.concatenate([np.zeros((4, 1)), commands], axis=1))
        attitudes, rates = rate_loop.turn(attitudes, rates, commands, 4.0, 0.05)
    turned = rotation.log(rotation.multiply(rotation.inverse(attitudes),
                                            np.array(bodies.attitudes)))
    assert np.max(np.abs(turned)) < 5e-3


@pytest.mark.parametrize('body', ['wheels', 'gimbal'])
def test_a_rotating_formation_spins_as_predicted(body):
    topology = topologies.rotating()
    loop, bodies = formation(
        Physics(body, rate=500.0, loop=RateLoop(20.0)), topology, pointing_up_to(1.0, 5))
    loop.advance(0.02, 750)
    before = np.array(bodies.reduced)
    loop.advance(0.02, 50)
    spin = measures.mean_angular_velocity(before, np.array(bodies.reduced), 1.0)
    predicted = rate_loop.rate_loop_equilibrium(
        shapes.TETRAHEDRON.points, topology.weights, gain.Cosine(), 20.0, h=0.02)
    assert np.linalg.norm(spin) == pytest.approx(np.linalg.norm(predicted.spin), rel=1e-3)
    shift = np.max(np.abs(measures.pairwise_angles(predicted.gamma) - THETA))
    assert error(bodies) == pytest.approx(shift, rel=0.1)


@pytest.mark.parametrize('body', ['wheels', 'gimbal'])
def test_the_same_start_and_commands_give_the_same_bits(body):
    def run():
        physics = Physics(body, loop=RateLoop(noise=0.01, bias=0.01), seed=4)
        loop, bodies = formation(physics, topologies.complete(), pointing_up_to(1.0, 6))
        loop.advance(0.01, 50)
        return bodies.attitudes, [bodies.joints(i) for i in range(4)]

    assert run() == run()


def test_saturated_wheels_are_slower_never_unstable_and_say_so():
    topology = topologies.complete()
    strong, weak = Wheels(torque_limit=5.0), Wheels(torque_limit=0.004, speed_limit=30.0)
    times = []
    for wheels in (strong, weak):
        loop, bodies = formation(Physics('wheels', rate=500.0, wheels=wheels), topology,
                                 random_attitudes(7))
        steps = 0
        worst = 0.0
        while error(bodies) > 1e-3:
            loop.advance(0.02, 5)
            steps += 5
            assert steps < 10000
            worst = max(worst, max(abs(v) for i in range(4) for v in bodies.joints(i).velocities))
        times.append(steps)
        limited = sum(bodies.saturated_steps)
        assert worst <= wheels.speed_limit * (1.0 + 1e-9)
    assert times[1] > 1.5 * times[0]
    assert limited > 0


def test_with_enough_torque_a_body_is_saturated_once_and_for_no_longer_than_proven():
    topology, cosine = topologies.complete(), gain.Cosine()
    bound = rate_loop.acceleration_bound(topology.weights, cosine)
    wheels = Wheels(torque_limit=1.2 * bound * max(Wheels().total_inertia), speed_limit=1e5)
    fastest = 3.0 * 0.75 * math.sqrt(3.0)  # the largest command there is
    longest = fastest / (wheels.acceleration_limit - bound)
    limited = []
    for seed in range(5):
        loop, bodies = formation(Physics('wheels', wheels=wheels), topology,
                                 random_attitudes(seed))
        for step in range(600):
            loop.advance(0.002, 1)
            for i, what in enumerate(bodies.saturated):
                before = bodies.saturated_steps[i]
                assert before == step + 1 if what else True, 'once, from the start on'
                assert not what or 0.002 * step <= longest
            rates = np.linalg.norm(bodies._velocities[:, 3:6], axis=1)
            assert np.max(rates) <= fastest * (1.0 + 1e-6)
        limited += bodies.saturated_steps
    assert max(limited) > 5


def test_physics_that_gets_out_of_hand_rests_where_it_was_and_says_so(caplog, capfd, tmp_path,
                                                                      monkeypatch):
    monkeypatch.chdir(tmp_path)
    bodies = make_bodies(random_attitudes(2), AXES, Physics('wheels'))
    bodies.step(0.1, [(0.1, 0.2, 0.3)] * 4)
    before = bodies.attitudes[:]
    bodies._velocities[1, 3] = 1e14
    bodies.step(0.01, [(0.1, 0.2, 0.3)] * 4)
    assert bodies.diverged_steps == 1
    assert np.allclose(bodies.attitudes, before, atol=1e-12)
    assert not np.any(bodies._velocities)
    # Where loggers were set up by somebody else, it is on the standard error.
    assert 'MuJoCo: ' in caplog.text + capfd.readouterr().err
    bodies.step(0.01, [(0.1, 0.2, 0.3)] * 4)
    assert bodies.diverged_steps == 1
    assert not list(tmp_path.iterdir()), 'no MUJOCO_LOG.TXT'


def test_what_a_file_says_of_its_world_is_kept_without_a_word(caplog, capfd, tmp_path,
                                                              monkeypatch):
    monkeypatch.chdir(tmp_path)
    text = THRUSTERS.format(motors=MOTORS).replace(
        '<mujoco>', '<mujoco><option gravity="0 0 -3" wind="1 0 0" timestep="0.005"/>')
    (tmp_path / 'own.xml').write_text(text)
    make_bodies(random_attitudes(), AXES, Physics('own.xml'))
    assert [path.name for path in tmp_path.iterdir()] == ['own.xml']
    assert not caplog.text
    assert capfd.readouterr() == ('', '')


def test_the_joints_tell_what_they_can_do():
    wheels = make_bodies(random_attitudes(), AXES, Physics('wheels')).limits()
    assert wheels['wheel_y'] == (-math.inf, math.inf, 600.0, 0.1)
    head = make_bodies(pointing_up_to(0.3), AXES, Physics(
        'gimbal', gimbal=Gimbal(tilt_limits=(-0.4, 0.5)))).limits()
    assert head == {'pan': (-math.inf, math.inf, 10.0, 1.0), 'tilt': (-0.4, 0.5, 10.0, 1.0)}


def test_a_gimbal_shows_how_far_it_can_go_and_when_it_can_go_no_further():
    bodies = make_bodies(pointing_up_to(0.3, n=2), AXES[:2], Physics(
        'gimbal', gimbal=Gimbal(tilt_limits=(-0.4, 0.4))))
    bodies.step(2.0, [(0.0, 1.0, 0.0), (0.0, 0.0, 1.0)])
    arcs = [part for part in bodies.parts() if part.kind == 'arc']
    assert [(arc.body, arc.at_limit) for arc in arcs] == [(0, True), (1, False)]
    for arc, gamma in zip(arcs, np.array(bodies.reduced)):
        ends = rotation.rotate(np.array(arc.attitude), np.array(arc.points)) / 0.16
        # The arc is that of the directions that it could point along without panning.
        assert np.arccos(ends @ gamma).min() < 0.02
        assert np.max(np.abs(ends[:, 2])) == pytest.approx(math.sin(0.4))
    assert np.arccos(ends[-1] @ ends[0]) == pytest.approx(0.8)


def test_a_wheel_at_its_speed_limit_is_told_apart_from_a_torque_limit():
    slow = Wheels(torque_limit=10.0, speed_limit=20.0)
    bodies = make_bodies(random_attitudes(n=1), AXES[:1], Physics('wheels', wheels=slow))
    bodies.step(1.0, [(0.0, 3.0, 0.0)])
    assert bodies.saturated == [('wheel speed',)]
    rate = bodies._velocities[0, 4]
    assert rate == pytest.approx(slow.inertia * 20.0 / slow.total_inertia[1], rel=1e-6)


def test_a_disturbance_fills_the_wheels_when_it_is_said_to():
    wheels = Wheels(disturbance=(0.0, 0.0, 0.01), torque_limit=5.0, speed_limit=300.0)
    bodies = make_bodies(random_attitudes(8, 1), AXES[:1], Physics('wheels', wheels=wheels))
    elapsed = 0.0
    while 'wheel speed' not in bodies.saturated[0]:
        bodies.step(0.05, [(0.0, 0.0, 0.0)])
        elapsed += 0.05
        assert elapsed < 60.0
    # Held still, the torque fills the wheels of the axes that it lies along: a single one first.
    least = wheels.lifetime(0.0)
    assert least <= elapsed <= math.sqrt(3.0) * least + 0.1


def test_a_spin_uses_up_no_momentum():
    loop, bodies = formation(Physics('wheels', rate=200.0), topologies.rotating(),
                             random_attitudes(9))
    loop.advance(0.02, 500)
    early = max(abs(v) for i in range(4) for v in bodies.joints(i).velocities)
    loop.advance(0.02, 1500)
    late = max(abs(v) for i in range(4) for v in bodies.joints(i).velocities)
    assert late < 1.5 * early
    assert Wheels().lifetime(0.5) == math.inf


def test_a_gimbal_at_its_joint_limit_says_so_and_the_rest_are_unharmed():
    bodies = make_bodies(pointing_up_to(0.5, 2), AXES, Physics(
        'gimbal', gimbal=Gimbal(tilt_limits=(-0.8, 0.8))))
    commands = [(0.0, 1.0, 0.0), (0.0, 0.0, 0.5), (0.0, 0.0, 0.5), (0.0, 0.0, 0.5)]
    bodies.step(3.0, commands)
    assert bodies.saturated[0] == ('tilt limit',)
    assert bodies.saturated[1:] == [(), (), ()]
    assert bodies.joints(0).positions[1] <= 0.8 + 1e-6
    assert all(bodies.joints(i).velocities[0] != 0.0 for i in (1, 2, 3))


def test_a_gimbal_that_cannot_reach_its_place_stays_and_the_others_find_theirs():
    physics = Physics('gimbal', gimbal=Gimbal(tilt_limits=(-0.4, 0.4)), rate=500.0)
    loop, bodies = formation(physics, topologies.complete(), pointing_up_to(0.35, 3))
    loop.advance(0.02, 1000)
    assert error(bodies) > 0.05  # no tetrahedron is within 0.4 rad of the horizon
    assert any('tilt limit' in what for what in bodies.saturated)
    assert all(abs(bodies.joints(i).positions[1]) < 0.4 + 1e-3 for i in range(4))
    before = np.array(bodies.reduced)
    loop.advance(0.02, 50)
    assert np.max(np.abs(np.array(bodies.reduced) - before)) < 1e-3  # at rest all the same


def test_limits_that_exclude_the_start_are_refused():
    up = rotation.between(np.array([1.0, 0.0, 0.0]), np.array([0.0, 0.0, 1.0]))
    physics = Physics('gimbal', gimbal=Gimbal(tilt_limits=(-0.4, 0.4)))
    with pytest.raises(BodyError, match=r'agent 1 starts along .* exclude') as caught:
        make_bodies([up], AXES[:1], physics)
    assert caught.value.key == 'gimbal.tilt_limits'
    level = [0.0, 0.0, 0.0, 1.0]
    assert physics.can_point([up, level], AXES[:2]).tolist() == [False, True]


def test_any_axis_of_the_body_may_point_and_the_base_may_be_mounted_anyhow():
    rng = np.random.default_rng(11)
    axes = rng.standard_normal((3, 3))
    axes /= np.linalg.norm(axes, axis=1, keepdims=True)
    attitudes, mounting = random_attitudes(12, 3), rotation.random(rng, (3,))
    bodies = make_bodies(attitudes, axes, Physics(
        'gimbal', rate=4000.0, loop=RateLoop(200.0), gimbal=Gimbal(
            tilt_limits=(-3.2, 3.2), mounting=tuple(map(tuple, mounting)))))
    assert np.allclose(bodies.reduced, rotation.rotate(attitudes, axes), atol=1e-12)
    before = np.array(bodies.reduced)
    command = np.cross(axes, rng.standard_normal((3, 3)))
    for _ in range(100):
        start = np.array(bodies.attitudes)
        bodies.step(1e-3, command)
    velocity = (np.array(bodies.reduced) - rotation.rotate(start, axes)) / 1e-3
    assert np.max(np.abs(np.array(bodies.reduced) - before)) > 0.05
    told = rotation.rotate(start, np.cross(command, axes))
    assert np.max(np.abs(velocity - told)) < 0.02


def test_the_body_of_a_gimbal_is_what_its_joints_make_it():
    bodies = make_bodies(pointing_up_to(1.0, 1), AXES, Physics('gimbal'))
    bodies.step(0.3, np.random.default_rng(0).standard_normal((4, 3)))
    for i in range(4):
        expected = gimbal.attitude(*bodies.joints(i).positions)
        assert np.allclose(bodies.attitudes[i], expected, atol=1e-12) or \
            np.allclose(bodies.attitudes[i], np.negative(expected), atol=1e-12)


def test_a_gyro_with_a_bias_makes_the_body_drift():
    physics = Physics('wheels', loop=RateLoop(bias=0.1), seed=3)
    bodies = make_bodies(random_attitudes(n=1), AXES[:1], physics)
    bodies.step(2.0, [(0.0, 0.0, 0.0)])
    assert np.allclose(bodies._velocities[0, 3:6], -bodies._bias[0], atol=1e-3)


# ------------------------------------------------------------------ files of one's own

THRUSTERS = """
<mujoco><worldbody><body name="body"><freejoint/>
  <geom type="box" size=".1 .1 .2" mass="3"/><site name="s"/></body></worldbody>
  <actuator>{motors}</actuator></mujoco>
"""
MOTORS = ''.join(f'<motor name="{a}" site="s" gear="0 0 0 {g}" ctrlrange="-1 1"/>'
                 for a, g in (('x', '1 0 0'), ('y', '0 1 0'), ('z', '0 0 1')))


def write(tmp_path, text):
    path = tmp_path / 'vehicle.xml'
    path.write_text(text)
    return str(path)


def test_a_file_with_thrusters_is_turned_by_them(tmp_path):
    path = write(tmp_path, THRUSTERS.format(motors=MOTORS))
    loop, bodies = formation(Physics(path, rate=500.0), topologies.complete(),
                             random_attitudes(4))
    loop.advance(0.02, 600)
    assert error(bodies) < 1e-3
    assert bodies.joints(0).names == ()


def test_what_ships_as_a_file_is_the_same_to_the_last_bit(tmp_path):
    path = write(tmp_path, models.wheels_xml(Wheels()))
    runs = []
    for body in ('wheels', path):
        loop, bodies = formation(Physics(body), topologies.complete(), random_attitudes(5))
        loop.advance(0.01, 20)
        runs.append(bodies.attitudes)
    assert runs[0] == runs[1]


def test_a_gimbal_of_a_file_brings_its_own_limits(tmp_path):
    path = write(tmp_path, models.gimbal_xml(Gimbal(tilt_limits=(-0.3, 0.3))))
    bodies = make_bodies(pointing_up_to(0.2, 4), AXES, Physics(path))
    bodies.step(3.0, [(0.0, -1.0, 0.0)] * 4)
    assert all(what == ('tilt limit',) for what in bodies.saturated)


@pytest.mark.parametrize(('text', 'problem'), [
    ('<mujoco><worldbody><body name="box"><freejoint/><geom size="1"/></body></worldbody>'
     '</mujoco>', "no body named 'body'"),
    ('<mujoco><worldbody><body name="body"><freejoint/><geom size="1"/></body></worldbody>'
     '</mujoco>', 'no actuators'),
    (THRUSTERS.format(motors='<motor site="s" gear="0 0 0 1 0 0"/>'), 'about every axis'),
    (THRUSTERS.format(motors=MOTORS.replace('motor', 'position')), 'not a motor'),
    (THRUSTERS.format(motors=MOTORS).replace('<geom ', '<geom pos=".1 0 0" '), 'centre of mass'),
    (THRUSTERS.format(motors=MOTORS).replace('<freejoint/>', ''), 'neither a free joint nor'),
    (models.gimbal_xml(Gimbal()).replace('axis="0 1 0"', 'axis="1 0 0"'), 'tilt about y'),
    (models.gimbal_xml(Gimbal()).replace('"tilt"', '"elevation"'), "'pan' and 'tilt'"),
    ('<mujoco>', 'is not an MJCF file'),
    ('wheels and a box', 'is not an MJCF file'),
])
def test_a_file_that_will_not_do_is_refused_in_one_line(tmp_path, text, problem):
    path = write(tmp_path, text)
    with pytest.raises(BodyError, match=problem) as caught:
        make_bodies(random_attitudes(), AXES, Physics(path))
    assert path in str(caught.value)
    assert '\n' not in str(caught.value)


def test_a_body_that_there_is_not_is_refused():
    with pytest.raises(BodyError, match="'wheel' is not valid, expected kinematic, wheels"):
        make_bodies(random_attitudes(), AXES, Physics('wheel'))


def test_wheels_without_inertia_and_impossible_boxes_are_refused():
    with pytest.raises(BodyError, match='none above the sum of the other two'):
        Wheels(body_inertia=(1.0, 1.0, 3.0))
    with pytest.raises(BodyError, match='lower and an upper'):
        Gimbal(tilt_limits=(1.0, -1.0))


def test_a_rate_loop_too_fast_for_the_physics_is_refused():
    with pytest.raises(BodyError, match=r'twice physics_rate'):
        Physics('wheels', loop=RateLoop(500.0), rate=200.0)
