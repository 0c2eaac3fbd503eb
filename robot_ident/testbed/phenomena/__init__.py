"""The phenomena of the simulated robot: the truth that identification has to find."""

from __future__ import annotations

from collections.abc import Sequence

from robot_ident.errors import InputError, did_you_mean
from robot_ident.robot.robot import Robot, at_every_joint
from robot_ident.testbed.phenomena import actuation, friction, mechanics, unlisted
from robot_ident.testbed.phenomena.phenomenon import Physics

PHYSICS: dict[str, type[Physics]] = {
    physics.name: physics
    for physics in (
        friction.Viscous,
        friction.Coulomb,
        actuation.TorqueOffset,
        friction.ViscousAsymmetric,
        friction.Stribeck,
        friction.ViscousNonlinear,
        friction.Presliding,
        friction.FrictionBehindPlay,
        friction.LoadFriction,
        friction.PositionFriction,
        actuation.TorqueRipple,
        mechanics.Backlash,
        mechanics.JointElasticity,
        mechanics.Cable,
        mechanics.GravitySpring,
        mechanics.BaseTilt,
        mechanics.ExternalForce,
        actuation.TorqueSaturation,
        actuation.TimeDelay,
        actuation.EncoderEccentricity,
        mechanics.RotorInertia,
        mechanics.Payload,
        mechanics.JointCoupling,
        friction.TemperatureDrift,
        mechanics.EndStop,
        unlisted.UnknownBump,
        unlisted.UnknownProduct,
        unlisted.UnknownOscillation,
        unlisted.UnknownGearError,
        unlisted.UnknownField,
    )
}


def _values(text: str, label: str, physics: type[Physics]) -> dict[str, float]:
    """Return the values of `k=v,...`; one number alone is the value of the first parameter."""
    values: dict[str, float] = {}
    for item in filter(None, text.split(",")):
        key, equals, number = item.partition("=")
        if not equals:
            key, number = physics.parameters[0].name, item
        try:
            value = float(number)
        except ValueError:
            value = float("nan")
        if not abs(value) < float("inf"):
            raise InputError(f"effect {label}: {key.strip()} = {number.strip()!r} is not a number")
        values[key.strip()] = value
    return values


def make_physics(label: str, robot: Robot) -> Physics:
    """Return the phenomenon that `NAME@JOINT[:k=v,...]` means on a robot; values that are left out are typical ones.

    One that belongs to the whole robot is written without `@JOINT`. Raises InputError on an unknown name, joint,
    parameter or value.
    """
    head, _, values = label.partition(":")
    name, at, joint = head.partition("@")
    if name not in PHYSICS:
        raise InputError(f"the simulated robot knows no effect {name!r}{did_you_mean(name, PHYSICS)}")
    if not at and PHYSICS[name].scope == "joint":
        raise InputError(f"effect {name!r} needs its joint: {name}@{robot.joints[0]}")
    if at and PHYSICS[name].scope == "robot":
        raise InputError(f"effect {name!r} belongs to no joint: write it without @{joint}")
    return PHYSICS[name](robot, robot.joint_index(joint) if at else None, _values(values, head, PHYSICS[name]))


def nominal_physics(robot: Robot) -> tuple[Physics, ...]:
    """Return the phenomena of the robot's own description (`simulation:` in its YAML)."""
    made: list[Physics] = []
    for name, by_joint in robot.simulation.items():
        if name not in PHYSICS:
            raise InputError(f"robot {robot.name}: simulation: unknown effect {name!r}{did_you_mean(name, PHYSICS)}")
        for joint, values in by_joint.items():
            index = robot.joint_index(joint)
            given = PHYSICS[name].known(robot, index) | dict(values)
            lacks = [value.name for value in PHYSICS[name].parameters if value.name not in given]
            if lacks:
                raise InputError(f"robot {robot.name}: simulation.{name}.{joint} lacks {lacks[0]!r}")
            made.append(PHYSICS[name](robot, index, given))
    return tuple(made)


def plant_physics(robot: Robot, effects: Sequence[str] = ()) -> tuple[Physics, ...]:
    """Return the phenomena of the robot's description with further ones (`NAME@JOINT[:k=v,...]`,
    `NAME@*` at every joint).

    One that is given here takes the place of the same effect at the same joint, and of those that it `replaces`;
    InputError when it is given twice.
    """
    further: dict[str, Physics] = {}
    for label in at_every_joint(effects, robot.joints):
        physics = make_physics(label, robot)
        if physics.label in further:
            raise InputError(f"effect {physics.label} is given twice")
        further[physics.label] = physics
    gone = {(name, physics.place) for physics in further.values() for name in (physics.name, *physics.replaces)}
    kept = [physics for physics in nominal_physics(robot) if (physics.name, physics.place) not in gone]
    return (*kept, *further.values())


def formula(kind: type[Physics]) -> str:
    """Return what a phenomenon is, from its own description."""
    first = (kind.__doc__ or "").split("\n\n")[0]
    return " ".join(first.split()).replace("`", "")


def values_in_words(text: str, robot: Robot | None = None) -> str:
    """Return `NAME@JOINT:k=v,...` with rounded values and their units; without the robot, those of revolute joints."""
    label, _, values = text.partition(":")
    name, _, joint = label.partition("@")
    slides = robot is not None and joint in robot.joints and bool(robot.prismatic[robot.joint_index(joint)])
    units = (
        {p.name: p.unit_prismatic if slides else p.unit for p in PHYSICS[name].parameters} if name in PHYSICS else {}
    )
    said = []
    for item in filter(None, values.split(",")):
        key, _, number = item.partition("=")
        unit = units.get(key, "")
        said.append(f"{key} {float(number):.4g}{'' if unit in ('', '1') else f' {unit}'}")
    return f"{label}: {', '.join(said)}" if said else label
