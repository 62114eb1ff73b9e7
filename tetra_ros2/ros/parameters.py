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

"""Declaring this package's parameters to ROS, and following their changes."""

from collections.abc import Callable, Iterable
import math
from typing import Any

from rcl_interfaces.msg import (
    FloatingPointRange,
    IntegerRange,
    ParameterDescriptor,
    ParameterType,
    SetParametersResult,
)
from rclpy.node import Node
from rclpy.parameter import Parameter
from tetra_ros2.config import parameters
from tetra_ros2.config.parameters import check_parameters, ConfigurationError, PARAMETERS
from tetra_ros2.formation import gain as gains

_TYPES = {
    bool: ParameterType.PARAMETER_BOOL,
    int: ParameterType.PARAMETER_INTEGER,
    float: ParameterType.PARAMETER_DOUBLE,
    str: ParameterType.PARAMETER_STRING,
}
_LISTS = {
    float: ParameterType.PARAMETER_DOUBLE_ARRAY,
    int: ParameterType.PARAMETER_INTEGER_ARRAY,
    str: ParameterType.PARAMETER_STRING_ARRAY,
}


def declare(node: Node, kind: str, accept: Callable[[dict[str, Any]], object],
            apply: Callable[[dict[str, Any]], None]) -> dict[str, Any]:
    """
    Declare the parameters of a kind of node, and keep them right as long as the node lives.

    :param node: the rclpy node
    :param kind: one of :data:`tetra_ros2.config.parameters.PARAMETERS`
    :param accept: called with a mapping of all values, checked one by one, before they count;
        raises ConfigurationError if they do not fit together
    :param apply: called with such a mapping after a change at run time
    :returns: the mapping for a start
    :raises ConfigurationError: if a value that the user set is not valid
    """
    specs = {spec.name: spec for spec in PARAMETERS[kind]}

    def values(changes: Iterable[Parameter] = ()) -> dict[str, Any]:
        given = {name: node.get_parameter(name).value for name in specs}
        given.update((p.name, p.value) for p in changes if p.name in specs)
        return check_parameters(kind, {k: v for k, v in given.items() if v is not None})

    def on_set(changes: list[Parameter]) -> SetParametersResult:
        for change in changes:
            if change.name in specs and change.type_ == Parameter.Type.NOT_SET:
                return SetParametersResult(
                    successful=False, reason=f'{change.name} cannot be deleted')
            # Whoever can set a parameter must not choose what this process imports.
            if change.name == 'gain.kind' and gains.OWN.fullmatch(str(change.value)) \
                    and not gains.is_known(change.value):
                return SetParametersResult(
                    successful=False, reason=f'gain.kind: {change.value!r} is not valid here: a '
                    'node takes a gain of your own only when it starts')
        # Each topic brings three parameters of rclpy's: with many topics, to look at all values
        # again for each of those takes most of a start.
        if not any(change.name in specs for change in changes):
            return SetParametersResult(successful=True)
        try:
            accept(values(changes))
        except ConfigurationError as error:
            return SetParametersResult(successful=False, reason=str(error))
        return SetParametersResult(successful=True)

    # What the user gave is checked here and not by the descriptor, which would say it less well.
    for spec in specs.values():
        node.declare_parameter(
            spec.name, _plain(spec.default), ParameterDescriptor(dynamic_typing=True))
    start = values()
    accept(start)
    for spec in specs.values():
        node.set_descriptor(spec.name, describe(spec))
    node.add_on_set_parameters_callback(on_set)
    node.add_post_set_parameters_callback(
        lambda changes: apply(values()) if any(p.name in specs for p in changes) else None)
    return start


def _plain(default: Any) -> Any:
    """Return a default as rclpy takes it."""
    return list(default) if isinstance(default, tuple) else default


def describe(spec: parameters.Parameter) -> ParameterDescriptor:
    """
    Return the descriptor of a parameter.

    Its type is dynamic for ROS, so that ``rate: 100`` does for 100.0; that the value is of the
    right kind is checked by :meth:`tetra_ros2.config.parameters.Parameter.check` all the same.
    """
    descriptor = ParameterDescriptor(
        description=spec.description,
        additional_constraints=spec.expected,
        read_only=not spec.dynamic,
        dynamic_typing=True,
        type=_LISTS[spec.items] if spec.items else _TYPES[type(spec.default)],
    )
    if spec.minimum is not None and spec.maximum is not None and math.isfinite(spec.maximum):
        if type(spec.default) is int:
            descriptor.integer_range = [
                IntegerRange(from_value=spec.minimum, to_value=spec.maximum, step=1)]
        else:
            descriptor.floating_point_range = [
                FloatingPointRange(from_value=spec.minimum, to_value=spec.maximum)]
    return descriptor
