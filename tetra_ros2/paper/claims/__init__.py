# Copyright 2026 The tetra_ros2 authors
# SPDX-License-Identifier: Apache-2.0

"""
The claims of the paper, one module a section.

Importing this registers all of them in :data:`tetra_ros2.paper.registry.CLAIMS`.
"""

import importlib

SECTIONS = (
    'preliminaries',
    'formulation',
    'stationary',
    'xi',
    'almost_global',
    'rotating',
    'simulation',
    'rate_loops',
    'polyhedra',
)
"""The modules of this package that hold claims, in the order of the paper."""

for _section in SECTIONS:
    importlib.import_module(f'{__name__}.{_section}')
