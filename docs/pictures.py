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
Make all pictures of the documentation anew: ``make pictures``, or ``python docs/pictures.py``.

Each comes from a run of the real nodes. With names after it, such as ``solids.png``, it makes
these only. The pictures of the viewer are taken in Chromium.
"""

from contextlib import contextmanager
import os
from pathlib import Path
import re
import shutil
import subprocess
import sys
import tempfile

HERE = Path(__file__).resolve().parent
SOLIDS = {'rotating': 'tetrahedron', 'octahedron': 'octahedron', 'cube': 'cube',
          'icosahedron': 'icosahedron', 'dodecahedron': 'dodecahedron'}
"""A configuration for each solid, and what it forms."""

DURATION = {'rotating': 25.0, 'spinning_dodecahedron': 30.0}
FLAGS = ['--no-sandbox', '--use-gl=angle', '--use-angle=swiftshader',
         '--enable-unsafe-swiftshader']


def _tetra(*arguments):
    subprocess.run([sys.executable, '-m', 'tetra_ros2', *map(str, arguments)], check=True,
                   stdout=subprocess.DEVNULL)


def _recording(config, folder):
    """Return the path of a recorded run of a configuration."""
    path = folder / config
    if not path.exists():
        _tetra('launcher', '--config', config, '--duration', DURATION.get(config, 25.0),
               '--record', path, '--quiet')
    return path


def _run(config, folder):
    from tetra_ros2.recording import plot, reader
    return plot.Run(reader.load(_recording(config, folder)))


def rotating_png(folder, out):
    """Draw the rotating tetrahedron on its sphere, with the way that it came."""
    _tetra('plot', _recording('rotating', folder), '--out', folder, '--only', 'sphere',
           '--format', 'png', '--to', 12)
    _shrink(folder / 'sphere.png', out)


def rotating_gif(folder, out):
    """Let the tetrahedron form and turn."""
    from tetra_ros2.drawing import picture
    run = _run('rotating', folder)
    part = run.times <= 20.0
    picture.write_movie(run.times[part], run.gamma[part], run.edges, out, size=300, most=76)


def solids_png(folder, out):
    """Draw all five Platonic solids side by side, each as it came out of a run."""
    from matplotlib import rc_context
    from matplotlib.backends.backend_agg import FigureCanvasAgg
    from matplotlib.figure import Figure
    from tetra_ros2.drawing import picture
    from tetra_ros2.recording import plot
    with rc_context(plot.STYLE):
        figure = Figure(figsize=(15.0, 3.4))
        FigureCanvasAgg(figure)
        for axes, (config, name) in zip(figure.subplots(1, 5), SOLIDS.items(), strict=True):
            run = _run(config, folder)
            picture.draw(axes, run.times[-200:], run.gamma[-200:], trail=1.5)
            axes.set_title(f'{name}, {run.n} agents', fontsize=13, y=-0.09)
        figure.subplots_adjust(left=0.0, right=1.0, bottom=0.06, top=1.0, wspace=0.0)
        figure.savefig(folder / 'solids.png', dpi=100)
    _shrink(folder / 'solids.png', out)


def dodecahedron_gif(folder, out):
    """Let the dodecahedron form, and turn about the middle of a face."""
    from tetra_ros2.drawing import picture
    run = _run('spinning_dodecahedron', folder)
    part = run.times <= 16.0
    picture.write_movie(run.times[part], run.gamma[part], run.edges, out, size=240, most=64)


def formation_html(folder, out):
    """Write the rotating formation as a page that plays by itself."""
    _tetra('viewer', '--bag', _recording('rotating', folder), '--html', out)


def viewer_png(folder, out):
    """Look at a running formation in a browser."""
    with _server('launcher', '--config', 'rotating', '--view') as address:
        _screenshot(address, folder / 'viewer.png', 14.0)
    _shrink(folder / 'viewer.png', out)


def viewer_bag_png(folder, out):
    """Look at the recording of a dodecahedron in a browser."""
    with _server('viewer', '--bag', _recording('spinning_dodecahedron', folder)) as address:
        _screenshot(address, folder / 'viewer_bag.png', 15.0, pause=True)
    _shrink(folder / 'viewer_bag.png', out)


PICTURES = {'rotating.png': rotating_png, 'rotating.gif': rotating_gif,
            'solids.png': solids_png, 'dodecahedron.gif': dodecahedron_gif,
            'formation.html': formation_html, 'viewer.png': viewer_png,
            'viewer_bag.png': viewer_bag_png}


@contextmanager
def _server(*arguments):
    """Start something with a page, and give its address."""
    process = subprocess.Popen(
        [sys.executable, '-m', 'tetra_ros2', *map(str, arguments), '--port', '0'],
        stdout=subprocess.PIPE, stderr=subprocess.DEVNULL, text=True)
    try:
        addresses = (re.search(r'open (\S+) in a browser', line) for line in process.stdout)
        found = next(filter(None, addresses), None)
        if found is None:
            raise RuntimeError(f'{arguments[0]} ended with status {process.wait()}')
        yield found[1]
    finally:
        process.terminate()
        process.communicate(timeout=30)


def _screenshot(address, path, seconds, pause=False):
    """Take a picture of a page that has been open for a time, and pause it for that if asked."""
    from playwright.sync_api import sync_playwright
    program = next(filter(None, map(shutil.which, (
        'chromium', 'chromium-browser', 'google-chrome'))), None)
    with sync_playwright() as playwright:
        browser = playwright.chromium.launch(executable_path=program, headless=True, args=FLAGS)
        page = browser.new_page(viewport={'width': 1200, 'height': 800})
        page.goto(address)
        page.get_by_text('charts', exact=True).wait_for()
        page.wait_for_timeout(1000.0 * seconds)
        for button in page.locator('.mantine-Notification-closeButton').all():
            button.click()
        if pause:  # a page that the processor draws has trails that lag behind the axes
            page.get_by_role('button', name='Pause').click()
            page.get_by_role('button', name='Play').wait_for()
        page.wait_for_timeout(800)
        page.screenshot(path=path)
        browser.close()


def _shrink(path, out):
    """Write a picture with a few colours, the agents' among them, so that the file is small."""
    import numpy as np
    from PIL import Image
    from tetra_ros2.drawing import colors
    own = [colors.rgb(color) for color in (*colors.AGENTS, colors.INK, '#ffffff')]
    with Image.open(path) as image:
        picture = image.convert('RGB')
    common = picture.quantize(256 - len(own), dither=Image.Dither.NONE).getpalette()
    palette = Image.new('P', (1, 1))
    palette.putpalette([*common[:3 * (256 - len(own))], *sum(own, ())])
    indices = np.array(picture.quantize(palette=palette, dither=Image.Dither.NONE))
    indices[np.all(np.asarray(picture) == 255, axis=-1)] = 255  # white, and not nearly so
    small = Image.fromarray(indices)
    small.putpalette(palette.getpalette())
    small.save(out, optimize=True)


def main(wanted):
    """Make the pictures of these names, or all; return the exit status."""
    unknown = set(wanted) - set(PICTURES)
    if unknown:
        print(f'no picture is called {", ".join(sorted(unknown))}; there are '
              f'{", ".join(PICTURES)}', file=sys.stderr)
        return 2
    os.environ.setdefault('ROS_AUTOMATIC_DISCOVERY_RANGE', 'LOCALHOST')
    with tempfile.TemporaryDirectory() as folder:
        for name in wanted or PICTURES:
            PICTURES[name](Path(folder), HERE / name)
            print(f'{name}: {(HERE / name).stat().st_size / 1000:.0f} kB', flush=True)
    return 0


if __name__ == '__main__':
    sys.exit(main(sys.argv[1:]))
