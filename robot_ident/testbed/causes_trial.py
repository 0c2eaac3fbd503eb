"""Recordings like real ones with several causes on every joint but one: which are named, and what does adding them buy?

Each case draws a robot as `base_trial` does and causes besides, identifies without an option, diagnoses, adds what was
named, and predicts the exact torque of another path. The names are counted joint by joint.
"""

from __future__ import annotations

import time
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np

from robot_ident.diagnosis.diagnose import diagnose
from robot_ident.effects.effort_gain import EffortGain
from robot_ident.errors import InputError
from robot_ident.estimation.effort_checks import taken_as_declared
from robot_ident.estimation.identify import extend, identify
from robot_ident.estimation.prediction import measured_for
from robot_ident.model.model import Model
from robot_ident.robot.robot import Robot
from robot_ident.signals.motion import Array
from robot_ident.testbed.like_real import KINDS, LikeReal, like_real
from robot_ident.testbed.trial import AsData, Case
from robot_ident.testbed.trial_table import Rate, wilson

ASKED = 0.15
"""Share of a joint's excess from which on a cause is asked for, where the excess is larger than what noise leaves."""
BINS = (0.0, 0.8, 0.95, 0.999, 1.001)
"""Bounds of the probabilities of names whose truth is counted together."""


@dataclass(frozen=True)
class CausesOutcome(AsData):
    """What one seed gave.

    causes: what acts, with its share of its joint's excess, `name@joint`; the rest without a name is `@joint`.
    over_noise: by joint the squared excess over that of what noise leaves. scaled: joints whose efforts have a scale of
    their own. named: with their probabilities; tied: what each may be instead. averaged: whether periods were
    averaged, so that noise is known. before, after: by joint, the mean square error on the unseen path over the exact
    torque's variance, without and with what was named. seconds: processor time of the diagnosis. trouble: the message
    where a step was refused.
    """

    seed: int
    kind: str
    rate: float
    averaged: bool
    causes: Mapping[str, float]
    over_noise: Mapping[str, float]
    scaled: tuple[str, ...]
    verdict: str
    named: Mapping[str, float]
    listed: Mapping[str, float]
    before: tuple[float, ...]
    after: tuple[float, ...]
    seconds: float
    trouble: str = ""
    tied: Mapping[str, tuple[str, ...]] = field(default_factory=dict)

    @property
    def silent_joints(self) -> list[str]:
        """Joints that have no cause with a name."""
        with_name = {place for name, _, place in map(_apart, self.causes) if name}
        return [place for name, _, place in map(_apart, self.causes) if not name and place not in with_name]

    def right(self, label: str) -> bool:
        """Return whether a name, or one that it is tied with, is that of a cause at its place, any line of a ripple
        too, or a gain that there is.
        """
        return any(
            _plain(one) in self.causes or (_apart(one)[0] == EffortGain.name and _apart(one)[2] in self.scaled)
            for one in (label, *self.tied.get(label, ()))
        )

    @property
    def told(self) -> set[str]:
        """Names, and what they are tied with."""
        return {_plain(one) for label in self.named for one in (label, *self.tied.get(label, ()))}


def _apart(label: str) -> tuple[str, str, str]:
    return label.partition("@")


def _plain(label: str) -> str:
    name, at, place = _apart(label)
    return f"{'torque_ripple' if name.startswith('torque_ripple') else name}{at}{place}"


def run_causes_case(case: Case, robot: Robot) -> CausesOutcome:
    """Draw what one seed gives, identify without an option, diagnose, add what is named."""
    drawn = like_real(robot, case.seed, causes=True)
    model = identify([drawn.train], replace(robot, base="prediction"), as_declared=True)
    measured = measured_for(model, drawn.train)
    started = time.process_time()
    found = diagnose([measured], model.structure, as_declared=taken_as_declared(model.notes))
    seconds = time.process_time() - started
    shares, over = _visible(model, drawn)
    before = _errors(model, drawn)
    after, trouble = before, ""
    effects = [one.effect for one in found.missing if not one.effect.measuring]
    if effects:
        try:
            after = _errors(extend(model, [measured], effects)[-1], drawn)
        except InputError as error:
            trouble = str(error)
    return CausesOutcome(
        case.seed,
        drawn.kind,
        drawn.rate,
        measured.motion.periodic,
        shares,
        over,
        tuple(joint for joint, scale in zip(robot.joints, drawn.scale, strict=True) if scale != 1.0),
        found.verdict,
        {one.label: 1.0 if one.probability is None else float(one.probability) for one in found.missing},
        {one.label: float(one.explained) for one in found.others},
        before,
        after,
        seconds,
        trouble,
        {one.label: one.tied_with for one in found.missing if one.tied_with},
    )


def _errors(model: Model, case: LikeReal) -> tuple[float, ...]:
    """Return by joint the mean square error on the unseen path over the variance of the exact torque."""
    return tuple(float(x) for x in np.mean(case.errors(model) ** 2, axis=0))


def _visible(model: Model, case: LikeReal) -> tuple[dict[str, float], dict[str, float]]:
    """Return what share of its joint's excess each cause makes, and each joint's excess over what noise leaves.

    The excess is what the base model can't take of all causes, filtered as the recording is; noise is the rest of what
    the model leaves, that of the encoders included.
    """
    joints = model.robot.joints

    def rows_of(torque: Array) -> Array:
        measured = measured_for(model, replace(case.train, tau=torque))
        return np.asarray(measured.passed(measured.torque) * measured.used[measured.rows])

    measured = measured_for(model, case.train)
    used = measured.used[measured.rows]
    base = measured.passed(model.structure.columns(measured.motion, model.values)) * used[:, :, None]
    scale = np.array([max(float(np.std(x)), 1e-12) for x in case.exact.T])
    parts = [rows_of(case.train.tau)]
    for k, cause in enumerate(case.causes):
        more = case.train.tau.copy()
        more[:, cause.joint] += case.hidden[:, k]
        parts.append(rows_of(more) - parts[0])
    columns = (base / scale[:, None]).reshape(-1, base.shape[2])
    flat = np.stack([(part / scale).ravel() for part in parts], axis=1)
    left = (flat - columns @ np.linalg.lstsq(columns, flat, rcond=1e-9)[0]).reshape(*used.shape, -1)
    excess, noise = left[:, :, 1:].sum(axis=2), left[:, :, 0] - left[:, :, 1:].sum(axis=2)
    of_all = np.maximum(np.sum(excess**2, axis=0), 1e-300)
    shares = {
        f"{cause.name}@{joints[cause.joint]}": float(np.sum(left[:, cause.joint, k] ** 2) / of_all[cause.joint])
        for k, cause in enumerate(case.causes, 1)
    }
    over = of_all / np.maximum(np.sum(noise**2, axis=0), 1e-300)
    return shares, {joint: float(x) for joint, x in zip(joints, over, strict=True)}


def causes_summary(outcomes: Sequence[CausesOutcome]) -> dict[str, Any]:
    """Return how often names were right, causes found, joints without any left alone; error removed; reliability."""
    rates = []
    for kind in ("all", *KINDS):
        own = [one for one in outcomes if kind in ("all", one.kind)]
        if own:
            rates += [{"kind": kind, **rate.to_dict()} for rate in _rates(own) if rate.cases]
    told = [(p, one.right(label)) for one in outcomes for label, p in one.named.items()]
    reliability = []
    for low, high in zip(BINS[:-1], BINS[1:], strict=True):
        right = [ok for p, ok in told if low <= p < high]
        if right:
            lower, upper = wilson(sum(right), len(right))
            mean = float(np.mean([p for p, _ in told if low <= p < high]))
            bounds = {"probability": mean, "lower": lower, "upper": upper}
            reliability.append({"names": len(right), "right": sum(right), **bounds})
    removed = [1.0 - sum(one.after) / sum(one.before) for one in outcomes if one.named and not one.trouble]
    return {
        "rates": rates,
        "reliability": reliability,
        "error_removed": {
            "cases": len(removed),
            "median": float(np.median(removed)) if removed else None,
            "tenth_percentile": float(np.quantile(removed, 0.1)) if removed else None,
        },
        "seconds": float(np.median([one.seconds for one in outcomes])),
        "troubles": {str(one.seed): one.trouble for one in outcomes if one.trouble},
    }


def _rates(outcomes: Sequence[CausesOutcome]) -> list[Rate]:
    right = [(one.seed, one.right(label)) for one in outcomes for label in one.named]
    found = [
        (one.seed, label in one.told)
        for one in outcomes
        for label, share in one.causes.items()
        if share >= ASKED and one.over_noise[_apart(label)[2]] > 1.0 and not label.startswith("@")
    ]
    alone = [(one.seed, label not in one.tied) for one in outcomes for label in one.named]
    disturbed = [
        (one.seed, any(_apart(name)[2] == joint for name in one.named))
        for one in outcomes
        for joint in one.silent_joints
    ]
    return [
        Rate.of("names that are right, or tied with one that is", right, hoped=True),
        Rate.of("names that are tied with no other", alone, hoped=True),
        Rate.of(
            f"causes of {100 * ASKED:.0f} % of a joint's excess and more that are named or tied", found, hoped=True
        ),
        Rate.of("joints without a cause that get a name", disturbed, hoped=False),
    ]
