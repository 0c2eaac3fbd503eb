"""Who may talk to the workbench: whoever has the token that was printed, from pages that it served itself."""

from __future__ import annotations

import hmac
from html import escape
from urllib.parse import quote, urlencode, urlsplit

from flask import Flask, Response, abort, request

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
