# Copyright 2026 The tetra_ros2 authors
# SPDX-License-Identifier: Apache-2.0

"""What the README says is so."""

from pathlib import Path
import re

import yaml

from tetra_ros2.cli import COMMANDS
from tetra_ros2.config import parameters
from tetra_ros2.config.configuration import ParameterFile
from tetra_ros2.formation import gain as gains

README = (Path(__file__).resolve().parents[2] / 'README.md').read_text()


def test_the_tables_of_parameters_are_those_of_the_code():
    table = README.split('<!-- parameters: begin -->')[1].split('<!-- parameters: end -->')[0]
    assert table.strip() == parameters.markdown().strip()


def test_the_example_of_a_configuration_is_one(tmp_path):
    text = re.search('```yaml\n(.*?)```', README, re.DOTALL)[1]
    file = tmp_path / 'example.yaml'
    file.write_text(text)
    assert ParameterFile(file).formation().topology.axis_agent == 1
    assert yaml.safe_load(text)['/**/plant']['ros__parameters']['seed'] == 7


def test_every_gain_and_every_command_is_listed():
    for kind in gains.KINDS:
        assert f'| `{kind}` |' in README
    for command in COMMANDS:
        assert f'`tetra {command}' in README


def test_the_example_in_python_runs():
    code = re.search('```python\n(.*?)```', README, re.DOTALL)[1]
    exec(compile(code, 'README.md', 'exec'), {})
