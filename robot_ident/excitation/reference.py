"""What a motion that can be played offers: its duration, its pose at the start, and its state at any time."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Protocol

from robot_ident.excitation.fourier import MotionExtremes
from robot_ident.signals.motion import Array, Motion


class Reference(Protocol):
    """A motion from rest to rest that a robot can be made to follow."""

    @property
    def duration(self) -> float:
        """Duration [s]."""

    @property
    def start_pose(self) -> Array:
        """Position at the start [n] rad."""

    def reference(self, t: Array) -> Motion:
        """Return the motion at instants t [N] s; at rest before the start and after the end."""


@dataclass(frozen=True)
class Piece:
    """A stretch of a motion from `start` to `end` [s] along which q and dq have no jump, with bounds of q, dq and ddq
    on it.

    jerk [n]: bounds of |d^3 q / dt^3| apart from the instants `jumps` at which the acceleration jumps; None where it is
    not known. name: which part of a motion it is.
    """

    start: float
    end: float
    motion: Callable[[Array], Motion]
    extremes: MotionExtremes
    jerk: Array | None = None
    jumps: tuple[float, ...] = ()
    name: str = ""


class Certifiable(Protocol):
    """A motion whose limits can be certified: named joints and pieces with known extremes."""

    @property
    def joints(self) -> tuple[str, ...]:
        """Names of the joints [n]."""

    def pieces(self) -> Sequence[Piece]:
        """Return the pieces that hold every state of the motion."""
