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
Simulate a weighted digraph of your own under a gain of your own.

Run it with ``python examples/simulate.py``. It needs numpy and nothing else.
"""

import numpy as np
from tetra_ros2.formation import custom, Formation, Gain


class Quartic(Gain):
    """The gain a / (1 + b theta^4): near neighbours count nearly alike, far ones hardly."""

    def f(self, theta, xp=np):
        """Return f at theta [rad/s]; xp is numpy for arrays and math for plain floats."""
        return self.a / (1.0 + self.b * theta**4)


# Agents 1 to 5 stand in a ring. Each sees the next one, and half as strongly the one before.
ring = custom(5, [(i, i % 5 + 1, 1.0) for i in range(1, 6)]
              + [(i % 5 + 1, i, 0.5) for i in range(1, 6)])
formation = Formation(ring, Quartic(a=2.0, b=0.2), pointing_axes=[0.0, 0.0, 1.0])


def main():
    """Simulate it, and compare what comes out with what theory says."""
    # As the nodes run it: commands are held for 1/50 s. The same seed gives the same run.
    sampled = formation.simulate(seed=1, duration=60.0, rate=50.0)
    # The closed loop itself, in continuous time, from the same start.
    exact = formation.simulate(sampled.attitudes[0], duration=60.0, rate=50.0, continuous=True)
    # What theory says of the formation that attracts.
    predicted = formation.analyze(rate=50.0, initial=sampled.attitudes[-1])

    print('angles in the end  [deg]', np.degrees(np.sort(exact.angles[-1])).round(3))
    print('angles, predicted  [deg]', np.degrees(predicted.angles).round(3))
    for name, rate in (('spin, continuous', np.linalg.norm(exact.spin())),
                       ('spin, predicted', predicted.spin_rate),
                       ('spin, sampled', np.linalg.norm(sampled.spin())),
                       ('spin, predicted', predicted.sampled_spin_rate)):
        print(f'{name:<16} {rate:.6f} rad/s')
    print(f'slowest mode     {predicted.slowest_rate:.3f} 1/s')


if __name__ == '__main__':
    main()
