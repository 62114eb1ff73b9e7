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

"""Section 6: the simulations, as runs of the real nodes and from random starts."""

import math

import numpy as np
from tetra_ros2.formation import measures, shapes
from tetra_ros2.paper.claims._common import starts_that_form
from tetra_ros2.paper.registry import claim, equal, Result, vanishes
from tetra_ros2.paper.system import SystemUnderTest

claim('almost-global-f2', 'Section 6', 'f2, for which it is not proven, forms as well',
      'uniform random starts that formed, of how many', graph='complete', which=1,
      starts=600)(starts_that_form)


def _figure(system: SystemUnderTest, graph: str) -> Result:
    worst = max(float(measures.shape_error(system.run(graph, gain).gamma[-1],
                                           shapes.TETRAHEDRON.angles)) for gain in system.gains)
    return vanishes(worst, 1e-3, 'rad; what sampling leaves of it under the rotating graph')


claim('figure-stationary', 'Fig:Sim:SF', 'both gains lead to the regular tetrahedron',
      'largest angle error at the end of runs of the nodes, complete graph', nodes=True,
      graph='complete')(_figure)


claim('figure-rotating', 'Fig:Sim:RF', 'both gains lead to the regular tetrahedron',
      'largest angle error at the end of runs of the nodes, rotating graph', nodes=True,
      graph='rotating')(_figure)


@claim('period', 'Section 6', 'one turn takes 2 sqrt(3) pi, with f1',
       'from the spin at the end of a run of the nodes', nodes=True)
def _period(system: SystemUnderTest) -> Result:
    spin = np.linalg.norm(system.run('rotating', system.gains[0]).angular_velocity())
    predicted = 2.0 * math.sqrt(3.0) * math.pi
    return equal(predicted, 2.0 * math.pi / spin, 1e-3 * predicted, 's; not so with f2')


claim('rotating-forms', 'Section 6', 'the rotating formation comes from random starts',
      'uniform random starts that formed, of how many; f1', graph='rotating', which=0,
      starts=1000)(starts_that_form)
