"""A motion played slower than it was designed."""

from __future__ import annotations

from dataclasses import dataclass

from robot_ident.excitation.reference import Reference
from robot_ident.signals.motion import Array, Motion


@dataclass(frozen=True)
class Slowed:
    """The same path at a share s of the speed, 0 < s <= 1: q(s t), s dq(s t), s^2 ddq(s t), within the same limits."""

    motion: Reference
    speed: float

    @property
    def duration(self) -> float:
        """Length [s]."""
        return self.motion.duration / self.speed

    @property
    def start_pose(self) -> Array:
        """Position at the start [n] rad."""
        return self.motion.start_pose

    def reference(self, t: Array) -> Motion:
        """Return the motion at t [N] s."""
        m = self.motion.reference(t * self.speed)
        return Motion(m.q, self.speed * m.dq, self.speed**2 * m.ddq)
