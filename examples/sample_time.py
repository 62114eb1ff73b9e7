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
Sweep the sample time, and show how fast the loop must run and what a slow loop costs.

Run it with ``python examples/sample_time.py``. It needs numpy and nothing else.
"""

import numpy as np
from tetra_ros2.formation import Cosine, Formation, rotating

formation = Formation(rotating(), Cosine())


def sweep(sample_times):
    """
    Yield what theory says and what a simulation shows at each sample time.

    :param sample_times: [s]
    :returns: for each that time, the analysis, and the spin of the simulation [rad/s]
    """
    for h in sample_times:
        analysis = formation.analyze(rate=1.0 / h)
        run = formation.simulate(seed=3, rate=1.0 / h, duration=400.0 * h + 40.0)
        yield h, analysis, float(np.linalg.norm(run.spin()))


def main():
    """Print a table, on both sides of the limit."""
    continuous = formation.analyze()
    limit = continuous.max_sample_time
    print(f'stable below a sample time of {limit:.4f} s; '
          f'without sampling it spins at {continuous.spin_rate:.5f} rad/s')
    print('  h [s]   decays at [1/s]   off the shape [rad]   spin, predicted and simulated')
    for h, analysis, spin in sweep([0.01, 0.3, 0.9 * limit, 1.05 * limit]):
        rest = f'{analysis.offset:18.5f}        {analysis.sampled_spin_rate:8.5f}  ' \
            f'{spin:8.5f} rad/s' if analysis.is_stable else '        not stable'
        print(f'{h:7.4f} {analysis.sampled_rate:16.4f} {rest}')


if __name__ == '__main__':
    main()
