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

from pathlib import Path
import signal
import socket
import time

import bags
from browser import (
    charts,
    dismiss,
    free_port,
    has_hue,
    launch,
    note_least_time,
    open_page,
    pixels,
    shown_time,
    status,
    until,
    wait_for_server,
)
from diagnostic_msgs.msg import DiagnosticArray
from harness import DEADLINE, interrupt, Probe, Processes, run, values
import numpy as np
import pytest
from rcl_interfaces.srv import GetParameters
from tetra_ros2 import signals
from tetra_ros2.cli import main
from tetra_ros2.drawing import colors
from tetra_ros2.formation import topology
from tetra_ros2.viewer import export
from tetra_ros2.viewer.scene import MOST_AGENTS
from tetra_ros2.wire import names

SLOWLY = ('--ros-args', '-p', 'real_time_factor:=1.0')
SIZES = {'usual': (1200, 800), 'small': (800, 600), 'phone': (390, 844)}

pytestmark = pytest.mark.timeout(300)


@pytest.fixture(scope='module')
def chromium():
    with launch() as browser:
        yield browser


@pytest.fixture
def visit(chromium):
    """Return a function that opens an address in a browser of its own, and waits for the page."""
    contexts = []

    # The fewer pixels the better: the processor draws them.
    def open_(port, size=SIZES['small'], query='', watch=None):
        contexts.append(context := chromium.new_context(
            viewport={'width': size[0], 'height': size[1]}))
        page = open_page(context, f'http://127.0.0.1:{port}/{query}', watch)
        page.get_by_text('charts', exact=True).wait_for()
        return page

    yield open_
    for context in contexts:
        context.close()


@pytest.fixture
def port():
    return free_port()


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
                        'shared', *SLOWLY)
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


def is_whole(scene):
    """Return whether what is in a picture is cut off nowhere, and as large as can be."""
    ink = np.max(np.abs(scene - scene[2, 2]), axis=-1) > 6
    rows_, columns = np.flatnonzero(ink.any(axis=1)), np.flatnonzero(ink.any(axis=0))
    height, width = ink.shape
    return (ink.any() and columns[0] > 0 and columns[-1] < width - 1 and rows_[0] > 0
            and rows_[-1] < height - 1 and np.ptp(columns) > 0.5 * min(width, height))


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
    before = until(page, lambda: (shown := shown_time(page)) > 3.0 and shown, 'time')
    note_least_time(page)
    page.get_by_role('button', name='Reset').click()
    until(page, lambda: page.evaluate('leastTime') < before, 'a new start')
    decay = until(page, lambda: (now := rows(page).get('decay [1/s]')) and now[-1] not in ('—', '')
                  and shown_time(page) > 9.0 and now, 'a decay', 2 * DEADLINE)
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
    probe.wait_for(lambda: not moving(probe), 'rest')
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

    def jumps():
        points = probe.received['formation/attitudes'][-400:]
        states = np.array([[[p.position.x, p.position.y, p.position.z] for p in s.poses]
                           for s in points])
        return np.max(np.linalg.norm(np.diff(states, axis=0), axis=-1)) > 0.3

    for name in ('Reset', 'New random start'):
        before = until(page, lambda: (shown := shown_time(page)) > 3.0 and shown, 'time')
        probe.received['formation/attitudes'].clear()
        probe.wait_for(lambda: len(probe.received['formation/attitudes']) > 5, 'states')
        note_least_time(page)
        page.get_by_text(name, exact=True).click()
        probe.wait_for(jumps, f'{name} starts it anew')
        until(page, lambda b=before: page.evaluate('leastTime') < b, 'the history begins anew')
        until(page, lambda: charts(page)[0][0][0][0] == 0.0, 'and so does the chart')

    page.get_by_text('max', exact=True).click()
    stamp, begun = probe.stamp(), time.monotonic()
    probe.wait_for(lambda: probe.stamp() > stamp + 20e9, 'twenty seconds of formation time')
    assert time.monotonic() - begun < 15.0, 'it runs as fast as it goes'
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


def test_it_copes_with_a_plant_that_goes_and_another_that_comes(visit, processes, port):
    viewer = processes.tetra('viewer', '--port', port)
    wait_for_server(port)
    page = visit(port)
    page.get_by_text('waiting').wait_for()
    first = processes.tetra('launcher', '--duration', '1e6', *SLOWLY)
    until(page, lambda: '4 agents, running' in page.inner_text('body'), 'a formation')
    first.kill()
    until(page, lambda: 'is the plant gone?' in page.inner_text('body'), 'the loss is told')
    processes.tetra('launcher', '--config', 'octahedron', '--duration', '1e6', *SLOWLY)
    page.get_by_text('6 agents').wait_for()
    page.get_by_text('agent 6', exact=True).wait_for()
    page.get_by_text('-1.0000, 0.0000').wait_for()  # the cosines of the octahedron
    page.close()
    status_, output = interrupt(viewer)
    assert status_ == 0
    assert f'http://127.0.0.1:{port}' in output
    assert 'Traceback' not in output


def test_somebody_elses_plant_without_agents_parameters_is_shown(visit, processes, port):
    processes.python(Path(__file__).parents[2] / 'examples' / 'own_plant.py')
    processes.tetra('viewer', '--port', port)
    wait_for_server(port)
    page = visit(port)
    page.get_by_text('4 agents').wait_for()
    first = until(page, lambda: shown_time(page), 'a time')
    until(page, lambda: shown_time(page) > first + 1.0, 'time that passes')
    assert len(until(page, lambda: charts(page), 'charts')) == 2
    pause = page.get_by_role('button', name='Pause')
    until(page, pause.is_disabled, 'no service, no button')


def test_a_thousand_states_a_second_make_thirty_pictures(visit, processes, port):
    processes.tetra('launcher', '--mode', 'realtime', '--duration', '1e6', '--ros-args', '-p',
                    'rate:=1000.0')
    processes.tetra('viewer', '--port', port)
    wait_for_server(port)
    page = visit(port)
    until(page, lambda: charts(page), 'charts')

    def busy(health):
        return 'picture rate [Hz]' in (v := values(health)) \
            and float(v['state rate [Hz]']) > 300.0 and float(v['picture rate [Hz]']) > 10.0

    with Probe() as plain:
        health = plain.wait_for_health('/viewer', busy, 'pictures')
    assert float(values(health)['picture rate [Hz]']) < 33.0
    before = charts(page)
    until(page, lambda: charts(page)[0][0][0][-1] > before[0][0][0][-1] + 3.0, 'three seconds')
    assert charts(page)[0][1] == 1, 'nothing was taken away and put back'
    assert charts(page)[1][1] <= 4, 'but for the axis of the error, when it has to go deeper'


def test_a_recording_plays_and_its_slider_goes_anywhere(visit, processes, port, tmp_path):
    bags.write(tmp_path / 'bag', 3000, topology.rotating())
    viewer = processes.tetra('viewer', '--bag', tmp_path / 'bag', '--port', port)
    wait_for_server(port)
    page = visit(port)
    first = until(page, lambda: shown_time(page), 'a time')
    until(page, lambda: shown_time(page) > first + 0.5, 'playing')
    page.get_by_role('button', name='Pause').click()
    page.get_by_role('button', name='Play').wait_for()
    paused = until(page, lambda: shown_time(page), 'a time')
    box = page.locator('input:visible').first
    for moment in ('15', '5'):
        box.fill(moment)
        box.press('Enter')
        until(page, lambda m=moment: shown_time(page) == pytest.approx(float(m), abs=0.02),
              f'the moment {moment}')
        until(page, lambda m=moment: charts(page)[0][0][0][-1] == pytest.approx(
            float(m), abs=0.02), 'charts to that moment')
    assert shown_time(page) != paused
    page.get_by_text('0.5774').wait_for()
    page.get_by_text('16', exact=True).click()
    page.get_by_role('button', name='Play').click()
    until(page, lambda: shown_time(page) == pytest.approx(29.99, abs=0.01), 'the end')
    page.get_by_role('button', name='Play').wait_for()
    assert interrupt(viewer)[0] == 0


def test_a_recording_becomes_a_page_that_plays_without_a_server(chromium, tmp_path):
    bags.write(tmp_path / 'bag', 600, topology.rotating())
    code, output, errors = run('viewer', '--bag', tmp_path / 'bag', '--html', tmp_path / 'x.html')
    assert (code, errors) == (0, '')
    assert 'MB; open it in a browser' in output
    assert (tmp_path / 'x.html').stat().st_size < 1.3e6
    context = chromium.new_context(viewport={'width': 420, 'height': 360}, offline=True)
    try:
        page = open_page(context, f'file://{tmp_path}/x.html')
        page.locator('canvas').first.wait_for()
        clock = page.locator('input').first
        until(page, lambda: float(clock.input_value()) > 0.5, 'time that passes')
        assert page.title() == 'tetra_ros2'
        assert 'bag: 4 agents' in page.inner_text('body')

        def shows_all():
            clock.fill('5.5')  # again and again, as it plays on meanwhile
            clock.press('Enter')
            picture = pixels(page, 'page')
            return all(np.sum(has_hue(picture, colors.rgb(colors.agent(i)))) > 30
                       for i in range(1, 5))

        until(page, shows_all, 'four agents')
        dismiss(page)
        page.set_viewport_size({'width': 300, 'height': 560})  # a phone
        until(page, lambda: is_whole(pixels(page, 'page_phone')[80:-60]), 'all of the sphere')
        assert not page.elsewhere
    finally:
        context.close()


@pytest.mark.parametrize(('arguments', 'key'), [
    (['--html', 'x.html'], '--html'), (['--bag', 'bag', '--html', '.'], '.'),
    (['--bag', 'bag', '--html', 'none/x.html'], 'none/x.html')], ids=str)
def test_a_page_that_cannot_be_written_is_refused_in_one_line(
        tmp_path, monkeypatch, arguments, key):
    monkeypatch.chdir(tmp_path)
    monkeypatch.setenv('PYTHONPATH', str(Path(__file__).parents[2]))
    bags.write(tmp_path / 'bag', 30)
    code, output, errors = run('viewer', *arguments)
    assert (code, output) == (2, '')
    assert errors.startswith(f'tetra: error: {key}: ')
    assert errors.count('\n') == 1


def test_a_page_whose_writing_is_interrupted_is_not_there(tmp_path, monkeypatch):
    def interrupt_it(*_):
        raise KeyboardInterrupt
    bags.write(tmp_path / 'bag', 30)
    monkeypatch.setattr(export.Scene, 'draw', interrupt_it)
    monkeypatch.setattr(signals, 'interrupt_once', lambda: None)  # those here are pytest's
    page = tmp_path / 'x.html'
    assert main(['viewer', '--bag', str(tmp_path / 'bag'), '--html', str(page)]) == \
        signals.INTERRUPTED
    assert not page.exists()


def test_a_run_that_has_ended_is_said_to_have(visit, processes, port):
    process = processes.tetra('launcher', '--duration', '1', '--view', '--port', port, '--quiet')
    wait_for_server(port)
    page = visit(port)
    page.get_by_text('the run has ended').wait_for()
    page.close()
    code, output = interrupt(process)
    assert 'Traceback' not in output
    assert code in (0, 1)


def test_a_thousand_agents_take_little_memory_and_no_faces(visit, processes, port):
    script = (
        'import sys, numpy as np, rclpy\n'
        'from geometry_msgs.msg import Pose, PoseArray\n'
        'rclpy.init()\n'
        'node = rclpy.create_node("plant")\n'
        'publisher = node.create_publisher(PoseArray, "formation/attitudes", 1)\n'
        'rng, k = np.random.default_rng(1), 0\n'
        'while True:\n'
        '    k += 1\n'
        '    points = rng.standard_normal((1000, 3))\n'
        '    points /= np.linalg.norm(points, axis=1, keepdims=True)\n'
        '    message = PoseArray()\n'
        '    message.header.frame_id = "world"\n'
        '    message.header.stamp.sec = k\n'
        '    for x, y, z in points.tolist():\n'
        '        pose = Pose()\n'
        '        pose.position.x, pose.position.y, pose.position.z = x, y, z\n'
        '        message.poses.append(pose)\n'
        '    publisher.publish(message)\n'
        '    rclpy.spin_once(node, timeout_sec=0.05)\n')
    viewer = processes.tetra('viewer', '--port', port)
    wait_for_server(port)
    page = visit(port, watch=(received := []))
    before = memory(viewer.pid)
    processes.python('-c', script)
    page.get_by_text('1000 agents').wait_for()
    first = until(page, lambda: shown_time(page), 'a time')
    sent = sum(received)
    last = until(page, lambda: (now := shown_time(page)) > first + 10.0 and now, 'ten states')
    sent = (sum(received) - sent) / (last - first)
    assert f'More than {MOST_AGENTS} agents' in page.inner_text('body')
    assert not charts(page)
    grown = memory(viewer.pid) - before
    print(f'a thousand agents: {grown / 1e6:.0f} MB more, {sent / 1e3:.0f} kB for each state')
    assert grown < 150e6
    assert 0.0 < sent < 40e3, 'three numbers for each direction take 12 kB'


def memory(pid):
    """Return the resident memory of a process [bytes]."""
    return int(Path(f'/proc/{pid}/statm').read_text().split()[1]) * 4096


def test_it_listens_on_this_machine_only_unless_told_otherwise(processes, port):
    processes.tetra('viewer', '--port', port)
    wait_for_server(port)
    listening = [line.split() for table in ('tcp', 'tcp6')
                 for line in Path(f'/proc/net/{table}').read_text().splitlines()[1:]]
    addresses = [fields[1].split(':')[0] for fields in listening
                 if fields[3] == '0A' and int(fields[1].split(':')[1], 16) == port]
    assert addresses == ['0100007F']


@pytest.mark.parametrize('arguments', [['viewer'], ['launcher', '--view']], ids=str)
def test_a_port_in_use_is_refused_in_one_line(arguments):
    with socket.socket() as taken:
        taken.bind(('127.0.0.1', 0))
        taken.listen()
        status_, _, errors = run(*arguments, '--port', taken.getsockname()[1])
    assert status_ == 2
    line, = (text for text in errors.splitlines() if 'error' in text)
    assert line.startswith('tetra: error: --port: cannot listen on 127.0.0.1')
    assert 'address already in use' in line


def test_what_is_no_recording_is_refused_in_one_line(tmp_path):
    bags.write(tmp_path / 'cut', 100)
    file, = (tmp_path / 'cut').glob('*.mcap')
    file.write_bytes(file.read_bytes()[:2000])
    for bag, reason in ((tmp_path / 'none', 'no such directory'), (tmp_path, 'rosbag2'),
                        (tmp_path / 'cut', 'cut off')):
        status_, output, errors = run('viewer', '--bag', bag)
        assert status_ == 2
        assert errors.startswith(f'tetra: error: {bag}: ')
        assert errors.count('\n') == 1
        assert reason in errors
        assert not output
    for wrong in (['--port', '99999999'], ['--host', '203.0.113.7']):
        status_, _, errors = run('viewer', *wrong)
        assert status_ == 2
        assert errors.splitlines()[-1].startswith('tetra: error: --port: cannot listen on')


def test_lockstep_with_a_view_is_nearly_as_fast(monkeypatch):
    from tetra_ros2.launcher import Launcher
    from tetra_ros2.viewer.node import Viewer
    from tetra_ros2.viewer.panel import Page
    active = [True]
    refresh = Viewer._refresh
    monkeypatch.setattr(Viewer, '_refresh', lambda self: active[0] and refresh(self))
    monkeypatch.setattr(Page, 'watched', True)  # it draws; the browser is on another machine
    ratios = []
    with Launcher('rotating', seed=1, view=('127.0.0.1', 0)) as formation:
        formation.run_for(5.0)
        watchers = formation.monitor._watchers[:]
        for _ in range(12):  # in pairs, as a busy machine is never twice as fast
            seconds = []
            for active[0] in (False, True):
                formation.monitor._watchers[:] = watchers if active[0] else []
                begun = time.process_time()
                formation.run_for(20.0)
                seconds.append(time.process_time() - begun)
            ratios.append(seconds[1] / seconds[0])
    print(f'with a viewer that draws: {np.median(ratios):.3f} of the processor time without')
    assert np.median(ratios) < 1.1


def test_signals_end_the_viewer_of_a_recording(processes, port, tmp_path):
    bags.write(tmp_path / 'bag', 50)
    viewer = processes.tetra('viewer', '--bag', tmp_path / 'bag', '--port', port)
    wait_for_server(port)
    viewer.send_signal(signal.SIGTERM)
    output, _ = viewer.communicate(timeout=DEADLINE)
    assert viewer.returncode == 0
    assert 'Traceback' not in output
