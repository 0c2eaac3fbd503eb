"""A low pass, or a delay, over the effort alone: the model's torque behind it is held against what was measured."""

from __future__ import annotations

from collections.abc import Sequence
from functools import partial
from itertools import product

import numpy as np
from numpy.typing import NDArray

from robot_ident.diagnosis.diagnosis import Estimate
from robot_ident.diagnosis.evidence import Evidence, Trajectory
from robot_ident.diagnosis.measuring.finding import Finding, chosen, fitted_loss, folds, raw_columns, weighed
from robot_ident.diagnosis.scan import BaseFit, BaseGram, base_gram
from robot_ident.effects.catalogue import CATALOGUE
from robot_ident.motion import Array

CUTOFFS = (2.0, 3.0, 4.5, 6.5, 9.5, 14.0, 20.0, 30.0, 45.0)
"""-3 dB frequencies [Hz] that are tried."""

ORDERS = (1, 2)
DELAYS = (-0.03, -0.02, -0.012, -0.006, 0.006, 0.012, 0.02, 0.03, 0.045)
"""Delays [s] of the rival that keeps steps sharp."""


def filters(evidence: Evidence, base: BaseGram) -> tuple[list[Finding], float]:
    """Return the best low pass of every joint and of all, and the most that a plain delay gains on data left out."""
    if any(t.measured.base_frequency is None for t in evidence.trajectories):
        return [], 0.0
    from dataclasses import replace

    raw = raw_columns(evidence)

    def through(kind: tuple[str, float, int]) -> BaseGram:
        parts = [_passed(columns, t, kind) for columns, t in zip(raw, evidence.trajectories, strict=True)]
        return base_gram(replace(evidence, phi=weighed(evidence, parts)))

    passes = {(f, k): through(("pass", f, k)) for f, k in product(CUTOFFS, ORDERS)}
    delays = [through(("delay", d, 0)) for d in DELAYS]
    n = base.power.shape[1]
    places: list[int | None] = [*range(n), *([None] if n > 1 else [])]
    delayed = max(_held_fall(base, delays, place) for place in places)
    out = [_finding(evidence, base, passes, place) for place in places]
    return [finding for finding in out if finding.held_out > 0.0], delayed


def _finding(
    evidence: Evidence, base: BaseGram, passes: dict[tuple[float, int], BaseGram], place: int | None
) -> Finding:
    joints = _joints(base, place)
    everything = range(len(base.power))
    losses = {kind: fitted_loss(chosen(base, made, joints), everything) for kind, made in passes.items()}
    cutoff, order = min(losses, key=losses.__getitem__)
    robot = evidence.structure.robot
    effect = CATALOGUE["effort_filter"](robot, place)
    near = sorted(CUTOFFS, key=lambda f: abs(np.log(f / cutoff)))[1]
    found = Estimate(f"cutoff of {effect.label}", _between(losses, cutoff, order), abs(near - cutoff) / 2.0, "Hz")
    return Finding(
        effect,
        fitted_loss(base, everything) - losses[cutoff, order],
        _held_fall(base, list(passes.values()), place),
        (found,),
        partial(_columns, kind=("pass", found.value, order), joints=joints),
        _fix(robot.joints, place, order, found.value),
        2,
    )


def _fix(names: Sequence[str], place: int | None, order: int, cutoff: float) -> str:
    kind = f"anti_alias: {{order: {order}, cutoff: {cutoff:.3g}}}"
    return f"{kind if place is None else f'joints: {{{names[place]}: {{{kind}}}}}'}  # in the robot YAML"


def _between(losses: dict[tuple[float, int], float], cutoff: float, order: int) -> float:
    """Return the cutoff of least error between neighbours of the grid, by a parabola over its logarithm."""
    at = CUTOFFS.index(cutoff)
    if at in (0, len(CUTOFFS) - 1):
        return cutoff
    three = CUTOFFS[at - 1 : at + 2]
    x, y = np.log(three) - np.log(cutoff), [losses[f, order] - losses[cutoff, order] for f in three]
    a, b, _ = np.polyfit(x, y, 2)
    return float(cutoff * np.exp(np.clip(-b / (2.0 * a), x[0], x[2]))) if a > 0.0 else cutoff


def _held_fall(base: BaseGram, made: Sequence[BaseGram], place: int | None) -> float:
    """Return the fall of the squared error on trajectories left out, the kind chosen on the others."""
    joints, total = _joints(base, place), 0.0
    mixed = [chosen(base, other, joints) for other in made]
    for left, train in folds(len(base.power)):
        best = mixed[int(np.argmin([fitted_loss(one, train) for one in mixed]))]
        total += float(BaseFit.of(base, train).loss(base, left).sum() - BaseFit.of(best, train).loss(best, left).sum())
    return total


def _joints(base: BaseGram, place: int | None) -> list[int]:
    return list(range(base.power.shape[1])) if place is None else [place]


def _columns(evidence: Evidence, *, kind: tuple[str, float, int], joints: Sequence[int]) -> tuple[Array, ...]:
    parts = []
    for columns, t in zip(raw_columns(evidence), evidence.trajectories, strict=True):
        changed = columns.copy()
        changed[:, joints] = _passed(columns[:, joints], t, kind)
        parts.append(changed)
    return weighed(evidence, parts)


def _passed(columns: Array, t: Trajectory, kind: tuple[str, float, int]) -> Array:
    """Return periodic columns [N, n, p] behind a Butterworth low pass, or late, line by line."""
    samples = len(columns)
    frequency = np.fft.rfftfreq(samples, t.motion.dt or t.measured.dt)
    h = _response(kind, np.asarray(frequency, dtype=float))
    lines = np.fft.rfft(columns, axis=0) * h.reshape(-1, 1, 1)
    return np.fft.irfft(lines, samples, axis=0)


def _response(kind: tuple[str, float, int], frequency: Array) -> NDArray[np.complex128]:
    word, value, order = kind
    if word == "delay":
        return np.asarray(np.exp(-2j * np.pi * frequency * value))
    s = 1j * frequency / value
    return np.asarray(1.0 / (1.0 + s) if order == 1 else 1.0 / (1.0 + np.sqrt(2.0) * s + s**2))
