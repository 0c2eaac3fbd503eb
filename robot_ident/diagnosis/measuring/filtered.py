"""A low pass over the effort alone: the model's torque behind it is held against what was measured."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from functools import partial
from itertools import product

import numpy as np

from robot_ident.diagnosis.diagnosis import Estimate
from robot_ident.diagnosis.evidence import Evidence, weighed_once
from robot_ident.diagnosis.measuring.finding import (
    Finding,
    chosen,
    curvature_std,
    fitted_loss,
    folds,
    raw_columns,
    weighed,
)
from robot_ident.diagnosis.measuring.passage import LOW_PASSES, ORDERS, Passage
from robot_ident.diagnosis.scan import BaseFit, BaseGram, base_gram
from robot_ident.effects.catalogue import CATALOGUE
from robot_ident.signals.motion import Array

NAME = "effort_filter"
CUTOFFS = (1.0, 1.4, 2.0, 3.0, 4.5, 6.5, 9.5, 14.0, 20.0, 30.0, 45.0, 65.0, 95.0)
"""-3 dB frequencies [Hz] that are tried at first, with the forms of `ORDERS`."""

_NEIGHBOUR = 0.4  # of the logarithm of a frequency: as far as the next point of the grid lies
_COARSE, _FINE = 0.03, 0.002  # of that logarithm: how near the best is looked for
_STEP = 0.01  # of that logarithm, over which the curvature of the squared error is taken


@dataclass(frozen=True)
class Passages:
    """Models of what is measured behind low passes: raw columns [N, n, p] of every trajectory, and the plain model."""

    evidence: Evidence
    base: BaseGram
    raw: tuple[Array, ...]

    @classmethod
    def of(cls, evidence: Evidence, base: BaseGram) -> Passages:
        """Take the model of some evidence, whose Gram matrices are known."""
        return cls(evidence, base, tuple(raw_columns(evidence)))

    def through(self, passage: Passage, joints: Sequence[int] | None = None) -> BaseGram:
        """Return the Gram matrices with the rows of some joints (None: all) behind a low pass."""
        all_of = self.evidence.trajectories
        phi = weighed_once(all_of, lambda place: passage.applied(self.raw[place], all_of[place]))
        made = base_gram(replace(self.evidence, phi=phi))
        return made if joints is None else chosen(self.base, made, joints)

    def loss(self, passage: Passage, joints: Sequence[int]) -> float:
        """Return the squared error of a fit to all trajectories."""
        return fitted_loss(self.through(passage, joints), range(len(self.base.power)))

    def best(
        self, start: Passage, joints: Sequence[int], reach: float = _NEIGHBOUR, near: float = _COARSE
    ) -> tuple[Passage, float]:
        """Return the passage of a form with the least squared error, near one of it, and that error."""
        from scipy.optimize import minimize_scalar

        found = minimize_scalar(
            lambda x: self.loss(Passage(start.form, start.at * float(np.exp(x))), joints),
            bounds=(-reach, reach),
            method="bounded",
            options={"xatol": near, "maxiter": 20},
        )
        return Passage(start.form, start.at * float(np.exp(found.x))), float(found.fun)

    @property
    def rate(self) -> float:
        """Samples per second."""
        t = self.evidence.trajectories[0]
        return 1.0 / (t.motion.dt or t.measured.dt)


def filters(evidence: Evidence, base: BaseGram) -> list[Finding]:
    """Return the best low pass of every joint and of all, over the grid alone."""
    if any(t.measured.base_frequency is None for t in evidence.trajectories):
        return []
    model = Passages.of(evidence, base)
    tried = [Passage(form, f) for f, form in product(CUTOFFS, ORDERS.values())]
    passes = {passage: model.through(passage) for passage in tried}
    n = base.power.shape[1]
    places: list[int | None] = [*range(n), *([None] if n > 1 else [])]
    out = [_of_grid(model, passes, place) for place in places]
    return [finding for finding in out if finding.gain > 0.0]


def exact(found: Finding, evidence: Evidence, base: BaseGram) -> Finding:
    """Return a low pass at its exact frequency, of the form among `LOW_PASSES` that leaves least."""
    model = Passages.of(evidence, base)
    joints, start = joints_of(found, base), _passage_of(found)
    losses = dict(model.best(start.like(form, model.rate), joints) for form in LOW_PASSES)
    closest = min(losses, key=losses.__getitem__)
    passage, _ = model.best(closest, joints, 2.0 * _COARSE, _FINE)
    declared = min((p for p in losses if p.form in ORDERS.values()), key=losses.__getitem__)
    declared = passage if declared == closest else declared
    std = curvature_std(
        lambda x: model.loss(Passage(passage.form, float(np.exp(x))), joints), np.log(passage.at), _STEP
    )
    better = _finding(model, passage, declared, found.effect.place, passage.at * std)
    return better if better.gain > found.gain else found


def joints_of(found: Finding, base: BaseGram) -> list[int]:
    """Return the joints whose effort passes."""
    return list(range(base.power.shape[1])) if found.effect.place is None else [found.effect.joint]


def _of_grid(model: Passages, passes: Mapping[Passage, BaseGram], place: int | None) -> Finding:
    joints = list(range(model.base.power.shape[1])) if place is None else [place]
    mixed = {passage: chosen(model.base, made, joints) for passage, made in passes.items()}
    losses = {passage: fitted_loss(one, range(len(model.base.power))) for passage, one in mixed.items()}
    best = min(losses, key=losses.__getitem__)
    near = sorted(CUTOFFS, key=lambda f: abs(np.log(f / best.at)))[1]
    names = model.evidence.structure.robot.joints
    found = _finding(model, best, best, None if place is None else names[place], abs(near - best.at) / 2.0)
    return replace(found, held_out=_held_fall(model.base, list(mixed.values())))


def _finding(model: Passages, passage: Passage, declared: Passage, place: str | None, std: float) -> Finding:
    """Return a low pass as a fault; declared: the best of those that a robot YAML can tell."""
    robot = model.evidence.structure.robot
    effect = CATALOGUE[NAME](robot, None if place is None else robot.joint_index(place))
    joints = list(range(robot.n)) if place is None else [effect.joint]
    after = model.through(passage, joints)
    everything = range(len(model.base.power))
    return Finding(
        effect,
        fitted_loss(model.base, everything) - fitted_loss(after, everything),
        _held_fall(model.base, [after]),
        (Estimate(f"cutoff of {effect.label}", passage.at, std, "Hz"),),
        partial(_columns, passage=passage, joints=joints),
        _fix(place, passage, declared),
        2,
    )


def _passage_of(found: Finding) -> Passage:
    """Return the passage of a finding of this file."""
    assert isinstance(found.columns, partial)
    passage = found.columns.keywords["passage"]
    assert isinstance(passage, Passage)
    return passage


def _fix(place: str | None, passage: Passage, declared: Passage) -> str:
    order = next(order for order, form in ORDERS.items() if form == declared.form)
    kind = f"anti_alias: {{order: {order}, cutoff: {declared.at:.3g}}}"
    near = "" if passage == declared else f": what comes nearest to a filter of another form ({passage.form})"
    return f"{kind if place is None else f'joints: {{{place}: {{{kind}}}}}'}  # in the robot YAML{near}"


def _held_fall(base: BaseGram, made: Sequence[BaseGram]) -> float:
    """Return the fall of the squared error on trajectories left out, the model chosen on the others."""
    total = 0.0
    for left, train in folds(len(base.power)):
        best = made[0] if len(made) == 1 else made[int(np.argmin([fitted_loss(one, train) for one in made]))]
        total += float(BaseFit.of(base, train).loss(base, left).sum() - BaseFit.of(best, train).loss(best, left).sum())
    return total


def _columns(evidence: Evidence, *, passage: Passage, joints: Sequence[int]) -> tuple[Array, ...]:
    parts = []
    for columns, t in zip(raw_columns(evidence), evidence.trajectories, strict=True):
        changed = columns.copy()
        changed[:, joints] = passage.applied(columns[:, joints], t)
        parts.append(changed)
    return weighed(evidence, parts)
