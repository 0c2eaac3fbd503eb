"""A self-contained HTML page and its sections: it opens from disk, with no network, on a light or a dark screen."""

from __future__ import annotations

import base64
import gzip
import json
import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from datetime import datetime, timezone
from pathlib import Path
from typing import TYPE_CHECKING, Any

from robot_ident import __version__
from robot_ident.figures.theme import FONT, private, recoloured
from robot_ident.files import write_text

if TYPE_CHECKING:
    from plotly.graph_objects import Figure


@dataclass(frozen=True)
class Plot:
    """A figure with what it shows in words (for readers who don't see it) and a caption below it."""

    figure: Figure
    text: str
    caption: str = ""


@dataclass(frozen=True)
class Table:
    """A table: header, rows, and which columns are numbers (to the right)."""

    header: Sequence[str]
    rows: Sequence[Sequence[Any]]
    numeric: Sequence[int] = ()


@dataclass(frozen=True)
class Section:
    """A part of a page: its title, a template (a file beside the others) and what that needs.

    Whatever is in the context is escaped; a `Plot` is drawn by the template's `{{ plot(NAME) }}`, a `Table` by
    `{{ table(NAME) }}`.
    """

    title: str
    template: str
    context: Mapping[str, Any]

    @property
    def anchor(self) -> str:
        """The section's place in the page's address."""
        return re.sub(r"[^a-z0-9]+", "-", self.title.lower()).strip("-")


_TEMPLATES = Path(__file__).parent / "templates"
_CONFIG = private("select2d", "lasso2d", responsive=True)


def render_page(title: str, sections: Sequence[Section], *, subtitle: str = "") -> str:
    """Return the page; plotly.js stands in it once, and everything that isn't a template is escaped."""
    from jinja2 import Environment, FileSystemLoader, StrictUndefined
    from plotly.offline import get_plotlyjs

    environment = Environment(
        loader=FileSystemLoader(_TEMPLATES),
        autoescape=True,
        undefined=StrictUndefined,
        trim_blocks=True,
        lstrip_blocks=True,
    )
    drawing = _Drawing(environment)
    parts = [
        {
            "heading": section.title,
            "anchor": section.anchor,
            "body": _safe(
                environment.get_template(section.template).render(
                    **section.context, plot=drawing.plot, table=drawing.table
                )
            ),
        }
        for section in sections
    ]
    return environment.get_template("page.html.j2").render(
        title=title,
        subtitle=subtitle,
        sections=parts,
        library=_packed(get_plotlyjs()) if drawing.plots else "",
        plots=_json(drawing.plots),
        config=_json(_CONFIG),
        font=_safe(FONT),
        version=__version__,
        written=datetime.now(timezone.utc).strftime("%Y-%m-%d %H:%M UTC"),
    )


def write_page(
    path: Path | str, title: str, sections: Sequence[Section], *, subtitle: str = "", force: bool = False
) -> None:
    """Write the page, whole or not at all."""
    write_text(path, render_page(title, sections, subtitle=subtitle), force=force)


class _Drawing:
    """Places plots and tables, and gathers what plotly draws when the page has loaded."""

    def __init__(self, environment: Any) -> None:
        self._environment = environment
        self.plots: list[dict[str, Any]] = []

    def plot(self, plot: Plot) -> Any:
        """Return the place of a plot."""
        spec = json.loads(plot.figure.to_json())
        axes = [key for key in spec["layout"] if key.startswith(("xaxis", "yaxis"))]
        shades = {shade: recoloured(shade, axes) for shade in ("light", "dark")}
        notes = [f"annotations[{k}].font.color" for k in range(len(spec["layout"].get("annotations", [])))]
        for tone in shades.values():
            tone |= dict.fromkeys(notes, tone["font.color"])
        identity = f"plot-{len(self.plots) + 1}"
        self.plots.append({"id": identity, "data": spec["data"], "layout": spec["layout"], "shades": shades})
        height = spec["layout"]["height"]
        template = self._environment.get_template("plot.html.j2")
        return _safe(template.render(id=identity, text=plot.text, caption=plot.caption, height=height))

    def table(self, table: Table) -> Any:
        """Return a table."""
        return _safe(self._environment.get_template("table.html.j2").render(table=table))


def _packed(text: str) -> Any:
    """Return a text as base64 of its gzip, which the page unpacks: plotly.js takes 2 MB instead of 5."""
    return _safe(base64.b64encode(gzip.compress(text.encode(), mtime=0)).decode())


def _safe(text: str) -> Any:
    from markupsafe import Markup

    return Markup(text)


def _json(data: Any) -> Any:
    """Return data for a script: no `<` that could end it, no line separators that JavaScript once minded."""
    text = json.dumps(data, separators=(",", ":"), allow_nan=False)
    for character in "<>&\u2028\u2029":
        text = text.replace(character, f"\\u{ord(character):04x}")
    return _safe(text)
