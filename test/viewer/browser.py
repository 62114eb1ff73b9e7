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

"""A real browser to look at the viewer with, and what is to be seen in it."""

from contextlib import closing, contextmanager
import os
from pathlib import Path
import re
import shutil
import socket
import time

from harness import DEADLINE
import numpy as np
import pytest

ARTEFACTS = Path(os.environ.get(
    'TETRA_ARTEFACTS', Path(__file__).parents[2] / 'build' / 'screenshots'))
"""Where screenshots are kept."""

FLAGS = ['--no-sandbox', '--disable-quic', '--no-first-run', '--disable-background-networking',
         '--disable-component-update', '--disable-sync', '--use-gl=angle',
         '--use-angle=swiftshader', '--enable-unsafe-swiftshader']

CHEAP_PICTURES = """
    const now = () => performance.now();
    window.requestAnimationFrame = f => setTimeout(() => f(now()), 200);
    window.cancelAnimationFrame = clearTimeout;
    const getContext = HTMLCanvasElement.prototype.getContext;
    HTMLCanvasElement.prototype.getContext = function (kind, options) {
        return getContext.call(this, kind, {...options, antialias: false});
    };
"""
"""
Makes a browser draw five pictures a second, with edges that are not smooth.

The processor draws them, which others want: smooth edges cost four times as much.
"""


@contextmanager
def launch():
    """Give a browser, or fail with the reason."""
    program = next(filter(None, map(shutil.which, ('chromium', 'chromium-browser',
                                                   'google-chrome'))), None)
    if program is None:
        pytest.fail('the viewer is tested in a real browser: apt install chromium', pytrace=False)
    from playwright.sync_api import sync_playwright
    with sync_playwright() as playwright, closing(playwright.chromium.launch(
            executable_path=program, headless=True, args=FLAGS)) as browser:
        yield browser


def open_page(context, address, received=None):
    """
    Open an address, and note what the page asks of other places.

    :param received: a list to which the sizes of all messages to the page are added [bytes]
    """
    page = context.new_page()
    page.set_default_timeout(2000.0 * DEADLINE)  # drawing on a busy processor takes its time
    page.elsewhere = []
    place = re.escape(re.match(r'(\w+://[^/]*)', address)[1])
    page.on('request', lambda request: page.elsewhere.append(request.url)
            if not re.match(rf'(blob:)?{place}|data:', request.url) else None)
    if received is not None:
        page.on('websocket', lambda socket: socket.on(
            'framereceived', lambda payload: received.append(len(payload))))
    page.goto(address)
    return page


def free_port():
    """Return a port on which nobody listens."""
    with socket.socket() as probe:
        probe.bind(('127.0.0.1', 0))
        return probe.getsockname()[1]


def wait_for_server(port):
    """Wait until somebody listens on a port."""
    deadline = time.monotonic() + DEADLINE
    while True:
        try:
            socket.create_connection(('127.0.0.1', port), timeout=1.0).close()
            return
        except OSError:
            assert time.monotonic() < deadline, f'nobody listens on port {port}'
            time.sleep(0.05)


def until(page, condition, what, timeout=DEADLINE):
    """Let a page live until a condition holds, and return what it returned."""
    deadline = time.monotonic() + timeout
    while not (result := condition()):
        assert time.monotonic() < deadline, f'{what}: not within {timeout} s; {status(page)}'
        page.wait_for_timeout(50)
    return result


def status(page):
    """Return the line of status of a page."""
    found = re.search(r'.*(waiting|agents|states|ended).*', page.inner_text('body'))
    return found[0] if found else page.inner_text('body')[:200]


def shown_time(page):
    """Return the formation time that a page shows [s], or None."""
    found = re.search(r't = ([\d.]+) s', page.inner_text('body'))
    return found and float(found[1])


def note_least_time(page):
    """
    Have a page note the least time that it shows from now on, as ``leastTime``.

    And, as ``leastStart``, the least at which its first chart begins.

    What a busy page shows for a second or two may be over when somebody asks.
    """
    page.evaluate(r"""() => {
        const look = () => {
            const shown = /t = ([\d.]+) s/.exec(document.body.innerText);
            if (shown) window.leastTime = Math.min(window.leastTime, Number(shown[1]));
            const first = Object.values(window.__viserTestpoints?.uplots ?? {})[0];
            const start = first?.chart.data[0][0];
            if (start !== undefined) window.leastStart = Math.min(window.leastStart, start);
        };
        clearInterval(window.looking);
        window.leastTime = window.leastStart = Infinity;
        window.looking = setInterval(look, 100);
    }""")


def charts(page):
    """Return the charts of a page: their data, and how often each was built."""
    return page.evaluate(
        'Object.values(window.__viserTestpoints?.uplots ?? {}).map('
        'u => [u.chart.data.map(d => Array.from(d)), u.createCount])')


def dismiss(page):
    """Take away what the browser has to say about the machine."""
    for button in page.locator('.mantine-Notification-closeButton').all():
        button.click()  # no GPU in here, it says


def pixels(page, name=None):
    """Return the pixels of a page; keep it as a picture if it has a name."""
    import io

    from PIL import Image
    raw = page.screenshot()
    if name is not None:
        ARTEFACTS.mkdir(parents=True, exist_ok=True)
        (ARTEFACTS / f'{name}.png').write_bytes(raw)
    with Image.open(io.BytesIO(raw)) as image:
        return np.asarray(image.convert('RGB')).astype(int)


def hue(rgb):
    """Return hue [deg] and saturation, ``(...)``: what light and haze leave of a colour."""
    r, g, b = np.moveaxis(np.asarray(rgb, dtype=float), -1, 0)
    most, least = np.max(rgb, axis=-1), np.min(rgb, axis=-1)
    angle = np.degrees(np.arctan2(np.sqrt(3.0) * (g - b), 2.0 * r - g - b)) % 360.0
    return angle, (most - least) / np.maximum(most, 1)


def has_hue(image, color, tolerance=12.0, least=0.25):
    """Return which pixels have the hue of a colour, red, green and blue from 0 to 255."""
    angle, saturation = hue(image)
    off = np.abs((angle - hue(color)[0] + 180.0) % 360.0 - 180.0)
    return (off < tolerance) & (saturation > least)


def is_whole(scene):
    """Return whether what is in a picture is cut off nowhere, and as large as can be."""
    ink = np.max(np.abs(scene - scene[2, 2]), axis=-1) > 6
    rows, columns = np.flatnonzero(ink.any(axis=1)), np.flatnonzero(ink.any(axis=0))
    height, width = ink.shape
    return (ink.any() and columns[0] > 0 and columns[-1] < width - 1 and rows[0] > 0
            and rows[-1] < height - 1 and np.ptp(columns) > 0.5 * min(width, height))
