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

"""The pan-tilt head over a serial line, against servos on a pseudo-terminal."""

import math
import time

import numpy as np
import pytest

PacketHandler = pytest.importorskip('dynamixel_sdk').PacketHandler

from tetra_ros2.drivers import dynamixel, pan_tilt  # noqa: E402
from tetra_ros2.drivers.pan_tilt import PanTilt  # noqa: E402
from tetra_ros2.drivers.simulated_bus import crc, SimulatedBus  # noqa: E402
from tetra_ros2.formation import gimbal  # noqa: E402


@pytest.fixture
def bus(tmp_path):
    with SimulatedBus(tmp_path / 'gimbal', (0.3, -0.2)) as made:
        yield made


@pytest.fixture
def patient(monkeypatch):
    """Have a head ask for long: on a busy machine a simulated servo may not answer in time."""
    monkeypatch.setattr(pan_tilt, 'TRIES', 100)


def drive(head, rate, seconds, period=0.01):
    begun = time.monotonic()
    while time.monotonic() - begun < seconds:
        head.apply(rate, period)
        head.attitude()
        time.sleep(period)


def test_the_checksum_is_that_of_the_makers_library():
    packet = [0xFF, 0xFF, 0xFD, 0x00, 0x01, 0x07, 0x00, 0x55, 0x00, 0x06, 0x04, 0x26]
    assert crc(bytes(packet)) == PacketHandler(2.0).updateCRC(0, packet, len(packet))


def test_the_attitude_is_that_of_the_servos(bus):
    head = PanTilt(port=bus.path)
    assert np.allclose(head.attitude(), gimbal.attitude(0.3, -0.2),
                       atol=dynamixel.POSITION_UNIT)
    head.close()


@pytest.mark.usefixtures('patient')
def test_the_head_turns_as_it_is_told(bus):
    head = PanTilt(port=bus.path)
    for sign in (1.0, -1.0, 1.0, -1.0, 1.0):
        head.attitude()
        pan, tilt = head.angles
        begun = time.monotonic()
        drive(head, (0.0, sign * 0.5, sign * 0.8), 0.4)
        elapsed = time.monotonic() - begun
        turned = sign * (head.angles[0] - pan), sign * (head.angles[1] - tilt)
        expected = pytest.approx((0.8 * elapsed / math.cos(0.1), 0.5 * elapsed), rel=0.15)
        if turned == expected:
            break  # otherwise the machine may have been busy, and the servos stopped meanwhile
    assert turned == expected
    head.close()
    deadline = time.monotonic() + 5.0
    while bus.servos[1].velocity or bus.servos[2].velocity:
        assert time.monotonic() < deadline, 'still turning'
        time.sleep(0.01)


def test_a_rate_below_one_unit_of_the_servo_is_right_in_the_mean(bus):
    head = PanTilt(port=bus.path)
    rate = 0.3 * dynamixel.VELOCITY_UNIT
    sent = []
    for _ in range(100):
        head.apply((0.0, rate, 0.0), 0.01)
        sent.append(head._left[1])
    assert max(map(abs, sent)) <= 0.5 + 1e-9  # never more behind than half a unit
    head.close()


@pytest.mark.usefixtures('patient')
def test_limits_are_kept(bus):
    head = PanTilt(port=bus.path, tilt_limits=(-0.25, 0.25))
    deadline = time.monotonic() + 30.0
    while head.at_limit != ('tilt',):
        assert time.monotonic() < deadline
        drive(head, (0.0, 5.0, 0.0), 0.1)
    drive(head, (0.0, 5.0, 0.0), 1.0)
    assert head.angles[1] < 0.25 + 0.02
    assert head.at_limit == ('tilt',)
    head.close()


def test_servos_stop_by_themselves_when_the_line_falls_silent_and_go_on_when_it_is_back(
        bus, patient):
    head = PanTilt(port=bus.path)
    head.apply((0.0, 1.0, 0.0), 0.01)
    deadline = time.monotonic() + 5.0
    while bus.servos[2].velocity:
        assert time.monotonic() < deadline
        time.sleep(0.01)
    stopped = bus.servos[2].position
    assert stopped + 0.2 < 0.5
    deadline = time.monotonic() + 30.0
    while bus.servos[2].position <= stopped + 0.1:  # within CHECK_EVERY commands
        assert time.monotonic() < deadline
        drive(head, (0.0, 1.0, 0.0), 0.05)
    head.close()


def test_a_port_that_is_not_there_is_named(tmp_path):
    with pytest.raises(OSError, match='nowhere') as caught:
        PanTilt(port=tmp_path / 'nowhere')
    assert '\n' not in str(caught.value)


def test_a_servo_that_does_not_answer_is_named(bus):
    with pytest.raises(OSError, match='servo 7'):
        PanTilt(port=bus.path, tilt_id=7)


def test_unplugged_it_raises_an_error_and_can_be_made_anew(bus):
    head = PanTilt(port=bus.path)
    bus.unplug()
    with pytest.raises(OSError):
        for _ in range(10):
            head.attitude()
    head.close()
    with pytest.raises(OSError):
        PanTilt(port=bus.path)
    bus.plug()
    again = PanTilt(port=bus.path)
    assert again.angles == pytest.approx((0.3, -0.2), abs=2 * dynamixel.POSITION_UNIT)
    again.close()
