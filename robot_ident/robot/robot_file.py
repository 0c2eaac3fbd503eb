"""Reads a robot: a name in `config/robots`, a robot YAML, or a bare URDF."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from pathlib import Path
from typing import Annotated, Any, Literal

import numpy as np
from pydantic import Field, ValidationInfo, field_validator, model_validator

from robot_ident.configuration import Closed, parse, read_yaml, schema
from robot_ident.errors import InputError, did_you_mean
from robot_ident.files import read_text
from robot_ident.provenance import config_file
from robot_ident.robot import workspace
from robot_ident.robot.anti_alias import AntiAlias
from robot_ident.robot.drives import EffortField, EffortFile, Efforts, EffortsField, EffortsFile, efforts_of
from robot_ident.robot.geometry import CLEARANCE, Geometry
from robot_ident.robot.rigid_body import RigidBody
from robot_ident.robot.robot import Definition, Drives, Limits, Noise, Robot, Spring, at_every_joint
from robot_ident.robot.urdf import (
    ENDLESS,
    check_serial,
    find_resource,
    followed,
    lock,
    parse_urdf,
    refuse_millimetres,
    refuse_mimics,
)
from robot_ident.signals.motion import Array, frozen_array

Positive = Annotated[float, Field(gt=0)]
NotNegative = Annotated[float, Field(ge=0)]
Vector = tuple[float, float, float]
Gravity = Annotated[float, Field(ge=-30.0, le=30.0)]  # m/s^2 along one axis; the Earth's is 9.81


class AntiAliasFile(Closed):
    """Analogue low pass of the torque channel: a Butterworth filter, or the sections that `filter` identified."""

    order: int | None = Field(None, ge=1, le=12, description="order of the Butterworth filter; default 8")
    cutoff: Positive | None = Field(None, description="-3 dB frequency, Hz")
    sections: list[tuple[Positive, Positive] | tuple[Positive]] | None = Field(
        None,
        min_length=1,
        max_length=12,
        description="in place of these: [natural frequency Hz, quality] of each pair of poles, [Hz] of a real one",
    )

    @model_validator(mode="after")
    def _one_of_both(self) -> AntiAliasFile:
        if (self.cutoff is None) == (self.sections is None) or (self.order is not None and self.sections is not None):
            raise ValueError("either order and cutoff, or sections alone, were expected")
        return self

    @property
    def filter(self) -> AntiAlias:
        """The filter."""
        if self.sections is not None:
            return AntiAlias.of_sections(self.sections)
        assert self.cutoff is not None
        return AntiAlias(8 if self.order is None else self.order, self.cutoff)


class JointFile(Closed):
    """A joint in a robot YAML; what is left out comes from the URDF."""

    position: tuple[float, float] | None = Field(None, description="lower and upper limit, rad or m")
    velocity: Positive | None = Field(None, description="largest speed, rad/s or m/s")
    acceleration: Positive | None = Field(None, description="largest acceleration, rad/s^2 or m/s^2")
    torque: Positive | None = Field(None, description="largest torque, Nm or N")
    current: Positive | None = Field(None, description="largest current of the drive, A")
    gear_ratio: Positive = Field(1.0, description="motor turns per joint turn")
    armature: NotNegative = Field(0.0, description="rotor inertia on the joint side, kg m^2")
    encoder_step: NotNegative = Field(0.0, description="resolution of the position, rad or m")
    torque_constant: Positive | None = Field(None, description="torque per ampere, Nm/A, on the side of effort")
    torque_curve: list[tuple[Positive, Positive]] | None = Field(
        None, min_length=1, description="[current A, joint torque Nm] pairs, rising, in place of torque_constant"
    )
    torque_delay: float | None = Field(
        None, ge=-0.5, le=0.5, description="time by which torque lags the position, s; default the robot's"
    )
    anti_alias: AntiAliasFile | None = Field(
        None, description="low pass in this joint's torque channel; default the robot's"
    )
    effort: EffortField = Field(EffortFile(), description="what this joint reports, where it differs from the others")
    torque_variance: Positive | None = Field(None, description="noise variance of one torque sample, (Nm)^2")
    position_variance: NotNegative | None = Field(None, description="noise variance of one position sample, rad^2")
    minimum_speed: NotNegative = Field(0.0, description="samples slower than this aren't used to identify, rad/s")

    @field_validator("torque_curve")
    @classmethod
    def _rising(cls, value: list[tuple[float, float]] | None) -> list[tuple[float, float]] | None:
        pairs = [(0.0, 0.0), *(value or [])]
        if any(b[0] <= a[0] or b[1] <= a[1] for a, b in zip(pairs, pairs[1:], strict=False)):
            raise ValueError("currents and torques must rise from pair to pair")
        return value

    @field_validator("position")
    @classmethod
    def _ordered(cls, value: tuple[float, float] | None) -> tuple[float, float] | None:
        if value is not None and value[0] >= value[1]:
            raise ValueError("the lower limit must be below the upper one")
        return value


class RuleFile(Closed):
    """A workspace rule in a robot YAML."""

    kind: Literal["half_space", "cylinder", "box"] = Field(
        description="half_space: kept; cylinder and box: kept or forbidden"
    )
    frame: str | None = Field(None, description="the frame that is meant; default the end effector")
    normal: Vector | None = Field(None, description="half_space: direction that is allowed")
    offset: float = Field(0.0, description="half_space: smallest distance along the normal, m")
    point: Vector = Field((0.0, 0.0, 0.0), description="cylinder: a point of its axis, m")
    axis: Vector = Field((0.0, 0.0, 1.0), description="cylinder: direction of its axis")
    radius: Positive | None = Field(None, description="cylinder: radius, m")
    lower: float | Vector | None = Field(None, description="cylinder: its lower end along the axis, m; box: corner, m")
    upper: float | Vector | None = Field(None, description="cylinder: its upper end along the axis, m; box: corner, m")
    inside: bool | None = Field(
        None, description="cylinder (default false) and box (default true): stay inside or outside"
    )
    guess: bool = Field(False, description="true: init's guess, which nobody has confirmed; take it away when you have")

    def rule(self, end_effector: str) -> workspace.WorkspaceRule:
        """Return the rule; ValueError where a field is missing or of the wrong form."""
        frame = self.frame or end_effector
        if self.kind == "half_space":
            if self.normal is None:
                raise ValueError("a half_space needs 'normal'")
            return workspace.half_space(frame, self.normal, self.offset)
        if self.kind == "cylinder":
            if self.radius is None or isinstance(self.lower, tuple) or isinstance(self.upper, tuple):
                raise ValueError("a cylinder needs 'radius', and 'lower' and 'upper' as numbers")
            return workspace.cylinder(
                frame, self.point, self.axis, self.radius, self.lower, self.upper, inside=self.inside is True
            )
        if not isinstance(self.lower, tuple) or not isinstance(self.upper, tuple):
            raise ValueError("a box needs 'lower' and 'upper' as [x, y, z]")
        return workspace.box(frame, self.lower, self.upper, inside=self.inside is not False)


class SelfCollisionFile(Closed):
    """What a robot YAML says about its links touching each other."""

    clearance: NotNegative = Field(CLEARANCE, description="smallest distance between two links, m")
    srdf: str | None = Field(None, description="SRDF whose disable_collisions name links that may touch")
    ignore: list[tuple[str, str]] = Field([], description="further pairs of links that may touch")
    check: bool = Field(True, description="false: links may touch")


class SpringFile(Closed):
    """Geometry of a gravity spring."""

    length: Positive = Field(description="distance of the fixed end from the axis, m")
    lever: Positive = Field(description="lever of the moving end, m")


class RobotFile(Closed):
    """A robot YAML (`schema: robot_ident/robot/1`)."""

    schema_: schema("robot_ident/robot/1") = Field(alias="schema", description="what this file is")  # type: ignore[valid-type]
    name: str = Field(description="name of the robot, repeated in every file made for it")
    urdf: str = Field(description="URDF file, relative to this one")
    end_effector: str | None = Field(None, description="frame of the end effector; default the last one")
    gravity: tuple[Gravity, Gravity, Gravity] = Field((0.0, 0.0, -9.81), description="in the base frame, m/s^2")
    joints: dict[str, JointFile] = Field(
        {}, description="the joints that move, in the order of the chain; others are locked"
    )
    locked: dict[str, float] = Field({}, description="angles at which other joints of the URDF are held, rad")
    workspace: list[RuleFile] = Field(
        [], description="rules on the position of frames; an empty list says that there is nothing to hit"
    )
    self_collision: SelfCollisionFile | None = Field(
        None, description="distance between links; looked at wherever the URDF has collision geometry"
    )
    springs: dict[str, SpringFile] = Field({}, description="gravity springs by joint")
    base: Literal["prediction", "declared"] = Field(
        "prediction",
        description="prediction: offsets and rotor inertias belong to the base model, and recordings are processed, as"
        " predicts motion left out best; declared: links, viscous and Coulomb friction and `effects`, no more",
    )
    effects: list[str] = Field([], description="effects known to be there, as name@joint; @* means every joint")
    base_parameters: dict[str, str] = Field({}, description="shown name: standard parameter, e.g. p1: Izz1")
    anti_alias: AntiAliasFile | None = Field(
        None, description="low pass in the torque channel, undone when identifying"
    )
    effort: EffortsField = Field(
        EffortsFile(), description="what the drives report as effort: torque, current, or more words in a mapping"
    )
    torque_delay: float = Field(0.0, ge=-0.5, le=0.5, description="time by which torque lags the position, s")
    simulation: dict[str, dict[str, float | dict[str, float]]] = Field(
        {}, description="true values in the simulated robot: effect: {joint: value or {parameter: value}}"
    )

    @field_validator("workspace")
    @classmethod
    def _rules(cls, value: list[RuleFile], info: ValidationInfo) -> list[RuleFile]:
        for rule in value:
            rule.rule(info.data.get("end_effector") or "end effector")
        return value


def builtin_robots() -> list[str]:
    """Return the names of the robots that come with the package."""
    return sorted(file.stem for file in config_file("robots").glob("*.yaml"))


def load_robot(name: str | Path = "kuka_ir361") -> Robot:
    """Read a robot by name (`kuka_ir361`), from a robot YAML or from a URDF.

    Raises InputError that names the file and the field when it can't be used.
    """
    path = Path(name)
    if path.suffix == ".urdf":
        text = read_text(path)
        file = RobotFile(schema="robot_ident/robot/1", name=path.stem, urdf=path.name)
        return _build(
            file, text, path, Definition({"schema": "robot_ident/robot/1", "name": path.stem, "urdf": path.name}, text)
        )
    builtin = path.suffix not in (".yaml", ".yml")
    if builtin:
        known = builtin_robots()
        if str(name) not in known:
            raise InputError(
                f"no robot {str(name)!r}{did_you_mean(str(name), known)} (or give a robot YAML or a URDF file)"
            )
        path = config_file("robots", f"{name}.yaml")
    data = read_yaml(path)
    file = parse(RobotFile, data, path)
    text = read_text(_located(file.urdf, path))
    return _build(file, text, path, None if builtin else Definition(data, text))


def robot_of(definition: Definition, source: str) -> Robot:
    """Return the robot of a definition that a model carries; `source` names the model's file in messages."""
    return _build(parse(RobotFile, dict(definition.yaml), source), definition.urdf, Path(source), definition)


def _located(name: str, path: Path) -> Path:
    """Return the file that a robot YAML at `path` names: relative to it, or in a package (`package://NAME/...`)."""
    found = find_resource(name, path.parent)
    if found is None and "://" in name:
        raise InputError(f"{path}: {name!r} was not found")
    return found or path.parent / name


def definition_of(robot: Robot) -> Definition:
    """Return what a robot was read from, of one that comes with the package too."""
    if robot.definition is not None:
        return robot.definition
    path = Path(robot.source)
    data = read_yaml(path)
    return Definition(data, read_text(_located(parse(RobotFile, data, path).urdf, path)))


def _build(file: RobotFile, text: str, path: Path, definition: Definition | None) -> Robot:
    urdf = path if path.suffix == ".urdf" else find_resource(file.urdf, path.parent) or path.parent / file.urdf
    model = parse_urdf(text, urdf)
    moving = tuple(file.joints) or tuple(name for name in list(model.names)[1:] if name not in file.locked)
    model = lock(model, moving, file.locked, path)
    check_serial(model, urdf)
    refuse_millimetres(model, urdf)
    refuse_mimics(text, moving, urdf)
    joints = tuple(list(model.names)[1:])
    if not joints:
        raise InputError(f"{urdf}: no joint moves")
    records = [file.joints.get(name, JointFile()) for name in joints]
    model.gravity.linear = np.array(file.gravity)
    model.armature = np.array([record.armature for record in records])
    end_effector = file.end_effector or _last_frame(model)
    if not model.existFrame(end_effector):
        frames = [frame.name for frame in model.frames]
        raise InputError(f"{path}: frame {end_effector!r} is not in the URDF{did_you_mean(end_effector, frames)}")
    rules = tuple(rule.rule(end_effector) for rule in file.workspace)
    for rule in rules:
        if not model.existFrame(rule.frame):
            raise InputError(f"{path}: workspace: frame {rule.frame!r} is not in the URDF")
    limits = _limits(model, records)
    geometry = _geometry(file, text, urdf, path, joints, limits)
    following = followed(text, joints)
    effort = efforts_of(
        file.effort, {name: record.effort for name, record in zip(joints, records, strict=True)}, joints, path
    )
    _refuse_weight_in_ampere(effort, records, joints, path)
    return Robot(
        name=file.name,
        source=str(path),
        definition=definition,
        joints=joints,
        rigid=RigidBody(model),
        limits=limits,
        geometry=geometry,
        drives=Drives(
            gear_ratio=_column(record.gear_ratio for record in records),
            armature=_column(record.armature for record in records),
            encoder_step=_column(record.encoder_step for record in records),
            torque_constant=_column(record.torque_constant for record in records),
        ),
        noise=Noise(
            torque_variance=_column(record.torque_variance for record in records),
            position_variance=_column(record.position_variance for record in records),
        ),
        end_effector=end_effector,
        workspace=rules,
        unchecked=_unchecked(file, rules, geometry, joints, following),
        following=following,
        springs={joint: Spring(spring.length, spring.lever) for joint, spring in file.springs.items()},
        simulation=_simulation(file, joints, path),
        known_effects=at_every_joint(file.effects, joints),
        base=file.base,
        base_parameters=dict(file.base_parameters),
        minimum_speed=_column(record.minimum_speed for record in records),
        anti_alias=tuple(
            kind.filter if kind else None for kind in (record.anti_alias or file.anti_alias for record in records)
        ),
        effort=effort,
        torque_delay=_column(file.torque_delay if r.torque_delay is None else r.torque_delay for r in records),
        torque_curves={
            name: tuple(record.torque_curve)
            for name, record in zip(joints, records, strict=True)
            if record.torque_curve is not None
        },
    )


def _refuse_weight_in_ampere(
    effort: Efforts, records: Sequence[JointFile], joints: tuple[str, ...], path: Path
) -> None:
    """Raise InputError where weight, in Nm, would be put back into currents whose Nm/A nobody knows."""
    for name, record in zip(joints, records, strict=True):
        one = effort.of(name)
        known = record.torque_constant is not None or record.torque_curve is not None
        if one.quantity == "current" and one.gravity == "removed" and not known:
            raise InputError(
                f"{path}: effort of {name}: gravity: removed needs torque_constant or torque_curve, since the weight is"
                " put back in Nm; info --robot with gravity: included says which Nm/A fits the URDF's masses"
            )


def _unchecked(
    file: RobotFile,
    rules: tuple[workspace.WorkspaceRule, ...],
    geometry: Geometry | None,
    joints: Sequence[str],
    following: Mapping[str, str],
) -> tuple[str, ...]:
    """Return what a robot's files leave out or only guess, in words."""
    out = [
        f"where {name} and all beyond it are (it follows {leader}, and stands still in this model)"
        for name, leader in following.items()
    ]
    if geometry is None and file.self_collision is None and len(joints) > 1:
        out.append("self-collision (no collision geometry in the URDF)")
    if "workspace" not in file.model_fields_set:
        out.append("surroundings (no workspace rule)")
    guessed = [rule.text for record, rule in zip(file.workspace, rules, strict=True) if record.guess]
    return (*out, *(f"whether '{text}' is true (guess: true in workspace)" for text in guessed))


def _geometry(
    file: RobotFile, text: str, urdf: Path, path: Path, moving: tuple[str, ...], limits: Limits
) -> Geometry | None:
    """Return what the links' bodies are read from, or None where there are none or nobody minds."""
    told = file.self_collision
    if told is not None and not told.check:
        return None
    asked = told or SelfCollisionFile()
    out = Geometry(
        text,
        urdf,
        moving,
        dict(file.locked),
        limits.lower,
        limits.upper,
        asked.clearance,
        frozenset(frozenset(pair) for pair in asked.ignore),
        None if asked.srdf is None else find_resource(asked.srdf, path.parent) or path.parent / asked.srdf,
        asked=told is not None,
    )
    if told is not None and not out.given:
        raise InputError(f"{path}: self_collision: {urdf} has no collision geometry")
    return out if out.given else None


def _last_frame(model: Any) -> str:
    last = [frame.name for frame in model.frames if frame.parentJoint == model.njoints - 1]
    return last[-1]


def _column(values: Iterable[float | None]) -> Array:
    return frozen_array([np.nan if value is None else value for value in values], None)


def _limits(model: Any, records: list[JointFile]) -> Limits:
    lower, upper = np.array(model.lowerPositionLimit), np.array(model.upperPositionLimit)
    # Pinocchio 3 knows one limit for both directions
    newer = hasattr(model, "upperVelocityLimit")
    velocity = np.array(model.upperVelocityLimit if newer else model.velocityLimit)
    torque = np.array(model.upperEffortLimit if newer else model.effortLimit)
    acceleration, current = np.full((2, len(records)), np.inf)
    lower[lower <= -ENDLESS], upper[upper >= ENDLESS] = -np.inf, np.inf
    velocity[velocity <= 0] = np.inf
    torque[torque <= 0] = np.inf
    for k, record in enumerate(records):
        if record.position is not None:
            lower[k], upper[k] = record.position
        velocity[k] = record.velocity or velocity[k]
        acceleration[k] = record.acceleration or acceleration[k]
        torque[k] = record.torque or torque[k]
        current[k] = record.current or current[k]
    return Limits(*(frozen_array(v, None) for v in (lower, upper, velocity, acceleration, torque, current)))


def _simulation(file: RobotFile, joints: tuple[str, ...], path: Path) -> dict[str, dict[str, dict[str, float]]]:
    out: dict[str, dict[str, dict[str, float]]] = {}
    for effect, by_joint in file.simulation.items():
        for joint, value in by_joint.items():
            if joint not in joints:
                raise InputError(
                    f"{path}: simulation.{effect}: joint {joint!r} does not move{did_you_mean(joint, joints)}"
                )
            values = value if isinstance(value, dict) else {effect: value}
            out.setdefault(effect, {})[joint] = {key: float(v) for key, v in values.items()}
    return out
