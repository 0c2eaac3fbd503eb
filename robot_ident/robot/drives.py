"""What a joint's effort means: gains, gear, side, coupling of its drives, and the topics that it comes by."""

from __future__ import annotations

import re
from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Annotated, Any, Literal

import numpy as np
from pydantic import BeforeValidator, Field

from robot_ident.configuration import Closed
from robot_ident.errors import InputError, did_you_mean
from robot_ident.signals.motion import Array, frozen_array

Side = Literal["motor", "joint", "link"]
"""Where effort is measured: on the motor's shaft, the same referred to the joint, or by a sensor behind the gear."""


@dataclass(frozen=True)
class Effort:
    """What one joint reports: reported * sign * gain is a torque Nm (a force N) or a current A, measured at a side.

    gravity: whether it holds the torque of the arm's weight (`included`) or the driver took that out (`removed`).
    unsigned: whether it is an absolute value, as hobby servos report it.
    relative: what makes a drive of unknown gain comparable with the others (A over A, or Nm/A that stand in for it),
    None: nothing does.
    """

    quantity: Literal["torque", "current"] = "torque"
    side: Side = "joint"
    sign: Literal[1, -1] = 1
    gain: float = 1.0
    gravity: Literal["included", "removed"] = "included"
    unsigned: bool = False
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


Positive = Annotated[float, Field(gt=0)]
_FIELD = re.compile(r"effort|velocity|position|data(\[\d+\])?")
_WORDS = ("quantity", "side", "sign", "gain", "gravity", "unsigned")


def _known_field(value: Any) -> Any:
    """Refuse a field that no message has which may hold an effort."""
    if isinstance(value, str) and not _FIELD.fullmatch(value):
        raise ValueError(
            "known fields are effort, velocity and position of a JointState, data and data[i] of a Float64MultiArray"
            + did_you_mean(value, ("effort", "velocity", "position", "data"))
        )
    return value


class EffortFile(Closed):
    """What a joint reports as effort; what is left out is as for all joints."""

    quantity: Literal["torque", "current"] | None = Field(None, description="torque (Nm, N) or current (A)")
    side: Side | None = Field(
        None, description="where it is measured: motor (its shaft), joint (motor torque referred to the joint) or link"
    )
    sign: Literal[1, -1] | None = Field(None, description="-1 where effort grows against the joint's direction")
    gain: Positive | None = Field(None, description="Nm or A that one reported unit is (mA: 0.001)")
    gravity: Literal["included", "removed"] | None = Field(
        None, description="removed: the driver takes the arm's weight out of what it reports"
    )
    unsigned: bool | None = Field(
        None, description="true: the driver reports absolute values; their sign is taken from the motion"
    )
    relative_gain: Positive | None = Field(
        None, description="current: gain over that of the other drives, where no torque_constant is known; unit A stays"
    )
    topic: str | None = Field(None, description="topic of the messages that hold it; default: found in the bag")
    field: Annotated[str | None, BeforeValidator(_known_field)] = Field(
        None, description="effort, velocity or position of a JointState; data (in the order of joints) or data[i]"
    )


class EffortsFile(EffortFile):
    """What all joints report as effort, and how drives move them."""

    coupling: list[list[float]] | None = Field(
        None, description="rows [joint][drive]: torque at the joints per torque of the drives, in the order of joints"
    )


def _spelled_out(value: Any) -> Any:
    """Take the short form: `current` for {quantity: current}."""
    return {"quantity": value} if isinstance(value, str) else value


EffortField = Annotated[EffortFile, BeforeValidator(_spelled_out)]
EffortsField = Annotated[EffortsFile, BeforeValidator(_spelled_out)]


def efforts_of(common: EffortsFile, single: Mapping[str, EffortFile], joints: tuple[str, ...], path: Path) -> Efforts:
    """Return what a robot's joints report.

    Raises InputError where a current is said to come from a link-side sensor, or the coupling is no n x n matrix that
    can be inverted.
    """
    base = _filled(Effort(), common)
    by_joint = {name: _filled(base, file) for name, file in single.items()}
    for name in joints:
        one = by_joint.get(name, base)
        if one.quantity == "current" and one.side == "link":
            raise InputError(f"{path}: effort of {name}: a link-side sensor reports a torque, not a current")
        if one.unsigned and one.sign == -1:
            raise InputError(f"{path}: effort of {name}: unsigned, so that sign: -1 says nothing; leave it out")
    coupling = None
    if common.coupling is not None:
        n = len(joints)
        if len(common.coupling) != n or any(len(row) != n for row in common.coupling):
            raise InputError(f"{path}: effort.coupling must be {n} x {n}, a row a joint and a column a drive")
        coupling = frozen_array(common.coupling, n, n)
        if np.linalg.matrix_rank(coupling) < n:
            raise InputError(f"{path}: effort.coupling = {common.coupling}: the drives don't move all joints")
        if any(by_joint.get(name, base).unsigned for name in joints):
            raise InputError(f"{path}: effort.coupling: the sign of an unsigned effort is unknown behind a coupling")
        if any(by_joint.get(name, base).side == "link" for name in joints):
            raise InputError(f"{path}: effort.coupling: a link-side sensor stands behind the coupling already")
    topic = common.topic if common.field in (None, "effort") else None
    return Efforts(base, by_joint, topic, coupling, _sources(common, single, joints, path))


def _sources(
    common: EffortsFile, single: Mapping[str, EffortFile], joints: tuple[str, ...], path: Path
) -> dict[str, EffortSource]:
    """Return where effort stands of joints that don't have it beside their position.

    Raises InputError where that would be the position itself, or numbers of no topic.
    """
    out = {}
    for place, name in enumerate(joints):
        file = single.get(name, common)
        topic, field = file.topic or common.topic, file.field or common.field or "effort"
        if field not in ("effort", "velocity") and topic is None:
            raise InputError(f"{path}: effort of {name}: field {field} needs the topic that holds it: effort.topic")
        source = EffortSource(topic, f"data[{place}]" if field == "data" else field)
        if field != "effort" or file.topic not in (None, common.topic):
            out[name] = source
    return out


def _filled(effort: Effort, file: EffortFile) -> Effort:
    told = {word: getattr(file, word) for word in _WORDS if getattr(file, word) is not None}
    if file.relative_gain is not None:
        told["relative"] = file.relative_gain
    return replace(effort, **told)
