"""Who may talk to the workbench: pages that it served itself, on this machine."""

from __future__ import annotations

from urllib.parse import urlsplit

from flask import Flask, Response, abort, request

_POLICY = (
    "default-src 'self'; script-src 'self' 'unsafe-inline'; style-src 'self' 'unsafe-inline';"
    " img-src 'self' data: blob:; connect-src 'self'; font-src 'self' data:; frame-ancestors 'none';"
    " form-action 'none'; base-uri 'none'; object-src 'none'"
)


def guard(server: Flask, port: int) -> None:
    """Refuse requests that name another host (DNS rebinding) or come from a page of another site.

    No page may load anything from elsewhere either.
    """
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

    @server.after_request
    def sealed(response: Response) -> Response:
        response.headers["Content-Security-Policy"] = _POLICY
        response.headers["X-Content-Type-Options"] = "nosniff"
        response.headers["Referrer-Policy"] = "no-referrer"
        response.headers["Cross-Origin-Resource-Policy"] = "same-origin"
        return response
