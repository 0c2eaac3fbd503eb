"""How far a motion stays from a robot's limits."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass
from typing import Any


@dataclass(frozen=True)
class Margin:
    """How far a motion stays from a limit: `value` comes nearest at `time` [s].

    `where` is a joint, the text of a workspace rule or a pair of links; `relative` is the margin as a share of the
    limit (of one metre for a rule and for links); `proven` tells a bound over continuous time from one over samples.
    `margin` > 0: it is kept.
    """

    quantity: str
    where: str
    margin: float
    value: float
    limit: float
    time: float
    unit: str
    relative: float
    proven: bool = True

    @property
    def kept(self) -> bool:
        """Whether the limit is kept, strictly."""
        return self.margin > 0.0

    @property
    def cells(self) -> tuple[str, ...]:
        """What tables show: limit, joint or rule, reached, allowed, margin, unit, time [s], proof or samples."""
        return (
            self.quantity.replace("_", "-"),
            self.where,
            f"{self.value:.5g}",
            f"{self.limit:.5g}",
            f"{self.margin:.3g}",
            self.unit,
            f"{self.time:.3f}",
            "proof" if self.proven else "samples",
        )

    def __str__(self) -> str:
        """Return the margin in words."""
        state, distance = "keeps" if self.kept else "breaks", f"{abs(self.margin):.3g} {self.unit}"
        if self.quantity == "workspace":
            return f"{state} the rule '{self.where}' by {distance} at t = {self.time:.3f} s"
        if self.quantity == "self_collision":
            apart = f"{self.value:.4g} m apart: that {state} the clearance of {self.limit:g} m"
            return f"links {self.where} come {apart} by {distance} at t = {self.time:.3f} s"
        what = f"{self.quantity} of {self.where}, {self.value:.6g} {self.unit},"
        return f"{what} {state} its limit {self.limit:g} {self.unit} by {distance} at t = {self.time:.3f} s"


@dataclass(frozen=True)
class Margins:
    """The tightest margin of every limit, what the robot's files don't tell, and what was left out on purpose."""

    items: tuple[Margin, ...]
    unknown: tuple[str, ...] = ()
    notes: tuple[str, ...] = ()

    @property
    def kept(self) -> bool:
        """Whether every limit is kept, strictly."""
        return all(item.kept for item in self.items)

    @property
    def not_checked(self) -> str:
        """What was not checked, as one line; empty where everything was."""
        return not_checked(self.unknown)

    @property
    def tightest(self) -> Margin | None:
        """The limit that comes nearest, relative to its size."""
        return min(self.items, key=lambda item: item.relative, default=None)

    @property
    def violations(self) -> tuple[Margin, ...]:
        """Limits that are not kept, the worst first."""
        return tuple(sorted((item for item in self.items if not item.kept), key=lambda item: item.relative))

    def to_json(self) -> dict[str, Any]:
        """Return the margins as plain values: by quantity and joint, rules of the workspace in a list."""
        out: dict[str, Any] = {"kept": self.kept, "position": {}, "velocity": {}, "acceleration": {}}
        for item in self.items:
            record = {key: getattr(item, key) for key in ("margin", "value", "limit", "time", "unit", "proven")}
            if item.quantity == "workspace":
                out.setdefault("workspace", []).append({"rule": item.where, **record})
            elif item.quantity == "self_collision":
                out["self_collision"] = {"links": item.where, **record}
            else:
                out.setdefault(item.quantity, {})[item.where] = record
        if self.unknown:
            out["unknown"] = list(self.unknown)
        if self.notes:
            out["notes"] = list(self.notes)
        return out


def not_checked(unknown: Iterable[str]) -> str:
    """Return what no certificate covers as one line; empty where there is nothing."""
    words = "; ".join(unknown)
    return f"not checked: {words}" if words else ""


def unchecked_refusal(unknown: Iterable[str], accept: str) -> str:
    """Return why a motion with something unchecked is refused, empty where all is checked; accept: what else to do."""
    line = not_checked(unknown)
    return f"{line}; write the facts into the robot YAML, or {accept}" if line else ""


def worst_of(parts: Iterable[Margins]) -> Margins:
    """Return the tightest margin of every limit over the parts of a motion."""
    parts = list(parts)
    items = tuple(min(same, key=lambda item: item.margin) for same in zip(*(part.items for part in parts), strict=True))
    return Margins(items, parts[0].unknown, parts[0].notes)
