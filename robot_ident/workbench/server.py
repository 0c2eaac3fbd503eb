"""Serves the workbench on this machine alone, to whoever has the token that was printed, from pages that it served
itself; its browser is opened without telling other users of the machine the token.
"""

from __future__ import annotations

import hmac
import logging
import secrets
import socket
import tempfile
import webbrowser
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from html import escape
from pathlib import Path
from urllib.parse import quote, urlencode, urlsplit

from dash import Dash
from flask import Flask, Response, abort, request
from werkzeug.serving import BaseWSGIServer, make_server

from robot_ident.errors import InputError
from robot_ident.workbench import callbacks, drawing
from robot_ident.workbench.controller import Desk
from robot_ident.workbench.layout import shell

_POLICY = (
    "default-src 'self'; script-src 'self' 'unsafe-inline'; style-src 'self' 'unsafe-inline';"
    " img-src 'self' data: blob:; connect-src 'self'; font-src 'self' data:; frame-ancestors 'none';"
    " form-action 'none'; base-uri 'none'; object-src 'none'"
)
_STRANGER = (
    "This request lacks the token of the workbench; open the URL with “?token=” that robot_ident workbench printed when"
    " it was started."
)


def guard(server: Flask, port: int, token: str) -> None:
    """Refuse requests without the token, those that name another host (DNS rebinding) or come from another site's page.

    The first address has the token (`?token=...`); a cookie has it from then on. No page may load anything from
    elsewhere either.
    """
    cookie = f"robot_ident_workbench_{port}"  # browsers keep one set of cookies for all ports of a host
    hosts = {f"{name}:{port}" for name in ("127.0.0.1", "localhost", "[::1]")}

    @server.before_request
    def same_site() -> None:
        if request.host.lower() not in hosts:
            abort(403, "this workbench answers to 127.0.0.1 and localhost alone")
        origin = request.headers.get("Origin")
        if origin is not None and urlsplit(origin).netloc.lower() not in hosts:
            abort(403, "this request comes from a page of another site")
        link = request.method == "GET" and request.headers.get("Sec-Fetch-Mode") == "navigate"
        if not link and request.headers.get("Sec-Fetch-Site", "same-origin") not in ("same-origin", "none"):
            abort(403, "this request comes from a page of another site")

    @server.before_request
    def known() -> Response | None:
        brought = request.args.get("token")
        if brought is not None and _same(brought, token):
            if request.method not in ("GET", "HEAD"):
                return None
            answer = _onward()
            answer.set_cookie(cookie, token, httponly=True, samesite="Strict")
            return answer
        if not _same(request.cookies.get(cookie, ""), token):
            abort(403, _STRANGER)
        return None

    @server.after_request
    def sealed(response: Response) -> Response:
        response.headers["Content-Security-Policy"] = _POLICY
        response.headers["X-Content-Type-Options"] = "nosniff"
        response.headers["Referrer-Policy"] = "no-referrer"
        response.headers["Cross-Origin-Resource-Policy"] = "same-origin"
        return response


def _same(brought: str, token: str) -> bool:
    return hmac.compare_digest(brought.encode("utf-8", "replace"), token.encode())


def _onward() -> Response:
    """Return an answer that leads to the same address without its token.

    A browser that came by another page's link would not show a strict cookie where it is redirected to; it does where
    a page of ours leads it.
    """
    rest = urlencode([(key, value) for key, value in request.args.items(multi=True) if key != "token"])
    path = "/" + quote(request.path.lstrip("/")) + (f"?{rest}" if rest else "")
    linked = request.headers.get("Sec-Fetch-Site", "none") not in ("none", "same-origin")
    page = f'<!DOCTYPE html><meta http-equiv="refresh" content="0; url={escape(path)}"><title>robot_ident</title>'
    answer = Response(page, 200 if linked else 303, mimetype="text/html")
    answer.headers["Cache-Control"] = "no-store"
    if not linked:
        answer.headers["Location"] = path
    return answer


def make_app(desk: Desk, port: int, token: str) -> Dash:
    """Return the application of a desk, for a server at a port of this machine; it answers those who have the token."""
    app = Dash(
        "robot_ident.workbench",
        title="robot_ident workbench",
        update_title="",
        assets_folder=str(Path(__file__).parent / "assets"),
        serve_locally=True,
        suppress_callback_exceptions=True,
        compress=False,
    )
    guard(app.server, port, token)
    app.layout = shell()
    callbacks.register(app, desk)
    drawing.register(app, desk)
    return app


HOST = "127.0.0.1"
DEFAULT_PORT = 8050
_TRIED = 20  # ports after the default one


def bind(desk: Desk, port: int | None, token: str) -> BaseWSGIServer:
    """Return a server of the desk's application, bound to a port of the loopback (None: the first free one from 8050).

    Raises InputError where the port is taken.
    """
    logging.getLogger("werkzeug").setLevel(logging.ERROR)  # no line for every request
    for tried in (*range(DEFAULT_PORT, DEFAULT_PORT + _TRIED), 0) if port is None else (port,):
        try:
            with socket.create_server((HOST, tried)) as listening:
                chosen = listening.getsockname()[1]
            break
        except OSError as error:
            refused = error
    else:
        raise InputError(f"--port {tried}: {refused.strerror}; give another one") from refused
    return make_server(HOST, chosen, make_app(desk, chosen, token).server, threaded=True)


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


@contextmanager
def browsed(address: str, folder: Path) -> Iterator[None]:
    """Show an address in the user's browser by a page in a folder that only the user can read, removed in the end."""
    page = None
    try:
        folder.mkdir(parents=True, exist_ok=True)
        handle, name = tempfile.mkstemp(prefix="open_", suffix=".html", dir=folder)  # rw for its owner
        page, url = Path(name), escape(address)
        with open(handle, "w", encoding="utf-8") as file:
            file.write(
                '<!DOCTYPE html><meta charset="utf-8"><meta name="referrer" content="no-referrer">'
                f'<meta http-equiv="refresh" content="0; url={url}"><title>robot_ident workbench</title>'
                f'<a href="{url}">robot_ident workbench</a>\n'
            )
        webbrowser.open(page.as_uri())
    except OSError:
        pass  # nothing can be written: the address was printed
    try:
        yield
    finally:
        if page is not None:
            page.unlink(missing_ok=True)
