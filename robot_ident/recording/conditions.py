"""Conditions of a recording: what the hand carried, how the base stood, how warm it was, on what day."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import asdict, dataclass
from datetime import date
from pathlib import Path
from typing import Annotated, Any, Literal

import numpy as np
from pydantic import BeforeValidator, Discriminator, Field, Tag

from robot_ident.configuration import ALTERNATIVE, Closed, read, schema, to_yaml
from robot_ident.errors import InputError
from robot_ident.robot.robot import Robot
from robot_ident.signals.motion import Array, Motion

Positive = Annotated[float, Field(gt=0)]
Vector = tuple[float, float, float]
Inertia = tuple[float, float, float, float, float, float]
SCHEMA = "robot_ident/conditions/1"
_ENDINGS = (".npz", ".csv", ".mcap", ".db3")  # of recordings that are one file
_FAR = 2.0  # m from the flange: no hand holds a body so far away
_GRAVITY = 1.5, 30.0  # m/s^2, from the Moon's to far beyond the Earth's


@dataclass(frozen=True)
class KnownPayload:
    """A body in the hand: mass [kg], centre of mass [m] in the end effector's frame, and (Ixx, Ixy, Iyy, Ixz, Iyz, Izz)
    [kg m^2] about that centre along the frame's axes.
    """

    mass: float
    centre: Vector = (0.0, 0.0, 0.0)
    inertia: Inertia = (0.0,) * 6

    def standard(self, robot: Robot) -> Array:
        """Return its ten inertial parameters about and along the last joint's frame.

        m, m p and R I R' + m (p^2 1 - p p'), with p its centre in that frame.
        """
        rotation, origin = hand(robot)
        p = origin + rotation @ np.array(self.centre)
        own = rotation @ tensor(self.inertia) @ rotation.T
        about = own + self.mass * (p @ p * np.eye(3) - np.outer(p, p))
        return np.array([self.mass, *(self.mass * p), *entries(about)])

    def torque(self, robot: Robot, motion: Motion) -> Array:
        """Return what it adds to the torque along a motion [N, n] Nm: Y_last(q, dq, ddq) of its ten parameters."""
        return np.asarray(payload_columns(robot, motion) @ self.standard(robot))


@dataclass(frozen=True)
class PayloadPart:
    """What is known of a payload that is to be estimated otherwise: as of `KnownPayload`, None where nothing is."""

    mass: float | None = None
    centre: Vector | None = None
    inertia: Inertia | None = None

    @property
    def given(self) -> tuple[str, ...]:
        """What is known, by name."""
        return tuple(name for name, value in asdict(self).items() if value is not None)


@dataclass(frozen=True)
class Conditions:
    """What a recording's sidecar states.

    payload: in the hand and known, None where there is none. estimated: it is not known, or `part` alone, and `payload`
    what recordings told of it, None as long as they have not; unknown payloads of one `body` are the same. gravity:
    m/s^2 in the base's frame, None: the robot's. temperature: deg C. day: of the recording, as written. assumed: what
    of the payload (centre, inertia) the sidecar leaves out, and is taken for zero.
    """

    payload: KnownPayload | None = None
    estimated: bool = False
    tool: str = ""
    gravity: Vector | None = None
    temperature: float | None = None
    day: str = ""
    note: str = ""
    body: str = ""
    part: PayloadPart = PayloadPart()
    assumed: tuple[str, ...] = ()

    def to_dict(self) -> dict[str, Any]:
        """Return the sidecar's contents."""
        data: dict[str, Any] = {"schema": SCHEMA}
        if self.estimated:
            data["payload"] = {"estimate": self.body, **_plain(self.part)} if self.body else "estimate"
        elif self.payload is not None:
            data["payload"] = {k: v for k, v in _plain(self.payload).items() if k not in self.assumed}
        for key in ("tool", "temperature", "day", "note"):
            value = getattr(self, key)
            if value not in ("", None):
                data[key] = value
        if self.gravity is not None:
            data["gravity"] = list(self.gravity)
        return data

    def notes(self, *, off: bool) -> tuple[str, ...]:
        """Return a line that says what is special, if anything is; off: a known payload's torque is taken off."""
        named = f" {self.body}" if self.body else ""
        but = f" but for its {' and '.join(self.part.given)}" if self.part.given else ""
        found = f"payload{named} of {self.payload.mass:g} kg{' taken off' if off else ''}" if self.payload else ""
        words = [
            found + self._assumptions,
            f"payload{named} unknown{but}" if self.estimated and not self.payload else "",
            f"tool {self.tool}" if self.tool else "",
            "" if self.gravity is None else f"gravity {', '.join(f'{g:g}' for g in self.gravity)} m/s^2",
            "" if self.temperature is None else f"{self.temperature:g} deg C",
            self.note,
        ]
        said = "; ".join(word for word in words if word)
        return (f"conditions: {said}",) if said else ()

    @property
    def _assumptions(self) -> str:
        """What is assumed of the payload, and how it is given or found instead."""
        if self.payload is None or not self.assumed:
            return ""
        if "centre" not in self.assumed:
            return ", no inertia about its centre assumed"
        kept = "" if "inertia" in self.assumed else ", inertia: [...]"
        point = "" if kept else " and no inertia about it"
        return (
            f", its centre at the origin of the end effector's frame{point} assumed: give centre: [x, y, z] m, or"
            f" payload: {{estimate: box, mass: {self.payload.mass:g}{kept}}} beside a recording without it finds it"
        )

    def text(self) -> str:
        """Return the sidecar as YAML."""
        return to_yaml(self.to_dict())


def _plain(record: KnownPayload | PayloadPart) -> dict[str, Any]:
    """Return what is told of a payload, for YAML."""
    return {k: list(v) if isinstance(v, tuple) else v for k, v in asdict(record).items() if v is not None}


# so that a mistake in one is not told as one in all
_BODY, _OPEN, _WORD = ALTERNATIVE + "body", ALTERNATIVE + "open", ALTERNATIVE + "word"


def _not_a_word(value: Any) -> Any:
    """Say how a part of a payload is left open."""
    if value == "estimate":
        raise ValueError("what is to be estimated is left out beside a name: payload: {estimate: box, mass: 2.0}")
    return value


Part = BeforeValidator(_not_a_word)
_INERTIA = "Ixx, Ixy, Iyy, Ixz, Iyz, Izz about that centre, kg m^2"


class PayloadFile(Closed):
    """A known payload in a sidecar."""

    mass: Annotated[Positive, Part] = Field(description="kg")
    centre: Annotated[Vector, Part] = Field(
        (0.0, 0.0, 0.0), description="centre of mass in the end effector's frame, m"
    )
    inertia: Annotated[Inertia, Part] = Field((0.0,) * 6, description=_INERTIA)


class OpenPayloadFile(Closed):
    """A payload in a sidecar that is not known, or in part, but is the same wherever it is called so."""

    estimate: Annotated[str, Field(min_length=1)] = Field(description="its name; what is left out is estimated")
    mass: Annotated[Positive | None, Part] = Field(None, description="kg, where it is known")
    centre: Annotated[Vector | None, Part] = Field(None, description="in the end effector's frame, m, where known")
    inertia: Annotated[Inertia | None, Part] = Field(None, description=f"{_INERTIA}, where known")


def _kind(value: Any) -> str:
    if isinstance(value, OpenPayloadFile) or (isinstance(value, dict) and "estimate" in value):
        return _OPEN
    return _BODY if isinstance(value, (dict, PayloadFile)) else _WORD


PayloadField = Annotated[
    Annotated[PayloadFile, Tag(_BODY)]
    | Annotated[OpenPayloadFile, Tag(_OPEN)]
    | Annotated[Literal["estimate", "none"], Tag(_WORD)],
    Discriminator(_kind),
]


class ConditionsFile(Closed):
    """`BAG.conditions.yaml` (`schema: robot_ident/conditions/1`)."""

    schema_: schema(SCHEMA) = Field(alias="schema", description="what this file is")  # type: ignore[valid-type]
    payload: PayloadField = Field("none", description="in the hand, or to be estimated")
    tool: str = Field("", description="what is mounted; it belongs to the arm")
    gravity: Vector | None = Field(None, description="in the base's frame, m/s^2; default the robot's")
    temperature: float | None = Field(None, description="deg C")
    day: date | None = Field(None, description="of the recording, 2026-03-01; default that of its first stamp")
    note: str = Field("", description="anything else")


def sidecar(bag: Path | str) -> Path:
    """Return where the conditions of a recording stand, or would: beside it, `BAG.conditions.yaml`, or, of a file
    with a known ending, `a.conditions.yaml` of `a.npz` where that is there.
    """
    places = _sidecars(Path(bag))
    return next((path for path in places if path.exists()), places[0])


def _sidecars(bag: Path) -> list[Path]:
    """Return where the conditions of a recording may stand."""
    names = [bag.name, *([bag.stem] if bag.suffix.lower() in _ENDINGS else [])]
    return [bag.with_name(f"{name}.conditions.yaml") for name in names]


def read_conditions(bag: Path | str) -> Conditions:
    """Return what the sidecar of a recording states, nothing where there is none; InputError where it can't be used, or
    where there are two.
    """
    path = sidecar(bag)
    if not path.exists():
        return Conditions()
    twice = [str(place) for place in _sidecars(Path(bag)) if place.exists()]
    if len(twice) > 1:
        raise InputError(f"{bag}: its conditions stand in {' and in '.join(twice)}; keep one of them")
    file = read(ConditionsFile, path)
    payload, part, named = None, PayloadPart(), ""
    assumed: tuple[str, ...] = ()
    if isinstance(file.payload, OpenPayloadFile):
        named = file.payload.estimate
        part = PayloadPart(file.payload.mass, file.payload.centre, file.payload.inertia)
        if part.given == ("mass", "centre", "inertia"):
            raise InputError(
                f"{path}: payload.estimate: mass, centre and inertia are all given; leave one out, or the word estimate"
            )
        _check_inertia(part, path)
    if isinstance(file.payload, PayloadFile):
        payload = KnownPayload(file.payload.mass, file.payload.centre, file.payload.inertia)
        assumed = tuple(name for name in ("centre", "inertia") if name not in file.payload.model_fields_set)
        _check_inertia(payload, path)
    centre = part.centre if payload is None else payload.centre
    if centre is not None and np.linalg.norm(centre) > _FAR:
        raise InputError(f"{path}: {in_metres(centre)}")
    if file.gravity is not None and not _GRAVITY[0] <= np.linalg.norm(file.gravity) <= _GRAVITY[1]:
        raise InputError(
            f"{path}: gravity = {list(file.gravity)}: m/s^2 in the base's frame was expected, 9.81 of them towards down"
        )
    return Conditions(
        payload,
        bool(named) or file.payload == "estimate",
        file.tool,
        file.gravity,
        file.temperature,
        "" if file.day is None else file.day.isoformat(),
        file.note,
        named,
        part,
        assumed,
    )


def in_metres(centre: Vector) -> str:
    """Return in words that a centre lies too far from the flange to be one in metres."""
    told, metres = (", ".join(f"{x * unit:g}" for x in centre) for unit in (1.0, 1e-3))
    return f"centre: [{told}] m lies {np.linalg.norm(centre):.3g} m from the flange: millimetres? write [{metres}]"


def tensor(inertia: Iterable[Any]) -> Array:
    """Return the symmetric matrix [3, 3] of Ixx, Ixy, Iyy, Ixz, Iyz, Izz."""
    xx, xy, yy, xz, yz, zz = inertia
    return np.array([[xx, xy, xz], [xy, yy, yz], [xz, yz, zz]])


def entries(matrix: Array) -> Array:
    """Return xx, xy, yy, xz, yz, zz [6] of a symmetric matrix [3, 3]."""
    return matrix[(0, 0, 1, 0, 1, 2), (0, 1, 1, 2, 2, 2)]


def _check_inertia(payload: KnownPayload | PayloadPart, path: Path) -> None:
    """Raise InputError where no body has such moments of inertia about its centre."""
    if payload.inertia is None:
        return
    moments = np.linalg.eigvalsh(tensor(payload.inertia))
    if moments[0] < -1e-12 or moments[0] + moments[1] < moments[2] * (1 - 1e-9) - 1e-12:
        raise InputError(f"{path}: payload.inertia = {list(payload.inertia)}: no body has these moments of inertia")


def hand(robot: Robot) -> tuple[Array, Array]:
    """Return rotation [3, 3] and origin [3] m of the end effector's frame in that of the last joint.

    Raises InputError where the end effector isn't on the last link.
    """
    model = robot.rigid.model
    frame = model.frames[model.getFrameId(robot.end_effector)]
    if frame.parentJoint != robot.n:
        raise InputError(f"robot {robot.name}: end effector {robot.end_effector!r} is not on the last link")
    return np.array(frame.placement.rotation), np.array(frame.placement.translation)


def payload_columns(robot: Robot, motion: Motion) -> Array:
    """Return the torque [N, n, 10] Nm per unit of a payload's ten parameters in the last joint's frame."""
    return robot.rigid.regressor(motion)[:, :, -10:]
