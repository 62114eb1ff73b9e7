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
The one home of every parameter: its name, default, range and meaning.

The nodes declare these tables to ROS (:mod:`tetra_ros2.ros.parameters`), and configuration files
are checked against them before any node starts (:mod:`tetra_ros2.config.configuration`).
"""

from collections.abc import Iterable, Mapping
from dataclasses import dataclass
import difflib
import math
from pathlib import Path
import re
import sys
from typing import Any

from tetra_ros2.formation import gain as gains
from tetra_ros2.formation import topology as topologies


class ConfigurationError(ValueError):
    """
    A configuration that cannot be used.

    Its text names, as far as they are known, the source, the key, the value and what would be
    right, in one line.
    """

    def __init__(self, problem: str, *, source: object = None, key: str | None = None) -> None:
        self.problem, self.source, self.key = problem, source, key
        super().__init__(': '.join(str(part) for part in (source, key, problem) if part))

    def at(self, source: object) -> 'ConfigurationError':
        """Return the same error with its source named."""
        return ConfigurationError(self.problem, source=source, key=self.key)


@dataclass(frozen=True)
class Parameter:
    """
    One parameter of a node.

    :param name: its ROS name; a dot separates the levels of the YAML file
    :param default: its default; the type of the default is the type of the parameter, where
        lists may be empty and ``items`` gives the type of their elements
    :param description: one sentence, with the unit
    :param minimum: the least value
    :param maximum: the greatest value
    :param choices: the only values, for strings
    :param pattern: other strings that are right as well
    :param pattern_name: what such a string is, in words
    :param items: the type of the elements, for lists
    :param dynamic: whether it may be changed while the node runs
    :param form: what a right value is, in words, where the above cannot tell
    """

    name: str
    default: Any
    description: str
    minimum: float | None = None
    maximum: float | None = None
    choices: tuple[str, ...] = ()
    pattern: re.Pattern[str] | None = None
    pattern_name: str = ''
    items: type | None = None
    dynamic: bool = False
    form: str = ''

    @property
    def expected(self) -> str:
        """Return in words what a right value is."""
        if self.form:
            return self.form
        if self.choices:
            return 'one of ' + ', '.join(self.choices) + (
                f', or {self.pattern_name}' if self.pattern else '')
        if self.items:
            items = {float: 'finite numbers', int: 'integers', str: 'strings'}
            return f'a list of {items[self.items]}'
        kind = {int: 'an integer', float: 'a number', str: 'a string', bool: 'true or false'}
        text = kind[type(self.default)]
        if self.minimum is not None and self.maximum is not None:
            text += f' from {_number(self.minimum)}'
            text += ' up' if self.maximum == math.inf else f' to {_number(self.maximum)}'
        return text

    def check(self, value: Any) -> Any:
        """
        Return the value, converted to the parameter's own type.

        :raises ConfigurationError: if it is of another type or out of range
        """
        if self.items:
            ok = not isinstance(value, (str, bytes, Mapping)) and isinstance(value, Iterable)
            value = list(value) if ok else value
            if ok and all(self._is(item, self.items) and self._is_finite(item)
                          for item in value):
                return tuple(self.items(item) for item in value)
        elif self._is(value, type(self.default)):
            if self.choices:
                if value in self.choices or (self.pattern and self.pattern.fullmatch(value)):
                    return value
            elif self.minimum is None:
                return value
            elif self.maximum is not None and self.minimum <= value <= self.maximum and (
                    value == math.inf or self._is_finite(value)):
                return type(self.default)(value)
        raise ConfigurationError(
            f'{shown(value)} is not valid{nearest(value, self.choices)}, '
            f'expected {self.expected}', key=self.name)

    @staticmethod
    def _is_finite(value: Any) -> bool:
        """Return whether a number is one that a float can hold; all else is finite enough."""
        return isinstance(value, str) or abs(value) <= sys.float_info.max

    @staticmethod
    def _is(value: Any, kind: type) -> bool:
        if isinstance(value, bool) or kind is bool:
            return isinstance(value, bool) and kind is bool
        if kind is float:
            return isinstance(value, (int, float)) and value == value
        return isinstance(value, kind)


def _number(value: float) -> str:
    """Return a bound as one would write it by hand."""
    return str(value) if isinstance(value, int) else f'{value:g}'


def shown(value: object, longest: int = 60) -> str:
    """Return a value as it should stand in a message, cut if it is long."""
    text = repr(value)
    return text if len(text) <= longest else text[:longest] + '...'


def nearest(word: object, words: Iterable[str]) -> str:
    """Return `` (did you mean ...?)`` if one of ``words`` is close to ``word``, or nothing."""
    close = difflib.get_close_matches(str(word), words, n=1, cutoff=0.6)
    return f' (did you mean {close[0]!r}?)' if close else ''


FORMATION = (
    Parameter(
        'topology.kind', 'complete', 'Who sees whom.', choices=topologies.KINDS),
    Parameter(
        'topology.n', 0, 'Number of agents; 0 for that of the polyhedron, and for 4 with the '
        'other kinds. The rotating topology needs 4.', minimum=0, maximum=1000),
    Parameter(
        'topology.k', 1, 'Rotating topology: the agent on the axis of rotation.',
        minimum=1, maximum=4),
    Parameter(
        'topology.p', 1, 'Rotating topology: the direction of the cycle of the other three.',
        minimum=0, maximum=1),
    Parameter(
        'topology.edges', (),
        'Custom topology: "i j" or "i j weight" for each agent j that agent i sees.', items=str),
    Parameter(
        'topology.polyhedron', 'tetrahedron', 'Polyhedron topology: the solid to form.',
        choices=topologies.POLYHEDRA),
    Parameter(
        'topology.axis', 'vertex', 'Polyhedron topology: the axis it turns about, fixed in the '
        'solid: through agent 1, through an edge or a face of its, or a vector in the frame of '
        'the vertices.', form='vertex, edge, face, or three numbers in quotes, such as '
        '"0 0.6 0.8"'),
    Parameter(
        'topology.spin', 0.0, 'Polyhedron and ring: the share of the largest spin that leaves '
        'every weight at 0 or more; the sign is the sense, 0 is at rest.',
        minimum=-1.0, maximum=1.0),
    Parameter(
        'topology.class_weights', (), 'Polyhedron topology: a weight for each distance between '
        'vertices, nearest first; empty for those recommended.', items=float),
    Parameter(
        'gain.kind', 'cosine', 'Family of the gain function f(theta).',
        choices=tuple(gains.KINDS), pattern=gains.OWN,
        pattern_name='module:Class for one of your own', dynamic=True),
    Parameter(
        'gain.a', 1.0, 'Amplitude of the gain function [rad/s].',
        minimum=1e-9, maximum=1e9, dynamic=True),
    Parameter(
        'gain.b', 1.0, 'Shape of the gain function, in the families that have one.',
        minimum=1e-9, maximum=1e9, dynamic=True),
    Parameter(
        'pointing_axis', (1.0, 0.0, 0.0),
        'Pointing axes b_i in the body frames: 3 numbers for all agents, or 3 for each.',
        items=float),
)
"""What all nodes of a formation share."""

ON_PUBLISHER_CONFLICT = Parameter(
    'on_publisher_conflict', 'report', 'What to do while a second publisher is on a topic that is '
    "one node's own: report it, or hold still until it is one again.",
    choices=('report', 'hold'), dynamic=True)

AGENT = FORMATION + (
    ON_PUBLISHER_CONFLICT,
    Parameter(
        'rate', 50.0, 'How often to answer with the newest measurements there are, while no full '
        'set of one stamp comes in [Hz].', minimum=1e-3, maximum=1e5, dynamic=True),
    Parameter(
        'measurement_timeout', 0.5, 'A neighbour not heard of for longer than this stops the '
        'agent [s].', minimum=1e-3, maximum=math.inf, dynamic=True),
)

POSES = (
    Parameter(
        'poses.source', 'pose', 'Where poses come from: a PoseStamped a body, one PoseArray of '
        'all, or TF.', choices=('pose', 'array', 'tf')),
    Parameter(
        'poses.topic', 'agent_{i}/pose', 'Topic of the poses; {i} stands for the number of the '
        'agent, {name} for the name of its body. For array the one topic; for tf not used.'),
    Parameter(
        'poses.names', (), 'Names of the bodies, one for each agent; empty for agent_1, '
        'agent_2 ... For tf the child frames.', items=str),
    Parameter(
        'poses.frame', '', 'Frame that all poses must be in; empty for any. For tf the parent, '
        'world if empty.'),
    Parameter(
        'poses.timeout', 0.2, 'A body whose last pose is older than this is lost [s].',
        minimum=1e-3, maximum=60.0),
    Parameter(
        'poses.max_rate', 20.0, 'A pose that the body would have had to turn faster to reach '
        'is a jump, and not used [rad/s].', minimum=1e-3, maximum=1e9),
    Parameter(
        'poses.frozen_angle', 0.02, 'A body told to turn this far while its pose stays the same '
        'to the last bit, for as long as poses.timeout, is frozen and counts as lost [rad]; 0 for '
        'never.',
        minimum=0.0, maximum=1e9),
)
"""What there is to say of poses that come from elsewhere."""

BODIES = (
    Parameter(
        'body', 'kinematic', 'What turns: kinematic bodies exactly as told, or bodies with mass '
        'by torques.', choices=('kinematic', 'wheels', 'gimbal'),
        pattern=re.compile(r'.+\.(xml|mjcf)'), pattern_name='the path of an MJCF file (.xml)'),
    Parameter(
        'physics_rate', 1000.0, 'Bodies with mass: steps of physics and rate loop per second '
        '[Hz].', minimum=1.0, maximum=1e6),
    Parameter(
        'rate_loop.bandwidth', 100.0, 'The k of the loop that makes dw/dt = k (u - w) of a body '
        'rate w under the command u [1/s].', minimum=1e-6, maximum=1e6),
    Parameter(
        'rate_loop.feedforward', True, 'Whether the rate loop makes up for the gyroscopic '
        'torque.'),
    Parameter(
        'gyro.noise', 0.0, 'Standard deviation of each sample of a gyro, per axis [rad/s].',
        minimum=0.0, maximum=1e3),
    Parameter(
        'gyro.bias', 0.0, "Standard deviation of a gyro's constant error, per axis [rad/s].",
        minimum=0.0, maximum=1e3),
    Parameter(
        'wheels.mass', 2.0, 'Mass of the box [kg].', minimum=1e-9, maximum=1e9),
    Parameter(
        'wheels.body_inertia', (0.010, 0.012, 0.014), 'Moments of inertia of the box, without '
        'its wheels [kg m^2].', items=float),
    Parameter(
        'wheels.inertia', 2e-4, 'Moment of inertia of a wheel about its axis [kg m^2].',
        minimum=1e-12, maximum=1e9),
    Parameter(
        'wheels.torque_limit', 0.1, 'Limit of the torque of a wheel [N m].',
        minimum=1e-12, maximum=1e9),
    Parameter(
        'wheels.speed_limit', 600.0, 'Limit of the speed of a wheel [rad/s].',
        minimum=1e-9, maximum=1e9),
    Parameter(
        'wheels.disturbance', (0.0, 0.0, 0.0), 'Torque on each body, constant in the world '
        '[N m].', items=float),
    Parameter(
        'gimbal.pan_limits', (), 'Limits of the pan joint [rad]; empty for none.', items=float),
    Parameter(
        'gimbal.tilt_limits', (-1.8, 1.8), 'Limits of the tilt joint [rad]; empty for none.',
        items=float),
    Parameter(
        'gimbal.rate_limit', 10.0, 'Limit of the rate of either joint [rad/s].',
        minimum=1e-9, maximum=1e9),
    Parameter(
        'gimbal.torque_limit', 1.0, 'Limit of the torque of either joint [N m].',
        minimum=1e-12, maximum=1e9),
    Parameter(
        'gimbal.mounting', (0.0, 0.0, 0.0, 1.0), 'Attitudes of the bases as quaternions x, y, z, '
        'w: 4 numbers for all agents, or 4 for each.', items=float),
)
"""What the plant's bodies are made of."""


PLANT = FORMATION + (
    ON_PUBLISHER_CONFLICT,
    Parameter(
        'mode', 'lockstep', 'How time passes: lockstep waits for every command, realtime for '
        'none.', choices=('lockstep', 'realtime')),
    Parameter(
        'rate', 100.0, 'Steps per second of formation time [Hz].',
        minimum=1e-3, maximum=1e5, dynamic=True),
    Parameter(
        'seed', -1, 'Seed of the random initial attitudes; -1 draws one and says which.',
        minimum=-1, maximum=2**63 - 1),
    Parameter(
        'initial_attitudes', (), 'Initial attitudes as quaternions x, y, z, w of all agents, 4 n '
        'numbers; empty for random ones.', items=float),
    Parameter(
        'command_timeout', 0.0, 'An agent whose command is older than this is held still [s]; 0 '
        'stands for 0.5 in realtime and 30 in lockstep.',
        minimum=0.0, maximum=math.inf, dynamic=True),
    Parameter(
        'max_angular_velocity', 1000.0, 'A command faster than this is dropped [rad/s].',
        minimum=1e-9, maximum=1e9, dynamic=True),
    Parameter(
        'real_time_factor', 0.0, 'Lockstep: seconds of formation time per second; 0 for as fast '
        'as the messages go.', minimum=0.0, maximum=1e6, dynamic=True),
    Parameter(
        'republish_period', 0.1, 'Lockstep: how long to wait before the measurements of a step '
        'are sent again [s].', minimum=1e-3, maximum=60.0),
    Parameter(
        'measurement_noise', 0.0, 'Standard deviation of a measured direction, per axis [rad].',
        minimum=0.0, maximum=1.0),
    Parameter(
        'measurement_delay', 0.0, 'How old the measurements are when they are sent [s]; rounded '
        'up to whole steps.', minimum=0.0, maximum=60.0),
    Parameter(
        'measurement_loss', 0.0, 'Probability that a measurement is lost, and the one before it '
        'sent again.', minimum=0.0, maximum=1.0),
    Parameter(
        'duration', 0.0, 'Pause when so much formation time has passed [s]; 0 for never.',
        minimum=0.0, maximum=1e9),
    *BODIES,
    Parameter(
        'external_bodies', (), 'Realtime: the agents whose bodies are elsewhere; their poses are '
        'listened to.', items=int),
    *POSES,
)

SENSORS = FORMATION + (
    Parameter(
        'rate', 100.0, 'Measurements per second [Hz].', minimum=1e-3, maximum=1e5),
    *POSES,
)

BODY = (
    Parameter(
        'driver', '', 'What drives the body, as module:Class.'),
    Parameter(
        'driver_options', (), 'What the driver is made with, "name=value" each.', items=str),
    Parameter(
        'rate', 100.0, 'How often the driver is told what to do [Hz].',
        minimum=1e-3, maximum=1e5),
    Parameter(
        'command_timeout', 0.5, 'The body is held when no command came for longer than this '
        '[s].', minimum=0.0, maximum=math.inf),
    Parameter(
        'max_angular_velocity', 10.0, 'The body is held while its command is faster than this '
        '[rad/s].', minimum=1e-9, maximum=1e9),
)

MONITOR = FORMATION + (
    Parameter(
        'topology.points', (), 'Custom topology: the directions that its weights are made for, '
        '3 n numbers; empty if there are none. The agents do not know them.', items=float),
    Parameter(
        'tolerance', 1e-3, 'A formation whose error stays below this has formed [rad].',
        minimum=1e-15, maximum=math.pi, dynamic=True),
    Parameter(
        'publish_tf', False, 'Publish the body frames on /tf, while somebody listens.'),
)

RECORDER = (
    Parameter(
        'output', '', 'Directory to record into; it must not exist yet.'),
    Parameter(
        'storage', 'mcap', 'Storage format.', choices=('mcap', 'sqlite3')),
    Parameter(
        'topics', (), 'Topics to record; empty for all topics of the formation.', items=str),
    Parameter(
        'regex', '', 'Record the topics whose full names match this regular expression too.'),
)

PARAMETERS = {'agent': AGENT, 'plant': PLANT, 'monitor': MONITOR, 'recorder': RECORDER,
              'sensors': SENSORS, 'body': BODY}

ROS_PARAMETERS = ('use_sim_time', 'start_type_description_service')
"""Parameters that every rclpy node has of its own, beside qos_overrides.*."""


def check_parameters(node: str, given: Mapping[str, Any]) -> dict[str, Any]:
    """
    Return all parameters of a node, those given checked, the others at their defaults.

    :param node: one of PARAMETERS
    :param given: a mapping from names to values
    :raises ConfigurationError: if a name is unknown or a value is not valid
    """
    specs = {spec.name: spec for spec in PARAMETERS[node]}
    values = {name: spec.default for name, spec in specs.items()}
    for name, value in given.items():
        if name in specs:
            values[name] = specs[name].check(value)
        elif not is_ros_parameter(name):
            raise ConfigurationError(
                f'there is no such parameter of the {node}{nearest(name, specs)}', key=name)
    return values


def is_ros_parameter(name: str) -> bool:
    """Return whether every rclpy node has a parameter of this name."""
    return name in ROS_PARAMETERS or name.startswith('qos_overrides.')


def markdown() -> str:
    """Return tables of all parameters, as they stand in ``docs/parameters.md``."""
    lines = []
    shared = {spec.name for spec in FORMATION}
    for title, specs in (
            ('all nodes but the recorder and the drivers of bodies', FORMATION),
            *((kind, [s for s in specs if s.name not in shared])
              for kind, specs in PARAMETERS.items())):
        lines += [f'| {title} | default | | |', '|---|---|---|---|']
        for spec in specs:
            default = list(spec.default) if isinstance(spec.default, tuple) else spec.default
            star = '*' if spec.dynamic else ''
            lines.append(f'| `{spec.name}`{star} | `{default!r}` | {spec.description} '
                         f'| {spec.expected} |')
        lines.append('')
    return '\n'.join(lines)


def with_tables(text: str) -> str:
    """Return a page with the tables of :func:`markdown` between the two marks in it."""
    begin, end = '<!-- parameters: begin -->', '<!-- parameters: end -->'
    before, rest = text.split(begin)
    return f'{before}{begin}\n\n{markdown()}\n{end}{rest.split(end)[1]}'


if __name__ == '__main__':
    page = Path(sys.argv[1])
    page.write_text(with_tables(page.read_text(encoding='utf-8')), encoding='utf-8')
