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

"""The closed loops that the claims of the paper are tested on."""

from dataclasses import dataclass, field
from functools import cached_property

import numpy as np
from tetra_ros2.formation import equilibria
from tetra_ros2.formation import topology as topologies
from tetra_ros2.formation.gain import Cosine, Exponential, Gain, Gaussian, Linear, Rational
from tetra_ros2.paper import runs


@dataclass(frozen=True)
class SystemUnderTest:
    """
    What the claims are tested on: two graphs, two gains, and a source of random numbers.

    :param complete: the topology of Graph As:SF:completegraph
    :param rotating: that of Graph As:RF:weighedgraph with k = 1, p = 1
    :param gains: the paper's two, f1 and f2; the first is that of As:SFG:f
    :param seed: of all that is random
    :param effort: how much more than usual to do
    """

    complete: topologies.Topology = field(default_factory=topologies.complete)
    rotating: topologies.Topology = field(default_factory=topologies.rotating)
    gains: tuple[Gain, Gain] = (Cosine(), Exponential())
    seed: int = 0
    effort: float = 1.0

    @property
    def rng(self) -> np.random.Generator:
        """Return a generator that is the same for every check."""
        return np.random.default_rng(self.seed)

    def times(self, count: int) -> int:
        """Return how many random points or starts to take, where usually one takes ``count``."""
        return max(1, round(count * self.effort))

    @cached_property
    def families(self) -> tuple[Gain, ...]:
        """Return the gains under test and some of the other families that satisfy As:SF:f."""
        return (*self.gains, Gaussian(1.5, 0.8), Linear(2.0, 0.9),
                Rational(0.7, 1.3))

    @cached_property
    def _runs(self) -> dict[tuple[str, Gain, int], runs.NodeRun]:
        return {}

    def run(self, graph: str, gain: Gain, seed: int = 0) -> runs.NodeRun:
        """Return a run of the real nodes, long enough to form and to come very close."""
        key = graph, gain, seed
        if key not in self._runs:
            quick = isinstance(gain, Cosine)
            self._runs[key] = runs.run_nodes(
                getattr(self, graph), gain, 14.0 if quick else 75.0,
                rate=400.0 if quick else 100.0, seed=self.seed + seed)
        return self._runs[key]

    @cached_property
    def equilibria(self) -> tuple[list[equilibria.Equilibrium], int]:
        """Return what Newton's method finds, complete graph and first gain; and the lost."""
        return equilibria.find_equilibria(
            self.rng, self.complete.weights, self.gains[0], self.times(300))
