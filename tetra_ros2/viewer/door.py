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
Who may look at the viewer, and who may drive the formation through it.

A web page of another origin can open a WebSocket to a server on this machine: the browser lets it,
and only the server can refuse. So the handshake is checked here, and everything that a browser
sends afterwards.
"""

from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from functools import lru_cache, partial
import gzip
import hmac
from http import HTTPStatus
from http.cookies import CookieError, SimpleCookie
import ipaddress
import logging
import math
import secrets
from typing import Any
from urllib.parse import parse_qs, urlsplit

import msgspec
from tetra_ros2.config.parameters import ConfigurationError
from tetra_ros2.viewer.skin import dress
import websockets.asyncio.server
from websockets.asyncio.server import ServerConnection
from websockets.datastructures import Headers
from websockets.http11 import Request, Response

LARGEST_MESSAGE = 64 * 1024
"""What a browser may send at once [bytes]: it sends a camera, or the value of a button."""

_LOOK = frozenset({'ViewerCameraMessage'})
_DRIVE = frozenset({'GuiUpdateMessage'})
_TOKEN = 'token'


def is_loopback(host: str) -> bool:
    """Return whether a host, as an address or a name, is this machine to itself only."""
    name = host.strip('[]').rstrip('.').lower()
    if name == 'localhost' or name.endswith('.localhost'):
        return True
    try:
        return ipaddress.ip_address(name).is_loopback
    except ValueError:
        return False


@dataclass(frozen=True)
class Door:
    """
    The rules of who is let in.

    :param host: address that the server listens on
    :param read_only: whether nobody may change anything
    :param token: what an address must hold to be let in; None where none is asked for
    """

    host: str
    read_only: bool = False
    token: str | None = None

    @classmethod
    def make(cls, host: str, read_only: bool) -> 'Door':
        """Return the door of a server: with a new token where others can reach and drive it."""
        needed = not read_only and not is_loopback(host)
        return cls(host, read_only, secrets.token_urlsafe(16) if needed else None)

    @property
    def query(self) -> str:
        """Return what belongs at the end of an address that is let in."""
        return '' if self.token is None else f'?{_TOKEN}={self.token}'

    def refusal(self, path: str, headers: Headers) -> str | None:
        """
        Return why a request is refused, or None.

        :param path: of the request, with its query
        :param headers: of the request
        """
        try:
            host, origin = headers.get('Host', ''), headers.get('Origin')
            # Without this a name that leads to 127.0.0.1 would make its page ours.
            if is_loopback(self.host) and not is_loopback(urlsplit(f'//{host}').hostname or ''):
                return 'this viewer is open to this machine only'
            if origin is not None and urlsplit(origin).netloc.lower() != host.lower():
                return 'a page of another origin may not use this viewer'
            if self.token is not None and not self._knows(path, headers):
                return 'open the address that the viewer printed, with its token'
        except (ValueError, KeyError):  # two headers of a kind, an address that is none
            return 'the request is malformed'
        return None

    def _knows(self, path: str, headers: Headers) -> bool:
        given = parse_qs(urlsplit(path).query).get(_TOKEN, [])
        for line in headers.get_all('Cookie'):
            try:
                given += [morsel.value for name, morsel in SimpleCookie(line).items()
                          if name == self._cookie]
            except CookieError:
                continue
        return any(hmac.compare_digest(value.encode(), (self.token or '').encode())
                   for value in given)

    @property
    def _cookie(self) -> str:
        """Return the name of the cookie, one for each server: the ports of a host share them."""
        return f'tetra_viewer_{hash(self.token) & 0xffffffff:x}'

    def answer(self, connection: ServerConnection, request: Request,
               serve: Callable[[ServerConnection, Request], Response | None]) -> Response | None:
        """Answer a request as viser does, if it may be answered."""
        reason = self.refusal(request.path, request.headers)
        if reason is not None:
            return connection.respond(HTTPStatus.FORBIDDEN, f'{reason}\n')
        response = serve(connection, request)
        if response is not None:
            # No other page may put this one into a frame, and have its buttons pressed unseen.
            _dress(response)
            response.headers['Content-Security-Policy'] = "frame-ancestors 'self'"
            response.headers['Referrer-Policy'] = 'no-referrer'
            if self.token is not None:  # the handshake that follows carries no query
                response.headers['Set-Cookie'] = (
                    f'{self._cookie}={self.token}; HttpOnly; SameSite=Strict; Path=/')
        return response

    def admits(self, raw: str | bytes) -> bool:
        """Return whether what a browser sent may be passed on."""
        try:
            # Text, which only a stranger sends, is a TypeError.
            message = msgspec.msgpack.decode(raw)  # type: ignore[arg-type]
            kind = message['type']
            if kind in _LOOK:
                return all(map(_is_plain, message.values()))
            updates = message['updates']
            return (kind in _DRIVE and not self.read_only and isinstance(message['uuid'], str)
                    and set(message) == {'type', 'uuid', 'updates'} and set(updates) == {'value'}
                    and _is_plain(updates['value']))
        except (msgspec.DecodeError, TypeError, KeyError, AttributeError, ValueError):
            return False


def _dress(response: Response) -> None:
    """Dress a page as this package has it."""
    if response.headers.get('Content-Type', '').startswith('text/html'):
        response.body = _dressed(bytes(response.body), response.headers['Content-Encoding'])
        del response.headers['Content-Length']
        response.headers['Content-Length'] = str(len(response.body))


@lru_cache(maxsize=2)
def _dressed(body: bytes, encoding: str) -> bytes:
    if encoding == 'gzip':
        return gzip.compress(dress(gzip.decompress(body)))
    return dress(body)


def _is_plain(value: Any) -> bool:
    """Return whether a value is what a camera or a button consists of, with finite numbers."""
    if isinstance(value, (list, tuple)):
        return len(value) <= 16 and all(
            isinstance(v, (int, float)) and math.isfinite(v) for v in value)
    if isinstance(value, (int, float)):  # bool is one
        return math.isfinite(value)
    return isinstance(value, str) and len(value) < 1000


class _Guarded(ServerConnection):
    """A connection that hears only what its door admits."""

    def __init__(self, *args: Any, door: Door, **kwargs: Any) -> None:
        super().__init__(*args, **kwargs)
        self._door = door
        # Who sends a word where a number belongs gets viser to raise; that is nobody's concern.
        self.loop.set_exception_handler(lambda _, context: logging.getLogger(__name__).debug(
            'while serving a browser: %s', context.get('exception') or context.get('message')))

    async def recv(self, *args: Any, **kwargs: Any) -> Any:
        while True:
            raw = await super().recv(*args, **kwargs)
            if self._door.admits(raw):
                return raw


@contextmanager
def guard(door: Door) -> Iterator[None]:
    """
    Put a door before the server that viser starts meanwhile.

    viser offers no way to check who connects; the library that it serves with does, and viser
    looks its ``serve`` up by this name when it starts.

    :param door: the door
    :raises ConfigurationError: if viser started without it: then it must not run
    """
    serve, used = websockets.asyncio.server.serve, []

    def guarded(*args: Any, process_request: Any = None, **kwargs: Any) -> Any:
        used.append(True)

        def answer(connection: ServerConnection, request: Request) -> Response | None:
            return door.answer(connection, request, process_request or (lambda *_: None))

        return serve(*args, **{**kwargs, 'max_size': LARGEST_MESSAGE}, process_request=answer,
                     create_connection=partial(_Guarded, door=door))  # type: ignore[arg-type]

    websockets.asyncio.server.serve = guarded  # type: ignore[assignment, misc]
    try:
        yield
    finally:
        websockets.asyncio.server.serve = serve  # type: ignore[misc]
    if not used:
        raise ConfigurationError(
            'this version of viser cannot be kept from answering to strangers', key='viewer')
