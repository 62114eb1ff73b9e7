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
The bodies as MuJoCo models: one vehicle, looked at and found fit, and n of them together.

A vehicle is an MJCF model with a body named ``body``, the attitude of which counts. Either it
floats, by a free joint of ``body``, and motors on wheels or sites turn it; or it is a gimbal, with
two hinges named ``pan`` and ``tilt`` and a motor of the same name on each.
"""

from dataclasses import dataclass
import logging
from pathlib import Path

import mujoco
import numpy as np
from numpy.typing import NDArray
from tetra_ros2.physics.settings import BodyError, Gimbal, Physics, Wheels

Array = NDArray[np.float64]

BODY = 'body'
PAN = 'pan'
TILT = 'tilt'


def _warn(text: str) -> None:
    logging.getLogger(__name__).warning('MuJoCo: %s', ' '.join(text.split()))


if mujoco.get_mju_user_warning() is None:
    # Otherwise MuJoCo writes a file MUJOCO_LOG.TXT into the current directory.
    mujoco.set_mju_user_warning(_warn)

LEVEL = np.array([0.0, 0.0, 0.0, 1.0])
"""The attitude of a base that is not turned."""

_OPTIONS = """
  <option gravity="0 0 0"><flag contact="disable"/></option>
  <compiler autolimits="true" angle="radian"/>
"""

_WHEEL = """
      <body name="wheel_{axis}">
        <joint name="wheel_{axis}" type="hinge" axis="{direction}"/>
        <inertial pos="0 0 0" mass="0.05" diaginertia="{inertia}"/>
        <geom type="cylinder" size="{radius}" fromto="{ends}" mass="0"/>
      </body>"""


def wheels_xml(wheels: Wheels) -> str:
    """Return the MJCF of a box with three reaction wheels."""
    parts, motors = '', ''
    sides = _box_sides(wheels.mass, wheels.body_inertia)
    for k, axis in enumerate('xyz'):
        unit = np.eye(3)[k]
        # A thin disc: half of it across its axis.
        inertia = wheels.inertia * (0.5 + 0.5 * unit)
        face = 0.5 * sides[k]  # it is mounted on
        ends = np.concatenate([face * unit, (face + 0.024) * unit])
        parts += _WHEEL.format(
            axis=axis, direction=_numbers(unit), inertia=_numbers(inertia), radius=0.06,
            ends=_numbers(ends))
        motors += (f'    <motor name="wheel_{axis}" joint="wheel_{axis}" '
                   f'ctrlrange="{-wheels.torque_limit!r} {wheels.torque_limit!r}"/>\n')
    return f"""<mujoco model="wheels">{_OPTIONS}
  <worldbody>
    <body name="{BODY}">
      <freejoint name="free"/>
      <inertial pos="0 0 0" mass="{wheels.mass!r}" diaginertia="{_numbers(wheels.body_inertia)}"/>
      <geom type="box" size="{_numbers(0.5 * sides)}" mass="0"/>{parts}
    </body>
  </worldbody>
  <actuator>
{motors}  </actuator>
</mujoco>
"""


def gimbal_xml(gimbal: Gimbal) -> str:
    """Return the MJCF of a pan-tilt gimbal."""
    def limited(limits: tuple[float, float]) -> str:
        return f'limited="true" range="{_numbers(limits)}"' if np.all(np.isfinite(limits)) \
            else 'limited="false"'

    force = f'ctrlrange="{-gimbal.torque_limit!r} {gimbal.torque_limit!r}"'
    return f"""<mujoco model="gimbal">{_OPTIONS}
  <worldbody>
    <geom type="cylinder" size="0.05" fromto="0 0 -0.16 0 0 -0.1" mass="0"/>
    <body name="yoke">
      <joint name="{PAN}" type="hinge" axis="0 0 1" {limited(gimbal.pan_limits)}/>
      <inertial pos="0 0 0" mass="0.3" diaginertia="0.0008 0.0006 0.001"/>
      <geom type="box" size="0.02 0.01 0.08" pos="0 0.07 -0.04" mass="0"/>
      <geom type="box" size="0.02 0.01 0.08" pos="0 -0.07 -0.04" mass="0"/>
      <body name="{BODY}">
        <joint name="{TILT}" type="hinge" axis="0 1 0" {limited(gimbal.tilt_limits)}/>
        <inertial pos="0 0 0" mass="0.4" diaginertia="0.0006 0.001 0.001"/>
        <geom type="box" size="0.06 0.045 0.045" mass="0"/>
        <geom type="cylinder" size="0.03" fromto="0.06 0 0 0.1 0 0" mass="0"/>
      </body>
    </body>
  </worldbody>
  <actuator>
    <motor name="{PAN}" joint="{PAN}" {force}/>
    <motor name="{TILT}" joint="{TILT}" {force}/>
  </actuator>
</mujoco>
"""


def _numbers(values: object) -> str:
    return ' '.join(repr(float(v)) for v in np.asarray(values, dtype=float).ravel())


def _box_sides(mass: float, inertia: tuple[float, float, float]) -> Array:
    """Return the sides of the solid box of that mass and inertia [m]."""
    j = np.asarray(inertia)
    sides: Array = np.sqrt(np.maximum(6.0 / mass * (np.sum(j) - 2.0 * j), 1e-6))
    return sides


@dataclass(frozen=True, eq=False)
class Vehicle:
    """
    One vehicle, as the rate loop has to know it.

    :param spec: the model, to be attached
    :param floats: whether it floats; otherwise it is a gimbal
    :param joints: names of its hinges, in the order of MuJoCo's velocities
    :param torque_limits: of its motors [N m], ``(m,)``
    :param momentum: what takes all velocities to the angular momentum, in the body frame,
        ``(3, nv)``; of a floating one
    :param allocation: torques of the motors for an angular acceleration of the body, ``(m, 3)``
    :param compliance: the angular acceleration that a torque on the body gives it, ``(3, 3)``
    :param wheel: for each motor, which hinge it drives; -1 for none, ``(m,)``
    :param wheel_response: acceleration of that hinge by its own motor, ``(m,)``
    :param limits: of the hinges [rad], ``(j, 2)``; infinite where the file gives none
    """

    spec: 'mujoco.MjSpec'
    floats: bool
    joints: tuple[str, ...]
    torque_limits: Array
    momentum: Array
    allocation: Array
    compliance: Array
    wheel: NDArray[np.int64]
    wheel_response: Array
    limits: Array


def load(physics: Physics) -> Vehicle:
    """
    Return the vehicle that is asked for.

    :raises BodyError: if there is none such, or it cannot be turned
    """
    if physics.body == 'wheels':
        return examine(mujoco.MjSpec.from_string(wheels_xml(physics.wheels)))
    if physics.body == 'gimbal':
        return examine(mujoco.MjSpec.from_string(gimbal_xml(physics.gimbal)))
    path = Path(physics.body)
    if not path.is_file():
        raise BodyError(f'{physics.body!r} is not valid, expected kinematic, wheels, gimbal or '
                        'the path of an MJCF file', 'body')
    try:
        return examine(mujoco.MjSpec.from_file(str(path)))
    except BodyError as error:
        raise BodyError(f'{path}: {error}', 'body') from None
    except (ValueError, RuntimeError, mujoco.FatalError) as error:
        reason = ' '.join(str(error).split())
        raise BodyError(f'{path}: is not an MJCF file: {reason}', 'body') from None


def examine(spec: 'mujoco.MjSpec') -> Vehicle:
    """
    Look at a model of one vehicle.

    :raises BodyError: if it lacks what its names are to say, or its motors cannot turn it
    """
    model = spec.compile()
    data = mujoco.MjData(model)
    mujoco.mj_forward(model, data)
    body = _find(model, mujoco.mjtObj.mjOBJ_BODY, BODY)
    if body < 0:
        raise BodyError(f'has no body named {BODY!r}')
    if not model.nu:
        raise BodyError('has no actuators')
    names = [model.joint(k).name for k in range(model.njnt)]
    kinds = [model.jnt_type[k] for k in range(model.njnt)]
    hinges = tuple(name for name, kind in zip(names, kinds)
                   if kind == mujoco.mjtJoint.mjJNT_HINGE)
    for k in range(model.nu):
        if model.actuator_gaintype[k] != mujoco.mjtGain.mjGAIN_FIXED or \
                model.actuator_biastype[k] != mujoco.mjtBias.mjBIAS_NONE or \
                model.actuator_dyntype[k] != mujoco.mjtDyn.mjDYN_NONE:
            raise BodyError(f'actuator {model.actuator(k).name!r} is not a motor')
    limited = model.actuator_ctrllimited.astype(bool)
    torque_limits = np.where(limited, np.min(np.abs(model.actuator_ctrlrange), axis=1), np.inf)
    forced = model.actuator_forcelimited.astype(bool)
    torque_limits = np.minimum(torque_limits, np.where(
        forced, np.min(np.abs(model.actuator_forcerange), axis=1), np.inf))
    inertia = np.zeros((model.nv, model.nv))
    mujoco.mj_fullM(model, data, inertia)
    moment = _moments(model, data)
    limits = np.array([model.jnt_range[k] if model.jnt_limited[k] else (-np.inf, np.inf)
                       for k, kind in enumerate(kinds) if kind == mujoco.mjtJoint.mjJNT_HINGE]
                      ).reshape(-1, 2)
    floats = bool(kinds) and kinds[0] == mujoco.mjtJoint.mjJNT_FREE
    if floats:
        if model.jnt_bodyid[0] != body:
            raise BodyError(f'its free joint is not that of {BODY!r}')
        if len(hinges) != model.njnt - 1:
            raise BodyError('has joints that are neither free nor hinges')
        if np.max(np.abs(inertia[:3, 3:])) > 1e-9 * np.max(inertia):
            raise BodyError(f'the centre of mass is not at the origin of {BODY!r}, or that of a '
                            'wheel not on its axis')
        inverse = np.linalg.inv(inertia)
        response = inverse[3:6] @ moment
        if np.linalg.matrix_rank(response, tol=1e-9 * np.max(np.abs(response), initial=1e-30)) < 3:
            raise BodyError('its motors cannot turn it about every axis')
        wheel = np.array([hinges.index(model.joint(model.actuator_trnid[k, 0]).name)
                          if model.actuator_trntype[k] == mujoco.mjtTrn.mjTRN_JOINT else -1
                          for k in range(model.nu)])
        by_motor = inverse @ moment
        own = np.array([by_motor[6 + w, k] if w >= 0 else 0.0 for k, w in enumerate(wheel)])
        allocation: Array = np.linalg.pinv(response).astype(float)
        return Vehicle(spec, True, hinges, torque_limits, inertia[3:6], allocation,
                       inverse[3:6, 3:6], wheel, own, limits)
    if hinges != (PAN, TILT) or model.njnt != 2:
        raise BodyError(f'{BODY!r} has neither a free joint nor hinges named {PAN!r} and '
                        f'{TILT!r}, in this order')
    if tuple(model.actuator(k).name for k in range(model.nu)) != (PAN, TILT):
        raise BodyError(f'expected two motors named {PAN!r} and {TILT!r}, in this order')
    if np.max(np.abs(moment - np.eye(2))) > 1e-9:
        raise BodyError(f'each of the motors {PAN!r} and {TILT!r} is to drive the hinge of its '
                        'name, with a gear of 1')
    axes = data.xaxis
    if np.max(np.abs(axes - [[0.0, 0.0, 1.0], [0.0, 1.0, 0.0]])) > 1e-6 or \
            abs(abs(data.xquat[body, 0]) - 1.0) > 1e-9:
        raise BodyError('at rest, pan is to turn about z, tilt about y, and the axes of '
                        f'{BODY!r} are to be those of the world')
    empty = np.zeros((0, 0))
    return Vehicle(spec, False, hinges, torque_limits, empty, empty, empty,
                   np.array([0, 1]), np.zeros(2), limits)


def _find(model: 'mujoco.MjModel', kind: 'mujoco.mjtObj', name: str) -> int:
    return int(mujoco.mj_name2id(model, kind, name))


def _moments(model: 'mujoco.MjModel', data: 'mujoco.MjData') -> Array:
    """Return the generalised force that a unit of each motor exerts, ``(nv, nu)``."""
    columns = []
    for k in range(model.nu):
        data.ctrl[:] = 0.0
        # A small one: the motor may be limited.
        data.ctrl[k] = small = 1e-6
        mujoco.mj_forward(model, data)
        columns.append(data.qfrc_actuator / small)
    data.ctrl[:] = 0.0
    mujoco.mj_forward(model, data)
    return np.stack(columns, axis=1)


def origins(n: int) -> Array:
    """Return where :func:`assemble` puts the vehicles [m], ``(n, 3)``."""
    places: Array = np.arange(1, n + 1)[:, None] * np.array([3.0, 0.0, 0.0])
    return places


def assemble(vehicle: Vehicle, mounting: Array) -> 'mujoco.MjModel':
    """
    Return one model of n vehicles ``agent_1/`` to ``agent_n/``, side by side.

    :param vehicle: one of them
    :param mounting: attitudes of their bases, unit quaternions x y z w, ``(n, 4)``
    """
    n = len(mounting)
    whole, one = mujoco.MjSpec(), vehicle.spec.copy()
    # Of the fourth order, free bodies keep their momentum to rounding. A gimbal touches its
    # limits, for which the implicit method is the better one.
    one.option.integrator = mujoco.mjtIntegrator.mjINT_RK4 if vehicle.floats \
        else mujoco.mjtIntegrator.mjINT_IMPLICITFAST
    one.option.disableflags |= mujoco.mjtDisableBit.mjDSBL_CONTACT
    if vehicle.floats:
        one.option.gravity = np.zeros(3)
    for name in dir(one.option):  # what the file says of its world holds for this one
        if not name.startswith('_'):
            setattr(whole.option, name, getattr(one.option, name))
    for k, geom in enumerate(one.geoms):
        geom.name = geom.name or f'part_{k}'  # so that each is known as that of its vehicle
    for i, origin in enumerate(origins(n), start=1):
        x, y, z, w = mounting[i - 1]
        frame = whole.worldbody.add_frame(pos=origin, quat=[w, x, y, z])
        whole.attach(one.copy(), prefix=f'agent_{i}/', frame=frame)
    return whole.compile()
