"""Brushing: the moments at which conditions hold, and how much of the error they hold."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from robot_ident.errors import InputError
from robot_ident.signals.motion import Array, Mask
from robot_ident.workbench.records import Rows
from robot_ident.workbench.view import View


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
            return cls(
                str(data["variable"]),
                float(data["lower"]),
                float(data["upper"]),
                None if place is None else int(place),
            )
        except (KeyError, TypeError, ValueError) as error:
            raise InputError(f"{dict(data)}: no region") from error


@dataclass(frozen=True)
class Held:
    """What brushed moments hold: their share of the excess error and of the time, and the residual's rms in them."""

    share: float
    of_time: float
    rms: float
    rows: int


def brushed(
    conditions: Sequence[Condition], rows: Sequence[Rows], loads: Sequence[Array], joints: Sequence[str], joint: int
) -> list[Mask]:
    """Return for every recording which rows [N] fulfil all conditions, looked at from a joint."""
    out = []
    for place, (one, load) in enumerate(zip(rows, loads, strict=True)):
        inside = np.ones(len(one.t), dtype=bool)
        for condition in conditions:
            if condition.recording not in (None, place):
                inside[:] = False
                continue
            x = values(one, condition.variable, load, joints, joint)
            inside &= (x >= condition.lower) & (x <= condition.upper)
        out.append(inside)
    return out


def values(rows: Rows, variable: str, load: Array, joints: Sequence[str], joint: int) -> Array:
    """Return the values [N] of a variable of a joint; `velocity of JOINT` is another joint's. load [N, n]: the torque
    that the gears carry.
    """
    kind, of, other = variable.partition(" of ")
    if of and other not in joints:
        raise InputError(f"{variable}: there is no joint {other!r}")
    columns = {
        "velocity": rows.dq,
        "position": rows.q,
        "load": load,
        "acceleration": rows.ddq,
        "time_since_reversal": rows.since,
        "speed": np.abs(rows.dq),
    }
    if kind == "time":
        return rows.t
    if kind not in columns:
        raise InputError(f"{kind}: no variable; known: time, {', '.join(columns)}")
    return columns[kind][:, list(joints).index(other) if of else joint]


def held(inside: Sequence[Mask], rows: Sequence[Rows], residual: Sequence[Array], joint: int) -> Held:
    """Return what the brushed moments of recordings hold of a joint's residual [N, n] Nm.

    Shares as `compare` has them: of sum (w r)^2 beyond the noise, and of the rows that count.
    """
    excess, total, count, all_rows, square = 0.0, 0.0, 0, 0, 0.0
    for mask, one, r in zip(inside, rows, residual, strict=True):
        used = one.weight[:, joint] > 0
        level = float(one.dof[joint]) / max(1, int(used.sum()))
        beyond = (one.weight[:, joint] * r[:, joint]) ** 2 - level
        both = used & mask
        excess += float(beyond[both].sum())
        total += float(beyond[used].sum())
        square += float(np.sum(r[both, joint] ** 2))
        count += int(both.sum())
        all_rows += int(used.sum())
    share = float(np.clip(excess / total, 0.0, 1.0)) if total > 0 else 0.0
    return Held(share, count / max(all_rows, 1), float(np.sqrt(square / max(count, 1))), count)


def in_words(view: View, joint: int, condition: Condition) -> str:
    """Return a condition in words: `0.1 < dq < 0.3 rad/s`."""
    symbol, unit = symbol_of(view, joint, condition.variable)
    source = "" if condition.recording is None else f" of {view.recordings[condition.recording]['name']}"
    return f"{condition.lower:.3g} < {symbol} < {condition.upper:.3g} {unit}{source}"


def symbol_of(view: View, joint: int, variable: str) -> tuple[str, str]:
    """Return the symbol and the unit of a variable."""
    kind, _, other = variable.partition(" of ")
    length = "m" if view.comparison["prismatic"][view.joints.index(other) if other else joint] else "rad"
    of = f" of {other}" if other and other != view.joints[joint] else ""
    return {
        "time": ("t", "s"),
        "position": (f"q{of}", length),
        "velocity": (f"dq{of}", f"{length}/s"),
        "speed": (f"|dq{of}|", f"{length}/s"),
        "acceleration": (f"ddq{of}", f"{length}/s²"),
        "load": (f"load torque{of}", view.unit(joint)),
        "time_since_reversal": (f"time since reversal{of}", "s"),
    }[kind]
