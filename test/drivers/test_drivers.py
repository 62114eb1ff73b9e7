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

"""Finding and making drivers, and the watchdog before them."""

import contextlib
import math
from pathlib import Path
import socketserver
import sys
import threading

from hypothesis import given
from hypothesis import strategies as st
import numpy as np
import pytest
from tetra_ros2 import drivers
from tetra_ros2.config.parameters import ConfigurationError
from tetra_ros2.drivers import watchdog
from tetra_ros2.formation import rotation
from tetra_ros2.formation.checks import Rejected

EXAMPLES = Path(__file__).parents[2] / 'examples'
RATE = (0.1, 0.2, 0.3)


class Twenty:
    """The smallest driver there is."""

    def __init__(self, speed=1.0):
        self.speed = speed

    def apply(self, angular_velocity, dt):
        """Do nothing."""


@pytest.mark.parametrize(('name', 'message'), [
    ('', "driver: '' is not valid, expected module:Class or one of pan_tilt, rate_setpoint"),
    ('os', 'expected module:Class'),
    ('no_such_module:Class', "no module 'no_such_module'; it is looked for on PYTHONPATH"),
    ('math:Class', "there is no 'Class' in 'math'"),
    ('math:pi', 'has no method apply'),
])
def test_a_driver_that_there_is_not_is_refused(name, message):
    with pytest.raises(ConfigurationError, match=message):
        drivers.find(name)


def test_a_driver_of_ones_own_is_found_and_made():
    kind = drivers.find(f'{__name__}:Twenty')
    assert drivers.make(kind, drivers.options(['speed=2.5'])).speed == 2.5


@pytest.fixture
def here(tmp_path, monkeypatch):
    """Be in a directory of one's own, from which nothing is imported by itself."""
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr(sys, 'path', [p for p in sys.path if p])
    return tmp_path


def test_a_file_in_the_current_directory_is_found(here):
    (here / 'my_own_gimbal.py').write_text('class Gimbal:\n    def apply(self, w, dt): pass\n')
    assert drivers.find('my_own_gimbal:Gimbal').__module__ == 'my_own_gimbal'


@pytest.mark.parametrize(('name', 'text', 'message'), [
    ('broken_1', 'import no_such_library', "ModuleNotFoundError: .*'no_such_library'"),
    ('broken_2', 'class Gimbal', 'SyntaxError: .*line 1'),
    ('broken_3', '1 / 0', r'ZeroDivisionError: .*broken_3.py, line 1'),
])
def test_a_file_that_cannot_be_imported_is_refused_in_one_line(here, name, text, message):
    (here / f'{name}.py').write_text(text)
    with pytest.raises(ConfigurationError, match=f'cannot be imported: {message}') as caught:
        drivers.find(f'{name}:Gimbal')
    assert '\n' not in str(caught.value)


class Failing(Twenty):
    """A driver that fails in its own way."""

    def __init__(self, error):
        raise error('it is\nso')


@pytest.mark.parametrize(('error', 'expected', 'message'), [
    (OSError, OSError, 'it is'),
    (ValueError, ConfigurationError, 'driver_options: Failing: it is'),
    (ZeroDivisionError, ConfigurationError,
     r'driver: Failing: ZeroDivisionError: it is so \(test_drivers.py, line \d+\)'),
])
def test_what_a_driver_raises_when_it_is_made_is_told(error, expected, message):
    with pytest.raises(expected, match=message):
        drivers.make(Failing, {'error': error})


@pytest.mark.parametrize('text', ['speed', '=1', 'a b=1', 'speed=[1'])
def test_an_option_of_another_form_is_refused(text):
    with pytest.raises(ConfigurationError, match='expected name=value'):
        drivers.options([text])


def test_an_option_that_the_driver_does_not_take_is_refused():
    with pytest.raises(ConfigurationError, match=r'driver_options: Twenty: .*colour'):
        drivers.make(Twenty, {'colour': 'red'})


def test_options_are_numbers_lists_or_texts():
    assert drivers.options(['a=1', 'b=[-1.5, 1.5]', 'port=/dev/ttyUSB0', 'c=']) == {
        'a': 1, 'b': [-1.5, 1.5], 'port': '/dev/ttyUSB0', 'c': None}


def test_before_any_command_and_after_a_silence_the_body_is_held():
    dog = watchdog.Watchdog(0.5, 10.0)
    assert dog.rate(0.0) == (watchdog.STILL, watchdog.WAITING)
    dog.command(1, RATE, 0.0)
    assert dog.rate(0.4) == (RATE, watchdog.TURNING)
    assert dog.rate(0.6) == (watchdog.STILL, watchdog.SILENT)
    dog.command(2, RATE, 0.7)
    assert dog.rate(0.7) == (RATE, watchdog.TURNING)


@pytest.mark.parametrize('rate', [(11.0, 0.0, 0.0), (math.nan, 0.0, 0.0), (0.0, math.inf, 0.0)])
def test_a_rate_beyond_limits_holds_the_body_until_a_good_one_comes(rate):
    dog = watchdog.Watchdog(0.5, 10.0)
    dog.command(1, RATE, 0.0)
    with pytest.raises(Rejected):
        dog.command(2, rate, 0.1)
    assert dog.rate(0.1) == (watchdog.STILL, watchdog.TOO_FAST)
    dog.command(3, RATE, 0.2)
    assert dog.rate(0.2) == (RATE, watchdog.TURNING)


def test_an_old_command_is_not_followed_unless_the_one_who_commands_was_started_anew():
    dog = watchdog.Watchdog(0.5, 10.0)
    dog.command(100, RATE, 0.0)
    with pytest.raises(Rejected):
        dog.command(99, (1.0, 0.0, 0.0), 0.1)
    assert dog.rate(0.1) == (RATE, watchdog.TURNING)
    dog.command(1, RATE, 5.0)
    assert dog.rate(5.0) == (RATE, watchdog.TURNING)


@given(st.lists(st.tuples(st.integers(0, 5), st.floats(-20.0, 20.0)), max_size=30))
def test_nothing_but_its_release_ends_an_emergency_stop(commands):
    dog = watchdog.Watchdog(0.5, 10.0)
    dog.stopped = True
    for k, (stamp, x) in enumerate(commands):
        with contextlib.suppress(Rejected):
            dog.command(stamp, (x, 0.0, 0.0), 0.1 * k)
        assert dog.rate(0.1 * k) == (watchdog.STILL, watchdog.STOPPED)
    dog.stopped = False
    dog.command(10, RATE, 100.0)
    assert dog.rate(100.0) == (RATE, watchdog.TURNING)


class Head(socketserver.StreamRequestHandler):
    """A gimbal over TCP that turns for 10 ms with each line."""

    def handle(self):
        angles = [0.3, -0.2]
        for line in self.rfile:
            rates = map(float, line.split())
            angles = [a + 0.01 * rate for a, rate in zip(angles, rates)]
            self.wfile.write(f'{angles[0]} {angles[1]}\n'.encode())


def test_the_driver_of_the_documentation_turns_its_gimbal(monkeypatch):
    monkeypatch.syspath_prepend(EXAMPLES)
    with socketserver.TCPServer(('127.0.0.1', 0), Head) as server:
        thread = threading.Thread(target=server.handle_request, daemon=True)
        thread.start()
        head = drivers.make(drivers.find('my_gimbal:Gimbal'), drivers.options(
            [f'address=127.0.0.1:{server.server_address[1]}']))
        axis = rotation.rotate(np.array(head.attitude()), [1.0, 0.0, 0.0])
        for _ in range(50):
            before = np.array(head.attitude())
            head.apply((0.0, 0.4, -0.6), 0.01)
        turned = rotation.log(rotation.multiply(rotation.inverse(before), np.array(
            head.attitude()))) / 0.01
        assert turned[1:] == pytest.approx([0.4, -0.6], abs=1e-2)  # and it rolls as it must
        assert not np.allclose(axis, rotation.rotate(np.array(head.attitude()), [1.0, 0.0, 0.0]))
        head.close()
    with pytest.raises(OSError):
        drivers.make(drivers.find('my_gimbal:Gimbal'), {'address': '127.0.0.1:1'})
