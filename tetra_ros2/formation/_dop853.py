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

"""
The integrator of order 8 by Dormand and Prince with its error estimates, DOP853, on arrays.

Hairer, Norsett, Wanner, Solving Ordinary Differential Equations I, II.5, II.6 and II.10.
"""

from collections.abc import Callable, Iterator
from dataclasses import dataclass

import numpy as np
from tetra_ros2.formation._types import Array

Rate = Callable[[Array], Array]

# For each stage the earlier stages and their factors; then the same for the step and for its two
# estimates of the error.
STAGES = (
    (),
    ((0, 0.05260015195876773),),
    ((0, 0.0197250569845379), (1, 0.0591751709536137)),
    ((0, 0.02958758547680685), (2, 0.08876275643042054)),
    ((0, 0.2413651341592667), (2, -0.8845494793282861), (3, 0.924834003261792)),
    ((0, 0.037037037037037035), (3, 0.17082860872947386), (4, 0.12546768756682242)),
    ((0, 0.037109375), (3, 0.17025221101954405), (4, 0.06021653898045596), (5, -0.017578125)),
    ((0, 0.03709200011850479), (3, 0.17038392571223998), (4, 0.10726203044637328), (5,
     -0.015319437748624402), (6, 0.008273789163814023)),
    ((0, 0.6241109587160757), (3, -3.3608926294469414), (4, -0.868219346841726), (5,
     27.59209969944671), (6, 20.154067550477894), (7, -43.48988418106996)),
    ((0, 0.47766253643826434), (3, -2.4881146199716677), (4, -0.590290826836843), (5,
     21.230051448181193), (6, 15.279233632882423), (7, -33.28821096898486), (8,
     -0.020331201708508627)),
    ((0, -0.9371424300859873), (3, 5.186372428844064), (4, 1.0914373489967295), (5,
     -8.149787010746927), (6, -18.52006565999696), (7, 22.739487099350505), (8,
     2.4936055526796523), (9, -3.0467644718982196)),
    ((0, 2.273310147516538), (3, -10.53449546673725), (4, -2.0008720582248625), (5,
     -17.9589318631188), (6, 27.94888452941996), (7, -2.8589982771350235), (8,
     -8.87285693353063), (9, 12.360567175794303), (10, 0.6433927460157636)),
)
SOLUTION = (
    (0, 0.054293734116568765), (5, 4.450312892752409), (6, 1.8915178993145003),
    (7, -5.801203960010585), (8, 0.3111643669578199), (9, -0.1521609496625161),
    (10, 0.20136540080403034), (11, 0.04471061572777259))
FIFTH_ERROR = (
    (0, 0.01312004499419488), (5, -1.2251564463762044), (6, -0.4957589496572502),
    (7, 1.6643771824549864), (8, -0.35032884874997366), (9, 0.3341791187130175),
    (10, 0.08192320648511571), (11, -0.022355307863886294))
THIRD_ERROR = (
    (0, -0.18980075407240762), (5, 4.450312892752409), (6, 1.8915178993145003),
    (7, -5.801203960010585), (8, -0.4226823213237919), (9, -0.1521609496625161),
    (10, 0.20136540080403034), (11, 0.02265179219836082))

# Three more stages, which may use the slope at the end of the step as the one of number 12.
DENSE_STAGES = (
    ((0, 0.056167502283047954), (6, 0.25350021021662483), (7, -0.2462390374708025),
     (8, -0.12419142326381637), (9, 0.15329179827876568), (10, 0.00820105229563469),
     (11, 0.007567897660545699), (12, -0.008298)),
    ((0, 0.03183464816350214), (5, 0.028300909672366776), (6, 0.053541988307438566),
     (7, -0.05492374857139099), (10, -0.00010834732869724932), (11, 0.0003825710908356584),
     (12, -0.00034046500868740456), (13, 0.1413124436746325)),
    ((0, -0.42889630158379194), (5, -4.697621415361164), (6, 7.683421196062599),
     (7, 4.06898981839711), (8, 0.3567271874552811), (12, -0.0013990241651590145),
     (13, 2.9475147891527724), (14, -9.15095847217987)),
)
# The four highest coefficients of the polynomial of degree 7 that the step is inside.
DENSE = (
    ((0, -8.428938276109013), (5, 0.5667149535193777), (6, -3.0689499459498917),
     (7, 2.38466765651207), (8, 2.117034582445028), (9, -0.871391583777973),
     (10, 2.2404374302607883), (11, 0.6315787787694688), (12, -0.08899033645133331),
     (13, 18.148505520854727), (14, -9.194632392478356), (15, -4.436036387594894)),
    ((0, 10.427508642579134), (5, 242.28349177525817), (6, 165.20045171727028),
     (7, -374.5467547226902), (8, -22.113666853125306), (9, 7.733432668472264),
     (10, -30.674084731089398), (11, -9.332130526430229), (12, 15.697238121770845),
     (13, -31.139403219565178), (14, -9.35292435884448), (15, 35.81684148639408)),
    ((0, 19.985053242002433), (5, -387.0373087493518), (6, -189.17813819516758),
     (7, 527.8081592054236), (8, -11.57390253995963), (9, 6.8812326946963),
     (10, -1.0006050966910838), (11, 0.7777137798053443), (12, -2.778205752353508),
     (13, -60.19669523126412), (14, 84.32040550667716), (15, 11.99229113618279)),
    ((0, -25.69393346270375), (5, -154.18974869023643), (6, -231.5293791760455),
     (7, 357.6391179106141), (8, 93.40532418362432), (9, -37.45832313645163),
     (10, 104.0996495089623), (11, 29.8402934266605), (12, -43.53345659001114),
     (13, 96.32455395918828), (14, -39.17726167561544), (15, -149.72683625798564)),
)


@dataclass(frozen=True, eq=False)
class Step:
    """
    An accepted step.

    :param begin: time at which it begins
    :param end: time at which it ends
    :param before: the solution at its beginning
    :param after: the solution at its end
    """

    begin: float
    end: float
    before: Array
    after: Array
    _rate: Rate
    _slopes: list[Array]

    def at(self, times: Array) -> Array:
        """Return the solution at times within the step, with them as the first axis."""
        h, slopes = self.end - self.begin, list(self._slopes)
        for stage in DENSE_STAGES:
            slopes.append(self._rate(_combine(self.before, slopes, stage, h)))
        change = self.after - self.before
        parts = [change, h * slopes[0] - change, 2.0 * change - h * (slopes[12] + slopes[0]),
                 *(_combine(0.0, slopes, row, h) for row in DENSE)]
        x = ((times - self.begin) / h).reshape(-1, *[1] * self.before.ndim)
        value = np.zeros((len(times), *self.before.shape))
        for power, part in enumerate(reversed(parts)):
            value = (value + part) * (1.0 - x if power % 2 else x)
        result: Array = self.before + value
        return result


def _combine(start: Array | float, slopes: list[Array], row: tuple[tuple[int, float], ...],
             h: float) -> Array:
    return start + h * sum((factor * slopes[source] for source, factor in row), np.zeros(()))


def steps(rate: Rate, start: Array, tolerance: float, restore: Rate, first: float,
          end: float = np.inf) -> Iterator[Step]:
    """
    Solve ``dx/dt = rate(x)`` from the time 0 on, step by step.

    :param rate: the right-hand side, which does not depend on time
    :param start: the solution at the time 0
    :param tolerance: on the estimated error of a step, the mean over the components
    :param restore: brings the end of a step back to where rounding and truncation led away from
    :param first: length of the first step to try
    :param end: the time at which to stop
    :raises FloatingPointError: if the solution is not finite
    """
    time, x, h = 0.0, start, first
    slope = rate(x)
    while time < end:
        h = min(h, end - time)
        slopes = [slope]
        for stage in STAGES[1:]:
            slopes.append(rate(_combine(x, slopes, stage, h)))
        fifth = float(np.sum(_combine(0.0, slopes, FIFTH_ERROR, 1.0) ** 2))
        third = float(np.sum(_combine(0.0, slopes, THIRD_ERROR, 1.0) ** 2))
        error = 0.0 if fifth == 0.0 else \
            h * fifth / np.sqrt((fifth + 0.01 * third) * x.size) / tolerance
        if not np.isfinite(error):
            raise FloatingPointError('the solution is not finite')
        if error <= 1.0:
            after = restore(_combine(x, slopes, SOLUTION, h))
            slope = rate(after)
            until = end if h == end - time else time + h
            yield Step(time, until, x, after, rate, [*slopes, slope])
            time, x = until, after
        h *= min(max(0.9 * max(error, 1e-12) ** -0.125, 0.2), 6.0)


def solve(rate: Rate, start: Array, times: Array, tolerance: float, restore: Rate,
          first: float) -> Array:
    """
    Return the solution at times, which ascend from 0, with them as the first axis.

    The other parameters are those of :func:`steps`.
    """
    result = np.empty((len(times), *start.shape))
    result[0] = start
    for step in steps(rate, start, tolerance, restore, first, float(times[-1])):
        low, high = np.searchsorted(times, (step.begin, step.end), side='right')
        if high > low:
            result[low:high] = restore(step.at(times[low:high]))
    return result
