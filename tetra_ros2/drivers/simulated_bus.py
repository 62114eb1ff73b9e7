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
A bus of Dynamixel servos that are not there, on a pseudo-terminal.

For trying a driver at a desk::

    python -m tetra_ros2.drivers.simulated_bus /tmp/gimbal
    tetra body --id 4 --driver pan_tilt --option port=/tmp/gimbal

It speaks Protocol 2.0 from the public description of it: ping, read, write, and the synchronous
kinds of the two. The servos turn as fast as they are told, and stop when the line falls silent
for as long as their bus watchdog says.
"""

from collections.abc import Sequence
import contextlib
import os
from pathlib import Path
import select
import struct
import sys
import threading
import time
import tty

from tetra_ros2.drivers import dynamixel

HEADER = b'\xff\xff\xfd\x00'
BROADCAST = 0xFE
PING, READ, WRITE, STATUS, SYNC_READ, SYNC_WRITE = 0x01, 0x02, 0x03, 0x55, 0x82, 0x83
ACCESS_ERROR = 0x07
MODEL = 1020  # XM430-W350


def crc(data: bytes) -> int:
    """Return the checksum of Protocol 2.0: CRC-16 of the polynomial 0x8005, from 0."""
    value = 0
    for byte in data:
        value ^= byte << 8
        for _ in range(8):
            value = (value << 1) ^ 0x8005 if value & 0x8000 else value << 1
            value &= 0xFFFF
    return value


class Servo:
    """
    One servo, as its control table.

    :param position: where it starts [rad] from the middle of its turn
    """

    def __init__(self, position: float = 0.0) -> None:
        self.position = position
        self.table = bytearray(256)
        self._at = self._heard = time.monotonic()

    @property
    def velocity(self) -> float:
        """Return how fast it turns [rad/s]."""
        if not self.table[dynamixel.TORQUE_ENABLE] or self.table[dynamixel.OPERATING_MODE] \
                != dynamixel.VELOCITY_MODE:
            return 0.0
        goal, = struct.unpack_from('<i', self.table, dynamixel.GOAL_VELOCITY)
        return float(goal * dynamixel.VELOCITY_UNIT)

    def update(self) -> None:
        """Let it have turned until now."""
        now = time.monotonic()
        watchdog = self.table[dynamixel.BUS_WATCHDOG]
        end = now
        if 0 < watchdog < dynamixel.WATCHDOG_FIRED:
            patience = self._heard + watchdog * dynamixel.WATCHDOG_UNIT
            end = min(now, max(patience, self._at))
        self.position += (end - self._at) * self.velocity
        if end < now:
            self.table[dynamixel.BUS_WATCHDOG] = dynamixel.WATCHDOG_FIRED
            struct.pack_into('<i', self.table, dynamixel.GOAL_VELOCITY, 0)
        self._at = now
        count = round(self.position / dynamixel.POSITION_UNIT) + dynamixel.CENTER
        struct.pack_into('<i', self.table, dynamixel.PRESENT_POSITION, count)
        struct.pack_into('<i', self.table, dynamixel.PRESENT_VELOCITY,
                         round(self.velocity / dynamixel.VELOCITY_UNIT))

    def heard(self) -> None:
        """Take note that there is traffic on the line."""
        self._heard = time.monotonic()

    def write(self, address: int, data: bytes) -> bool:
        """Return whether a register took these bytes."""
        goal = address <= dynamixel.GOAL_VELOCITY < address + len(data)
        if goal and self.table[dynamixel.BUS_WATCHDOG] == dynamixel.WATCHDOG_FIRED:
            return False
        if address <= dynamixel.OPERATING_MODE < address + len(data) \
                and self.table[dynamixel.TORQUE_ENABLE]:
            return False
        self.table[address:address + len(data)] = data
        return True


class SimulatedBus:
    """
    Servos on a pseudo-terminal, in a thread; a context manager.

    :param path: where the port is to be found, a symbolic link
    :param positions: where the servos 1, 2 ... start [rad]
    """

    def __init__(self, path: str | Path, positions: Sequence[float] = (0.0, 0.0)) -> None:
        self.path = Path(path)
        self.servos = {i: Servo(p) for i, p in enumerate(positions, start=1)}
        self.packets = 0
        self._master: int | None = None
        self._slave: int | None = None
        self._thread: threading.Thread | None = None
        self._leave = threading.Event()

    def __enter__(self) -> 'SimulatedBus':
        """Plug it in."""
        self.plug()
        return self

    def __exit__(self, *_: object) -> None:
        """Unplug it."""
        self.unplug()

    def plug(self) -> None:
        """Let the port appear."""
        self._master, self._slave = os.openpty()
        tty.setraw(self._slave)
        self.path.unlink(missing_ok=True)
        self.path.symlink_to(os.ttyname(self._slave))
        self._leave.clear()
        self._thread = threading.Thread(target=self._serve, args=(self._master,), daemon=True)
        self._thread.start()

    def unplug(self) -> None:
        """Let the port vanish, as that of a cable pulled out does."""
        if self._thread is None:
            return
        self._leave.set()
        self._thread.join()
        self._thread = None
        self.path.unlink(missing_ok=True)
        for end in (self._master, self._slave):
            if end is not None:
                os.close(end)

    def _serve(self, master: int) -> None:
        waiting = b''
        while not self._leave.is_set():
            ready, _, _ = select.select([master], [], [], 0.02)
            for servo in self.servos.values():
                servo.update()
            if not ready:
                continue
            try:
                waiting += os.read(master, 4096)
            except OSError:
                time.sleep(0.01)  # nobody has the port open
                continue
            for servo in self.servos.values():
                servo.heard()
            waiting = self._take(waiting, master)

    def _take(self, data: bytes, master: int) -> bytes:
        """Answer all whole packets; return what is left."""
        while (begin := data.find(HEADER)) >= 0 and len(data) >= begin + 7:
            length = data[begin + 5] | data[begin + 6] << 8
            end = begin + 7 + length
            if len(data) < end:
                return data[begin:]
            packet, data = data[begin:end], data[end:]
            if crc(packet[:-2]) == packet[-2] | packet[-1] << 8:
                self.packets += 1
                body = packet[8:-2].replace(b'\xff\xff\xfd\xfd', b'\xff\xff\xfd')
                answer = self._answer(packet[4], packet[7], body)
                if answer:
                    with contextlib.suppress(OSError):
                        os.write(master, answer)
        return data if data.find(HEADER) >= 0 else data[-3:]

    def _answer(self, number: int, instruction: int, body: bytes) -> bytes:
        if instruction == SYNC_READ:
            address, length = struct.unpack_from('<HH', body)
            return b''.join(self._read(i, address, length) for i in body[4:] if i in self.servos)
        if instruction == SYNC_WRITE:
            address, length = struct.unpack_from('<HH', body)
            for k in range(4, len(body), length + 1):
                if body[k] in self.servos:
                    self.servos[body[k]].write(address, body[k + 1:k + 1 + length])
            return b''
        servo = self.servos.get(number)
        if servo is None:
            return b''
        if instruction == PING:
            return self._status(number, struct.pack('<HB', MODEL, 50))
        if instruction == READ:
            return self._read(number, *struct.unpack_from('<HH', body))
        if instruction == WRITE:
            address, = struct.unpack_from('<H', body)
            done = servo.write(address, body[2:])
            return self._status(number, b'', 0 if done else ACCESS_ERROR)
        return b''

    def _read(self, number: int, address: int, length: int) -> bytes:
        servo = self.servos[number]
        servo.update()
        return self._status(number, bytes(servo.table[address:address + length]))

    @staticmethod
    def _status(number: int, data: bytes, error: int = 0) -> bytes:
        body = (bytes([STATUS, error]) + data).replace(b'\xff\xff\xfd', b'\xff\xff\xfd\xfd')
        packet = HEADER + struct.pack('<BH', number, len(body) + 2) + body
        return packet + struct.pack('<H', crc(packet))


def main() -> None:
    """Serve two servos until Ctrl-C."""
    path = sys.argv[1] if len(sys.argv) == 2 else '/tmp/tetra_gimbal'
    with SimulatedBus(path), contextlib.suppress(KeyboardInterrupt):
        print(f'two servos on {path}; Ctrl-C unplugs them', flush=True)
        while True:
            time.sleep(1.0)


if __name__ == '__main__':
    main()
