"""What an average of periods hides: drift of friction with temperature, a trend from period to period; samples off the
clock, by which positions scatter the more the faster the joints move.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from robot_ident.diagnosis.before_after import errors, estimates, mean_squares
from robot_ident.diagnosis.diagnosis import Diagnosis, Estimate, Finding
from robot_ident.diagnosis.power import least_torque
from robot_ident.diagnosis.selection.refinement import best_values
from robot_ident.effects import Effect, make_effect
from robot_ident.effects.catalogue import CATALOGUE
from robot_ident.estimation.equations import apart
from robot_ident.model.structure import Structure
from robot_ident.recording.measurement import Measurement
from robot_ident.regression.evidence import Evidence, extended, gather, held
from robot_ident.regression.more_than_noise import ALPHA
from robot_ident.signals.motion import Array, Motion

DRIFT = "temperature_drift"
UNSEEN_IN_MEANS = (
    "errors are those of averages over periods, which take its mean for viscous friction; adding it lowers the error of"
    " single periods and of recordings of another length"
)
_LEAST = 4  # periods in which a trend is looked for
_CERTAIN = 40.0  # chi-square units beyond which a trend is no chance of noise whose variance all samples tell
_LIKE_NOISE = 0.01  # chance of a scatter about the course from which on it is no more than that
_HOPELESS = 0.1  # chance of the gain on a grid of time constants beyond which none between them is looked for
_FINE = 0.1  # of log T0: how near the best time constant is looked for


@dataclass(frozen=True)
class DriftTest:
    """Of one joint: gain of a warming that all recordings share, in units of chi-square, its p-value, times the number
    of settings and joints that are looked at (Bonferroni), and the torque [Nm rms] by which it changes the periods.

    least: the torque below which it isn't worth a name, however surely it is there.
    """

    gain: float
    p_value: float
    torque: float
    least: float

    @property
    def told(self) -> bool:
        """Whether friction falls from period to period more than noise lets it seem to, by a torque that counts."""
        return self.p_value < ALPHA and self.torque >= self.least


def drift_tests(evidence: Evidence) -> tuple[DriftTest, ...]:
    """Return for every joint whether its friction falls as it does while a gear warms up.

    In period m of a recording the torque beyond its mean over periods, along the effect's own column of unit length u
    and over the noise, is b_m = u (tau_m - mean tau) / s; w_m is what the column itself has there. With one size a > 0
    for all recordings, whose every period but the mean tells (nu = sum (M - 1) - 1), at the best time constant,

        gain = (sum w b)^2 / sum w^2,  F = gain / ((sum b^2 - gain) / nu) ~ F(1, nu):

    noise is taken from how the b_m scatter about the course, since it may be larger so slowly than over all lines.
    Where they scatter as all lines tell, a gain far beyond chance needs no more periods than it has.
    """
    robot = evidence.structure.robot
    known = [m for m in evidence.recordings if _known_one_by_one(m)]
    effects = [make_effect(f"{DRIFT}@{name}", robot) for name in robot.joints]
    return tuple(_drift_test(known, effect, least_torque(evidence, j)) for j, effect in enumerate(effects))


def _drift_test(known: Sequence[Measurement], effect: Effect, least: float) -> DriftTest:
    from scipy.optimize import minimize_scalar

    (span,) = effect.inner

    def at(place: float) -> DriftTest:
        return _with_time_constant(known, effect.at({span.name: float(np.exp(place))}), least)

    def among(test: DriftTest) -> DriftTest:
        return replace(test, p_value=min(1.0, test.p_value * len(tests) * effect.robot.n))

    tests = [at(float(np.log(point))) for point in span.grid]
    nearest = min(tests, key=lambda test: test.p_value)
    if nearest.p_value > _HOPELESS:  # a finer search gains little
        return among(nearest)
    bounds = (float(np.log(span.lower)), float(np.log(span.upper)))
    found = minimize_scalar(lambda x: -at(float(x)).gain, bounds=bounds, method="bounded", options={"xatol": _FINE})
    return among(min([nearest, at(float(found.x))], key=lambda test: test.p_value))


def _with_time_constant(known: Sequence[Measurement], effect: Effect, least: float) -> DriftTest:
    """Return the test of one joint and time constant by itself."""
    from scipy.special import chdtrc, fdtrc

    courses = [course for m in known if (course := _course(m, effect)) is not None]
    dof = sum(len(b) - 1 for b, _, _ in courses) - 1
    along = sum(float(w @ b) for b, w, _ in courses)
    if dof < 1 or along <= 0.0:  # friction that rises is no warming
        return DriftTest(0.0, 1.0, 0.0, least)
    squares = sum(float(w @ w) for _, w, _ in courses)
    gain = along**2 / squares
    torque = along / squares * np.sqrt(np.mean(np.concatenate([(unit * w) ** 2 for _, w, unit in courses])))
    rest = max(sum(float(b @ b) for b, _, _ in courses) - gain, 1e-12 * gain)
    p = float(fdtrc(1, dof, gain / (rest / dof))) / 2.0
    if gain >= _CERTAIN and float(chdtrc(dof, rest)) > _LIKE_NOISE:
        p = min(p, float(chdtrc(1, gain)) / 2.0)
    return DriftTest(gain, p, float(torque), least)


def _known_one_by_one(measured: Measurement) -> bool:
    periods = measured.period_torque
    return periods is not None and len(periods) == len(measured.motion.began) and len(periods) >= _LEAST


def _course(measured: Measurement, effect: Effect) -> tuple[Array, Array, float] | None:
    """Return b and w [M] of a recording's periods, and the torque [Nm rms] of one period in which b is 1; None where
    its motion doesn't show the effect.
    """
    periods, joint, motion = measured.period_torque, effect.joint, measured.motion
    assert periods is not None
    columns = np.stack([effect.columns(replace(motion, began=(start,)))[:, joint, 0] for start in motion.began])
    usual = columns.mean(axis=0)
    length = float(np.linalg.norm(usual))
    if length == 0.0:
        return None
    beyond = np.nan_to_num(periods[:, :, joint] - np.nanmean(periods[:, :, joint], axis=0))
    noise = float(np.sqrt(measured.torque_variance[joint]))
    b, w = beyond @ usual / (length * noise), (columns - usual) @ usual / (length * noise)
    return b - b.mean(), w, noise / float(np.sqrt(len(usual)))


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

    kept = [effect for effect in structure.added if not effect.trends]
    return [less(m) for m in measurements], Structure.build(structure.robot, kept), [less(m) for m in validation]


def drift_finding(evidence: Evidence, joint: int, test: DriftTest, validation: Sequence[Measurement]) -> Finding:
    """Return the drift of a joint's friction that its test tells of, fitted to the periods taken apart.

    Its mean squares are those of averages, which hide it; a validation recording that begins as cold shows its fall.
    """
    robot = evidence.structure.robot
    effect = make_effect(f"{DRIFT}@{robot.joints[joint]}", robot)
    single = gather(apart(evidence.recordings, [effect]), evidence.structure)
    best = best_values(effect, single)
    found, gain = (effect, 0.0) if best is None else best
    after = extended(single, [found])
    return Finding(
        effect=found,
        p_value=test.p_value,
        explained=float(np.clip(gain / test.gain, 0.0, 1.0)),
        mse_before=mean_squares(evidence),
        mse_after=mean_squares(held(evidence, after.structure, after.values)),
        validation_before=errors(evidence, validation) if validation else None,
        validation_after=errors(after, validation) if validation else None,
        parameters=estimates(after, found),
        tied_with=(),
        experiment=None,
    )


_JITTER_SIGMAS = 6.0  # of the evidence, over all recordings together
_LEAST_JITTER = 0.01  # of the sample time, below which jitter is of no consequence


def with_jitter(found: Diagnosis, evidence: Evidence) -> Diagnosis:
    """Return a diagnosis with samples off the clock named as well, where the periods show them."""
    jitter = jitter_finding(evidence)
    return found if jitter is None else replace(found, verdict="missing", missing=(*found.missing, jitter))


def jitter_finding(evidence: Evidence) -> Finding | None:
    """Return samples off the clock as a finding, None where the periods don't show any.

    It makes no torque: what it leaves in the mean is what there was.
    """
    from scipy.special import ndtr

    told = [(m, m.off_clock) for m in evidence.recordings if m.off_clock is not None]
    if not told:
        return None
    sigmas = sum(found.sigmas for _, found in told) / len(told) ** 0.5
    sizes = [found.size / m.sample_rate for m, found in told]
    size = (sum(s**2 for s in sizes) / len(sizes)) ** 0.5
    if sigmas < _JITTER_SIGMAS or max(found.size for _, found in told) < _LEAST_JITTER:
        return None
    mse = mean_squares(evidence)
    return Finding(
        effect=CATALOGUE["stamp_jitter"](evidence.structure.robot, None),
        p_value=float(ndtr(-sigmas)),
        explained=0.0,
        mse_before=mse,
        mse_after=mse,
        validation_before=None,
        validation_after=None,
        parameters=(Estimate("stamp_jitter", 1e3 * size, 500.0 * size / sigmas * len(told) ** 0.5, "ms"),),
        tied_with=(),
        experiment=None,
        fix="the driver or recorder: stamp samples when they are taken (the header's stamp, not that of arrival)",
    )
