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

"""What an analysis says of the graph."""

import pytest
from tetra_ros2.formation import complete, custom, Exponential, Formation

FOLLOWERS = [(i, j) for i, j, _ in complete(4).edges if i != 1]
"""Agent 1 sees nobody and everybody sees it: connected, but not strongly."""


@pytest.mark.parametrize(('edges', 'strongly'), [
    (FOLLOWERS, False), ([*FOLLOWERS, (1, 2)], True)])
def test_a_graph_is_strongly_connected_if_everybody_is_seen_by_everybody(edges, strongly):
    found = Formation(custom(4, edges), Exponential()).analyze()
    assert found.strongly_connected is strongly
    assert found.edges == len(edges)
