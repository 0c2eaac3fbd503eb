"""A section of a page: a small class that says its title, its template and what goes into it."""

from __future__ import annotations

import re
from abc import ABC, abstractmethod
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, ClassVar

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


class Section(ABC):
    """A part of a page. A subclass states `title` and `template` (a file beside the others) and gives `context`.

    Whatever is in the context is escaped; a `Plot` is drawn by the template's `{{ plot(NAME) }}`, a `Table` by
    `{{ table(NAME) }}`.
    """

    title: ClassVar[str]
    template: ClassVar[str]

    @abstractmethod
    def context(self) -> Mapping[str, Any]:
        """Return what the template needs."""

    @property
    def heading(self) -> str:
        """The title as it is shown."""
        return self.title

    @property
    def anchor(self) -> str:
        """The section's place in the page's address."""
        return re.sub(r"[^a-z0-9]+", "-", self.heading.lower()).strip("-")
