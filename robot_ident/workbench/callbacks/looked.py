"""The step that a page looks at."""

from __future__ import annotations

from typing import Any

from robot_ident.workbench.desk import Desk
from robot_ident.workbench.view import View


def looked_at(desk: Desk, stand: dict[str, Any] | None) -> View | None:
    """Return the step that a page looks at, None as long as there is none."""
    return None if stand is None else View.of(desk.session(stand["session"]))
