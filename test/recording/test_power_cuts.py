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

"""A few of the kills of `make power-cuts`: one of each kind on a launcher that records."""

from benchmarks import power_cuts


def test_nothing_older_than_a_second_is_lost_whatever_is_killed():
    outcomes = power_cuts.run(
        1, seed=3, jobs=2, victims={'launcher': power_cuts.VICTIMS['launcher']})
    assert len(outcomes) == 6
    for (_, victim, storage), (outcome,) in outcomes.items():
        assert outcome.problem is None, (victim, storage, outcome)
        # Whoever ends with the recorder has time to complete the bag; a killed writer has not.
        assert outcome.torn == (victim != 'launcher'), (victim, storage)
