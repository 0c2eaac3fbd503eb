"""Drift of friction with temperature: invisible in an average of periods, a trend from period to period."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from robot_ident.diagnosis.before_after import errors, estimates, mean_squares
from robot_ident.diagnosis.candidates import Folds, candidate_of, score
from robot_ident.diagnosis.diagnosis import Suspect
from robot_ident.diagnosis.evidence import Evidence, added, extended, gather, held
from robot_ident.diagnosis.refine import refined
from robot_ident.diagnosis.scan import base_gram
from robot_ident.effects import make_effect
from robot_ident.estimation.apart import apart
from robot_ident.model.structure import Structure
from robot_ident.motion import Array, Motion
from robot_ident.recording.measurement import Measurement

DRIFT = "temperature_drift"
UNSEEN_IN_MEANS = (
    "errors are those of averages over periods, which take its mean for viscous friction; adding it lowers the error of"
    " single periods and of recordings of another length"
)
_LEAST = 4  # periods in which a trend is looked for


def drift_gain(evidence: Evidence) -> Array:
    """Return for every joint [n] how much a linear trend of its viscous friction gains, in units of chi-square.

    For period m the viscous friction beyond the mean is b_m = sum v (tau_m - mean tau) / sum v^2, with variance s^2 /
    sum v^2; the squared slope of b_m over m, in units of its variance, is chi-square with one degree of freedom for
    each recording.
    """
    gain = np.zeros(evidence.structure.robot.n)
    for measured in recordings(evidence):
        periods = measured.period_torque
        if periods is None or len(periods) < _LEAST:
            continue
        number = np.arange(len(periods)) - (len(periods) - 1) / 2.0
        for joint in range(len(gain)):
            v = measured.motion.dq[:, joint]
            power = float(v @ v)
            extra = np.nan_to_num(periods[:, :, joint] - np.nanmean(periods[:, :, joint], axis=0))
            if power <= 0.0:
                continue
            trend = float(number @ (extra @ v))
            gain[joint] += trend**2 / (measured.torque_variance[joint] * power * float(number @ number))
    return gain


def recordings(evidence: Evidence) -> tuple[Measurement, ...]:
    """Return the measurements of an evidence, each once where parts of it are left out in turn."""
    return tuple({id(t.measured): t.measured for t in evidence.trajectories}.values())


def without_trends(
    measurements: Sequence[Measurement], structure: Structure, validation: Sequence[Measurement]
) -> tuple[Sequence[Measurement], Structure, Sequence[Measurement]]:
    """Return measurements, model and validation less what trends in the model, as the periods taken apart tell it.

    Averages by themselves can't tell the course of a trend from its level.
    """
    trending = {effect.label for effect in structure.effects if effect.trends}
    if not trending:
        return measurements, structure, validation
    single = gather(apart(measurements, structure.effects), structure)
    values = dict(zip(structure.names, single.values, strict=True))
    found = [
        (effect, np.array([values[name] for name in effect.parameter_names()]))
        for effect in structure.effects
        if effect.label in trending
    ]

    def less(measured: Measurement) -> Measurement:
        def torque(motion: Motion) -> Array:
            return np.asarray(sum(effect.columns(motion) @ size for effect, size in found))

        periods, began = measured.period_torque, measured.motion.began
        if periods is not None and len(began) == len(periods):
            periods = periods - np.stack([torque(replace(measured.motion, began=(start,))) for start in began])
        return replace(measured, torque=measured.torque - torque(measured.motion), period_torque=periods)

    kept = [effect for effect in added(structure) if not effect.trends]
    return [less(m) for m in measurements], Structure.build(structure.robot, kept), [less(m) for m in validation]


def drift_suspect(evidence: Evidence, joint: int, gain: float, validation: Sequence[Measurement]) -> Suspect:
    """Return the drift of a joint's friction that gains so much as a trend, fitted to the periods taken apart.

    Its mean squares are those of averages, which hide it; a validation recording that begins as cold shows its fall.
    """
    from scipy.stats import chi2

    robot = evidence.structure.robot
    effect = make_effect(f"{DRIFT}@{robot.joints[joint]}", robot)
    seen = recordings(evidence)
    single = gather(apart(seen, [effect]), evidence.structure)
    folds = Folds.of(base_gram(single))
    found = refined(score(candidate_of(effect, single), single, folds), single, folds)
    after = extended(single, [found.effect])
    return Suspect(
        effect=found.effect,
        p_value=min(1.0, float(chi2.sf(gain, len(seen))) * robot.n),
        explained=float(np.clip(found.gain / gain, 0.0, 1.0)),
        mse_before=mean_squares(evidence),
        mse_after=mean_squares(held(evidence, after.structure, after.values)),
        validation_before=errors(evidence, validation) if validation else None,
        validation_after=errors(after, validation) if validation else None,
        parameters=estimates(after, found.effect),
        tied_with=(),
        experiment=None,
    )
