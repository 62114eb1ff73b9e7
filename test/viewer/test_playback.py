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

"""The viewer of a recording, in a real browser and as a page without a server."""

from pathlib import Path
import signal

import bags
from browser import (
    charts,
    CHEAP_PICTURES,
    dismiss,
    has_hue,
    is_whole,
    open_page,
    pixels,
    shown_time,
    until,
    wait_for_server,
)
from harness import DEADLINE, interrupt, run
import numpy as np
import pytest
from tetra_ros2 import signals
from tetra_ros2.cli import main
from tetra_ros2.drawing import colors
from tetra_ros2.formation import topology
from tetra_ros2.viewer import export

pytestmark = pytest.mark.timeout(300)

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
    context.add_init_script(CHEAP_PICTURES)
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


def test_signals_end_the_viewer_of_a_recording(processes, port, tmp_path):
    bags.write(tmp_path / 'bag', 50)
    viewer = processes.tetra('viewer', '--bag', tmp_path / 'bag', '--port', port)
    wait_for_server(port)
    viewer.send_signal(signal.SIGTERM)
    output, _ = viewer.communicate(timeout=DEADLINE)
    assert viewer.returncode == 0
    assert 'Traceback' not in output
