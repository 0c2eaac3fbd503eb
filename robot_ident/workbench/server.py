"""Serves the workbench on this machine alone, to whoever was told its token."""

from __future__ import annotations

import logging
import secrets
import socket
from collections.abc import Callable

from werkzeug.serving import BaseWSGIServer, WSGIRequestHandler, make_server

from robot_ident.errors import InputError
from robot_ident.workbench.app import make_app
from robot_ident.workbench.desk import Desk

HOST = "127.0.0.1"
DEFAULT_PORT = 8050
_TRIED = 20  # ports after the default one


class _Quiet(WSGIRequestHandler):
    """Logs no request."""

    def log_request(self, code: int | str = "-", size: int | str = "-") -> None:
        """Say nothing."""


def bind(desk: Desk, port: int | None, token: str) -> BaseWSGIServer:
    """Return a server of the desk's application, bound to a port of the loopback (None: the first free one from 8050).

    Raises InputError where the port is taken.
    """
    logging.getLogger("werkzeug").setLevel(logging.ERROR)
    chosen = _free() if port is None else port
    try:
        listening = socket.create_server((HOST, chosen))
    except OSError as error:
        raise InputError(f"--port {chosen}: {error.strerror}; give another one") from error
    chosen = listening.getsockname()[1]
    listening.close()
    return make_server(HOST, chosen, make_app(desk, chosen, token).server, threaded=True, request_handler=_Quiet)


def serve(desk: Desk, port: int | None, page: str, ready: Callable[[str], None]) -> None:
    """Serve until interrupted; `ready(address)` is called, with the address of a page, once requests are answered."""
    token = secrets.token_urlsafe()
    server = bind(desk, port, token)
    ready(f"http://{HOST}:{server.server_port}/{page}?token={token}")
    try:
        server.serve_forever()
    finally:
        server.server_close()
        desk.close()


def _free() -> int:
    for port in range(DEFAULT_PORT, DEFAULT_PORT + _TRIED):
        with socket.socket() as probe:
            probe.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
            try:
                probe.bind((HOST, port))
            except OSError:
                continue
            return port
    return 0
