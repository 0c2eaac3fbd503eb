"""The columns of a model: rigid-body base parameters and effects, in one order with names and units."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from types import SimpleNamespace
from typing import Any

import numpy as np

from robot_ident.effects import Effect, Signals, make_effect
from robot_ident.errors import InputError
from robot_ident.model.base_parameters import BaseParameters, random_states, reduce_to_base
from robot_ident.motion import Array, Motion
from robot_ident.robot.robot import Robot


@dataclass(frozen=True)
class Parameter:
    """One parameter of a model; `joint` is None where it belongs to no single joint."""

    name: str
    unit: str
    joint: str | None
    effect: str
    meaning: str


@dataclass(frozen=True)
class Structure:
    """tau = Phi(q, dq, ddq) theta (Swevers et al. 1997, eq. 1): what the columns of Phi are."""

    robot: Robot
    base: BaseParameters
    effects: tuple[Effect, ...]
    parameters: tuple[Parameter, ...]
    notes: tuple[str, ...] = ()

    @classmethod
    def build(cls, robot: Robot, effects: Sequence[str] = ()) -> Structure:
        """Return the paper's model of a robot, its known effects and further ones (`name@joint`).

        Raises InputError on an unknown effect or joint, one that is in the model already, or one whose column others
        span.
        """
        base = reduce_to_base(robot)
        known = [f"{name}@{joint}" for name in ("viscous", "coulomb") for joint in robot.joints]
        known += [label for label in robot.known_effects if label not in known]
        merged = [label for label in known if (rule := _merges(label, robot, base)) is not None and rule]
        notes = tuple(f"{label} merges with {_merges(label, robot, base)}" for label in merged)
        labels = [label for label in known if label not in merged]
        for label in effects:
            effect = make_effect(label, robot)
            if effect.label in labels:
                raise InputError(f"effect {label!r} is in the model already")
            rule = _merges(effect.label, robot, base)
            if rule:
                raise InputError(f"effect {label!r} merges with {rule}: its column is in the model already")
            labels.append(effect.label)
        made = tuple(make_effect(label, robot) for label in labels)
        return cls(robot, base, made, _parameters(robot, base, made), notes)

    @property
    def names(self) -> tuple[str, ...]:
        """Names of the parameters [p]."""
        return tuple(parameter.name for parameter in self.parameters)

    @property
    def labels(self) -> tuple[str, ...]:
        """The effects as `name@joint`."""
        return tuple(effect.label for effect in self.effects)

    def columns(self, motion: Motion) -> Array:
        """Return Phi [N, n, p] along a motion."""
        rigid = self.robot.rigid.regressor(motion)[:, :, list(self.base.columns)]
        return np.concatenate([rigid, *(effect.columns(motion) for effect in self.effects)], axis=2)

    def symbolic(self, sign: Any = None) -> Any:
        """Return the CasADi function (q, dq, ddq) -> Phi [n, p]; `sign` may be a smooth stand-in for the sign
        function.
        """
        import casadi as ca

        from robot_ident.robot.symbolic import regressor_expression

        n = self.robot.n
        q, dq, ddq = ca.SX.sym("q", n), ca.SX.sym("dq", n), ca.SX.sym("ddq", n)
        m = SimpleNamespace(
            sin=ca.sin, cos=ca.cos, exp=ca.exp, sqrt=ca.sqrt, sign=sign or ca.sign, fabs=ca.fabs, tanh=ca.tanh
        )
        x = Signals(ca.vertsplit(q), ca.vertsplit(dq), ca.vertsplit(ddq))
        columns = [regressor_expression(self.robot, q, dq, ddq)[:, list(self.base.columns)]]
        for effect in self.effects:
            for term in effect.terms(x, m):
                column = ca.SX(n, 1)
                for joint, value in term.items():
                    column[joint] = value
                columns.append(column)
        return ca.Function("phi", [q, dq, ddq], [ca.horzcat(*columns)])

    def true_values(self) -> Array:
        """Return theta [p] of the simulated robot: base parameters of the URDF and armature, effects from its YAML (0
        where absent).
        """
        robot = self.robot
        base = self.base.values(robot.rigid.parameters, robot.drives.armature)
        coefficients: list[float] = []
        for effect in self.effects:
            truth = effect.truth()
            coefficients += [0.0] * len(effect.coefficients) if truth is None else effect.coefficient_values(truth)
            if truth is not None:
                base = base + self._absorbed(effect, truth)
        return np.concatenate([base, coefficients])

    def _absorbed(self, effect: Effect, truth: dict[str, float]) -> Array:
        """Return what the part of an effect that has no column of its own adds to the base parameters."""
        motion = random_states(self.robot)
        terms = effect.absorbed(Signals.of(motion), np, truth)
        torque = np.zeros((motion.samples, self.robot.n))
        for joint, values in terms.items():
            torque[:, joint] = values
        rigid = self.robot.rigid.regressor(motion)[:, :, list(self.base.columns)]
        share, *_ = np.linalg.lstsq(rigid.reshape(-1, rigid.shape[2]), torque.ravel(), rcond=None)
        return np.asarray(share)


def _merges(label: str, robot: Robot, base: BaseParameters) -> str:
    """Return the base parameter that a rotor inertia merges with, or an empty text."""
    effect = make_effect(label, robot)
    if effect.name != "rotor_inertia" or effect.joint in base.free_rotors:
        return ""
    column = 10 * robot.n + effect.joint
    into = [name for name, row in zip(base.names, base.regrouping, strict=True) if row[column] != 0.0]
    return ", ".join(into)


def _parameters(robot: Robot, base: BaseParameters, effects: Sequence[Effect]) -> tuple[Parameter, ...]:
    rigid = [
        Parameter(name, unit, robot.joints[link], "rigid_body", rule)
        for name, unit, link, rule in zip(base.names, base.units, base.links, base.rules, strict=True)
    ]
    further = [
        Parameter(name, unit, robot.joints[effect.joint], effect.name, effect.meaning)
        for effect in effects
        for name, unit in zip(effect.parameter_names(), effect.parameter_units(), strict=True)
    ]
    return (*rigid, *further)
