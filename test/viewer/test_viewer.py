# Copyright 2026 The tetra_ros2 authors
# SPDX-License-Identifier: Apache-2.0

"""The viewer in a real browser: what it shows, what its buttons do, what it survives."""

from contextlib import closing
import os
from pathlib import Path
import re
import shutil
import signal
import socket
import time

import bags
from harness import DEADLINE, interrupt, run
import numpy as np
import pytest
from rcl_interfaces.srv import GetParameters

from tetra_ros2.drawing import colors
from tetra_ros2.formation import topology
from tetra_ros2.viewer import history

ARTEFACTS = Path(os.environ.get(
    'TETRA_ARTEFACTS', Path(__file__).parents[2] / 'build' / 'screenshots'))
"""Where screenshots are kept."""

FLAGS = ['--no-sandbox', '--disable-quic', '--no-first-run', '--disable-background-networking',
         '--disable-component-update', '--disable-sync', '--use-gl=angle',
         '--use-angle=swiftshader', '--enable-unsafe-swiftshader']
SLOWLY = ('--ros-args', '-p', 'real_time_factor:=1.0')

pytestmark = pytest.mark.timeout(300)


@pytest.fixture(scope='module')
def chromium():
    program = next(filter(None, map(shutil.which, ('chromium', 'chromium-browser',
                                                   'google-chrome'))), None)
    if program is None:
        pytest.fail('the viewer is tested in a real browser: apt install chromium', pytrace=False)
    from playwright.sync_api import sync_playwright
    with sync_playwright() as playwright:
        browser = playwright.chromium.launch(executable_path=program, headless=True, args=FLAGS)
        with closing(browser):
            yield browser


@pytest.fixture
def open_page(chromium):
    """Return a function that opens an address in a browser of its own, and waits for the page."""
    contexts = []

    def open_(port):
        contexts.append(context := chromium.new_context(viewport={'width': 1200, 'height': 800}))
        page = context.new_page()
        page.set_default_timeout(1000.0 * DEADLINE)
        page.elsewhere = []
        page.on('request', lambda request: page.elsewhere.append(request.url)
                if not re.match(rf'(blob:)?https?://127\.0\.0\.1:{port}/', request.url) else None)
        page.goto(f'http://127.0.0.1:{port}/')
        page.get_by_text('charts', exact=True).wait_for()
        return page

    yield open_
    for context in contexts:
        context.close()


@pytest.fixture
def port():
    with socket.socket() as probe:
        probe.bind(('127.0.0.1', 0))
        return probe.getsockname()[1]


def wait_for_server(port):
    deadline = time.monotonic() + DEADLINE
    while True:
        try:
            socket.create_connection(('127.0.0.1', port), timeout=1.0).close()
            return
        except OSError:
            assert time.monotonic() < deadline, f'nobody listens on port {port}'
            time.sleep(0.05)


def until(page, condition, what):
    """Let a page live until a condition holds, and return what it returned."""
    deadline = time.monotonic() + DEADLINE
    while not (result := condition()):
        assert time.monotonic() < deadline, f'{what}: not within {DEADLINE} s; {status(page)}'
        page.wait_for_timeout(50)
    return result


def status(page):
    return re.search(r'.*(waiting|agents|states).*', page.inner_text('body'))[0]


def shown_time(page):
    """Return the formation time that a page shows [s], or None."""
    found = re.search(r't = ([\d.]+) s', page.inner_text('body'))
    return found and float(found[1])


def charts(page):
    """Return the charts of a page: their data, and how often each was built."""
    return page.evaluate(
        'Object.values(window.__viserTestpoints?.uplots ?? {}).map('
        'u => [u.chart.data.map(d => Array.from(d)), u.createCount])')


def picture(page, name):
    """Keep a screenshot, and return its pixels."""
    from PIL import Image
    for button in page.locator('.mantine-Notification-closeButton').all():
        button.click()  # no GPU in here, it says
    page.mouse.move(400, 780)
    page.wait_for_timeout(1500)  # and what was paused comes to rest in the picture too
    ARTEFACTS.mkdir(parents=True, exist_ok=True)
    path = ARTEFACTS / f'{name}.png'
    page.screenshot(path=path)
    with Image.open(path) as image:
        return np.asarray(image.convert('RGB')).astype(int)


def hue(rgb):
    """Return hue [deg] and saturation, ``(...)``: what light and haze leave of a colour."""
    r, g, b = np.moveaxis(np.asarray(rgb, dtype=float), -1, 0)
    most, least = np.max(rgb, axis=-1), np.min(rgb, axis=-1)
    angle = np.degrees(np.arctan2(np.sqrt(3.0) * (g - b), 2.0 * r - g - b)) % 360.0
    return angle, (most - least) / np.maximum(most, 1)


def pixels_like(pixels, color):
    """Return how many pixels of the scene have the hue of a colour."""
    angle, saturation = hue(pixels[250:, :800])
    off = np.abs((angle - hue(colors.rgb(color))[0] + 180.0) % 360.0 - 180.0)
    return int(np.sum((off < 12.0) & (saturation > 0.25)))


def test_the_page_shows_labelled_axes_and_moving_charts(open_page, processes, probe, port):
    processes.tetra('launcher', '--config', 'rotating', '--view', '--port', port, '--duration',
                    '1000')
    probe.listen_to_attitudes()
    wait_for_server(port)
    page = open_page(port)
    for i in range(1, 5):
        page.get_by_text(f'agent {i}', exact=True).wait_for()
    page.get_by_text('-0.3333', exact=True).wait_for()
    page.get_by_text('0.5774').wait_for()  # the predicted spin, once the agents have told
    page.get_by_text('1.5220').wait_for()  # and the rate of decay
    first = until(page, lambda: len(data := charts(page)) == 2 and data, 'both charts')
    later = until(page, lambda: (data := charts(page))[0][0][0][-1] > first[0][0][0][-1] + 2.0
                  and data, 'time in the charts')
    (cosines, built), (error, built_too) = later
    assert len(cosines) == 1 + 6 + 1, 'time, six cosines, one target'
    assert (built, built_too) == (1, 1), 'new data never means a new chart'
    np.testing.assert_allclose(cosines[-1], -1.0 / 3.0, atol=1e-6)
    assert np.max(np.abs(cosines[1:-1])) <= 1.0
    assert np.all(np.isfinite(error))
    page.get_by_text('Pause', exact=True).click()
    page.get_by_text('Go on', exact=True).wait_for()
    page.wait_for_timeout(2500)  # longer than a plant may be silent
    assert 'paused' in status(page)
    pixels = picture(page, 'viewer')
    for i in range(1, 5):
        assert pixels_like(pixels, colors.agent(i)) > 100, f'agent {i}'
    assert not page.elsewhere, 'it needs no network'


def moving(probe):
    """Return whether the last states on the topic differ."""
    states = probe.received['formation/attitudes'][-5:]
    points = np.array([[[p.position.x, p.position.y, p.position.z] for p in s.poses]
                       for s in states])
    return len(points) == 5 and float(np.max(np.ptp(points, axis=0))) > 0.0


def test_buttons_act_on_the_topics_and_a_second_browser_sees_the_same(
        open_page, processes, probe, port):
    processes.tetra('launcher', '--config', 'rotating', '--duration', '1e6', *SLOWLY)
    processes.tetra('viewer', '--port', port)
    probe.listen_to_attitudes()
    wait_for_server(port)
    page, second = open_page(port), open_page(port)
    probe.wait_for(lambda: moving(probe), 'motion')

    page.get_by_role('button', name='Pause').click()
    second.get_by_text('Go on', exact=True).wait_for()
    probe.wait_for(lambda: not moving(probe), 'rest')
    stamp = probe.stamp()
    received = len(probe.received['formation/attitudes'])
    probe.wait_for(lambda: len(probe.received['formation/attitudes']) > received + 5, 'repeats')
    assert probe.stamp() == stamp
    until(page, lambda: shown_time(page) == shown_time(second), 'the same time in both')

    second.get_by_role('button', name='Go on').click()
    page.get_by_role('button', name='Pause').wait_for()
    probe.wait_for(lambda: moving(probe), 'motion')

    def jumps():
        points = probe.received['formation/attitudes'][-400:]
        states = np.array([[[p.position.x, p.position.y, p.position.z] for p in s.poses]
                           for s in points])
        return np.max(np.linalg.norm(np.diff(states, axis=0), axis=-1)) > 0.3

    for name in ('Reset', 'New random start'):
        probe.received['formation/attitudes'].clear()
        probe.wait_for(lambda: len(probe.received['formation/attitudes']) > 5, 'states')
        page.get_by_text(name, exact=True).click()
        probe.wait_for(jumps, f'{name} starts it anew')
        page.get_by_text('at new random attitudes').first.wait_for()
        page.get_by_text('at new random attitudes').first.wait_for(state='hidden')

    box = page.locator('input:visible').first
    until(page, lambda: box.is_enabled() and box.input_value() == '1', 'the gain')
    box.fill('2.5')
    box.press('Enter')

    def gains():
        return {probe.call(GetParameters, f'agent_{i}/get_parameters', GetParameters.Request(
            names=['gain.a'])).values[0].double_value for i in range(1, 5)}

    until(page, lambda: gains() == {2.5}, 'the gain of all agents')
    page.get_by_text('1.4434').wait_for()  # theory follows: 2.5 times as fast
    second.get_by_text('1.4434').wait_for()

    page.get_by_text('max', exact=True).click()
    stamp, begun = probe.stamp(), time.monotonic()
    probe.wait_for(lambda: probe.stamp() > stamp + 20e9, 'twenty seconds of formation time')
    assert time.monotonic() - begun < 15.0, 'it runs as fast as it goes'


def test_it_copes_with_a_plant_that_goes_and_another_that_comes(open_page, processes, port):
    viewer = processes.tetra('viewer', '--port', port)
    wait_for_server(port)
    page = open_page(port)
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


def test_somebody_elses_plant_without_agents_parameters_is_shown(open_page, processes, port):
    processes.python(Path(__file__).parents[1] / 'foreign_plant.py')
    processes.tetra('viewer', '--port', port)
    wait_for_server(port)
    page = open_page(port)
    page.get_by_text('4 agents').wait_for()
    first = until(page, lambda: shown_time(page), 'a time')
    until(page, lambda: shown_time(page) > first + 1.0, 'time that passes')
    assert len(until(page, lambda: charts(page), 'charts')) == 2
    pause = page.get_by_role('button', name='Pause')
    until(page, pause.is_disabled, 'no service, no button')


def test_a_thousand_states_a_second_make_thirty_pictures(open_page, processes, probe, port):
    from harness import values
    processes.tetra('launcher', '--mode', 'realtime', '--duration', '1e6', '--ros-args', '-p',
                    'rate:=1000.0')
    processes.tetra('viewer', '--port', port)
    wait_for_server(port)
    page = open_page(port)
    until(page, lambda: charts(page), 'charts')

    def busy(health):
        return 'picture rate [Hz]' in (v := values(health)) \
            and float(v['state rate [Hz]']) > 300.0 and float(v['picture rate [Hz]']) > 10.0

    health = probe.wait_for_health('/viewer', busy, 'pictures')
    assert float(values(health)['picture rate [Hz]']) < 33.0
    before = charts(page)
    until(page, lambda: charts(page)[0][0][0][-1] > before[0][0][0][-1] + 3.0, 'three seconds')
    assert [built for _, built in charts(page)] == [1, 1], 'nothing was taken away and put back'


def test_a_recording_plays_and_its_slider_goes_anywhere(open_page, processes, port, tmp_path):
    bags.write(tmp_path / 'bag', 2000, topology.rotating())
    viewer = processes.tetra('viewer', '--bag', tmp_path / 'bag', '--port', port)
    wait_for_server(port)
    page = open_page(port)
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
    picture(page, 'viewer_bag')
    page.get_by_text('16', exact=True).click()
    page.get_by_role('button', name='Play').click()
    until(page, lambda: shown_time(page) == pytest.approx(19.99, abs=0.01), 'the end')
    page.get_by_role('button', name='Play').wait_for()
    assert interrupt(viewer)[0] == 0


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


def test_a_history_keeps_half_a_minute_and_begins_anew_with_the_plant():
    past = history.History()
    for k in range(100_000):
        past.add(10**9 + k * 10**6, np.full((2, 3), float(k)))
    times, gamma = past.samples()
    assert times[-1] == pytest.approx(99.999)
    assert times[0] >= 99.999 - history.WINDOW - 0.1
    assert len(times) <= history.SAMPLES + 1
    assert gamma[-1, 0, 0] == 99_999
    trail = past.trail(3.0)
    assert len(trail) == pytest.approx(61, abs=2)
    past.add(10**9, np.zeros((2, 3)))
    assert len(past.samples()[0]) == 1
    past.add(2 * 10**9, np.zeros((3, 3)))
    assert past.samples()[1].shape == (1, 3, 3)


def test_signals_end_the_viewer_of_a_recording(processes, port, tmp_path):
    bags.write(tmp_path / 'bag', 50)
    viewer = processes.tetra('viewer', '--bag', tmp_path / 'bag', '--port', port)
    wait_for_server(port)
    viewer.send_signal(signal.SIGTERM)
    output, _ = viewer.communicate(timeout=DEADLINE)
    assert viewer.returncode == 0
    assert 'Traceback' not in output
