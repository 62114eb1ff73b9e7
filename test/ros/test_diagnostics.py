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

from node_bench import Bench
from tetra_ros2.nodes.monitor import Monitor
from tetra_ros2.ros import diagnostics


def test_each_report_tells_of_what_was_dropped_since_the_last_one(probe):
    with Bench(probe, Monitor) as bench:
        health = bench.node.health
        for count in (1, 2, 5):
            for _ in range(count):
                health.reject('malformed', 'somebody')
            health.report()
            assert f'dropped: {count} malformed (somebody)' in health.message
            health.report()
            assert 'dropped' not in health.message
        assert health.rejected == {'malformed (somebody)': 8}


def test_a_rate_is_of_the_time_since_the_last_report(probe, monkeypatch):
    now = 100.0
    monkeypatch.setattr(diagnostics.time, 'monotonic', lambda: now)
    with Bench(probe, Monitor) as bench:
        health = bench.node.health
        now += 1.0
        health.rates({'steps': 50})
        now += 2.0
        assert health.rates({'steps': 70}) == {'steps': 10.0}
