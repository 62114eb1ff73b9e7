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

"""What describes a formation is a value: nobody changes it, and it is a key."""

from dataclasses import fields, is_dataclass
import importlib
import inspect
import pkgutil

import pytest
from tetra_ros2 import formation

MODULES = [importlib.import_module(f'{formation.__name__}.{module.name}')
           for module in pkgutil.iter_modules(formation.__path__)]
VALUES = sorted(
    {thing for module in MODULES for _, thing in inspect.getmembers(module, inspect.isclass)
     if is_dataclass(thing) and thing.__module__ == module.__name__}, key=lambda c: c.__name__)


def test_there_are_such():
    assert {'Topology', 'Gain', 'Shape', 'Analysis', 'Summary', 'Design'} <= {
        value.__name__ for value in VALUES}


@pytest.mark.parametrize('value', VALUES, ids=lambda value: value.__name__)
def test_a_value_is_never_changed_and_can_be_a_key(value):
    assert value.__dataclass_params__.frozen
    assert value.__hash__ is not None
    # Arrays compare element by element, which is neither yes nor no, and have no hash.
    arrays = any('Array' in str(field.type) or 'ndarray' in str(field.type)
                 for field in fields(value))
    assert not (arrays and value.__dataclass_params__.eq)
