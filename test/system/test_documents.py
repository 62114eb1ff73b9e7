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

"""What README and docs say is so."""

from pathlib import Path
import re

import pytest
from tetra_ros2.commands import COMMANDS
from tetra_ros2.config import parameters
from tetra_ros2.config.configuration import ParameterFile
from tetra_ros2.formation import gain as gains
import yaml

TOP = Path(__file__).resolve().parents[2]
README = (TOP / 'README.md').read_text()
PARAMETERS = (TOP / 'docs' / 'parameters.md').read_text()
PAGES = [TOP / 'README.md', TOP / 'CONTRIBUTING.md', *sorted((TOP / 'docs').glob('*.md'))]


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


@pytest.mark.parametrize('code', re.findall('```python\n(.*?)```', README, re.DOTALL))
def test_the_examples_in_python_run(code):
    exec(compile(code, 'README.md', 'exec'), {})


@pytest.mark.parametrize('page', PAGES, ids=lambda page: page.name)
def test_every_link_to_a_file_finds_it(page):
    text = re.sub('```.*?```', '', page.read_text(), flags=re.DOTALL)
    targets = re.findall(r'\]\(([^)\s]+)\)', text) + re.findall('src="([^"]+)"', text)
    for target in targets:
        path, _, _ = target.partition('#')
        if path and '://' not in path:
            assert (page.parent / path).exists(), target


def test_every_page_is_in_the_table_of_contents():
    index = (TOP / 'docs' / 'index.md').read_text()
    for page in (TOP / 'docs').glob('*.md'):
        assert page.stem == 'index' or re.search(rf'^{page.stem}$', index, re.MULTILINE), page.stem
