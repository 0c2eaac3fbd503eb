"""What the drives report as effort: quantity, measuring point, sign, gain, and whether gravity is in it."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Literal

import numpy as np

from robot_ident.signals.motion import Array

Side = Literal["motor", "joint", "link"]
"""Where effort is measured: on the motor's shaft, the same referred to the joint, or by a sensor behind the gear."""


@dataclass(frozen=True)
class Effort:
    """What one joint reports: reported * sign * gain is a torque Nm (a force N) or a current A, measured at a side.

    gravity: whether it holds the torque of the arm's weight (`included`) or the driver took that out (`removed`).
    relative: what makes a drive of unknown gain comparable with the others (A over A, or Nm/A that stand in for it),
    None: nothing does.
    """

    quantity: Literal["torque", "current"] = "torque"
    side: Side = "joint"
    sign: Literal[1, -1] = 1
    gain: float = 1.0
    gravity: Literal["included", "removed"] = "included"
    relative: float | None = None


@dataclass(frozen=True)
class EffortSource:
    """Where the effort of one joint stands: a topic (None: that of the positions) and a field of its messages.

    field: effort, velocity or position of a JointState, by the joint's name; data[i] of a Float64MultiArray.
    """

    topic: str | None
    field: str = "effort"

    @property
    def index(self) -> int | None:
        """Place in the array of numbers, None where a name says which."""
        return int(self.field[len("data[") : -1]) if self.field.startswith("data[") else None


@dataclass(frozen=True)
class Efforts:
    """What the joints of a robot report, and where.

    by_joint: those that differ from `common`. topic: of the JointState messages, None: found in the bag. coupling
    [n, n]: torque at the joints = coupling @ torque of the drives, None where each drive moves one joint. sources: of
    joints whose effort stands elsewhere than in the field `effort` beside their position.
    """

    common: Effort = Effort()
    by_joint: Mapping[str, Effort] | None = None
    topic: str | None = None
    coupling: Array | None = None
    sources: Mapping[str, EffortSource] = field(default_factory=dict)

    def of(self, joint: str) -> Effort:
        """Return what a joint reports."""
        return (self.by_joint or {}).get(joint, self.common)

    def plain(self, joints: tuple[str, ...]) -> bool:
        """Whether every joint reports the torque on the joint side as it is."""
        return self.coupling is None and all(self.of(joint) == Effort() for joint in joints)

    def drives(self, joints: tuple[str, ...]) -> Array:
        """Return the factor [n] from what is reported to Nm or A: sign times gain."""
        return np.array([self.of(joint).sign * self.of(joint).gain for joint in joints])


_IN_AMPERE = {
    "kg m^2": "A s^2/rad",
    "kg m": "A s^2/m",
    "kg": "A s^2/m",
    "Nm": "A",
    "N": "A",
}


def in_ampere(unit: str) -> str:
    """Return the unit of a parameter of a torque that is counted in A: kg m^2 = Nm s^2/rad becomes A s^2/rad."""
    if unit in _IN_AMPERE:
        return _IN_AMPERE[unit]
    first, space, rest = unit.partition(" ")
    return f"A{space}{rest}" if first in ("Nm", "N") else unit.replace("Nm/", "A/")
