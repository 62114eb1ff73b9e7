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
Drivers of bodies: what turns a real one as the law commands.

A driver is a class with one method, ``apply(angular_velocity, dt)``: turn the body at that rate
(x, y, z) [rad/s] in its own frame, for about ``dt`` [s], until the next call. It may have
``attitude()``, which returns the body's attitude as a quaternion x y z w, body to world, or None;
``close()``; and ``at_limit``, the names of what is at a limit. Whatever it cannot reach it says by
raising OSError: the body then counts as lost, and the driver is made anew until it can be.
"""

from collections.abc import Mapping, Sequence
from importlib import import_module
import inspect
import os
from pathlib import Path
import re
import sys
import traceback
from typing import Any, Protocol

from tetra_ros2.config.parameters import ConfigurationError, shown
from tetra_ros2.formation._types import Vector
import yaml

SHIPPED = {
    'pan_tilt': 'tetra_ros2.drivers.pan_tilt:PanTilt',
    'rate_setpoint': 'tetra_ros2.drivers.rate_setpoint:RateSetpoint',
}
"""The drivers that ship, by their short names."""


class Driver(Protocol):
    """What a driver has to have."""

    def apply(self, angular_velocity: Vector, dt: float) -> None:
        """
        Turn the body.

        :param angular_velocity: in the body frame [rad/s]; zero holds it
        :param dt: until about when [s]
        :raises OSError: if the body cannot be reached
        """


def find(name: str) -> type:
    """
    Return the class of a driver.

    :param name: the short name of one that ships; or ``module:Class``, where the module is one
        that Python finds, on PYTHONPATH, among what is installed, or in the current directory
    :raises ConfigurationError: if there is none such
    """
    module, _, attribute = SHIPPED.get(name, name).partition(':')
    if not re.fullmatch(r'[A-Za-z_][\w.]*', module) or not attribute.isidentifier():
        raise ConfigurationError(
            f'{shown(name)} is not valid, expected module:Class or one of '
            f'{", ".join(SHIPPED)}', key='driver')
    # Last, so that no file in the current directory takes the place of an installed module.
    if not {'', os.getcwd()} & set(sys.path):
        sys.path.append(os.getcwd())
    try:
        found = getattr(import_module(module), attribute)
    except ModuleNotFoundError as error:
        if name in SHIPPED:
            raise  # it is there, and lacks an extra
        if error.name is None or not f'{module}.'.startswith(f'{error.name}.'):
            raise ConfigurationError(
                f'{module} cannot be imported: {described(error)}', key='driver') from error
        raise ConfigurationError(
            f'there is no module {error.name!r}; it is looked for on PYTHONPATH, among the '
            f'installed packages and in {os.getcwd()}', key='driver') from None
    except AttributeError:
        raise ConfigurationError(
            f'there is no {attribute!r} in {module!r}', key='driver') from None
    except Exception as error:  # whatever a module may raise while it is imported
        raise ConfigurationError(
            f'{module} cannot be imported: {described(error)}', key='driver') from error
    if not callable(getattr(found, 'apply', None)):
        raise ConfigurationError(
            f'{name} has no method apply(angular_velocity, dt)', key='driver')
    return found  # type: ignore[no-any-return]


def described(error: BaseException) -> str:
    """Return in one line what somebody's code has raised, and where."""
    text = ' '.join(f'{type(error).__name__}: {error}'.split())
    frames = traceback.extract_tb(error.__traceback__)
    if not frames or isinstance(error, (ImportError, SyntaxError)):  # they say it themselves
        return text
    return f'{text} ({Path(frames[-1].filename).name}, line {frames[-1].lineno})'


def options(texts: Sequence[str]) -> dict[str, Any]:
    """
    Return what a driver is made with.

    :param texts: ``name=value`` each; the value as YAML has it: a number, a list, a text
    :raises ConfigurationError: if one is not of this form
    """
    made = {}
    for text in texts:
        name, equals, value = text.partition('=')
        try:
            if not equals or not name.isidentifier():
                raise ValueError
            made[name] = yaml.safe_load(value)
        except (ValueError, yaml.YAMLError):
            raise ConfigurationError(
                f'{shown(text)} is not valid, expected name=value', key='driver_options') from None
    return made


def make(kind: type, given: Mapping[str, Any], node: Any = None) -> Driver:
    """
    Make a driver.

    :param kind: of :func:`find`
    :param given: of :func:`options`
    :param node: the node, for drivers that say ``wants_node = True``
    :raises ConfigurationError: if it does not take these options
    :raises OSError: if the body cannot be reached
    """
    extra = {'node': node} if getattr(kind, 'wants_node', False) else {}
    try:
        inspect.signature(kind).bind(**given, **extra)
        driver: Driver = kind(**given, **extra)
    except OSError:
        raise
    except (TypeError, ValueError) as error:
        said = ' '.join(str(error).split())
        raise ConfigurationError(f'{kind.__name__}: {said}', key='driver_options') from error
    except Exception as error:  # it is somebody else's code
        raise ConfigurationError(f'{kind.__name__}: {described(error)}', key='driver') from error
    return driver
