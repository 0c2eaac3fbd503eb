"""A robot: its rigid arm, limits, drives, noise and what is known of its other physics."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from functools import cached_property
from pathlib import Path
from typing import Any, Literal

import numpy as np

from robot_ident.errors import InputError, did_you_mean
from robot_ident.robot.anti_alias import AntiAlias
from robot_ident.robot.drives import Efforts, Side
from robot_ident.robot.geometry import Geometry
from robot_ident.robot.rigid_body import RigidBody
from robot_ident.robot.workspace import WorkspaceRule
from robot_ident.signals.motion import Array


@dataclass(frozen=True)
class Limits:
    """Limits of every joint [n]: position rad, velocity rad/s, acceleration rad/s^2, torque Nm, current of its drive A;
    inf where unknown.
    """

    lower: Array
    upper: Array
    velocity: Array
    acceleration: Array
    torque: Array
    current: Array


@dataclass(frozen=True)
class Drives:
    """Drives [n], joint side: gear ratio, rotor inertia (armature) kg m^2, encoder step rad, Nm per A (nan:
    unknown).
    """

    gear_ratio: Array
    armature: Array
    encoder_step: Array
    torque_constant: Array


@dataclass(frozen=True)
class Noise:
    """Variance [n] of the noise of one sample: torque (Nm)^2, position rad^2 (nan: unknown)."""

    torque_variance: Array
    position_variance: Array


@dataclass(frozen=True)
class Spring:
    """Geometry of a tension spring beside a joint: distance of its fixed end from the axis and its lever [m]."""

    length: float
    lever: float


@dataclass(frozen=True)
class Definition:
    """What a robot was read from: its YAML as data and its URDF as text, enough to read it again."""

    yaml: Mapping[str, Any]
    urdf: str


@dataclass(frozen=True)
class Robot:
    """A serial arm, from URDF and YAML.

    `simulation` holds the true values of effects in the simulated robot: effect -> joint -> parameter -> value.
    `geometry`: the bodies of its links, None where the URDF has none or they may touch. `known_effects` are part of
    every model of this robot, as `name@joint`. `base_parameters` gives names to base parameters: shown name -> standard
    parameter. `minimum_speed` [n] rad/s: slower samples aren't used to identify.
    Measuring chain of the torque: `anti_alias` [n] (the filter in each joint's, None: none; empty: no joint has one),
    `effort` (what each joint reports: torque or current, where measured, sign), `torque_delay` [n] s by which torque
    lags position, `torque_curves` (A, Nm) by joint for a constant.
    `base`: whether identification adds offsets and rotor inertias where they predict better, or takes what is declared.
    `unchecked`: what its files leave out or only guess, so that no certificate covers it, in words. `following`: joints
    that stand still here though they follow another (a parallelogram, a belt), and which.
    `definition` is what it was read from, None for a robot that comes with the package.
    """

    name: str
    source: str
    joints: tuple[str, ...]
    rigid: RigidBody
    limits: Limits
    drives: Drives
    noise: Noise
    end_effector: str
    definition: Definition | None = None
    workspace: tuple[WorkspaceRule, ...] = ()
    geometry: Geometry | None = None
    springs: Mapping[str, Spring] = field(default_factory=dict)
    simulation: Mapping[str, Mapping[str, Mapping[str, float]]] = field(default_factory=dict)
    known_effects: tuple[str, ...] = ()
    base_parameters: Mapping[str, str] = field(default_factory=dict)
    minimum_speed: Array = field(default_factory=lambda: np.zeros(0))
    anti_alias: tuple[AntiAlias | None, ...] = ()
    effort: Efforts = field(default_factory=Efforts)
    torque_delay: Array = field(default_factory=lambda: np.zeros(1))
    torque_curves: Mapping[str, tuple[tuple[float, float], ...]] = field(default_factory=dict)
    base: Literal["prediction", "declared"] = "prediction"
    unchecked: tuple[str, ...] = ()
    following: Mapping[str, str] = field(default_factory=dict)

    @classmethod
    def load(cls, name: str | Path = "kuka_ir361") -> Robot:
        """Read a robot by name, from a robot YAML or from a URDF."""
        from robot_ident.robot.robot_file import load_robot

        return load_robot(name)

    @property
    def n(self) -> int:
        """Number of joints."""
        return len(self.joints)

    @cached_property
    def prismatic(self) -> tuple[bool, ...]:
        """Which joints are prismatic (their torque is a force in N)."""
        return self.rigid.prismatic

    def torque_unit(self, joint: int) -> str:
        """Return the unit of a joint's torque: A where its drive's gain is unknown."""
        return "A" if self.in_ampere(joint) else self.link_torque_unit(joint)

    def link_torque_unit(self, joint: int) -> str:
        """Return the unit of what the links ask of a joint by their masses, and of its limit, whatever it reports."""
        return "N" if self.prismatic[joint] else "Nm"

    def known_rotor(self, joint: int) -> float:
        """Return the inertia of a joint's motor [kg m^2] on the joint's side, 0 where it is not known in the units of
        the torque.
        """
        return 0.0 if self.in_ampere(joint) else float(self.drives.armature[joint])

    def in_ampere(self, joint: int) -> bool:
        """Return whether a joint reports a current whose Nm/A nobody knows, so that its results carry the unit A."""
        name = self.joints[joint]
        known = name in self.torque_curves or np.isfinite(self.drives.torque_constant[joint])
        return self.effort.of(name).quantity == "current" and not known

    @property
    def ampere_joints(self) -> tuple[str, ...]:
        """The joints whose results carry the unit A."""
        return tuple(name for joint, name in enumerate(self.joints) if self.in_ampere(joint))

    @property
    def compares_with_newton_metres(self) -> np.ndarray:
        """Whether a joint's measured torque stands beside one in Nm [n]: known, or by a relative gain beside known."""
        ampere = np.array([self.in_ampere(joint) for joint in range(self.n)])
        stands_in = np.array([self.effort.of(name).relative is not None for name in self.joints])
        return np.asarray(~ampere | (stands_in & (not ampere.all())))

    def side(self, joint: int) -> Side:
        """Return where a joint's effort is measured."""
        return self.effort.of(self.joints[joint]).side

    def joint_index(self, name: str) -> int:
        """Return the index of a joint; InputError suggests the nearest name."""
        if name not in self.joints:
            held = {} if self.definition is None else self.definition.yaml.get("locked") or {}
            if name in held:
                raise InputError(f"robot {self.name}: joint {name!r} is held here, at {held[name]:.4g}")
            raise InputError(f"robot {self.name} has no joint {name!r}{did_you_mean(name, self.joints)}")
        return self.joints.index(name)


def at_every_joint(labels: Iterable[str], joints: Sequence[str]) -> tuple[str, ...]:
    """Return effects as `name@joint[:values]`, `name@*[:values]` being one at every joint that has none of its own."""
    given = list(labels)
    own = {label.partition(":")[0] for label in given}
    out: list[str] = []
    for label in given:
        head, colon, values = label.partition(":")
        name, _, joint = head.partition("@")
        each = [f"{name}@{one}" for one in joints]
        out += [f"{one}{colon}{values}" for one in each if one not in own] if joint == "*" else [label]
    return tuple(out)
