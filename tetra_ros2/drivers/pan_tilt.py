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

"""A pan-tilt head of two Dynamixel servos on a serial line, by the maker's own library."""

from collections.abc import Sequence
from contextlib import suppress
import math
import os
import termios
from typing import Any

import dynamixel_sdk
from tetra_ros2.drivers import dynamixel
from tetra_ros2.formation import gimbal
from tetra_ros2.formation._types import Quaternion, Vector

WATCHDOG = 0.2
"""After how long a silence on the line the servos stop by themselves [s]."""

CHECK_EVERY = 50
"""After how many commands to look whether that has happened."""

TRIES = 6
"""
How often a servo is asked before it counts as gone: a packet may be garbled, the machine busy.

Each takes 34 ms at most, so that both give up after about the same silence.
"""

STIFFNESS = 4.0
"""How fast, at most, a joint goes towards a limit that is 1 rad away [rad/s]."""


class PanTilt:
    """
    Two servos in velocity mode; see :mod:`tetra_ros2.formation.gimbal` for the geometry.

    The servos take whole units of 0.024 rad/s: what is lost by rounding is made up for in the
    next command, so that the mean is right. They stop by themselves when the line falls silent.

    :param port: such as ``/dev/ttyUSB0``
    :param baud: of the line
    :param pan_id: of the pan servo on the bus
    :param tilt_id: of the tilt servo
    :param pan_limits: lower and upper [rad]; None for endless
    :param tilt_limits: lower and upper [rad]; None for endless
    :param rate_limit: of either joint [rad/s]
    :param pan_sign: -1 if the servo counts against z of the base
    :param tilt_sign: -1 if the servo counts against y of the base
    :param mounting: attitude of the base in the world, a unit quaternion x y z w
    :raises OSError: if the port is not there or a servo does not answer
    """

    def __init__(self, *, port: str, baud: int = 1_000_000, pan_id: int = 1, tilt_id: int = 2,
                 pan_limits: Sequence[float] | None = None,
                 tilt_limits: Sequence[float] | None = (-1.8, 1.8), rate_limit: float = 5.0,
                 pan_sign: int = 1, tilt_sign: int = 1,
                 mounting: Sequence[float] = (0.0, 0.0, 0.0, 1.0)) -> None:
        self._ids = (pan_id, tilt_id)
        self._signs = (pan_sign, tilt_sign)
        self._limits = tuple(tuple(map(float, limits)) if limits else gimbal.ENDLESS
                             for limits in (pan_limits, tilt_limits))
        self._rate_limit = rate_limit
        self._mounting: Quaternion = tuple(map(float, mounting))  # type: ignore[assignment]
        self._left = [0.0, 0.0]  # what rounding has left of the rates, in units
        self._commands = 0
        self._where = str(port)
        self._port = dynamixel_sdk.PortHandler(self._where)
        self._packets = dynamixel_sdk.PacketHandler(2.0)
        try:
            self._port.openPort()
            self._port.setBaudRate(baud)
        except OSError as error:
            reason = os.strerror(error.errno) if error.errno else 'cannot be opened'
            raise OSError(f'{port}: {reason}') from None
        try:
            self._set_up()
        except OSError:
            self._port.closePort()
            raise
        self._goals = dynamixel_sdk.GroupSyncWrite(
            self._port, self._packets, dynamixel.GOAL_VELOCITY, 4)
        self._positions = dynamixel_sdk.GroupSyncRead(
            self._port, self._packets, dynamixel.PRESENT_POSITION, 4)
        for number in self._ids:
            self._positions.addParam(number)
        self.angles = self._read_angles()  # pan and tilt, as last read [rad]

    def _set_up(self) -> None:
        for number in self._ids:
            self._write(number, dynamixel.BUS_WATCHDOG, 0)
            self._write(number, dynamixel.TORQUE_ENABLE, 0)
            self._write(number, dynamixel.OPERATING_MODE, dynamixel.VELOCITY_MODE)
            self._write(number, dynamixel.TORQUE_ENABLE, 1)
            self._write(number, dynamixel.BUS_WATCHDOG,
                        round(WATCHDOG / dynamixel.WATCHDOG_UNIT))

    def _lost(self, number: object, result: int) -> OSError:
        said = ' '.join(str(self._packets.getTxRxResult(result)).split())
        return OSError(f'{self._where}: servo {number}: {said}')

    def _guarded(self, call: Any, *arguments: Any) -> Any:
        try:
            return call(*arguments)
        except (OSError, termios.error, TypeError) as error:
            # Without its device, pyserial raises one or another, by what it was doing.
            raise OSError(f'{self._where}: {error}') from None

    def _write(self, number: int, address: int, value: int) -> None:
        for _ in range(TRIES):
            result, error = self._guarded(
                self._packets.write1ByteTxRx, self._port, number, address, value)
            if result == dynamixel_sdk.COMM_SUCCESS:
                break
        if result != dynamixel_sdk.COMM_SUCCESS:
            raise self._lost(number, result)
        if error:
            said = ' '.join(str(self._packets.getRxPacketError(error)).split())
            raise OSError(f'{self._where}: servo {number}: {said}')

    def _read_angles(self) -> tuple[float, float]:
        for _ in range(TRIES):
            result = self._guarded(self._positions.txRxPacket)
            if result == dynamixel_sdk.COMM_SUCCESS:
                break
        if result != dynamixel_sdk.COMM_SUCCESS:
            raise self._lost(' and '.join(map(str, self._ids)), result)
        pan, tilt = (
            sign * dynamixel.POSITION_UNIT * (dynamixel.signed(self._positions.getData(
                number, dynamixel.PRESENT_POSITION, 4)) - dynamixel.CENTER)
            for number, sign in zip(self._ids, self._signs))
        return pan, tilt

    def apply(self, angular_velocity: Vector, dt: float) -> None:
        """
        Turn the head.

        :raises OSError: if the servos cannot be reached
        """
        _, y, z = angular_velocity
        units = []
        for k, rate in enumerate(gimbal.joint_rates(y, z, self.angles[1])):
            low, high = self._limits[k]
            angle = self.angles[k]
            rate = max(-self._rate_limit, min(self._rate_limit, rate))
            rate = max(STIFFNESS * (low - angle), min(STIFFNESS * (high - angle), rate))
            exact = self._signs[k] * rate / dynamixel.VELOCITY_UNIT + self._left[k]
            # A body that is to be held is held, and not nudged by what was left over.
            whole = round(exact) if rate else 0
            self._left[k] = exact - whole if rate else 0.0
            units.append(whole)
        self._commands += 1
        if self._commands % CHECK_EVERY == 0:
            self._rearm()
        self._goals.clearParam()
        for number, whole in zip(self._ids, units):
            self._goals.addParam(
                number, list(dynamixel.unsigned(whole).to_bytes(4, 'little')))
        result = self._guarded(self._goals.txPacket)
        if result != dynamixel_sdk.COMM_SUCCESS:
            raise self._lost(' and '.join(map(str, self._ids)), result)

    def _rearm(self) -> None:
        """Let servos move again that have stopped since the line was silent."""
        for number in self._ids:
            for _ in range(TRIES):
                value, result, _error = self._guarded(
                    self._packets.read1ByteTxRx, self._port, number, dynamixel.BUS_WATCHDOG)
                if result == dynamixel_sdk.COMM_SUCCESS:
                    break
            if result != dynamixel_sdk.COMM_SUCCESS:
                raise self._lost(number, result)
            if value == dynamixel.WATCHDOG_FIRED:
                self._write(number, dynamixel.BUS_WATCHDOG, 0)
                self._write(number, dynamixel.BUS_WATCHDOG,
                            round(WATCHDOG / dynamixel.WATCHDOG_UNIT))

    @property
    def at_limit(self) -> tuple[str, ...]:
        """Return which joints are at a limit, to within 1 degree."""
        return tuple(name for name, angle, (low, high) in
                     zip(('pan', 'tilt'), self.angles, self._limits)
                     if min(angle - low, high - angle) < math.radians(1.0))

    def attitude(self) -> Quaternion:
        """
        Return the attitude of the head, body to world.

        :raises OSError: if the servos cannot be reached
        """
        self.angles = self._read_angles()
        x, y, z, w = gimbal.attitude(*self.angles)
        a, b, c, d = self._mounting
        return (d * x + a * w + b * z - c * y, d * y - a * z + b * w + c * x,
                d * z + a * y - b * x + c * w, d * w - a * x - b * y - c * z)

    def close(self) -> None:
        """Stop the servos where they are, and give the port back."""
        with suppress(OSError):  # they may be gone already
            self.apply((0.0, 0.0, 0.0), 0.0)
        self._port.closePort()
