# Copyright 2026 The tetra_ros2 authors
# SPDX-License-Identifier: Apache-2.0

"""The web server that the browsers look at."""

import contextlib
import io
import logging
import socket

import viser

from tetra_ros2.config.parameters import ConfigurationError

TITLE = 'tetra_ros2'


def serve(host, port):
    """
    Start the server.

    :param host: address to listen on
    :param port: to listen on; 0 for any that is free
    :returns: a ``viser.ViserServer``
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
        server = viser.ViserServer(host=host, port=port, label=TITLE, verbose=False)
    server.gui.configure_theme(
        control_layout='fixed', control_width='large', show_logo=False, show_share_button=False,
        brand_color=(0, 114, 178))
    return server


def stop(server):
    """End it, and send the browsers away."""
    with contextlib.redirect_stdout(io.StringIO()):  # as it greeted, it takes its leave
        server.stop()


def address(server):
    """Return the address to open in a browser."""
    host = server.get_host()
    shown = {'0.0.0.0': 'localhost', '::': 'localhost'}.get(host, host)
    return f'http://{f"[{shown}]" if ":" in shown else shown}:{server.get_port()}'
