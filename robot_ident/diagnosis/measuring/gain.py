"""A wrong gain or sign of one joint's effort: its row multiplied, all parameters fitted again.

tau_j = g Y_j theta: for every g the best theta is a linear fit, so that the error's profile over g is exact, however
far g is from 1. Joints' rows that share no parameters leave the profile flat: the gain is then not decidable.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from functools import partial

import numpy as np

from robot_ident.diagnosis.diagnosis import Estimate
from robot_ident.diagnosis.measuring.fitted_fault import FittedFault, curvature_std, fitted_loss, folds, multiplied
from robot_ident.effects.catalogue import CATALOGUE
from robot_ident.recording.measurement import Measurement
from robot_ident.regression.evidence import Evidence
from robot_ident.regression.gram import BaseFit, BaseGram
from robot_ident.signals.motion import Array

GRID = (-2.0, -1.0, -0.5, 0.25, 0.5, 0.7, 0.85, 0.93, 1.08, 1.18, 1.4, 1.8, 2.5, 4.0)
"""Gains that are tried before the best is refined."""

VAGUE = 0.05
"""Standard deviation of a gain from which on it is called not decidable."""


def gains(evidence: Evidence, base: BaseGram) -> list[FittedFault]:
    """Return the best gain of every joint that lowers the error on trajectories left out."""
    joints, count = evidence.structure.robot.joints, len(base.power)
    before = fitted_loss(base, range(count))
    held_before = sum(_held_out(base, _ones(base), left, train) for left, train in folds(count))
    out = []
    for joint in range(len(joints)):
        gain = _best(base, joint, range(count))
        profile = partial(_loss, base, joint, range(count))
        held = sum(
            _held_out(base, _row(base, joint, _near(base, joint, train, gain)), left, train)
            for left, train in folds(count)
        )
        fall, held_fall = before - profile(gain), held_before - held
        if held_fall <= 0.0:
            continue
        effect = CATALOGUE["effort_gain"](evidence.structure.robot, joint)
        std = curvature_std(profile, gain, 1e-3 * abs(gain))
        value = Estimate(f"gain of {joints[joint]}", gain, std, "times too large")
        columns = partial(_columns, joint=joint, gain=gain)
        out.append(FittedFault(effect, fall, held_fall, (value,), columns, _fix(evidence, joint, gain)))
    return out


def single_gains(evidence: Evidence, base: BaseGram) -> list[FittedFault]:
    """Return for every recording and joint the gain by which the effort of that recording alone differs."""
    joints, everything = evidence.structure.robot.joints, range(len(base.power))
    sources = evidence.recordings
    if len(sources) < 2:
        return []
    before, out = fitted_loss(base, everything), []
    for place, source in enumerate(sources):
        rows = [k for k, t in enumerate(evidence.trajectories) if t.measured is source]
        for joint, name in enumerate(joints):

            def loss(gain: float, rows: Sequence[int] = rows, joint: int = joint) -> float:
                return fitted_loss(_in_part(base, rows, joint, gain), everything)

            gain = _nearby(loss, min(GRID, key=loss))
            fall = before - loss(gain)
            effect = CATALOGUE["effort_gain"](evidence.structure.robot, joint)
            std = curvature_std(loss, gain, 1e-3 * abs(gain))
            told = Estimate(f"gain of {name} in recording {place + 1}", gain, std, "times too large")
            columns = partial(_columns, joint=joint, gain=gain, source=source)
            fix = f"{source.source}: its effort of {name} is {gain:.4g} times that of the other recordings: record anew"
            out.append(FittedFault(effect, fall, fall - 1.0, (told,), columns, fix, 1, place + 1))
    return out


def undecidable_gains(evidence: Evidence, base: BaseGram) -> list[str]:
    """Return the joints whose gain these recordings don't tell to 5 %: their own parameters absorb it."""
    everything = range(len(base.power))
    out = []
    for joint, name in enumerate(evidence.structure.robot.joints):
        if curvature_std(partial(_loss, base, joint, everything), 1.0, 1e-2) > VAGUE:
            out.append(name)
    return out


def _columns(evidence: Evidence, *, joint: int, gain: float, source: Measurement | None = None) -> tuple[Array, ...]:
    """Return the columns with a joint's rows multiplied, in one recording alone where a source is given."""
    out = []
    for t, phi in zip(evidence.trajectories, evidence.phi, strict=True):
        changed = phi.copy()
        if source is None or t.measured is source:
            changed[:, joint] *= gain
        out.append(changed)
    return tuple(out)


def _fix(evidence: Evidence, joint: int, gain: float) -> str:
    robot = evidence.structure.robot
    told = robot.effort.of(robot.joints[joint])
    name, factor = robot.joints[joint], told.gain / abs(gain)
    words = [f"sign: {-told.sign}"] if gain < 0.0 else []
    if abs(abs(gain) - 1.0) > 0.02 or gain > 0.0:
        words.append(f"gain: {factor:.4g}")
    return f"joints: {{{name}: {{effort: {{{', '.join(words)}}}}}}}  # in the robot YAML"


def _ones(base: BaseGram) -> Array:
    return np.ones(base.power.shape[1])


def _row(base: BaseGram, joint: int, gain: float) -> Array:
    factors = _ones(base)
    factors[joint] = gain
    return factors


def _in_part(base: BaseGram, rows: Sequence[int], joint: int, gain: float) -> BaseGram:
    """Return the Gram matrices of a model with a joint's rows of some trajectories multiplied."""
    own, torque = base.own.copy(), base.torque.copy()
    own[rows, joint] *= gain**2
    torque[rows, joint] *= gain
    return BaseGram(own, torque, base.power)


def _loss(base: BaseGram, joint: int, train: Sequence[int], gain: float) -> float:
    return fitted_loss(multiplied(base, _row(base, joint, gain)), train)


def _held_out(base: BaseGram, factors: Array, left: int, train: Sequence[int]) -> float:
    made = multiplied(base, factors)
    return float(BaseFit.of(made, train).loss(made, left).sum())


def _best(base: BaseGram, joint: int, train: Sequence[int]) -> float:
    """Return the gain of least error: the best of the grid, refined."""
    losses = [_loss(base, joint, train, gain) for gain in GRID]
    return _near(base, joint, train, GRID[int(np.argmin(losses))])


def _near(base: BaseGram, joint: int, train: Sequence[int], start: float) -> float:
    """Return the gain of least error within a factor 1.6 of a start; its sign stays."""
    return _nearby(partial(_loss, base, joint, train), start)


def _nearby(loss: Callable[[float], float], start: float) -> float:
    from scipy.optimize import minimize_scalar

    def along(x: float) -> float:
        return loss(start * float(np.exp(x)))

    found = minimize_scalar(along, bounds=(-0.5, 0.5), method="bounded", options={"xatol": 1e-4, "maxiter": 25})
    return start * float(np.exp(found.x))
