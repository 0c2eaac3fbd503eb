"""Opens a browser without telling other users of the machine the token, as its command line would (`ps` shows it)."""

from __future__ import annotations

import tempfile
import webbrowser
from collections.abc import Iterator
from contextlib import contextmanager
from html import escape
from pathlib import Path


@contextmanager
def browsed(address: str, folder: Path) -> Iterator[None]:
    """Show an address in the user's browser by a page in a folder that only the user can read, removed in the end."""
    page = None
    try:
        page = leading_to(address, folder)
        webbrowser.open(page.as_uri())
    except OSError:
        pass  # nothing can be written: the address was printed
    try:
        yield
    finally:
        if page is not None:
            page.unlink(missing_ok=True)


def leading_to(address: str, folder: Path) -> Path:
    """Write a page that leads to an address, for this user's eyes alone."""
    folder.mkdir(parents=True, exist_ok=True)
    handle, name = tempfile.mkstemp(prefix="open_", suffix=".html", dir=folder)  # rw for its owner
    with open(handle, "w", encoding="utf-8") as file:
        url = escape(address)
        file.write(
            '<!DOCTYPE html><meta charset="utf-8"><meta name="referrer" content="no-referrer">'
            f'<meta http-equiv="refresh" content="0; url={url}"><title>robot_ident workbench</title>'
            f'<a href="{url}">robot_ident workbench</a>\n'
        )
    return Path(name)
