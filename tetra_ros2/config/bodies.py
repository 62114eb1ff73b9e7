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

"""From the plant's parameters to bodies with mass."""

from collections.abc import Mapping
from typing import Any

import numpy as np
from tetra_ros2.config.configuration import (
    formation_from_parameters,
    initial_attitudes,
    UNIT_TOLERANCE,
)
from tetra_ros2.config.parameters import ConfigurationError
from tetra_ros2.formation.gimbal import ENDLESS, Limits
from tetra_ros2.physics.settings import BodyError, Gimbal, Physics, RateLoop, Wheels

KINEMATIC = 'kinematic'
"""The body that needs no physics."""


def physics_from_parameters(values: Mapping[str, Any], n: int) -> Physics | None:
    """
    Return what the bodies are made of, or None if they turn as they are told.

    :param values: all parameters of the plant, each of them checked
    :param n: the number of agents
    :raises ConfigurationError: if they do not fit together
    """
    if values['body'] == KINEMATIC:
        return None
    try:
        return Physics(
            body=values['body'],
            rate=values['physics_rate'],
            loop=RateLoop(values['rate_loop.bandwidth'], values['rate_loop.feedforward'],
                          values['gyro.noise'], values['gyro.bias']),
            wheels=Wheels(values['wheels.mass'], _vector(values, 'wheels.body_inertia'),
                          values['wheels.inertia'], values['wheels.torque_limit'],
                          values['wheels.speed_limit'],
                          _vector(values, 'wheels.disturbance')),
            gimbal=Gimbal(_limits(values, 'gimbal.pan_limits'),
                          _limits(values, 'gimbal.tilt_limits'), values['gimbal.rate_limit'],
                          values['gimbal.torque_limit'], _mounting(values, n)),
            seed=max(values['seed'], 0))
    except BodyError as error:
        raise ConfigurationError(str(error), key=error.key) from None


def _numbers(values: Mapping[str, Any], key: str, count: int) -> tuple[float, ...]:
    given: tuple[float, ...] = values[key]
    if len(given) != count:
        raise ConfigurationError(
            f'{list(given)} is not valid, expected {count} numbers', key=key)
    return given


def _vector(values: Mapping[str, Any], key: str) -> tuple[float, float, float]:
    x, y, z = _numbers(values, key, 3)
    return x, y, z


def _limits(values: Mapping[str, Any], key: str) -> Limits:
    if not values[key]:
        return ENDLESS
    low, high = _numbers(values, key, 2)
    return low, high


def _mounting(values: Mapping[str, Any],
              n: int) -> tuple[tuple[float, float, float, float], ...]:
    key = 'gimbal.mounting'
    given = np.array(values[key], dtype=float)
    if len(given) not in (4, 4 * n):
        raise ConfigurationError(
            f'{len(given)} numbers are not valid, expected 4 for all agents or {4 * n} for '
            f'{n} agents', key=key)
    quaternions = given.reshape(-1, 4)
    lengths = np.linalg.norm(quaternions, axis=1)
    if np.any(~(np.abs(lengths - 1.0) <= UNIT_TOLERANCE)):
        raise ConfigurationError(
            f'{list(values[key])} is not valid, expected unit quaternions x, y, z, w', key=key)
    return tuple((x, y, z, w) for x, y, z, w in (quaternions / lengths[:, None]).tolist())


def check_bodies(values: Mapping[str, Any]) -> None:
    """
    Refuse bodies that there are not, or that cannot start where they are to.

    :param values: all parameters of the plant, each of them checked
    :raises ConfigurationError: if there is anything wrong with them
    """
    formation = formation_from_parameters(values)
    n = formation.topology.n
    physics = physics_from_parameters(values, n)
    for i in values['external_bodies']:
        if not 1 <= i <= n:
            raise ConfigurationError(
                f'there is no agent {i} among {n}', key='external_bodies')
    if values['external_bodies'] and values['mode'] != 'realtime':
        raise ConfigurationError(
            f'{list(values["external_bodies"])} is not valid in lockstep: bodies elsewhere do '
            'not wait; say mode: realtime', key='external_bodies')
    check_poses(values, n)
    if physics is None:
        return
    given = initial_attitudes(values, n)
    if given is not None:
        for i in np.flatnonzero(~physics.can_point(given, formation.pointing_axes)):
            raise ConfigurationError(
                f'agent {i + 1} starts where the limits of the gimbal, gimbal.pan_limits and '
                'gimbal.tilt_limits, do not let it point', key='initial_attitudes')
    from tetra_ros2.physics import models  # MuJoCo is an extra
    try:
        models.load(physics)
    except BodyError as error:
        raise ConfigurationError(str(error), key=error.key) from None


def check_poses(values: Mapping[str, Any], n: int) -> None:
    """
    Refuse poses that cannot be told apart.

    :param values: checked parameters, with those of POSES
    :param n: the number of agents
    :raises ConfigurationError: if the names are not n, or the topic has no place for them
    """
    names, topic = values['poses.names'], values['poses.topic']
    if names and len(names) != n:
        raise ConfigurationError(
            f'{len(names)} names are not valid, expected one for each of {n} agents',
            key='poses.names')
    if values['poses.source'] == 'pose':
        try:
            first, second = (topic.format(i=i, name=f'agent_{i}') for i in (1, 2))
        except (KeyError, IndexError, ValueError):
            first = second = ''
        if first == second:
            raise ConfigurationError(
                f'{topic!r} is not valid, expected a topic with {{i}} or {{name}} in it, such '
                'as /vrpn_mocap/{name}/pose', key='poses.topic')
