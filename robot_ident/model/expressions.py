"""The columns of a model as CasADi expressions, for designs that need their gradients."""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property
from types import SimpleNamespace
from typing import Any

import casadi as ca
import numpy as np

from robot_ident.effects import Effect, Signals
from robot_ident.errors import InputError
from robot_ident.model.base_parameters import BaseParameters
from robot_ident.model.rigid_sensitivity import standard_parameters
from robot_ident.model.structure import Structure
from robot_ident.robot.robot import Robot
from robot_ident.robot.symbolic import regressor_expression
from robot_ident.signals.motion import Array

_NAMES = ("q", "dq", "ddq", "d3q", "d4q")


def mathematics(sign: Any = None) -> Any:
    """Return CasADi's functions under the names that equations use; `sign` may be a smooth stand-in."""
    names = ("sin", "cos", "exp", "sqrt", "fabs", "tanh")
    return SimpleNamespace(sign=sign or ca.sign, **{name: getattr(ca, name) for name in names})


@dataclass(frozen=True)
class SymbolicCourse:
    """A state with its derivatives along time up to the fourth: expressions of the state go on along the motion.

    symbols: q, dq, ddq, d3q, d4q [n]. values [b]: base parameters of the arm, None where they aren't known.
    """

    robot: Robot
    base: BaseParameters
    symbols: tuple[Any, ...]
    values: Array | None

    def rate(self, x: Any) -> Any:
        """Return dx/dt by the chain rule: x may depend on derivatives up to the third."""
        pairs = zip(self.symbols[:-1], self.symbols[1:], strict=True)
        return sum(ca.jtimes(x, state, following) for state, following in pairs)

    def at(self, x: Any, later: float) -> Any:
        """Return x with the state of `later` seconds from now, by its Taylor series."""
        moved, highest = [], len(self.symbols) - 1
        for first in range(highest + 1):
            series, share = self.symbols[first], 1.0
            for order in range(1, highest - first + 1):
                share *= later / order
                series = series + share * self.symbols[first + order]
            moved.append(series)
        return ca.substitute(x, ca.vertcat(*self.symbols), ca.vertcat(*moved))

    def displaced(self, joint: int, displacement: Any) -> list[Any]:
        """Return dtau/dq e + dtau/ddq e' + M e'' by joint [n], of a link that stands off by e with its derivatives."""
        change = ca.SX(self.robot.n, 1)
        for state, size in zip(self.symbols[:3], displacement, strict=True):
            change += ca.jacobian(self._rigid, state[joint]) * size
        return list(ca.vertsplit(change))

    def gravity(self, direction: Array) -> list[Any]:
        """Return the torque by joint [n] per m/s^2 of gravity in a direction [3]."""
        still = ca.SX(self.robot.n, 1)
        columns = regressor_expression(self.robot, self.symbols[0], still, still, direction)
        return list(ca.vertsplit(ca.densify(ca.mtimes(columns, self._standard))))

    @cached_property
    def _rigid(self) -> Any:
        """Torque [n] of the arm with these base parameters."""
        return ca.mtimes(regressor_expression(self.robot, *self.symbols[:3]), self._standard)

    @cached_property
    def _standard(self) -> Any:
        if self.values is None:
            raise ValueError("the arm's base parameters are needed")
        return ca.DM(standard_parameters(self.robot, self.base, self.values).ravel())


def columns_function(structure: Structure, sign: Any = None, values: Array | None = None) -> Any:
    """Return the CasADi function (q, dq, ddq) -> Phi [n, p]; `sign` may be a smooth stand-in for the sign function.

    values [p or more] are needed where an effect depends on the model's torque. An effect with memory counts as its
    smooth stand-in, and the function then takes the third and fourth derivative of q too. Raises InputError where
    values are missing, and where no motion shows an effect.
    """
    symbols = tuple(ca.SX.sym(name, structure.robot.n) for name in _NAMES)
    phi = columns_expression(structure, symbols, mathematics(sign), values)
    used = symbols if ca.depends_on(phi, ca.vertcat(*symbols[3:])) else symbols[:3]
    return ca.Function("phi", list(used), [phi], {"cse": True})


def columns_expression(structure: Structure, symbols: tuple[Any, ...], m: Any, values: Array | None) -> Any:
    """Return Phi [n, p] as an expression of the state's symbols with the functions m."""
    base = structure.base
    course = SymbolicCourse(structure.robot, base, symbols, None if values is None else values[: len(base.columns)])
    x = Signals(*(ca.vertsplit(symbol) for symbol in symbols[:3]))
    rigid = _rigid(structure, symbols)
    plain = [
        rigid,
        *(_columns(structure, effect, x, m, course) for effect in structure.effects if not effect.uses_torque),
    ]
    if structure.uses_torque:
        if values is None:
            first = next(effect.label for effect in structure.effects if effect.uses_torque)
            raise InputError(f"the columns of {first} depend on the model's torque: a first model is needed")
        load, total, _ = structure.load_total_dry(plain, np.asarray(values))
        x = replace(x, load=ca.vertsplit(ca.densify(load)), total=ca.vertsplit(ca.densify(total)))
    rest = iter(plain[1:])
    columns = [_columns(structure, e, x, m, course) if e.uses_torque else next(rest) for e in structure.effects]
    return ca.horzcat(rigid, *columns)


def slopes_function(structure: Structure, sign: Any, values: Array) -> Any:
    """Return the CasADi function (q, dq, ddq) -> [n, 3 n]: the derivatives of the torque Phi theta by q, dq and ddq.

    As `torque_derivatives` takes them: the sign function counts as constant, and effects that depend on torque or
    memory are left out.
    """
    held: list[tuple[Any, Any]] = []

    def constant(v: Any) -> Any:
        held.append((ca.SX.sym(f"sign_{len(held)}"), (sign or ca.sign)(v)))
        return held[-1][0]

    base, scales = structure.base, structure.scales
    symbols = tuple(ca.SX.sym(name, structure.robot.n) for name in _NAMES[:3])
    x, m = Signals(*(ca.vertsplit(symbol) for symbol in symbols)), mathematics(constant)
    torque = ca.mtimes(_rigid(structure, symbols), ca.DM(values[: len(base.columns)]))
    for effect, own in structure.placed:
        if effect.uses_torque or not effect.symbolic:
            continue
        for size, term in zip(values[own], effect.terms(x, m), strict=True):
            for joint, value in term.items():
                torque[joint] += float(size) * value * (scales[joint] if effect.through_links else 1.0)
    slopes = ca.densify(ca.jacobian(torque, ca.vertcat(*symbols)))
    if held:
        slopes = ca.substitute(slopes, ca.vertcat(*(s for s, _ in held)), ca.vertcat(*(v for _, v in held)))
    return ca.Function("slopes", list(symbols), [slopes], {"cse": True})


def _rigid(structure: Structure, symbols: tuple[Any, ...]) -> Any:
    """Return the columns of the base parameters [n, b] in the scale that each joint reports."""
    return _reported(structure, regressor_expression(structure.robot, *symbols[:3])[:, list(structure.base.columns)])


def _reported(structure: Structure, columns: Any) -> Any:
    """Return columns [n, k] of the links in the scale of each joint."""
    return ca.mtimes(ca.diag(ca.DM(structure.scales)), columns) if structure.scaled else columns


def _columns(structure: Structure, effect: Effect, x: Signals, m: Any, course: SymbolicCourse) -> Any:
    """Return the columns of an effect [n, k] as a matrix of expressions."""
    terms = effect.designed_terms(x, m, course)
    columns = ca.SX(effect.robot.n, len(terms))
    for k, term in enumerate(terms):
        for joint, value in term.items():
            columns[joint, k] = value
    return _reported(structure, columns) if effect.through_links else columns
