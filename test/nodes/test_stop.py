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

"""The emergency stop from the command line: whom it stops, and what it says of those."""

from concurrent.futures import ThreadPoolExecutor
from contextlib import suppress

import pytest
from std_srvs.srv import SetBool, Trigger
from tetra_ros2.nodes import stop


@pytest.fixture
def press(probe, capfd, monkeypatch):
    """Return what presses the button while the probe answers: exit status, output, errors."""
    def pressed(data=True, namespace='', patience=30.0, again=60.0):
        monkeypatch.setattr(stop, 'PATIENCE', patience)
        monkeypatch.setattr(stop, 'ASK_AGAIN', again)
        with ThreadPoolExecutor(1) as pool:
            future = pool.submit(stop.main, data, namespace)
            status = probe.wait_for(lambda: future.done() and (future.result(),), 'the end')[0]
        return status, *capfd.readouterr()
    return pressed


@pytest.fixture
def offer(probe):
    """Return what offers a service that writes down what it is asked."""
    asked = []

    def made(name, success=True, kind=SetBool):
        def answer(request, response):
            asked.append((name, getattr(request, 'data', None)))
            response.success, response.message = success, 'as you say'
            return response
        probe.node.create_service(kind, name, answer)
        return asked
    return made


@pytest.mark.parametrize('data', [True, False])
def test_the_plant_and_all_bodies_are_told_and_nobody_else(offer, press, data):
    for name in ('body_12/stop', 'plant/stop', 'body_3/stop'):
        offer(name)
    offer('camera/stop')
    offer('body_x/stop')
    offer('elsewhere/body_1/stop')
    asked = offer('body_4/stop', kind=Trigger)
    status, output, errors = press(data)
    assert sorted(asked) == [(f'{n}/stop', data) for n in ('body_12', 'body_3', 'plant')]
    assert output == ''.join(
        f'/{n}/stop: as you say\n' for n in ('body_12', 'body_3', 'plant'))
    assert (status, errors) == (0, '')


def test_only_the_formation_of_the_namespace_is_stopped(offer, press):
    offer('a/b/body_1/stop')
    asked = offer('body_1/stop')
    status, output, _ = press(namespace='/a/b')
    assert asked == [('a/b/body_1/stop', True)]
    assert (status, output) == (0, '/a/b/body_1/stop: as you say\n')


def test_a_body_that_does_not_stop_is_no_success(offer, press):
    offer('body_1/stop', success=False)
    offer('body_2/stop')
    status, output, _ = press()
    assert (status, output) == (1, '/body_1/stop: no answer\n/body_2/stop: as you say\n')


def test_with_nothing_to_stop_it_gives_up_and_says_so(press):
    status, output, errors = press(patience=0.5)
    assert (status, output) == (1, '')
    assert errors.startswith('tetra: error: there is nothing to stop')


def test_who_does_not_answer_is_asked_again(probe, press, monkeypatch):
    asked = []

    def answer(request, response):
        asked.append(request.data)
        if len(asked) == 1:
            raise LookupError('to whom?')
        response.success, response.message = True, 'stopped'
        return response

    def spin_once(timeout_sec, spin=probe.executor.spin_once):
        with suppress(LookupError):
            spin(timeout_sec)

    monkeypatch.setattr(probe.executor, 'spin_once', spin_once)
    probe.node.create_service(SetBool, 'plant/stop', answer)
    assert press(again=0.5) == (0, '/plant/stop: stopped\n', '')
    assert len(asked) >= 2
    assert all(asked)
