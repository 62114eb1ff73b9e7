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
From a YAML file, or from the values of ROS parameters, to checked objects.

Nothing unchecked gets past this module.
"""

from collections.abc import Iterable, Iterator, Mapping, Sequence
import itertools
import os
from pathlib import Path
import re
from typing import Any

import numpy as np
from tetra_ros2.config.parameters import (
    check_parameters,
    ConfigurationError,
    FORMATION,
    is_ros_parameter,
    nearest,
    PARAMETERS,
    shown,
)
from tetra_ros2.config.share import shipped
from tetra_ros2.formation import Formation, sphere, Topology
from tetra_ros2.formation import gain as gains
from tetra_ros2.formation import topology as topologies
from tetra_ros2.formation._types import Array
import yaml

LONGEST_NAMESPACE = 150
"""How long a namespace may be; the names of topics must still fit behind it."""

UNIT_TOLERANCE = 1e-3
"""How far from 1 the length of a quaternion that a user wrote down may be."""


def formation_from_parameters(values: Mapping[str, Any]) -> Formation:
    """
    Return the formation that checked parameter values describe: what all nodes agree on.

    :raises ConfigurationError: if values that are right by themselves do not fit together
    """
    topology = _topology(values)
    return Formation(topology, gain_from_parameters(values), _axes(values, topology.n))


def gain_from_parameters(values: Mapping[str, Any]) -> gains.Gain:
    """
    Return the gain that ``gain.kind``, ``gain.a`` and ``gain.b`` describe.

    :raises ConfigurationError: if there is no such family, or it violates the assumption As:SF:f
    """
    kind = values['gain.kind']
    try:
        family = gains.family(kind)
    except gains.UnknownGain as error:
        raise ConfigurationError(
            f'{shown(kind)} is not valid: {error}', key='gain.kind') from error
    try:
        return family(values['gain.a'], values['gain.b'])
    except ValueError as error:
        raise ConfigurationError(str(error), key='gain') from error
    except Exception as error:  # whatever the constructor of somebody's family may raise
        raise ConfigurationError(
            f'{shown(kind)} is not valid: {type(error).__name__}: {error}',
            key='gain.kind') from error


def _topology(values: Mapping[str, Any]) -> Topology:
    kind, edges = values['topology.kind'], values['topology.edges']
    _refuse_foreign(values)
    if kind == 'polyhedron':
        return _polyhedron(values)
    if values['topology.n'] == 1:
        raise ConfigurationError(
            '1 is not valid, expected an integer from 2 to 1000', key='topology.n')
    n = values['topology.n'] or 4
    if kind == 'complete':
        return topologies.complete(n)
    if kind == 'rotating':
        if n != 4:
            raise ConfigurationError(
                f'{n} is not valid, the rotating topology needs 4', key='topology.n')
        return topologies.rotating(values['topology.k'], values['topology.p'])
    if kind == 'ring':
        # Here and below: the agents of other graphs load no shape.
        from tetra_ros2.formation import targets
        return targets.ring(n, values['topology.spin'])
    parsed: list[tuple[int, int] | tuple[int, int, float]] = []
    for index, text in enumerate(edges):
        try:
            i, j, *weight = text.split()
            if len(weight) > 1:
                raise ValueError
            parsed.append((int(i), int(j), float(weight[0])) if weight else (int(i), int(j)))
        except ValueError:
            raise ConfigurationError(
                f'{text!r} is not valid, expected "i j" or "i j weight", such as "1 2 0.5"',
                key=f'topology.edges[{index}]') from None
    try:
        topology = topologies.custom(n, parsed)
    except topologies.EdgeError as error:
        raise ConfigurationError(
            f'{edges[error.index]!r} is not valid: {error}',
            key=f'topology.edges[{error.index}]') from None
    points = values.get('topology.points', ())  # only who watches has them
    if not points:
        return topology
    from tetra_ros2.formation import targets  # as above
    try:
        return targets.given(topology, targets.directions(points))
    except ValueError as error:
        raise ConfigurationError(str(error), key='topology.points') from None


def _refuse_foreign(values: Mapping[str, Any]) -> None:
    """Refuse values that the kind of the topology has no use for."""
    kind = values['topology.kind']
    for key, kinds, why in (
            ('topology.edges', ('custom',),
             f'a {kind} topology has its own edges; say kind: custom to give others'),
            ('topology.points', ('custom',),
             f'a {kind} topology has its own shape; say kind: custom to give another'),
            ('topology.spin', ('polyhedron', 'ring'),
             f'a {kind} topology has no spin to choose; say kind: polyhedron or ring'),
            ('topology.class_weights', ('polyhedron',),
             f'a {kind} topology has no classes of distance; say kind: polyhedron')):
        if values.get(key) and kind not in kinds:
            raise ConfigurationError(why, key=key)


def _polyhedron(values: Mapping[str, Any]) -> Topology:
    from tetra_ros2.formation import targets  # as above
    solid, n = values['topology.polyhedron'], values['topology.n']
    needed = targets.number_of_vertices(solid)
    if n not in (0, needed):
        raise ConfigurationError(
            f'{n} is not valid, the {solid} needs {needed}; leave it out, or say 0',
            key='topology.n')
    axis = values['topology.axis']
    if axis not in targets.AXES:
        try:
            axis = np.array([float(x) for x in axis.strip('[]() ').replace(',', ' ').split()])
            if axis.shape != (3,):
                raise ValueError
        except ValueError:
            raise ConfigurationError(
                f'{shown(values["topology.axis"])} is not valid'
                f'{nearest(values["topology.axis"], targets.AXES)}, expected vertex, edge, face, '
                'or three numbers in quotes, such as "0 0.6 0.8"',
                key='topology.axis') from None
        try:
            sphere.normalize(axis)
        except ValueError as error:
            raise ConfigurationError(
                f'{shown(values["topology.axis"])} is not valid: {error}',
                key='topology.axis') from None
    try:
        return targets.polyhedron(
            solid, values['topology.class_weights'], axis, values['topology.spin'])
    except ValueError as error:  # the rest has been checked
        raise ConfigurationError(str(error), key='topology.class_weights') from None


def _axes(values: Mapping[str, Any], n: int) -> Array:
    axes = np.array(values['pointing_axis'], dtype=float)
    if len(axes) not in (3, 3 * n):
        raise ConfigurationError(
            f'{len(axes)} numbers are not valid, expected 3 for all agents or {3 * n} for '
            f'{n} agents', key='pointing_axis')
    axes = axes.reshape(-1, 3)
    for index, axis in enumerate(axes):
        try:
            sphere.normalize(axis)
        except ValueError as error:
            raise ConfigurationError(
                f'{axis.tolist()} of agent {index + 1} is not valid: {error}',
                key='pointing_axis') from None
    return np.broadcast_to(sphere.normalize(axes), (n, 3))


def initial_attitudes(values: Mapping[str, Any], n: int) -> Array | None:
    """
    Return the initial attitudes that were given, unit quaternions ``(n, 4)``, or None.

    :raises ConfigurationError: if there are not 4 n numbers, or one is not a unit quaternion
    """
    given = np.array(values['initial_attitudes'], dtype=float)
    if not len(given):
        return None
    if len(given) != 4 * n:
        raise ConfigurationError(
            f'{len(given)} numbers are not valid, expected {4 * n} for {n} agents',
            key='initial_attitudes')
    quaternions = given.reshape(n, 4)
    lengths = np.linalg.norm(quaternions, axis=1)
    for index in np.flatnonzero(~(np.abs(lengths - 1.0) <= UNIT_TOLERANCE)):
        raise ConfigurationError(
            f'{quaternions[index].tolist()} of agent {index + 1} is not valid, expected a unit '
            'quaternion x, y, z, w', key='initial_attitudes')
    unit: Array = quaternions / lengths[:, None]
    return unit


class ParameterFile:
    """
    A checked ROS 2 parameter file.

    It is read as rcl reads it, which is not quite as YAML has it: ``1e2`` is a number, ``1_000``
    is none, there are no aliases, and what is said twice counts twice.

    :param path: the file
    :raises ConfigurationError: if it cannot be read, is not a parameter file, has an unknown
        key, or has a value that is not valid for a node that it applies to
    """

    def __init__(self, path: str | Path) -> None:
        self.path = Path(path)
        self._sections: list[tuple[str, dict[str, Any]]] = []
        try:
            self._read(_compose(self.path), '')
            self._check()
        except ConfigurationError as error:
            raise error.at(self.path) from None

    def _read(self, mapping: yaml.MappingNode, prefix: str) -> None:
        """Collect the sections in the order of the file; namespaces may be nested levels."""
        complete = False
        for name, node in mapping.value:
            key = f'{prefix}/{name.value.strip("/")}'
            if not isinstance(node, yaml.MappingNode) or not (node.value or prefix) or complete:
                what = 'parameters' if name.value == 'ros__parameters' \
                    else '"ros__parameters:" and the parameters below it'
                raise ConfigurationError(f'expected {what}', key=key[1:])
            if name.value == 'ros__parameters':
                self._sections.append((prefix, dict(_flatten(node))))
                complete = True  # as to rcl: further nodes of the level must stand before it
            else:
                self._read(node, key)

    def _check(self) -> None:
        """Check every section, and then what comes together at every node."""
        for pattern, parameters in self._sections:
            kinds = _kinds(pattern)
            for key, value in parameters.items():
                specs = [spec for kind in kinds for spec in PARAMETERS[kind] if spec.name == key]
                if kinds and not specs and not is_ros_parameter(key):
                    known = [spec.name for kind in kinds for spec in PARAMETERS[kind]]
                    raise ConfigurationError(
                        f'there is no such parameter{nearest(key, known)}', key=key)
                if isinstance(value, list) and len({type(item) for item in value}) > 1:
                    raise ConfigurationError(
                        f'{shown(value)} is not valid: ROS 2 wants the elements of a list to '
                        'be of one type, so write 1.0 beside 0.5', key=key)
                for spec in specs:
                    spec.check(value)
        self._check_nodes()

    def _check_nodes(self) -> None:
        n = self.formation().topology.n
        for pattern, _ in self._sections:
            match = re.fullmatch(r'agent_(\d+)', pattern.rsplit('/', 1)[-1])
            if match and not 1 <= int(match[1]) <= n:
                raise ConfigurationError(
                    f'there is no agent {match[1]} among {n}', key=pattern[1:])
        checked = set()
        for kind, name in (('plant', 'plant'), *(('agent', f'agent_{i + 1}') for i in range(n))):
            values = self.values(kind, f'/{name}')
            shared = tuple(values[spec.name] for spec in FORMATION)
            if shared not in checked:
                checked.add(shared)
                if (m := formation_from_parameters(values).topology.n) != n:
                    raise ConfigurationError(
                        f'{m} for {name} is not valid, it is {n} for the others',
                        key='topology.n')
        initial_attitudes(self.values('plant'), n)

    def given(self, full_name: str) -> dict[str, Any]:
        """Return the parameters, by name, that the file gives the node ``/namespace/name``."""
        merged = {}
        for pattern, parameters in self._sections:
            if _matches(pattern, full_name):
                merged.update(parameters)
        return merged

    def values(self, node: str, full_name: str | None = None) -> dict[str, Any]:
        """
        Return all parameters of a node, checked.

        :param node: one of PARAMETERS
        :param full_name: ``/namespace/name`` of the node; by default its usual name, in no
            namespace
        """
        specs = {spec.name for spec in PARAMETERS[node]}
        given = self.given(full_name or f'/{node}')
        return check_parameters(node, {k: v for k, v in given.items() if k in specs})

    def formation(self) -> Formation:
        """Return the formation, as the monitor is told of it."""
        return formation_from_parameters(self.values('monitor'))


class _Composer(yaml.SafeLoader):
    """YAML without aliases, as rcl has it."""

    def compose_node(self, parent: yaml.Node | None, index: int) -> yaml.Node | None:
        if self.check_event(yaml.AliasEvent):
            mark = self.peek_event().start_mark  # type: ignore[no-untyped-call]
            raise yaml.composer.ComposerError(None, None, 'ROS 2 takes no aliases', mark)
        return super().compose_node(parent, index)


def _compose(path: Path) -> yaml.MappingNode:
    """Return the mapping at the top of a YAML file, as nodes."""
    try:
        node = yaml.compose(path.read_text(encoding='utf-8'), _Composer)
    except (OSError, UnicodeDecodeError) as error:
        reason = getattr(error, 'strerror', None) or 'not a text file'
        raise ConfigurationError(f'cannot be read: {reason}') from None
    except (yaml.YAMLError, RecursionError) as error:
        mark = getattr(error, 'problem_mark', None)
        place = f' in line {mark.line + 1}, column {mark.column + 1}' if mark else ''
        problem = getattr(error, 'problem', None) or 'not readable'
        raise ConfigurationError(f'is not YAML: {problem}{place}') from None
    if not isinstance(node, yaml.MappingNode):
        raise ConfigurationError(
            'is not a ROS 2 parameter file, expected "/**:" and "ros__parameters:" above the '
            'parameters')
    return node


def _flatten(mapping: yaml.MappingNode, prefix: str = '') -> Iterator[tuple[str, Any]]:
    """Yield (dotted name, value) for nested parameters."""
    for name, node in mapping.value:
        key = f'{prefix}{name.value}'
        if isinstance(node, yaml.MappingNode):
            yield from _flatten(node, f'{key}.')
        elif isinstance(node, yaml.SequenceNode):
            if not all(isinstance(item, yaml.ScalarNode) for item in node.value):
                raise ConfigurationError('a list of lists is not valid', key=key)
            yield key, [_scalar(item) for item in node.value]
        else:
            yield key, _scalar(node)


_TRUE = {'Y', 'y', 'yes', 'Yes', 'YES', 'true', 'True', 'TRUE', 'on', 'On', 'ON'}
_FALSE = {'N', 'n', 'no', 'No', 'NO', 'false', 'False', 'FALSE', 'off', 'Off', 'OFF'}
_INTEGER = re.compile(r'[-+]?(0[xX][0-9a-fA-F]+|[0-9]+)')
_FLOAT = re.compile(r'[-+]?([0-9]+\.?[0-9]*|\.[0-9]+)([eE][-+]?[0-9]+)?')
_SPECIAL = re.compile(r'[-+]?\.(inf|Inf|INF)|\.(nan|NaN|NAN)')


def _scalar(node: yaml.ScalarNode) -> str | int | float | bool:
    """Return the value of a scalar as rcl takes it."""
    text: str = node.value
    if node.style is not None:  # quoted, or a block of text
        return text
    if text in _TRUE or text in _FALSE:
        return text in _TRUE
    if _INTEGER.fullmatch(text):
        digits = text.lstrip('+-')
        base = 16 if digits[:2] in ('0x', '0X') else 8 if re.fullmatch('0[0-7]+', digits) else 10
        return int(text, base)
    if _SPECIAL.fullmatch(text):
        return float(text.replace('.', ''))
    return float(text) if _FLOAT.fullmatch(text) else text


def _matches(pattern: str, full_name: str) -> bool:
    """Return whether a section's name stands for a node: ``*`` is one token, ``**`` any."""
    regex = ''
    for token in pattern.strip('/').split('/'):
        regex += {'**': '(/[^/]+)*', '*': '/[^/]+'}.get(token, '/' + re.escape(token))
    return re.fullmatch(regex, full_name) is not None


def _kinds(pattern: str) -> tuple[str, ...]:
    """
    Return the kinds of node that a section can be for; none for one of somebody else's nodes.

    :raises ConfigurationError: if it looks like a slip of the pen
    """
    name = pattern.rsplit('/', 1)[-1]
    if name in ('*', '**'):
        return tuple(PARAMETERS)
    if re.fullmatch(r'agent_\d+', name):
        return ('agent',)
    if re.fullmatch(r'body_\d+', name):
        return ('body',)
    if name in ('plant', 'monitor', 'recorder', 'sensors'):
        return (name,)
    if hint := nearest(name, ('agent_1', 'plant', 'monitor', 'recorder', 'sensors', 'body_1')):
        raise ConfigurationError(f'there is no such node{hint}', key=pattern[1:])
    return ()


def find_file(name: str | Path) -> Path:
    """
    Return the path of a configuration file.

    :param name: a path, or the bare name of a file that ships, such as ``rotating``
    :raises ConfigurationError: if there is none
    """
    path = Path(name)
    try:
        if path.is_file():
            return path
    except OSError as error:
        raise ConfigurationError(f'cannot be read: {error.strerror}', source=name) from None
    known = shipped()
    if str(name) in known:
        return known[str(name)]
    problem = 'is a directory' if path.is_dir() else 'there is no such file'
    raise ConfigurationError(
        f'{problem}; the names that ship are {", ".join(known)}{nearest(name, known)}',
        source=name)


def load(name: str | Path) -> ParameterFile:
    """Return the checked :class:`ParameterFile` of a path or a shipped name."""
    return ParameterFile(find_file(name))


def check_new(path: str | Path) -> None:
    """
    Refuse a path to record into that exists.

    :raises ConfigurationError: if it does
    """
    if os.path.lexists(path):
        raise ConfigurationError(
            'exists already, and an existing recording is never overwritten; give another path',
            source=path)


def check_namespace(namespace: str) -> str:
    """
    Return a namespace in full, ``/a/b``, or nothing for none.

    :raises ConfigurationError: if ROS 2 does not allow it
    """
    full = '/' + namespace.strip('/') if namespace.strip('/') else ''
    if not re.fullmatch(r'(/[A-Za-z_][A-Za-z0-9_]*)*', full) or len(full) > LONGEST_NAMESPACE:
        raise ConfigurationError(
            f'{shown(namespace)} is not valid, expected names of letters, digits and _, that do '
            f'not begin with a digit, joined by /, {LONGEST_NAMESPACE} characters at most',
            key='--namespace')
    return full


def check_ros_arguments(arguments: Sequence[str], kinds: Iterable[str]) -> None:
    """
    Refuse parameters on a command line that no node will ever look at.

    :param arguments: arguments as after ``--ros-args``
    :param kinds: the kinds of node that are to run
    :raises ConfigurationError: if there is one, or a parameter file is not valid
    """
    known = [spec.name for kind in kinds for spec in PARAMETERS[kind]]
    for option, value in itertools.pairwise(arguments):
        if option in ('-p', '--param'):
            name = value.partition(':=')[0].rpartition(':')[2]
            if name not in known and not is_ros_parameter(name):
                raise ConfigurationError(
                    f'there is no such parameter{nearest(name, known)}', key=f'-p {name}')
        elif option == '--params-file':
            ParameterFile(value)
