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

"""A browser to open the viewer's pages in."""

import pytest

# What drives a browser is imported where it is wanted: without it the other tests still run.


@pytest.fixture(scope='module')
def chromium():
    """Return a browser."""
    from browser import launch
    with launch() as browser:
        yield browser


@pytest.fixture
def visit(chromium):
    """Return a function that opens an address in a browser of its own, and waits for the page."""
    from browser import CHEAP_PICTURES, open_page
    contexts = []

    # The fewer pixels the better, and the fewer pictures: the processor draws them.
    def open_(port, size=(800, 600), query='', watch=None):
        contexts.append(context := chromium.new_context(
            viewport={'width': size[0], 'height': size[1]}))
        context.add_init_script(CHEAP_PICTURES)
        page = open_page(context, f'http://127.0.0.1:{port}/{query}', watch)
        page.get_by_text('charts', exact=True).wait_for()
        return page

    yield open_
    for context in contexts:
        context.close()


@pytest.fixture
def port():
    """Return a port on which nobody listens."""
    from browser import free_port
    return free_port()
