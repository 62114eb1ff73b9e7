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

"""The page that leads from the paper to the code: every label is there, every name exists."""

import importlib
from pathlib import Path
import re

from tetra_ros2.paper import verify  # noqa: F401, it registers the claims
from tetra_ros2.paper.registry import CLAIMS

HERE = Path(__file__).parent
PAGE = (HERE.parents[1] / 'docs' / 'paper-map.md').read_text(encoding='utf-8')
LABELS = (HERE / 'labels.txt').read_text(encoding='utf-8').split()
"""All labels of the paper, in its order."""

OF_THE_PAPER = {'preliminaries', 'formulation', 'stationary', 'xi', 'almost_global', 'rotating',
                'simulation', '_common', 'errata'}
"""Modules of claims of the paper; others are about what it does not treat."""


def rows():
    lines = [line for line in PAGE.splitlines() if line.startswith('| ') and '---' not in line]
    return [[cell.strip() for cell in line.strip('|').split('|')] for line in lines]


def names(cell):
    return re.findall(r'`([^`]+)`', cell)


def test_every_label_of_the_paper_has_its_row_in_order():
    assert len(LABELS) == len(set(LABELS)) == 74
    assert [names(row[0])[0] for row in rows() if len(row) == 5 and names(row[0])] == LABELS


def test_every_function_that_is_named_exists():
    implemented = {name for row in rows() for name in names(row[-2])}
    assert len(implemented) > 30
    for name in implemented:
        module, _, attribute = f'tetra_ros2.{name}'.rpartition('.')
        assert hasattr(importlib.import_module(module), attribute), name


def test_every_claim_about_the_paper_is_named_and_every_name_is_a_claim():
    named = {name for row in rows() for name in names(row[-1])}
    assert named - set(CLAIMS) == set()
    missing = {key for key in set(CLAIMS) - named if CLAIMS[key].section in OF_THE_PAPER}
    assert missing == set()


def test_a_label_that_a_claim_names_is_one_of_the_paper():
    for claim in (c for c in CLAIMS.values() if c.section in OF_THE_PAPER):
        for label in re.findall(r'(?:eq|Thm|thm|As|Rmk|Fig):[\w:]+', claim.label):
            assert label in LABELS, claim.key
