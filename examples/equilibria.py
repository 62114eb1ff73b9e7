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
Find the relative equilibria of a formation, and say which of them attract.

Run it with ``python examples/equilibria.py``. It needs numpy and nothing else.
"""

import numpy as np
from tetra_ros2.formation import complete, Cosine, Formation, rotating


def show(name, formation):
    """Print one line for each relative equilibrium."""
    print(name)
    for equilibrium in formation.equilibria(starts=400, seed=0):
        growing, neutral, decaying = equilibrium.inertia
        print(f'  {equilibrium.kind:<20} {equilibrium.stability:<9} '
              f'spins at {equilibrium.spin_rate:.4f} rad/s; {growing} modes grow, '
              f'{neutral} stay, {decaying} decay; from {equilibrium.found} starts')


def main():
    """Compare the paper's two graphs."""
    show('complete graph', Formation(complete(), Cosine()))
    spinning = Formation(rotating(), Cosine())
    show('rotating graph', spinning)

    # The spinning tetrahedron is the only one that attracts. The paper gives its spin.
    tetrahedron, = [e for e in spinning.equilibria() if e.stability == 'stable']
    theta = np.arccos(-1.0 / 3.0)
    print(f'spin of the {tetrahedron.kind} {tetrahedron.spin_rate:.12f} rad/s')
    print(f'sqrt(3)/2 f(theta*)      {np.sqrt(3.0) / 2.0 * spinning.gain.f(theta):.12f} rad/s')
    print('its eigenvalues [1/s]', np.round(tetrahedron.eigenvalues, 4))


if __name__ == '__main__':
    main()
