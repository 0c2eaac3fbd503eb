"""Does friction take energy away? Where it gives some to a joint, the sign of effort, position or time is wrong.

And base parameters that no arm of its size can have: their torque alone is many times what a joint gives.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from robot_ident.effects import Effect
from robot_ident.estimation.equations import Equations
from robot_ident.model.model import IMPOSSIBLE
from robot_ident.model.structure import Structure
from robot_ident.recording.measurement import Measurement
from robot_ident.signals.motion import Array

_MASS_OR_INERTIA = (0, 4, 6, 9)  # m, Ixx, Iyy, Izz among the ten of a link
POSITIVE = ("viscous", "coulomb", "rotor_inertia")  # effects whose coefficient is an amount, never below zero
_SURE = 5.0  # standard deviations
_TIMES = 10.0  # of a joint's torque; the arms that we know stay below 2.5
_KNOWN = 2.0  # standard deviations, below which the value is said to be unknown anyhow
_NAMED = 3


@dataclass(frozen=True)
class Driven:
    """Joints that their friction drives, and coefficients that can't be negative and are; how many standard deviations
    below zero by name.
    """

    joints: dict[str, float]
    coefficients: dict[str, float]

    @property
    def notes(self) -> tuple[str, ...]:
        """What is wrong, in words: of a joint that is driven its coefficients say nothing more."""
        joints, coefficients = (
            ", ".join(f"{name} (by {size:.0f} sigma)" for name, size in found.items())
            for found in (self.joints, self.coefficients)
        )
        sign = "the sign of the effort, of the position or of time is wrong there"
        lack = "a sign is wrong, or it stands in for something that the model lacks"
        driving = (f"friction that drives instead of braking: {joints}; {sign}",) if joints else ()
        return (*driving, *((f"negative, which it can't be: {coefficients}; {lack}",) if coefficients else ()))


def driven(structure: Structure, measurements: Sequence[Measurement], values: Array, covariance: Array) -> Driven:
    """Return where friction drives: its mean power P = mean(dq tau_f) over all motions is negative beyond doubt.

    tau_f: every effect on a joint whose sign turns with the motion's, save those that depend on torque; P is linear in
    their coefficients, values [p or more] with covariance, so that its variance is w' C w.
    """
    linear = len(structure.parameters)
    theta, spread = values[:linear], covariance[:linear, :linear]
    power = np.zeros((structure.robot.n, linear))  # W that a unit of each parameter takes from each joint
    rows = sum(measured.motion.samples for measured in measurements)
    for effect, own in _places(structure):
        brakes = [(one.symmetry or effect.symmetry) == "dissipative" for one in effect.coefficients]
        for motion in (measured.motion for measured in measurements):
            columns = effect.columns(motion)[:, effect.joint]
            power[effect.joint, own] += np.where(brakes, motion.dq[:, effect.joint] @ columns / rows, 0.0)
    below: dict[str, float] = {}
    for joint, name in enumerate(structure.robot.joints):
        _note(below, name, float(power[joint] @ theta), float(power[joint] @ spread @ power[joint]))
    single: dict[str, float] = {}
    for effect, own in _places(structure):
        others = [e for e, _ in _places(structure) if e.joint == effect.joint and e.name not in POSITIVE]
        if effect.name not in POSITIVE or effect.place in below or others:
            continue  # several kinds of friction on a joint are told apart only in their sum
        _note(single, effect.label, float(theta[own.start]), float(spread[own.start, own.start]))
    for k in _amounts(structure):
        _note(single, structure.names[k], float(theta[k]), float(spread[k, k]))
    return Driven(below, single)


def _amounts(structure: Structure) -> list[int]:
    """Return the base parameters that are sums of masses, moments of inertia and rotors alone, none of them taken off:
    what they hold is never below zero.
    """
    rows, column = structure.base.regrouping, np.arange(structure.base.regrouping.shape[1])
    others = (column < 10 * structure.robot.n) & ~np.isin(column % 10, _MASS_OR_INERTIA)
    return [k for k, row in enumerate(rows) if np.all(row >= 0.0) and not np.any(row[others])]


def _note(found: dict[str, float], name: str, value: float, variance: float) -> None:
    if value < 0.0 < variance and -value > _SURE * np.sqrt(variance):
        found[name] = float(-value / np.sqrt(variance))


def negative_notes(structure: Structure, values: Array, std: Array) -> list[str]:
    """Return a line for each coefficient of an effect that the data put below zero, where it has no meaning.

    Friction as a whole is judged by the power that it takes (`driven`).
    """
    names = structure.names
    return [
        f"{names[k]} is {values[k]:.4g} +- {std[k]:.2g}, and nothing of the kind is below zero: another effect is there"
        for effect, own in structure.placed
        for k, coefficient in zip(range(own.start, own.stop), effect.coefficients, strict=True)
        if coefficient.positive and effect.name not in POSITIVE and values[k] < -_SURE * std[k] < 0.0
    ]


def _places(structure: Structure) -> list[tuple[Effect, slice]]:
    """Return the effects on one joint that don't depend on torque, with the places of their parameters."""
    return [(effect, own) for effect, own in structure.placed if effect.place is not None and not effect.uses_torque]


def implausible_notes(structure: Structure, equations: Equations, values: Array, std: Array) -> list[str]:
    """Return a line on base parameters whose share of a joint's torque, rms of phi_k theta_k over rms of tau, is beyond
    any arm's: others take it off again, as they do where an axis of the URDF or the unit of an effort is wrong.
    """
    count = len(structure.base.columns)
    share = np.zeros((structure.robot.n, count))
    for joint in np.unique(equations.joint):
        rows = equations.joint == joint
        torque = float(np.mean(equations.torque[rows] ** 2))
        if torque > 0.0:
            share[joint] = np.sqrt(np.mean((equations.phi[rows, :count] * values[:count]) ** 2, axis=0) / torque)
    worst, where = share.max(axis=0), share.argmax(axis=0)
    found = [
        k for k in np.argsort(-worst) if worst[k] > _TIMES and abs(values[k]) > _KNOWN * std[k] and np.isfinite(std[k])
    ]
    if not found:
        return []
    words = [
        f"{structure.names[k]} = {values[k]:.4g} ± {std[k]:.2g} {structure.parameters[k].unit}, whose torque would be"
        f" {worst[k]:.3g} times that of {structure.robot.joints[where[k]]}"
        for k in found[:_NAMED]
    ]
    more = f", and {len(found) - _NAMED} more" if len(found) > _NAMED else ""
    return [
        f"{IMPOSSIBLE} {'; '.join(words)}{more}: others take it off again; check the URDF's axes and the"
        " effort's unit first (robot_ident info BAG --robot)"
    ]
