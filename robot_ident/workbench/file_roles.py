"""Which recordings to fit and which to keep for validation, proposed from what they hold."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Literal

import numpy as np

from robot_ident.recording.measurement import Measurement
from robot_ident.report.wording import joined

Role = Literal["training", "validation", "none"]

_ENOUGH = 3  # different motions from which on one is kept for validation: two make a diagnosis firm
_ALIKE = 0.1  # of a joint's spread, by which mean and spread of two recordings of one motion may differ


@dataclass(frozen=True)
class Seen:
    """What a recording holds: seconds, periods (1: nothing repeats) of `period` s; mean and spread [n] rad or m of the
    positions, by which motions are told apart.
    """

    seconds: float
    periods: int
    period: float
    rate: float
    mean: tuple[float, ...]
    spread: tuple[float, ...]

    @classmethod
    def of(cls, measured: Measurement) -> Seen:
        """Return what a processed recording holds."""
        repeats = measured.base_frequency is not None and measured.periods > 1
        length = measured.motion.samples * measured.dt
        return cls(
            seconds=length * (measured.periods if repeats else 1),
            periods=measured.periods if repeats else 1,
            period=length,
            rate=measured.sample_rate,
            mean=tuple(float(v) for v in measured.motion.q.mean(axis=0)),
            spread=tuple(float(v) for v in measured.motion.q.std(axis=0)),
        )

    @property
    def in_words(self) -> str:
        """Return `16 periods of 10 s, 150 Hz`."""
        what = f"{self.periods} periods of {self.period:.3g} s" if self.periods > 1 else f"{self.seconds:.3g} s, once"
        return f"{what}, {self.rate:.4g} Hz"

    def same_motion(self, other: Seen) -> bool:
        """Return whether two recordings hold one motion, as far as their positions tell."""
        room = _ALIKE * np.maximum(self.spread, other.spread)
        return bool(
            abs(self.period - other.period) < _ALIKE * self.period
            and np.all(np.abs(np.subtract(self.mean, other.mean)) <= room)
            and np.all(np.abs(np.subtract(self.spread, other.spread)) <= room)
        )


def propose(seen: Mapping[str, Seen | None]) -> tuple[dict[str, Role], str]:
    """Return what each recording (None: it can't be used) is best for, and why.

    What repeats tells its noise and is fitted. Kept for validation are the recordings that don't repeat while others
    do; else, of three different motions or more, the one with the least data.
    """
    usable = {name: one for name, one in seen.items() if one is not None}
    if not usable:
        words = "None of these recordings can be used with this robot: choose another one below."
        return dict.fromkeys(seen, "none"), words
    motions = _motions(usable)
    single = [names for names in motions if all(usable[name].periods == 1 for name in names)]
    kept: list[str] = []
    why = ""
    if single and len(single) < len(motions):
        kept = [name for names in single for name in names]
        why = "does not repeat, and is kept" if len(kept) == 1 else "do not repeat, and are kept"
    elif len(motions) >= _ENOUGH:
        kept = min(reversed(motions), key=lambda names: sum(usable[name].seconds for name in names))
        why = "holds a motion of its own, and is kept" if len(kept) == 1 else "hold a motion of their own, and are kept"
    roles: dict[str, Role] = {n: "validation" if n in kept else "training" if n in usable else "none" for n in seen}
    fitted = [name for name, role in roles.items() if role == "training"]
    words = f"Proposed by what they hold: {joined(fitted)} for training"
    words += f"; {joined(kept)} {why} for validation" if kept else ""
    left = [names for names in motions if names[0] not in kept]
    words += "" if len(left) > 1 else "; a second, different motion would make a diagnosis firm"
    return roles, f"{words}. Change what you like."


def _motions(seen: Mapping[str, Seen]) -> list[list[str]]:
    """Return the recordings, those of one motion together."""
    out: list[list[str]] = []
    for name, one in seen.items():
        found = next((names for names in out if seen[names[0]].same_motion(one)), [])
        if not found:
            out.append(found)
        found.append(name)
    return out
