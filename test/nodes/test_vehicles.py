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

"""Bodies of which some are elsewhere, and what is told of them."""

from types import SimpleNamespace

from node_bench import Bench
import numpy as np
import pytest
from tetra_ros2.config.parameters import ConfigurationError
from tetra_ros2.formation import rotation
from tetra_ros2.formation.bodies import RigidBodies
from tetra_ros2.nodes import poses
from tetra_ros2.nodes.plant import Plant
from tetra_ros2.nodes.vehicles import PartlyElsewhere

AXES = np.tile([1.0, 0.0, 0.0], (4, 1))
TURN = (0.1, -0.2, 0.3)


class Poses:
    """Bodies 2 and 4 are elsewhere, as long as it is known where."""

    def __init__(self, attitudes):
        self.trackers = {1: None, 3: None}
        self.known = {i: attitudes[i] for i in self.trackers}
        self.heard = []

    def attitudes(self):
        return self.known

    def told(self, rates, h):
        self.heard.append((list(rates), h))


def test_who_is_simulated_moves_and_who_is_elsewhere_is_where_its_pose_says():
    first, other = (rotation.random(np.random.default_rng(seed), (4,)) for seed in (1, 2))
    alone = RigidBodies(first, AXES)
    poses = Poses([tuple(q) for q in other.tolist()])
    bodies = PartlyElsewhere(RigidBodies(first, AXES), poses)
    assert bodies.lost == frozenset()
    for _ in range(3):
        bodies.step(0.1, [TURN] * 4)
        alone.step(0.1, [TURN] * 4)
    assert poses.heard == [([TURN] * 4, 0.1)] * 3, 'it is told to move all the same'
    for i in range(4):
        expected = alone.attitudes[i] if i in (0, 2) else poses.known[i]
        assert bodies.attitudes[i] == pytest.approx(expected, abs=1e-15)
        assert bodies.reduced[i] == pytest.approx(
            rotation.rotate(np.array(expected), AXES[i]), abs=1e-12)
    before = bodies.attitudes[3]
    poses.known = {1: tuple(first[1].tolist())}
    bodies.look()
    assert bodies.lost == frozenset({3})
    assert bodies.attitudes[1] == pytest.approx(first[1])
    assert bodies.attitudes[3] == before, 'it stays where it was last seen'


def test_only_who_is_named_is_elsewhere(probe, monkeypatch):
    monkeypatch.setattr(poses, 'LOOKS', 1)  # nobody publishes any
    with Bench(probe, Plant, mode='realtime', external_bodies=[2, 4]) as bench:
        assert sorted(bench.node._vehicles.poses.trackers) == [1, 3]
        assert isinstance(bench.node.bodies, PartlyElsewhere)
        assert bench.node.bodies.lost == frozenset({1, 3}), 'nothing was heard of them yet'
    with Bench(probe, Plant, mode='realtime') as bench:
        assert bench.node._vehicles.poses is None
        assert isinstance(bench.node.bodies, RigidBodies)


def test_a_physics_that_diverged_and_poses_that_are_lost_are_told(probe, monkeypatch):
    pytest.importorskip('mujoco')
    with Bench(probe, Plant, body='wheels') as bench:
        vehicles = bench.node._vehicles
        assert vehicles.assess()[0] == ''
        monkeypatch.setattr(vehicles, 'poses', SimpleNamespace(
            assess=lambda: ('agent_4: lost', {'poses of agent_4': 7})))
        monkeypatch.setattr(vehicles._bodies, 'diverged_steps', 3)
        monkeypatch.setattr(vehicles._bodies, 'saturated', [(), ('torque', 'speed'), (), ()])
        monkeypatch.setattr(vehicles._bodies, 'saturated_steps', [0, 5, 2, 0])
        text, values = vehicles.assess()
        assert text.startswith('at a limit: agent_2: torque, speed; agent_3: saturated for a whil')
        assert 'the physics has diverged' in text
        assert text.endswith('; poses: agent_4: lost')
        assert values['diverged steps'] == 3
        assert values['saturated steps of agent_2'] == 5
        assert values['poses of agent_4'] == 7
        monkeypatch.setattr(vehicles._bodies, 'saturated', [()] * 4)
        assert 'at a limit' not in vehicles.assess()[0], 'it was told of'


def test_limits_that_leave_no_random_start_are_refused(probe, monkeypatch):
    pytest.importorskip('mujoco')
    with Bench(probe, Plant, body='gimbal') as bench:
        vehicles, asked = bench.node._vehicles, []
        physics = SimpleNamespace(can_point=lambda attitudes, axes: asked.append(1) or np.array(
            [True, True, True, False]))
        monkeypatch.setattr(vehicles, 'physics', physics)
        with pytest.raises(ConfigurationError, match='no random start is within the limits'):
            vehicles.draw(np.random.default_rng(0))
        assert len(asked) > 10
