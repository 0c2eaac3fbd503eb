"""What a page looks at: a joint of a step, what is laid over its residual, and the moments that are brushed, with how
much of the error they hold.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Any, Literal

import numpy as np

from robot_ident.errors import InputError
from robot_ident.signals.motion import Array, Mask
from robot_ident.workbench.view import Overlay, View

Shade = Literal["light", "dark"]


@dataclass(frozen=True)
class Condition:
    """lower <= variable <= upper, in one recording (by its place) or in all (None)."""

    variable: str
    lower: float
    upper: float
    recording: int | None = None

    @classmethod
    def of(cls, data: Mapping[str, Any]) -> Condition:
        """Return the condition that a browser sent; InputError where it is none."""
        try:
            place = data.get("recording")
            ends = float(data["lower"]), float(data["upper"])
            return cls(str(data["variable"]), *ends, None if place is None else int(place))
        except (KeyError, TypeError, ValueError) as error:
            raise InputError(f"{dict(data)}: no region") from error


@dataclass(frozen=True)
class Held:
    """What brushed moments hold: their share of the excess error and of the time, and the residual's rms in them."""

    share: float
    of_time: float
    rms: float
    rows: int


@dataclass(frozen=True)
class Look:
    """What a page looks at: a joint of a step, the recording that is drawn over time, what is laid over the residual,
    the regions that are brushed, and over which third variable the residual is drawn.
    """

    view: View
    joint: int
    recording: int = 0
    overlays: Sequence[Overlay] = ()
    conditions: Sequence[Condition] = ()
    over: str = "load"
    shade: Shade = "light"

    @property
    def name(self) -> str:
        """The name of the joint."""
        return self.view.joints[self.joint]

    @property
    def unit(self) -> str:
        """The unit of its torque."""
        return self.view.unit(self.joint)

    @cached_property
    def inside(self) -> list[Mask] | None:
        """Which rows [N] of every recording fulfil all conditions; None where nothing is brushed."""
        if not self.conditions:
            return None
        out = []
        for place, one in enumerate(self.view.rows):
            inside = np.ones(len(one.t), dtype=bool)
            for condition in self.conditions:
                x = self.values(place, condition.variable)
                here = condition.recording in (None, place)
                inside &= (x >= condition.lower) & (x <= condition.upper) & here
            out.append(inside)
        return out

    def used(self, recording: int) -> Mask:
        """Return which rows [N] of a recording count at the joint."""
        return np.asarray(self.view.rows[recording].weight[:, self.joint] > 0)

    def values(self, recording: int, variable: str) -> Array:
        """Return the values [N] of a variable of the joint; `velocity of JOINT` is another joint's."""
        kind, of, other = variable.partition(" of ")
        if of and other not in self.view.joints:
            raise InputError(f"{variable}: there is no joint {other!r}")
        rows = self.view.rows[recording]
        columns = {
            "velocity": rows.dq,
            "position": rows.q,
            "load": self.view.loads[recording],
            "acceleration": rows.ddq,
            "time_since_reversal": rows.since,
            "speed": np.abs(rows.dq),
        }
        if kind == "time":
            return rows.t
        if kind not in columns:
            raise InputError(f"{kind}: no variable; known: time, {', '.join(columns)}")
        return columns[kind][:, self.view.joints.index(other) if of else self.joint]

    def symbol(self, variable: str) -> tuple[str, str]:
        """Return the symbol and the unit of a variable."""
        kind, _, other = variable.partition(" of ")
        length = "m" if self.view.comparison["prismatic"][self.view.joints.index(other or self.name)] else "rad"
        of = f" of {other}" if other and other != self.name else ""
        return {
            "time": ("t", "s"),
            "position": (f"q{of}", length),
            "velocity": (f"dq{of}", f"{length}/s"),
            "speed": (f"|dq{of}|", f"{length}/s"),
            "acceleration": (f"ddq{of}", f"{length}/s²"),
            "load": (f"load torque{of}", self.unit),
            "time_since_reversal": (f"time since reversal{of}", "s"),
        }[kind]

    def in_words(self, condition: Condition) -> str:
        """Return a condition in words: `0.1 < dq < 0.3 rad/s`."""
        symbol, unit = self.symbol(condition.variable)
        place = condition.recording
        source = "" if place is None else f" of {self.view.recordings[place]['name']}"
        return f"{condition.lower:.3g} < {symbol} < {condition.upper:.3g} {unit}{source}"

    def held(self) -> Held | None:
        """Return what the brushed moments of the training recordings hold of the residual; None where nothing is.

        Shares as `compare` has them: of sum (w r)^2 beyond the noise, and of the rows that count.
        """
        if self.inside is None:
            return None
        excess, total, count, all_rows, square = 0.0, 0.0, 0, 0, 0.0
        for place in self.view.training:
            one, used, r = self.view.rows[place], self.used(place), self.view.residual[place][:, self.joint]
            level = float(one.dof[self.joint]) / max(1, int(used.sum()))
            beyond = (one.weight[:, self.joint] * r) ** 2 - level
            both = used & self.inside[place]
            excess += float(beyond[both].sum())
            total += float(beyond[used].sum())
            square += float(np.sum(r[both] ** 2))
            count += int(both.sum())
            all_rows += int(used.sum())
        share = float(np.clip(excess / total, 0.0, 1.0)) if total > 0 else 0.0
        return Held(share, count / max(all_rows, 1), float(np.sqrt(square / max(count, 1))), count)
