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

"""Checks that the claims of several sections share."""

import numpy as np
from tetra_ros2.formation import batch, shapes, sphere, stability
from tetra_ros2.paper.registry import equal, Result
from tetra_ros2.paper.runs import slowest_rate
from tetra_ros2.paper.system import SystemUnderTest
from tetra_ros2.study.confidence import lower_bound


def rate_of_run(system: SystemUnderTest, graph: str, which: int) -> Result:
    """Compare the slowest rate in a run of the nodes with the slowest eigenvalue."""
    gain = system.gains[which]
    predicted = {'complete': stability.complete_spectrum(gain)[:5],
                 'rotating': stability.rotating_spectrum(gain)}[graph]
    slowest = -float(np.max(predicted.real))
    measured = slowest_rate(system.run(graph, gain), getattr(system, graph), gain)
    return equal(slowest, measured, 0.01 * slowest, '1/s; tolerance 1 %')


def starts_that_form(system: SystemUnderTest, graph: str, which: int, starts: int) -> Result:
    """Count the uniform random starts that come to the tetrahedron; all of them must."""
    topology, gain = getattr(system, graph), system.gains[which]
    gamma = sphere.random(system.rng, (system.times(starts), 4))
    # Compiling takes longer than the few starts of the quick check do without.
    follow = batch.run if system.effort <= 1.0 else batch.fastest(gain, 4)
    h = 0.05
    formed, _ = follow(gamma, topology.weights, gain, shapes.TETRAHEDRON.angles, 0.02, h,
                       round((60.0 if which == 0 else 150.0) / h), 20)
    count = int(np.sum(formed != batch.NEVER))
    bound = lower_bound(count, len(gamma))
    return Result(len(gamma), count, 0, count == len(gamma),
                  f'so the chance to form is above {bound:.4%} with 95 % confidence')
