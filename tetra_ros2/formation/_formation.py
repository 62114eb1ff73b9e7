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

"""The noun of this library: who sees whom, how strongly that repels, and what points."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import ArrayLike, NDArray
from tetra_ros2.formation import sphere
from tetra_ros2.formation.gain import Gain
from tetra_ros2.formation.topology import Topology

if TYPE_CHECKING:
    from tetra_ros2.formation._trajectory import Trajectory
    from tetra_ros2.formation.analysis import Analysis
    from tetra_ros2.formation.equilibria import Equilibrium
    from tetra_ros2.formation.shapes import Shape

# The methods import what they need when they are called: every agent has a Formation, and nothing
# in the process of an agent may know of attitudes or shapes.


@dataclass(frozen=True, eq=False)
class Formation:
    """
    A formation of n rigid bodies under the law ``w_i = -sum_j W(i,j) f(theta_ij) b_i x y_ij``.

    :param topology: who sees whom, and how much it counts
    :param gain: the gain function f
    :param pointing_axes: the axes b_i in the body frames, of any length, ``(3,)`` for all bodies
        or ``(n, 3)``; kept as unit vectors, ``(n, 3)``
    :raises ValueError: if there are not so many axes, or one is zero or not finite
    :raises TypeError: if topology or gain is something else
    """

    topology: Topology
    gain: Gain
    pointing_axes: NDArray[np.float64] = (1.0, 0.0, 0.0)  # type: ignore[assignment]

    def __post_init__(self) -> None:
        """Check the parts, and freeze the axes."""
        if not isinstance(self.topology, Topology):
            raise TypeError(f'topology must be a Topology, such as complete(), '
                            f'not {self.topology!r}')
        if not isinstance(self.gain, Gain):
            raise TypeError(f'gain must be a Gain, such as Cosine(), not {self.gain!r}')
        axes = np.array(self.pointing_axes, dtype=float)
        if axes.shape not in ((3,), (self.n, 3)):
            raise ValueError(
                f'pointing axes must have the shape (3,) or ({self.n}, 3), not {axes.shape}')
        axes = np.broadcast_to(sphere.normalize(axes), (self.n, 3)).copy()
        axes.setflags(write=False)
        object.__setattr__(self, 'pointing_axes', axes)

    @property
    def n(self) -> int:
        """Return the number of agents."""
        return self.topology.n

    @property
    def shape(self) -> Shape | None:
        """Return the shape that the topology is known to lead to, or None."""
        from tetra_ros2.formation.shapes import known_shape
        return known_shape(self.topology)

    def simulate(self, initial: ArrayLike | None = None, *, seed: int | None = None,
                 duration: float = 30.0, rate: float = 100.0, continuous: bool = False,
                 noise: float = 0.0, delay: float = 0.0, loss: float = 0.0) -> Trajectory:
        """
        Return how the formation moves.

        By default the loop is sampled, as the nodes run it in lockstep: commands are held
        constant for ``1 / rate``. The result is then that of the nodes to the last bit.

        :param initial: attitudes, unit quaternions x y z w, body to world, ``(n, 4)``; or reduced
            attitudes, unit vectors, ``(n, 3)``; random ones by default, uniform on SO(3)
        :param seed: of all that is random; None for something else each time
        :param duration: formation time [s]; rounded to whole samples
        :param rate: samples per second [Hz]
        :param continuous: solve the closed loop eq:RF:ClosedSystem in continuous time instead,
            to about 1e-9; ``rate`` then says only how often the solution is kept
        :param noise: standard deviation of a measured direction, per axis [rad]
        :param delay: how old the measurements are [s]; rounded up to whole steps
        :param loss: the probability that a measurement is lost, and the one before it used again
        :raises ValueError: if an argument is not valid; measurements of a continuous loop are
            exact
        """
        from tetra_ros2.formation._trajectory import simulate
        return simulate(self, initial, seed, duration, rate, continuous, noise, delay, loss)

    def equilibria(self, *, starts: int = 400, seed: int = 0) -> list[Equilibrium]:
        """
        Return the relative equilibria that Newton's method finds: at rest or spinning steadily.

        Those that a rotation, a mirror image, or a permutation of agents that leaves the weights
        as they are, takes into one another are one: the law makes no difference between them.
        Where equilibria form a continuum, some points of it are listed one by one.

        :param starts: from how many random formations to look
        :param seed: of these
        :returns: the one most often found first
        """
        from tetra_ros2.formation.equilibria import find_equilibria
        return find_equilibria(
            np.random.default_rng(seed), self.topology.weights, self.gain, starts)[0]

    def analyze(self, *, rate: float = 100.0, delay: float = 0.0, noise: float = 1e-3,
                start: float = 0.1, error: float = 1e-3,
                initial: ArrayLike | None = None, seed: int = 0) -> Analysis:
        """
        Return what theory says of the formation that attracts, at rest or spinning.

        :param rate: of the sampled loop [Hz]
        :param delay: how old the measurements are [s]; rounded up to whole steps
        :param noise: standard deviation of a measured direction, per axis [rad]
        :param start: error from which on to count the settling time [rad]
        :param error: error at which it has settled [rad]
        :param initial: where to start looking if no shape is known; see :meth:`simulate`
        :param seed: of random attitudes in its place
        :raises ValueError: if an argument is not valid, or there is no formation to analyse
        """
        from tetra_ros2.formation.analysis import analyze
        return analyze(self, rate=rate, delay=delay, noise=noise, start=start, error=error,
                       initial=initial, seed=seed)
