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

import os
import subprocess
import sys
import time

from benchmarks import power_cuts
import pytest


def test_nothing_older_than_a_second_is_lost_whatever_is_killed():
    outcomes = power_cuts.run(
        1, seed=3, jobs=2, victims={'launcher': power_cuts.VICTIMS['launcher']})
    assert len(outcomes) == 6
    for (_, victim, storage), (outcome,) in outcomes.items():
        assert outcome.problem is None, (victim, storage, outcome)
        # Whoever ends with the recorder has time to complete the bag; a killed writer has not.
        assert outcome.torn == (victim != 'launcher'), (victim, storage)


@pytest.mark.skipif(not hasattr(os, 'SCHED_IDLE'), reason='only Linux tells')
def test_who_is_ready_and_gets_no_processor_waits_and_who_sleeps_does_not():
    processor = {min(os.sched_getaffinity(0))}
    busy = [subprocess.Popen([sys.executable, '-c', 'while True: pass']) for _ in range(2)]
    asleep = subprocess.Popen([sys.executable, '-c', 'print(flush=True); input()'],
                              stdin=subprocess.PIPE, stdout=subprocess.PIPE)
    try:
        for process in busy:
            os.sched_setaffinity(process.pid, processor)
        os.sched_setscheduler(busy[1].pid, os.SCHED_IDLE, os.sched_param(0))
        asleep.stdout.readline()
        while power_cuts._running(asleep.pid)[0]:
            pass
        begun = time.monotonic()
        with power_cuts.Waiting([busy[1].pid, asleep.pid]) as waiting, \
                pytest.raises(subprocess.TimeoutExpired):
            busy[0].wait(2.0)
        assert 0.3 < waiting.seconds[busy[1].pid] <= time.monotonic() - begun
        assert waiting.seconds[asleep.pid] == 0.0
    finally:
        for process in (*busy, asleep):
            process.kill()
            process.wait()
        asleep.stdin.close()
        asleep.stdout.close()
