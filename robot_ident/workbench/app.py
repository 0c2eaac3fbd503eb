"""The web application: Dash, with all it needs served from this machine."""

from __future__ import annotations

from pathlib import Path

from dash import Dash

from robot_ident.workbench.callbacks import brushing, client, deeds, navigation, opening, panels, pictures, proposing
from robot_ident.workbench.desk import Desk
from robot_ident.workbench.guard import guard
from robot_ident.workbench.layout import shell


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
    client.register(app)
    for part in (navigation, opening, proposing, brushing, deeds, panels, pictures):
        part.register(app, desk)
    return app
