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

"""How punctual and how fresh the steps of a plant in real time were."""

import numpy as np

ON_TIME = 0.25e-3
"""How late a step may be that counts as in time [s]."""


def judge(notes, n, rate):
    """
    Say how punctual and how fresh a run in real time was.

    :param notes: for each step its time, the oldest stamp among the commands that it applied
        [ns], and how many of these answer the step before, ``(m, 3)``
    """
    stamps, oldest, fresh = notes.T
    period = 1e9 / rate
    since = stamps - stamps[0]
    # The schedule is where most steps are, at the early edge of them: a timer is never early.
    # First about the mean on the circle, as a step may be late by more than half a period.
    middle = np.angle(np.mean(np.exp(2j * np.pi * since / period))) / (2.0 * np.pi) * period
    offsets = since - middle
    since = since - middle - np.quantile(offsets - np.round(offsets / period) * period, 0.05)
    tolerance = min(50e3, 0.2 * period)
    slots = np.floor((since + tolerance) / period)
    late = since - slots * period
    skipped = np.diff(slots, prepend=slots[0] - 1) > 1
    # Behind a gap it cannot be told which slot a step was for: that one counts as late.
    on_time = (late <= ON_TIME * 1e9) & ~skipped
    scheduled = slots[-1] - slots[0] + 1
    ages = np.arange(len(stamps)) - np.searchsorted(stamps, oldest)
    return {'steps': len(stamps), 'steps/s': 1e9 * (len(stamps) - 1) / (stamps[-1] - stamps[0]),
            'on time': len(np.unique(slots[on_time])) / scheduled,
            'fresh': float(fresh[1:].sum() / (n * (len(stamps) - 1))),
            'oldest [steps]': int(ages[1:].max()),
            'jitter p50 [ms]': float(np.quantile(late, 0.5) / 1e6),
            'jitter p99 [ms]': float(np.quantile(late, 0.99) / 1e6)}
