"""The catalogue of physical effects, one small file each: its equation gives columns, gradients and documentation."""

from __future__ import annotations

from collections.abc import Mapping

from robot_ident.effects.coulomb import Coulomb
from robot_ident.effects.effect import Coefficient, Effect, Inner, Mathematics, Signals, Torques
from robot_ident.effects.gravity_spring import GravitySpring
from robot_ident.effects.rotor_inertia import RotorInertia
from robot_ident.effects.torque_offset import TorqueOffset
from robot_ident.effects.viscous import Viscous
from robot_ident.effects.wrist_coupling import WristCoupling
from robot_ident.errors import InputError, did_you_mean
from robot_ident.robot.robot import Robot

CATALOGUE: dict[str, type[Effect]] = {
    effect.name: effect for effect in (Viscous, Coulomb, TorqueOffset, GravitySpring, RotorInertia, WristCoupling)
}


def make_effect(label: str, robot: Robot, setting: Mapping[str, float] | None = None) -> Effect:
    """Return the effect that `name@joint` means on a robot; InputError suggests the nearest name or joint."""
    name, at, joint = label.partition("@")
    if name not in CATALOGUE:
        raise InputError(f"unknown effect {name!r}{did_you_mean(name, CATALOGUE)} (robot_ident effects lists them)")
    kind = CATALOGUE[name]
    if kind.scope == "robot":
        if at:
            raise InputError(f"effect {name!r} is of the whole robot: write it without @{joint}")
        return kind(robot, 0, setting)
    if not at:
        raise InputError(f"effect {name!r} needs its joint: {name}@{robot.joints[0]}")
    return kind(robot, robot.joint_index(joint), setting)


__all__ = ["CATALOGUE", "Coefficient", "Effect", "Inner", "Mathematics", "Signals", "Torques", "make_effect"]
