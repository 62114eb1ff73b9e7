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

"""Which formations are the same to the law: turned, reflected, with like agents exchanged."""

import itertools

from hypothesis import given, settings
from hypothesis import strategies as st
import numpy as np
import pytest
from strategies import any_gain, any_weights, assert_close, formations, quaternions
from tetra_ros2.formation import law, rotation, shapes, sphere, topology
from tetra_ros2.formation.equivalence import automorphism, equivalent


@given(formations(4), any_weights(4), any_gain())
def test_the_law_commutes_with_reflections(gamma, weights, gain):
    mirror = np.array([1.0, -1.0, 1.0])
    assert_close(law.velocity(gamma * mirror, weights, gain),
                 law.velocity(gamma, weights, gain) * mirror, atol=1e-12)


def automorphisms(weights):
    n = len(weights)
    return [p for p in itertools.permutations(range(n))
            if np.array_equal(weights[np.ix_(p, p)], weights)]


small_weights = st.lists(st.sampled_from([0.0, 0.0, 1.0, 2.0]), min_size=16, max_size=16).map(
    lambda values: np.array(values).reshape(4, 4) * (1.0 - np.eye(4)))


@settings(max_examples=60)
@given(small_weights, st.permutations(range(4)), quaternions(), st.integers(0, 2**16))
def test_it_finds_a_permutation_exactly_where_there_is_one(weights, permutation, turn, seed):
    gamma = sphere.random(np.random.default_rng(seed), 4)
    moved = rotation.rotate(turn, gamma[permutation]) * [-1.0, -1.0, -1.0]
    found = automorphism(gamma, moved, weights, 1e-9)
    back = tuple(np.argsort(permutation).tolist())
    # Four points in general position: no other permutation has the same cosines.
    assert found == (back if back in automorphisms(weights) else None)


def test_agents_at_the_same_place_are_told_apart_by_their_weights():
    gamma = np.array([[0.0, 0.0, 1.0]] * 3 + [[0.0, 0.0, -1.0]])
    rotating = topology.rotating(1, 1).weights
    for alone in itertools.permutations(range(4), 2):
        one, another = (np.where(np.arange(4) == i, -1.0, 1.0)[:, None] * gamma[0] for i in alone)
        assert equivalent(one, another, rotating) == (0 not in alone)


def test_both_chiralities_of_the_spinning_tetrahedron_are_one():
    points = shapes.TETRAHEDRON.points
    assert equivalent(points, -points, topology.rotating().weights)


@pytest.mark.parametrize('n', [20, 60])
def test_many_agents_take_no_more_than_a_moment(n):
    rng = np.random.default_rng(0)
    p = rng.permutation(n)
    ring = topology.custom(n, [(i, i % n + 1) for i in range(1, n + 1)]).weights
    everybody = topology.complete(n).weights
    gamma = sphere.random(rng, n)
    same = np.tile([0.0, 0.0, 1.0], (n, 1))
    assert equivalent(gamma, gamma[p], everybody)
    assert equivalent(same, same, everybody)
    assert equivalent(same, same, ring)
    turned = np.roll(np.arange(n), 7)
    assert equivalent(gamma, gamma[turned], ring)
    assert not equivalent(gamma, gamma[p], ring)
    two = np.where(np.arange(n) % 2 == 0, 1.0, -1.0)[:, None] * [0.0, 0.0, 1.0]
    halves = np.where(np.arange(n) < n // 2, 1.0, -1.0)[:, None] * [0.0, 0.0, 1.0]
    assert equivalent(two, halves, everybody)
    assert not equivalent(two, halves, ring)
