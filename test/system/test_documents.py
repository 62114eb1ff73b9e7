# Copyright 2026 The tetra_ros2 authors
# SPDX-License-Identifier: Apache-2.0

"""What README and docs say is so."""

from pathlib import Path
import re

import yaml

from tetra_ros2.commands import COMMANDS
from tetra_ros2.config import parameters
from tetra_ros2.config.configuration import ParameterFile
from tetra_ros2.formation import gain as gains

TOP = Path(__file__).resolve().parents[2]
README = (TOP / 'README.md').read_text()
PARAMETERS = (TOP / 'docs' / 'parameters.md').read_text()


def test_the_tables_of_parameters_are_those_of_the_code():
    assert parameters.with_tables(PARAMETERS) == PARAMETERS, \
        'run: python -m tetra_ros2.config.parameters docs/parameters.md'


def test_the_example_of_a_configuration_is_one(tmp_path):
    text = re.search('```yaml\n(.*?)```', PARAMETERS, re.DOTALL)[1]
    file = tmp_path / 'example.yaml'
    file.write_text(text)
    assert ParameterFile(file).formation().topology.axis_agent == 1
    assert yaml.safe_load(text)['/**/plant']['ros__parameters']['seed'] == 7


def test_every_gain_and_every_command_is_listed():
    for kind in gains.KINDS:
        assert f'| `{kind}` |' in PARAMETERS
    table = README.split('| command | does |')[1].split('\n\n')[0]
    listed = set(re.findall('`(?:tetra )?([a-z]+)`', table))
    assert listed == set(COMMANDS)
