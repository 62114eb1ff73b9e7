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
Intrinsic formations of reduced attitudes: a library that needs numpy and no ROS.

::

    from tetra_ros2.formation import Cosine, Formation, rotating

    formation = Formation(rotating(), Cosine())
    trajectory = formation.simulate(seed=7, duration=30.0)
    print(trajectory.errors[-1], trajectory.spin())

What is listed in ``__all__`` is the interface. The modules below it hold the mathematics. They
work on numpy arrays of shape ``(..., n, 3)``: one formation, or a million. The exceptions are
``controller``, ``bodies``, ``sensing`` and ``observer``, the parts of the running loop, which use
plain floats: on vectors of three numbers numpy costs more than the arithmetic.

The names of equations, lemmas and theorems are those of Zhang, Song, He, Hong, Hu, *Intrinsic
Tetrahedron Formation of Reduced Attitude*.
"""

import importlib
from typing import Any, TYPE_CHECKING

if TYPE_CHECKING:
    from tetra_ros2.formation._formation import Formation
    from tetra_ros2.formation._trajectory import Trajectory
    from tetra_ros2.formation.analysis import Analysis
    from tetra_ros2.formation.equilibria import Equilibrium
    from tetra_ros2.formation.gain import (
        Cosine,
        Exponential,
        Gain,
        Gaussian,
        Linear,
        Rational,
    )
    from tetra_ros2.formation.shapes import known_shape, Shape
    from tetra_ros2.formation.targets import polyhedron, ring
    from tetra_ros2.formation.topology import complete, custom, rotating, Topology

__all__ = [
    'Analysis',
    'Cosine',
    'Equilibrium',
    'Exponential',
    'Formation',
    'Gain',
    'Gaussian',
    'Linear',
    'Rational',
    'Shape',
    'Topology',
    'Trajectory',
    'complete',
    'custom',
    'known_shape',
    'polyhedron',
    'ring',
    'rotating',
]

_HOMES = {
    '_formation': ('Formation',),
    '_trajectory': ('Trajectory',),
    'analysis': ('Analysis',),
    'gain': ('Cosine', 'Exponential', 'Gain', 'Gaussian', 'Linear', 'Rational'),
    'shapes': ('Shape', 'known_shape'),
    'equilibria': ('Equilibrium',),
    'targets': ('polyhedron', 'ring'),
    'topology': ('Topology', 'complete', 'custom', 'rotating'),
}
_HOME = {name: module for module, names in _HOMES.items() for name in names}


def __getattr__(name: str) -> Any:
    # On demand: the process of an agent must not load the shapes, the plant or the analysis.
    if name in _HOME:
        return getattr(importlib.import_module(f'{__name__}.{_HOME[name]}'), name)
    raise AttributeError(f'module {__name__!r} has no attribute {name!r}')


def __dir__() -> list[str]:
    return sorted({*globals(), *__all__})
