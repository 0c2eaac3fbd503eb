"""The catalogue: all effects by name, those that users add, and how one is made from `name@joint`."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from typing import Protocol

from robot_ident.effects.backlash import Backlash
from robot_ident.effects.base_tilt import BaseTilt
from robot_ident.effects.cable import Cable
from robot_ident.effects.coulomb import Coulomb
from robot_ident.effects.effect import Effect
from robot_ident.effects.effort_filter import EffortFilter
from robot_ident.effects.effort_gain import EffortGain
from robot_ident.effects.encoder_eccentricity import EncoderEccentricity
from robot_ident.effects.end_stop import EndStop
from robot_ident.effects.exchanged_joints import ExchangedJoints
from robot_ident.effects.external_force import ExternalForce
from robot_ident.effects.friction_behind_play import FrictionBehindPlay
from robot_ident.effects.gravity_spring import GravitySpring
from robot_ident.effects.joint_coupling import JointCoupling
from robot_ident.effects.joint_elasticity import JointElasticity
from robot_ident.effects.link_length import LinkLength
from robot_ident.effects.load_friction import LoadFriction
from robot_ident.effects.mirrored_joint import MirroredJoint
from robot_ident.effects.payload import Payload
from robot_ident.effects.position_friction import PositionFriction
from robot_ident.effects.presliding import Presliding
from robot_ident.effects.rotor_inertia import RotorInertia
from robot_ident.effects.stamp_jitter import StampJitter
from robot_ident.effects.stribeck import Stribeck
from robot_ident.effects.temperature_drift import TemperatureDrift
from robot_ident.effects.time_delay import TimeDelay
from robot_ident.effects.torque_offset import TorqueOffset
from robot_ident.effects.torque_ripple import TorqueRipple
from robot_ident.effects.torque_ripple_2 import TorqueRipple2
from robot_ident.effects.torque_ripple_3 import TorqueRipple3
from robot_ident.effects.torque_saturation import TorqueSaturation
from robot_ident.effects.torque_scale import TorqueScale
from robot_ident.effects.viscous import Viscous
from robot_ident.effects.viscous_asymmetric import ViscousAsymmetric
from robot_ident.effects.viscous_nonlinear import ViscousNonlinear
from robot_ident.effects.wrist_coupling import WristCoupling
from robot_ident.errors import InputError, did_you_mean
from robot_ident.robot.robot import Robot

RIPPLES: tuple[type[TorqueRipple], ...] = (TorqueRipple, TorqueRipple2, TorqueRipple3)
"""The lines of a ripple, the strongest first."""

_ALL: tuple[type[Effect], ...] = (
    Viscous,
    Coulomb,
    TorqueOffset,
    ViscousAsymmetric,
    Stribeck,
    ViscousNonlinear,
    Presliding,
    FrictionBehindPlay,
    LoadFriction,
    PositionFriction,
    *RIPPLES,
    Backlash,
    JointElasticity,
    Cable,
    GravitySpring,
    BaseTilt,
    ExternalForce,
    TorqueSaturation,
    TimeDelay,
    EncoderEccentricity,
    RotorInertia,
    Payload,
    JointCoupling,
    WristCoupling,
    TemperatureDrift,
    EndStop,
    EffortGain,
    TorqueScale,
    EffortFilter,
    StampJitter,
    LinkLength,
    MirroredJoint,
    ExchangedJoints,
)

CATALOGUE: dict[str, type[Effect]] = {effect.name: effect for effect in _ALL}


def register(effects: Mapping[str, type[Effect]]) -> None:
    """Add a user's effects to the catalogue of this process; InputError on a name that another effect has."""
    for name, effect in effects.items():
        if CATALOGUE.get(name, effect) is not effect:
            raise InputError(f"effect {name!r} is in the catalogue already; give yours another name")
    CATALOGUE.update(effects)


def make_effect(label: str, robot: Robot, setting: Mapping[str, float] | None = None) -> Effect:
    """Return the effect that `name@joint` (or `name`) means on a robot.

    Raises InputError on an unknown name or joint, with the nearest, and on an effect that the robot can't have.
    """
    name, at, joint = label.partition("@")
    if name not in CATALOGUE:
        more = "robot_ident effects lists them; those of your own come by --effects-from FILE.py"
        raise InputError(f"unknown effect {name!r}{did_you_mean(name, CATALOGUE)} ({more})")
    kind = CATALOGUE[name]
    if at and kind.scope == "robot":
        raise InputError(f"effect {name!r} is of the whole robot: write it without @{joint}")
    if not at and kind.scope == "joint":
        raise InputError(f"effect {name!r} needs its joint: {name}@{robot.joints[0]}")
    place = robot.joint_index(joint) if at else None
    reason = kind.available(robot, place)
    if reason:
        raise InputError(f"{label}: {reason}")
    if kind.measuring:
        raise InputError(
            f"{label}: a fault of what is measured is no part of a model; put it right in the robot YAML"
            " (diagnose says the line)"
        )
    return kind(robot, place, setting)


def refuse_unseen(labels: Iterable[str], robot: Robot) -> None:
    """Raise InputError on effects (`name@joint`) that a robot can't have or that its sensors can't show: it takes no
    recording to say so.
    """
    for label in labels:
        if label.endswith("@*"):
            continue
        unseen = make_effect(label, robot).unseen
        if unseen:
            raise InputError(f"effect {label!r}: {unseen}")


def holder(effect: Effect, labels: Iterable[str]) -> str | None:
    """Return which effect of a model (`name@joint`) holds the column of another one already, or None."""
    for label in labels:
        name, _, joint = label.partition("@")
        if joint == (effect.place or "") and effect.name in CATALOGUE[name].contains:
            return label
    return None


def beside(effect: Effect, labels: Iterable[str]) -> Effect:
    """Return an effect less the coefficients whose columns effects of a model (`name@joint`) at its place hold."""
    at = "" if effect.place is None else f"@{effect.place}"
    present = set(labels)
    for name, coefficient in effect.contains.items():
        if f"{name}{at}" in present:
            effect = effect.without(coefficient)
    return effect


class Rotors(Protocol):
    """What is known of a robot's base parameters."""

    @property
    def free_rotors(self) -> tuple[int, ...]:
        """Joints whose rotor inertia merges with no link's."""


class Holder(Protocol):
    """A model's structure, as far as it decides which effects may be missing."""

    @property
    def robot(self) -> Robot:
        """The robot."""

    @property
    def base(self) -> Rotors:
        """Its base parameters."""

    @property
    def labels(self) -> tuple[str, ...]:
        """Effects that the model holds, as `name@joint`."""


def candidates_of(structure: Holder) -> Sequence[Effect]:
    """Return the effects that a model may lack: those that a column can show, at every place that the robot has and
    where its sensors can see them.
    """
    robot, out = structure.robot, []
    for kind in CATALOGUE.values():
        if not (kind.candidate and kind.regression):
            continue
        for place in _places(kind, robot):
            if kind.available(robot, place) or (kind is RotorInertia and place not in structure.base.free_rotors):
                continue
            effect = kind(robot, place)
            if effect.unseen:
                continue
            if effect.label not in structure.labels and not holder(effect, structure.labels):
                out.append(beside(effect, structure.labels))
    return out


def unseen_of(robot: Robot) -> dict[str, tuple[str, ...]]:
    """Return by joint the effects that its sensor can't show, whatever a model lacks; joints that show all left out."""
    out = {}
    for joint, name in enumerate(robot.joints):
        kinds = [k for k in CATALOGUE.values() if k.candidate and k.scope != "robot" and not k.available(robot, joint)]
        unseen = tuple(kind.name for kind in kinds if kind(robot, joint).unseen)
        if unseen:
            out[name] = unseen
    return out


def _places(kind: type[Effect], robot: Robot) -> Sequence[int | None]:
    joints: list[int | None] = [] if kind.scope == "robot" else list(range(robot.n))
    whole = kind.scope == "robot" or (kind.scope == "joint_or_robot" and robot.n > 1)
    return [None, *joints] if whole else joints
