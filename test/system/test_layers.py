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

"""The table of layers in CONTRIBUTING.md is true: nothing imports what stands below it."""

import ast
from pathlib import Path
import re
import sys

import pytest

TOP = Path(__file__).resolve().parents[2]
PACKAGE = TOP / 'tetra_ros2'
BASE = {'numpy', 'yaml', 'rich'}
ROS = {'rclpy', 'builtin_interfaces', 'diagnostic_msgs', 'geometry_msgs', 'rcl_interfaces',
       'rosgraph_msgs', 'rosidl_runtime_py', 'sensor_msgs', 'std_msgs', 'std_srvs', 'tf2_msgs',
       'visualization_msgs'}
MOST_LINES = 500


def table(text):
    """Return for each layer, in order, the layers and the packages that it may import."""
    rows = re.findall(r'^\| `(\w+)` \| ([^|]*)\| ([^|]*)\|', text, re.MULTILINE)
    layers = {}
    for name, above, outside in rows:
        packages = {word.strip() for word in outside.split(',')} - {''}
        if 'ROS' in packages:
            packages = packages - {'ROS'} | ROS
        layers[name] = {word.strip() for word in above.split(',')} - {''}, packages | BASE
    return layers


def imports(source):
    """Yield the full name of every module that a source imports, wherever it does."""
    for node in ast.walk(ast.parse(source)):
        if isinstance(node, ast.Import):
            yield from (alias.name for alias in node.names)
        elif isinstance(node, ast.ImportFrom):
            assert not node.level, 'imports are absolute'
            if node.module == 'tetra_ros2':
                yield from (f'tetra_ros2.{alias.name}' for alias in node.names)
            else:
                yield node.module


def violations(layer, source, layers):
    """Return what a module of a layer imports and may not."""
    above, packages = layers[layer]
    wrong = []
    for name in imports(source):
        first, _, rest = name.partition('.')
        if first == 'tetra_ros2':
            other = rest.partition('.')[0]
            if other not in {'', layer} | above:
                wrong.append(name)
        elif first not in packages | sys.stdlib_module_names:
            wrong.append(name)
    return wrong


LAYERS = table((TOP / 'CONTRIBUTING.md').read_text())
MODULES = sorted(path for path in PACKAGE.rglob('*.py')
                 if path.relative_to(PACKAGE).parts[0] not in ('__init__.py', '__main__.py'))


def layer_of(path):
    return path.relative_to(PACKAGE).parts[0].removesuffix('.py')


def test_every_layer_stands_in_the_table():
    assert {layer_of(path) for path in MODULES} == set(LAYERS)


def test_a_layer_may_import_only_what_stands_above_it():
    seen = set()
    for name, (above, _) in LAYERS.items():
        assert above <= seen, f'{name} may import what stands below it'
        seen.add(name)


@pytest.mark.parametrize('path', MODULES, ids=lambda path: str(path.relative_to(PACKAGE)))
def test_a_module_imports_only_what_its_layer_may(path):
    assert not violations(layer_of(path), path.read_text(), LAYERS)


def test_an_import_that_is_turned_round_is_found():
    source = 'from tetra_ros2.nodes.agent import Agent'
    assert violations('formation', source, LAYERS) == ['tetra_ros2.nodes.agent']
    assert violations('launcher', source, LAYERS) == []
    assert violations('formation', 'import rclpy', LAYERS) == ['rclpy']
    late = 'def f():\n    from rclpy.node import Node'
    assert violations('wire', late, LAYERS) == ['rclpy.node']


@pytest.mark.parametrize(
    'path', [*MODULES, *(p for folder in ('benchmarks', 'docs', 'examples')
                         for p in sorted((TOP / folder).glob('*.py')))],
    ids=lambda path: str(path.relative_to(TOP)))
def test_no_module_is_too_long_to_read(path):
    assert len(path.read_text().splitlines()) <= MOST_LINES
