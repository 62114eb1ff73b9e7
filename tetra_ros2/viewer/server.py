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

"""The web server that the browsers look at."""

import contextlib
import io
import logging
import socket
from typing import Any

from tetra_ros2.config.parameters import ConfigurationError
from tetra_ros2.viewer.door import Door, guard, is_loopback
from tetra_ros2.viewer.skin import TITLE
import viser


class Server(viser.ViserServer):
    """
    A viser server with a door.

    :param door: who is let in
    :param port: to listen on; 0 for any that is free
    """

    def __init__(self, door: Door, port: int) -> None:
        with guard(door):
            super().__init__(host=door.host, port=port, label=TITLE, verbose=False)
        self.door = door
        self.gui.configure_theme(
            control_width='large', show_logo=False, show_share_button=False,
            brand_color=(0, 114, 178))
        self.gui.main_panel.dock_right()

    def request_share_url(self, *_: Any, **__: Any) -> None:
        """Do nothing: a tunnel through somebody else's machine is not for a browser to open."""

    @property
    def address(self) -> str:
        """Return the address to open in a browser, one that other machines understand too."""
        host = self.door.host
        if host in ('', '0.0.0.0', '::'):
            host = _own_address(host)
        shown = f'[{host}]' if ':' in host else host
        return f'http://{shown}:{self.get_port()}/{self.door.query}'

    @property
    def invitation(self) -> str:
        """Return the line that tells a person where to look."""
        notes = []
        if not is_loopback(self.door.host):
            notes.append('other machines may look' + (
                '' if self.door.read_only else ', and drive it with this address'))
        if self.door.read_only:
            notes.append('read-only')
        return f'open {self.address} in a browser' + (f' ({", ".join(notes)})' if notes else '')


def serve(host: str, port: int, read_only: bool = False) -> Server:
    """
    Start the server.

    :param host: address to listen on; beyond this machine, a browser needs the token that
        the printed address holds, unless the page is read-only
    :param port: to listen on; 0 for any that is free
    :param read_only: whether browsers may do nothing but look
    :raises ConfigurationError: if the port is taken or the address is not of this machine
    """
    # viser itself would quietly take another port than the one that was asked for.
    try:
        with socket.socket(socket.AF_INET6 if ':' in host else socket.AF_INET) as probe:
            probe.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
            probe.bind((host, port))
            port = probe.getsockname()[1]
    except (OSError, OverflowError) as error:
        reason = getattr(error, 'strerror', None) or str(error)
        raise ConfigurationError(
            f'cannot listen on {host} port {port}: {reason.lower()}; give another one',
            key='--port') from None
    # Who connects and says nothing, such as a port scanner, is not worth a traceback.
    logging.getLogger('websockets.server').setLevel(logging.CRITICAL)
    with contextlib.redirect_stdout(io.StringIO()):  # it greets, whatever it was told
        return Server(Door.make(host, read_only), port)


def stop(server: viser.ViserServer) -> None:
    """End it, and send the browsers away."""
    with contextlib.redirect_stdout(io.StringIO()):  # as it greeted, it takes its leave
        server.stop()


def _own_address(host: str) -> str:
    """Return the address of this machine that others are most likely to reach it at."""
    family, other = (socket.AF_INET6, '2001:db8::1') if host == '::' \
        else (socket.AF_INET, '192.0.2.1')
    with socket.socket(family, socket.SOCK_DGRAM) as probe:
        try:
            probe.connect((other, 9))  # sends nothing; the system only chooses a way
            return str(probe.getsockname()[0])
        except OSError:  # no network at all
            return socket.gethostname()
