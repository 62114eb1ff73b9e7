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

"""The random starts of a study: all different, as many as were asked for."""

import numpy as np
import pytest
from tetra_ros2.study.montecarlo import Plan


def plan(starts, chunk, seed=0):
    return Plan((), starts, seed, 1e-2, 1.0, 60.0, chunk)


def everything(plan):
    return [plan.attitudes(chunk, 4) for chunk in range(plan.chunks)]


def test_no_two_starts_of_a_study_are_the_same():
    attitudes = np.concatenate(everything(plan(90, 20)))
    assert len(np.unique(attitudes.reshape(-1, 16), axis=0)) == 90


@pytest.mark.parametrize(('starts', 'chunk', 'sizes'), [
    (90, 20, [20, 20, 20, 20, 10]), (40, 20, [20, 20]), (7, 20, [7]), (21, 20, [20, 1])])
def test_the_chunks_hold_as_many_starts_as_were_asked_for(starts, chunk, sizes):
    assert [len(part) for part in everything(plan(starts, chunk))] == sizes


def test_a_seed_gives_the_same_starts_again_and_another_one_others():
    here, again, other = (np.concatenate(everything(plan(30, 20, seed))) for seed in (3, 3, 4))
    np.testing.assert_array_equal(here, again)
    assert not np.any(np.all(here == other, axis=(1, 2)))
