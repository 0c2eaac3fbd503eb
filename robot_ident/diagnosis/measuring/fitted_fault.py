"""What a test for a fault of measuring found, and how two models are held against each other on data left out."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numpy as np

from robot_ident.diagnosis.diagnosis import Estimate
from robot_ident.effects import Effect
from robot_ident.regression.evidence import Evidence
from robot_ident.regression.gram import BaseFit, BaseGram, base_gram
from robot_ident.signals.motion import Array

Columns = Callable[[Evidence], tuple[Array, ...]]
"""The model's columns [N, n, p] on every trajectory of some evidence, as they are with a fault."""


@dataclass(frozen=True)
class FittedFault:
    """A fault with the best values of its parameters.

    gain: fall of the squared error of all data, held_out: of data left out of the fit, both in units of chi-square.
    columns: those of a model of what is measured with the fault in it. fix: the line to change, and where. single:
    the number of the recording, from 1, that alone has it, so that none left out can tell of it; None: all have.
    """

    effect: Effect
    gain: float
    held_out: float
    parameters: tuple[Estimate, ...]
    columns: Columns
    fix: str
    more: int = 1  # parameters
    single: int | None = None

    @property
    def label(self) -> str:
        """`name@joint`."""
        return self.effect.label


def with_columns(evidence: Evidence, columns: Columns) -> Evidence:
    """Return evidence whose model has other columns, fitted; its structure no longer describes them."""
    phi = columns(evidence)
    plain = replace(evidence, phi=phi)
    base = base_gram(plain)
    return replace(plain, values=BaseFit.of(base, range(len(phi))).values)


def weighed(evidence: Evidence, raw: Sequence[Array]) -> tuple[Array, ...]:
    """Return columns [N, n, p] Nm of every trajectory as evidence holds them."""
    return tuple(t.weighed(columns) for t, columns in zip(evidence.trajectories, raw, strict=True))


def raw_columns(evidence: Evidence) -> list[Array]:
    """Return the model's own columns [N, n, p] Nm of every trajectory, one array for all parts of a measurement."""
    known: dict[int, Array] = {}
    for t, rigid in zip(evidence.trajectories, evidence.rigid, strict=True):
        if id(t.measured) not in known:
            known[id(t.measured)] = evidence.structure.columns(t.motion, evidence.values, rigid)
    return [known[id(t.measured)] for t in evidence.trajectories]


def fitted_loss(base: BaseGram, train: Sequence[int]) -> float:
    """Return the squared error of a fit to some trajectories on them."""
    values, weights = BaseFit.of(base, train).values, np.zeros(len(base.power))
    weights[list(train)] = 1.0
    own, torque, power = base.weighed(weights)
    return float(power + (own @ values - 2.0 * torque) @ values)


def folds(count: int) -> list[tuple[int, list[int]]]:
    """Return (left out, fitted) for every one of a number of trajectories."""
    return [(left, [t for t in range(count) if t != left]) for left in range(count)]


def multiplied(base: BaseGram, factors: Array) -> BaseGram:
    """Return the Gram matrices of a model whose rows are multiplied by a factor [n] each."""
    own = base.own * (factors**2)[None, :, None, None]
    return BaseGram(own, base.torque * factors[None, :, None], base.power)


def chosen(base: BaseGram, other: BaseGram, joints: Sequence[int]) -> BaseGram:
    """Return the Gram matrices of two models of equal parameters, the rows of some joints from the other."""
    own, torque = base.own.copy(), base.torque.copy()
    own[:, joints], torque[:, joints] = other.own[:, joints], other.torque[:, joints]
    return BaseGram(own, torque, base.power)


def curvature_std(loss: Callable[[float], float], at: float, step: float) -> float:
    """Return 1 / sqrt(half the second derivative) of a squared error in units of chi-square: a standard deviation."""
    bend = (loss(at + step) - 2.0 * loss(at) + loss(at - step)) / step**2
    return float(np.sqrt(2.0 / bend)) if bend > 0.0 else float("inf")
