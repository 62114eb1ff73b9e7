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

"""Who is let in by the viewer, and what they may do: tried with a WebSocket, without a browser."""

import gzip
import http.client
import re
import time
from urllib.parse import urlsplit

from harness import DEADLINE
from hypothesis import given
from hypothesis import strategies as st
import msgspec
import pytest
from tetra_ros2.viewer import door as doors
from tetra_ros2.viewer import server as servers
import viser
from websockets.exceptions import InvalidStatus
from websockets.sync.client import connect

CAMERA = {'type': 'ViewerCameraMessage', 'wxyz': [1.0, 0.0, 0.0, 0.0], 'position': [3.0, 0.0, 0.0],
          'fov': 1.0, 'near': 0.1, 'far': 100.0, 'image_height': 600, 'image_width': 800,
          'look_at': [0.0, 0.0, 0.0], 'up_direction': [0.0, 0.0, 1.0]}


class Site:
    """A server with one button and one number, and what has been done to them."""

    def __init__(self, host='127.0.0.1', read_only=False):
        self.server = servers.serve(host, 0, read_only)
        self.port = self.server.get_port()
        self.pressed, self.values = 0, []
        self.button = self.server.gui.add_button('button')
        self.number = self.server.gui.add_number('number', 1.0)
        self.button.on_click(lambda _: setattr(self, 'pressed', self.pressed + 1))
        self.number.on_update(lambda _: self.values.append(self.number.value))

    def connect(self, host='127.0.0.1', origin=None, query='', **kwargs):
        return connect(f'ws://{host}:{self.port}/{query}', origin=origin, max_size=None,
                       subprotocols=[f'viser-v{viser.__version__}'], **kwargs)

    def update(self, handle, value, **more):
        return msgspec.msgpack.encode({
            'type': 'GuiUpdateMessage', 'uuid': handle._impl.uuid, 'updates': {'value': value},
            **more})

    def enter(self, **kwargs):
        """Return a connection that the server counts as a browser."""
        connection = self.connect(**kwargs)
        connection.send(msgspec.msgpack.encode(CAMERA))
        wait(lambda: self.server.get_clients(), 'a browser')
        return connection

    def get(self, path='/', headers=None):
        connection = http.client.HTTPConnection('127.0.0.1', self.port, timeout=DEADLINE)
        connection.request('GET', path, headers=headers or {})
        response = connection.getresponse()
        return response, response.read()


def wait(condition, what):
    deadline = time.monotonic() + DEADLINE
    while not condition():
        assert time.monotonic() < deadline, what
        time.sleep(0.01)


@pytest.fixture(scope='module')
def site():
    made = Site()
    yield made
    servers.stop(made.server)


@pytest.fixture(scope='module')
def open_site():
    made = Site('0.0.0.0')
    yield made
    servers.stop(made.server)


@pytest.mark.parametrize('origin', [
    'http://example.org', 'http://localhost', 'http://127.0.0.1', 'http://127.0.0.1:1',
    'https://127.0.0.1.example.org', 'null', 'file://', 'http://[', ''], ids=str)
def test_a_page_of_another_origin_is_refused(site, origin):
    with pytest.raises(InvalidStatus) as refusal:
        site.connect(origin=origin)
    assert refusal.value.response.status_code == 403
    assert site.get(headers={'Origin': origin})[0].status == 403


def test_the_viewers_own_page_is_let_in_and_drives(site):
    for host in ('127.0.0.1', 'localhost'):
        before = site.pressed
        with site.enter(host=host, origin=f'http://{host}:{site.port}') as page:
            page.send(site.update(site.button, True))
            wait(lambda b=before: site.pressed == b + 1, 'the button')


@pytest.mark.parametrize('host', ['example.org', 'rebound.example:8080', '10.0.0.1', '',
                                  '127.0.0.1.example.org', '['])
def test_a_name_that_only_leads_to_this_machine_is_refused(site, host):
    response, _ = site.get(headers={'Host': host})
    assert response.status in (400, 403)


def test_the_page_bears_our_name_and_no_other_page_may_frame_it(site):
    response, body = site.get(headers={'Accept-Encoding': 'gzip'})
    assert response.status == 200
    assert b'<title>tetra_ros2</title>' in gzip.decompress(body)
    assert "frame-ancestors 'self'" in response.headers['Content-Security-Policy']
    assert response.headers['Set-Cookie'] is None
    plain, body = site.get()
    assert b'<title>tetra_ros2</title>' in body
    assert int(plain.headers['Content-Length']) == len(body)


def test_beyond_this_machine_a_token_is_wanted(open_site):
    address = urlsplit(open_site.server.address)
    assert address.hostname not in ('0.0.0.0', 'localhost'), 'others can use it'
    assert 'token=' in address.query
    assert 'other machines' in open_site.server.invitation
    for wrong in ('', '?token=', '?token=x', '?' + address.query[:-1]):
        assert open_site.get(f'/{wrong}')[0].status == 403
        with pytest.raises(InvalidStatus):
            open_site.connect(query=wrong)
    response, _ = open_site.get(f'/?{address.query}')
    assert response.status == 200
    cookie = response.headers['Set-Cookie']
    assert 'HttpOnly' in cookie
    assert 'SameSite=Strict' in cookie
    before = open_site.pressed
    with open_site.enter(additional_headers={'Cookie': cookie.split(';')[0]}) as page:
        page.send(open_site.update(open_site.button, True))
        wait(lambda: open_site.pressed == before + 1, 'the button')
    with pytest.raises(InvalidStatus):  # the token alone does not make another's page ours
        open_site.connect(origin='http://example.org', query=f'?{address.query}')


def test_tokens_and_cookies_of_two_servers_differ(open_site):
    other = doors.Door.make('0.0.0.0', False)
    assert other.token != open_site.server.door.token
    assert other._cookie != open_site.server.door._cookie


def test_read_only_lets_everybody_look_and_nobody_do_anything():
    site = Site('0.0.0.0', read_only=True)
    try:
        assert 'token' not in site.server.address
        assert 'read-only' in site.server.invitation
        with site.enter() as page:
            page.send(site.update(site.number, 5.0))
            page.send(site.update(site.button, True))
            page.send(msgspec.msgpack.encode({**CAMERA, 'fov': 1.25}))
            client, = site.server.get_clients().values()
            wait(lambda: client.camera.fov == 1.25, 'what came after')
            assert site.number.value == 1.0
            assert not site.pressed
    finally:
        servers.stop(site.server)


def test_garbage_and_wrong_values_change_nothing_and_raise_nothing(site, capfd):
    before, values = site.pressed, list(site.values)
    garbage = [
        b'', b'\0', b'\xff' * 1000, b'\x90', b'\xc1', 'text', msgspec.msgpack.encode([1, 2]),
        msgspec.msgpack.encode({'type': 'NoSuchMessage'}),
        msgspec.msgpack.encode({'type': 'ShareUrlRequest'}),
        msgspec.msgpack.encode({'type': 'FileTransferStartUpload', 'source_component_uuid': 'x'}),
        msgspec.msgpack.encode({**CAMERA, 'fov': float('nan')}),
        *(site.update(site.number, value) for value in (
            float('nan'), float('inf'), None, [1], {'a': 1}, 'much', 'x' * 10_000)),
        site.update(site.number, 5.0, removed=True),
        msgspec.msgpack.encode({'type': 'GuiUpdateMessage', 'uuid': site.number._impl.uuid,
                                'updates': {'update_cb': 3, 'removed': True}}),
        msgspec.msgpack.encode({'type': 'GuiUpdateMessage', 'uuid': 'nobody', 'updates': {}})]
    with site.enter() as page:
        for message in garbage:
            page.send(message)
        page.send(site.update(site.button, True))
        wait(lambda: site.pressed == before + 1, 'the connection still does what it may')
        assert site.number.value == 1.0
        assert site.values == values
    for message in (b'x' * (2 * doors.LARGEST_MESSAGE),
                    msgspec.msgpack.encode({**CAMERA, 'extra': 1})):
        with site.connect() as page:  # these are hung up upon
            page.send(message)
    with site.enter() as page:
        page.send(site.update(site.number, 3))
        wait(lambda: site.number.value == 3.0, 'a good value after all of it')
    site.number.value = 1.0
    output, errors = capfd.readouterr()
    assert not re.search('Traceback|rror', output + errors)


@given(st.binary(max_size=200) | st.recursive(
    st.none() | st.booleans() | st.floats() | st.text(max_size=5) | st.sampled_from(
        ['GuiUpdateMessage', 'ViewerCameraMessage']),
    lambda inner: st.lists(inner, max_size=4) | st.dictionaries(
        st.sampled_from(['type', 'uuid', 'updates', 'value', 'x']), inner, max_size=4),
    max_leaves=12).map(msgspec.msgpack.encode))
def test_whatever_is_sent_is_judged_without_an_error(raw):
    assert doors.Door('127.0.0.1').admits(raw) in (True, False)
    assert not doors.Door('127.0.0.1', read_only=True).admits(raw) \
        or b'ViewerCameraMessage' in raw


def test_fifty_browsers_come_and_go(site):
    before = site.pressed
    pages = [site.connect() for _ in range(50)]
    for page in pages:
        page.send(msgspec.msgpack.encode(CAMERA))
    wait(lambda: len(site.server.get_clients()) == 50, 'fifty browsers')
    for page in pages:
        page.send(site.update(site.button, True))
    wait(lambda: site.pressed == before + 50, 'fifty clicks')
    for page in pages:
        page.close()
    wait(lambda: not site.server.get_clients(), 'nobody')


def test_a_viser_that_does_not_use_the_door_is_not_run(monkeypatch):
    from tetra_ros2.config.parameters import ConfigurationError
    with pytest.raises(ConfigurationError, match='strangers'), doors.guard(doors.Door('x')):
        pass
