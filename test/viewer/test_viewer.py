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

"""The viewer in a real browser: what it shows, what its buttons do, what it survives."""

import time

from browser import (
    charts,
    dismiss,
    free_port,
    has_hue,
    is_whole,
    note_least_time,
    pixels,
    shown_time,
    status,
    until,
    wait_for_server,
)
from diagnostic_msgs.msg import DiagnosticArray
from harness import interrupt, Probe, Processes, values
import numpy as np
import pytest
from rcl_interfaces.srv import GetParameters
from tetra_ros2.drawing import colors
from tetra_ros2.wire import names

SIZES = {'usual': (1200, 800), 'small': (800, 600), 'phone': (390, 844)}

pytestmark = pytest.mark.timeout(300)


@pytest.fixture(scope='module')
def probe():
    """Return a node of its own, the same for all tests in here."""
    with Probe('shared') as node:
        node.listen_to_attitudes()
        node.listen(DiagnosticArray, names.DIAGNOSTICS)
        yield node


@pytest.fixture(scope='module')
def formation():
    """Start the rotating formation in one process and a viewer in another; return its port."""
    port = free_port()
    with Processes() as processes:
        processes.tetra('launcher', '--config', 'rotating', '--duration', '1e6', '--namespace',
                        'shared', '--ros-args', '-p', 'real_time_factor:=3.0', '-p', 'rate:=40.0')
        viewer = processes.tetra('viewer', '--port', port, '--namespace', 'shared')
        wait_for_server(port)
        yield port
        code, output = interrupt(viewer)
        assert code == 0
        assert f'open http://127.0.0.1:{port}/ in a browser' in output
        assert 'Traceback' not in output


def moving(probe):
    """Return whether the last states on the topic differ."""
    states = probe.received['formation/attitudes'][-5:]
    points = np.array([[[p.position.x, p.position.y, p.position.z] for p in s.poses]
                       for s in states])
    return len(points) == 5 and float(np.max(np.ptp(points, axis=0))) > 0.0


def paused(probe):
    """Return whether the last states are one and the same, not only of bodies that are held."""
    stamps = [(s.header.stamp.sec, s.header.stamp.nanosec)
              for s in probe.received['formation/attitudes'][-5:]]
    return len(stamps) == 5 and len(set(stamps)) == 1 and not moving(probe)


def rows(page):
    """Return the numbers of the table by name: theory, with sampling, and measured."""
    return {row[0]: row[1:] for row in page.evaluate(
        "Array.from(document.querySelectorAll('table tr')).map("
        'r => Array.from(r.children).map(c => c.innerText.trim()))')}


def test_the_page_shows_labelled_axes_moving_charts_and_what_theory_says(formation, visit):
    page = visit(formation)
    for i in range(1, 5):
        page.get_by_text(f'agent {i}', exact=True).wait_for()
    page.get_by_text('-0.3333', exact=True).wait_for()
    page.get_by_text('0.5774').wait_for()  # the predicted spin, once the agents have told
    page.get_by_text('1.5220').wait_for()  # and the rate of decay
    assert page.title() == 'tetra_ros2'
    first = until(page, lambda: len(data := charts(page)) == 2 and data, 'both charts')
    later = until(page, lambda: (data := charts(page))[0][0][0][-1] > first[0][0][0][-1] + 2.0
                  and data, 'time in the charts')
    (cosines, built), (error, _) = later
    assert len(cosines) == 1 + 6 + 1, 'time, six cosines, one target'
    assert built == 1, 'new data never means a new chart'
    np.testing.assert_allclose(cosines[-1], -1.0 / 3.0, atol=1e-6)
    assert np.max(np.abs(cosines[1:-1])) <= 1.0
    assert np.all(np.isfinite(error))
    text = page.inner_text('body')
    assert 'cos θ₁₂' in text
    assert not page.elsewhere, 'it needs no network'


@pytest.mark.parametrize('size', SIZES)
def test_all_of_the_sphere_is_on_the_page(formation, visit, size):
    page = visit(formation, SIZES[size], '?darkMode' if size == 'small' else '')
    until(page, lambda: shown_time(page), 'a time')
    dismiss(page)
    width = SIZES[size][0] - (420 if size != 'phone' else 0)  # the panel and its shadow

    def whole():
        """Return whether each agent is seen, nothing is cut off, and it is as large as can be."""
        scene = pixels(page, f'viewer_{size}')[:, :width]
        if size == 'phone':  # the panel stands below
            scene = scene[:int(page.locator('canvas').first.bounding_box()['height']) - 20]
        return (
            all(np.any(has_hue(scene, colors.rgb(colors.agent(i)))) for i in range(1, 5))
            and is_whole(scene))

    until(page, whole, 'all of the sphere')


def test_a_measured_decay_is_that_of_the_sampled_loop_and_not_of_an_old_gain(
        formation, visit, probe):
    page = visit(formation)
    page.get_by_text('start anew').wait_for()
    for _ in range(6):
        before = until(page, lambda: (shown := shown_time(page)) > 3.0 and shown, 'time')
        note_least_time(page)
        page.get_by_role('button', name='Reset').click()
        until(page, lambda b=before: page.evaluate('leastTime') < b, 'a new start')
        decay = until(page, lambda: (now := rows(page).get('decay [1/s]'))
                      and (time := shown_time(page)) > 9.0
                      and (now[-1] not in ('—', '') or time > 20.0) and now, 'a decay, or none')
        if decay[-1] not in ('—', ''):
            break
        # The machine is so busy that too few states came meanwhile to tell it.
    theory, sampled, measured = map(float, decay)
    assert theory == pytest.approx(1.522, abs=1e-3)
    assert measured == pytest.approx(sampled, rel=0.02)
    box = page.locator('input:visible').first
    box.fill('2.5')
    box.press('Enter')
    page.get_by_text('1.4434').wait_for()  # theory follows: 2.5 times as fast
    until(page, lambda: rows(page)['decay [1/s]'][-1] == '—' or float(
        rows(page)['decay [1/s]'][-1]) > 3.0, 'the old decay is not told any more')

    def gains():
        return {probe.call(GetParameters, f'agent_{i}/get_parameters', GetParameters.Request(
            names=['gain.a'])).values[0].double_value for i in range(1, 5)}

    until(page, lambda: gains() == {2.5}, 'the gain of all agents')
    box.fill('0')
    box.press('Enter')
    until(page, lambda: gains() == {2.5} and box.input_value() != '0', 'a gain of zero is refused')
    assert 'rclpy' not in page.inner_text('body')
    box.fill('1')
    box.press('Enter')
    until(page, lambda: gains() == {1.0}, 'the gain as it was')


def test_buttons_act_on_the_topics_and_a_second_browser_sees_the_same(formation, visit, probe):
    page, second = visit(formation), visit(formation)
    probe.wait_for(lambda: moving(probe), 'motion')

    page.get_by_role('button', name='Pause').click()
    second.get_by_text('Go on', exact=True).wait_for()
    probe.wait_for(lambda: paused(probe), 'rest')
    stamp = probe.stamp()
    received = len(probe.received['formation/attitudes'])
    probe.wait_for(lambda: len(probe.received['formation/attitudes']) > received + 5, 'repeats')
    assert probe.stamp() == stamp
    until(page, lambda: shown_time(page) == shown_time(second), 'the same time in both')
    page.wait_for_timeout(2500)  # longer than a plant may be silent
    assert 'paused' in status(page)

    second.get_by_role('button', name='Go on').click()
    page.get_by_role('button', name='Pause').wait_for()
    probe.wait_for(lambda: moving(probe), 'motion')
    second.close()

    states = probe.received['formation/attitudes']

    def jumps():
        # At the newest alone, as all come while a busy machine has no time to look at many.
        old, new = (np.array([[p.position.x, p.position.y, p.position.z] for p in state.poses])
                    for state in states[-2:])
        return np.max(np.linalg.norm(new - old, axis=-1)) > 0.3

    for name in ('Reset', 'New random start'):
        before = until(page, lambda: (shown := shown_time(page)) > 3.0 and shown, 'time')
        states.clear()
        probe.wait_for(lambda: len(states) > 5, 'states')
        note_least_time(page)
        page.get_by_text(name, exact=True).click()
        probe.wait_for(jumps, f'{name} starts it anew')
        until(page, lambda b=before: page.evaluate('leastTime') < b, 'the history begins anew')
        until(page, lambda: page.evaluate('leastStart') == 0.0, 'and so does the chart')

    page.get_by_text('max', exact=True).click()
    stamp, begun = probe.stamp(), time.monotonic()
    probe.wait_for(lambda: probe.stamp() > stamp + 50e9, 'fifty seconds of formation time')
    assert time.monotonic() - begun < 15.0, 'as fast as it goes, not three times as fast'
    until(page, lambda: (data := charts(page)) and np.ptp(data[0][0][0]) > 5.0, 'charts')
    assert np.ptp(charts(page)[0][0][0]) < 31.0, 'half a minute, however fast it goes'
    page.get_by_role('button', name='1', exact=True).click()


def test_nothing_on_diagnostics_disturbs_the_viewer(formation, visit, probe):
    publisher = probe.node.create_publisher(DiagnosticArray, names.DIAGNOSTICS, 10)
    probe.wait_for(lambda: publisher.get_subscription_count() > 1, 'the viewer')
    for message in (b'\0\1\0\0', b'', b'\0\1\0\0' + b'\xff' * 40, b'\1', b'x' * 5000):
        publisher.publish(message)

    def counted():
        return any(f'malformed ({names.DIAGNOSTICS})' in key
                   for message in probe.received[names.DIAGNOSTICS][-40:]
                   for health in message.status if health.name == '/shared/viewer'
                   for key in values(health))

    probe.wait_for(counted, 'a count')
    page = visit(formation)
    first = until(page, lambda: shown_time(page), 'a time')
    until(page, lambda: shown_time(page) > first + 0.5, 'time that passes')
