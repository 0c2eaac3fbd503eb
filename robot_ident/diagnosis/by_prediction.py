"""Diagnosis of recordings that don't tell their noise: an effect is named where it predicts motion it has not seen.

Without periods there is no noise floor, so nothing says that a model is adequate. What can be said is that an effect
makes the error fall on parts of the recordings that were left out of the fit; what is left is reported as it is, noise
included. Every joint is weighed by the residual that the model leaves on it.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from robot_ident.diagnosis.before_after import errors, estimates, mean_squares
from robot_ident.diagnosis.candidates import Candidate, Folds, Score, enumerate_candidates, score
from robot_ident.diagnosis.diagnosis import Diagnosis, Suspect, Verdict
from robot_ident.diagnosis.evidence import Evidence, Trajectory, added, extended, fitted, split
from robot_ident.diagnosis.progress import Tell, after, silent
from robot_ident.diagnosis.refine import refined
from robot_ident.diagnosis.scan import add, base_gram, columns_of, gram
from robot_ident.diagnosis.ties import BLOCK, tied
from robot_ident.diagnosis.unexplained import explain_by_variables
from robot_ident.excitation.tell import experiment_between
from robot_ident.model.structure import Structure
from robot_ident.motion import Array, Motion
from robot_ident.recording.low_pass import ZeroPhaseLowPass
from robot_ident.recording.measurement import Measurement

FALL = 0.1  # of the squared error on its joints that a member must remove on data left out (5 % of the rms)
AGAIN = 0.2  # the same where a joint has a member already: what an imperfect column leaves looks like another effect
HALVES = 0.02  # the same where a half of one recording predicts the other: what it extrapolates is uncertain
CHANCE = 0.05  # largest p-value, all candidates together
MUCH, OWN_CHANCE = 0.25, 0.01  # or so large a fall every way, with so large a p-value of the candidate alone
VALIDATION = 0.02  # by which a member may raise the mean square of a validation recording on its joints
MOST = 8  # members
_SHARES = (FALL, FALL, HALVES)  # of the views
_BLOCK = 1.0  # s: of blocks that are left out in turn
_PARTS = 4
_SAMPLES = 50.0  # a second per Hz of the low pass: enough to time a reversal
_ROWS = 4.0  # a second per Hz of the low pass: more say nothing new
_LISTED = 6
_STRUCTURE = 0.1  # of the error that a curve over a variable must predict on unseen motion to call it unexplained


@dataclass(frozen=True)
class _View:
    """Evidence cut one way, with the base fitted to all but each part."""

    evidence: Evidence
    folds: Folds

    @classmethod
    def of(cls, evidence: Evidence) -> _View:
        return cls(evidence, Folds.of(base_gram(evidence)))

    @property
    def loss(self) -> Array:
        """Held-out squared error [n]."""
        return np.asarray(self.folds.loss.sum(axis=0))


@dataclass(frozen=True)
class _Stage:
    """The model with the members found so far, seen by parts left out in every way, and the candidates' scores."""

    views: tuple[_View, ...]
    candidates: dict[str, Candidate]
    scores: list[Score]

    @property
    def evidence(self) -> Evidence:
        return self.views[0].evidence


def tells_noise(measured: Measurement) -> bool:
    """Return whether a recording tells the noise of its torque."""
    variance = measured.averaged_variance
    return bool(np.all(np.isfinite(variance)) and np.all(variance > 0))


def diagnose_by_prediction(
    measurements: Sequence[Measurement],
    structure: Structure,
    validation: Sequence[Measurement] = (),
    tell: Tell = silent,
) -> Diagnosis:
    """Return what is missing from a model by the error on data left out; the verdict is never `adequate`.

    One recording is left out at a time; a single one is cut into blocks of a second, into quarters and into halves, and
    an effect has to help each way. A named effect removes 10 % or more of the squared error, beyond chance, and doesn't
    harm the validation.
    """
    tell(0.05, "trying every effect")
    whole = weighed_by_residual(measurements, structure)
    stage = first = _stage(_views(whole))
    members: list[Score] = []
    while len(members) < MOST:
        tell(after(len(members), 0.3, 0.8), "looking for more" if members else "looking for a cause")
        found = _choose(stage, members, whole, validation)
        if found is None:
            break
        members.append(found)
        stage = _stage(_extended(first.views, members))
    tell(0.8, "weighing what was found")
    members = _needed(first, members)
    return _conclude(whole, first, members, validation, measurements)


def weighed_by_residual(measurements: Sequence[Measurement], structure: Structure) -> Evidence:
    """Return the evidence with every joint in units of the rms residual that the model leaves on it."""
    plain = []
    for measured in measurements:
        kept = _thinned(measured)
        weight = kept.used[kept.rows].astype(float)
        dof = weight.sum(axis=0) * kept.independent
        plain.append(Trajectory(kept, kept.motion, weight, kept.passed(kept.torque) * weight, dof))
    rigid = tuple(structure.rigid_columns(t.motion) for t in plain)
    evidence = fitted(structure, tuple(plain), rigid)
    for _ in range(2):  # the weights of the joints and the fit settle together
        squared = np.sum([np.sum((r * (t.weight > 0)) ** 2, axis=0) for r, t in _newton(evidence)], axis=0)
        rows = np.sum([np.sum(t.weight > 0, axis=0) for t in plain], axis=0)
        sigma = np.sqrt(np.maximum(squared / np.maximum(rows, 1), 1e-300))
        scaled = [
            replace(t, weight=w, y=t.measured.passed(t.measured.torque) * w)
            for t in plain
            for w in ((t.weight > 0) * np.sqrt(t.measured.independent) / sigma,)
        ]
        evidence = fitted(structure, tuple(scaled), rigid, evidence.memory)
    return evidence


def _newton(evidence: Evidence) -> list[tuple[Array, Trajectory]]:
    """Return each trajectory's residual in Nm, zero where a row doesn't count."""
    pairs = zip(evidence.residual, evidence.trajectories, strict=True)
    return [(r / np.where(t.weight > 0, t.weight, 1.0), t) for r, t in pairs]


def _thinned(measured: Measurement) -> Measurement:
    """Return a low-passed measurement with no more samples and rows than its low pass leaves worth looking at."""
    low_pass = measured.low_pass
    if low_pass is None or measured.base_frequency is not None:
        return measured
    every = max(1, int(1.0 / (_SAMPLES * low_pass.cutoff * measured.dt)))
    if every > 1:
        smooth = ZeroPhaseLowPass(4.0 * low_pass.cutoff, measured.dt, measured.motion.samples)
        q, dq, ddq = (getattr(measured.motion, name)[::every] for name in ("q", "dq", "ddq"))
        measured = replace(
            measured,
            dt=measured.dt * every,
            motion=Motion(q, dq, ddq, dt=measured.dt * every, gravity=measured.motion.gravity),
            torque=smooth.apply(measured.torque)[::every],
            used=measured.used[::every],
            standstill=measured.standstill[::every],
            low_pass=ZeroPhaseLowPass(low_pass.cutoff, measured.dt * every, len(q)),
            samples_per_period=len(q),
            decimate=max(1, measured.decimate // every),
        )
    most = max(1, int(1.0 / (_ROWS * low_pass.cutoff * measured.dt)))
    return replace(measured, decimate=max(measured.decimate, most))


def _views(whole: Evidence) -> tuple[_View, ...]:
    if len(whole.trajectories) > 1:
        return (_View.of(whole),)
    return (_View.of(split(whole, _PARTS, _BLOCK)), _View.of(split(whole, _PARTS)), _View.of(split(whole, 2)))


def _extended(views: Sequence[_View], members: Sequence[Score]) -> tuple[_View, ...]:
    return tuple(_View.of(extended(view.evidence, [m.effect for m in members])) for view in views)


def _stage(views: tuple[_View, ...]) -> _Stage:
    first = views[0]
    candidates = {candidate.label: candidate for candidate in enumerate_candidates(first.evidence)}
    scores = [score(candidate, first.evidence, first.folds) for candidate in candidates.values()]
    return _Stage(views, candidates, sorted(scores, key=lambda s: -s.held_out))


def _choose(
    stage: _Stage, members: Sequence[Score], whole: Evidence, validation: Sequence[Measurement]
) -> Score | None:
    """Return the best candidate that is worth a name, the simplest of those that tie with it; None where none is."""
    view = stage.views[0]
    for best in stage.scores:
        if best.held_out <= 0.0:
            return None
        if not _worthwhile(best, stage):
            continue
        rivals = tied(best, stage.scores, view.evidence, view.folds)
        equals = [best, *(rival for rival in rivals if _worthwhile(rival, stage))]
        for chosen in sorted(equals, key=lambda s: (len(s.effect.coefficients) + len(s.effect.inner), -s.held_out)):
            found = refined(chosen, view.evidence, view.folds)
            if not _harms(found, members, whole, validation):
                return found
    return None


def _worthwhile(candidate: Score, stage: _Stage) -> bool:
    """Return whether a candidate's error falls clearly whichever way parts are left out, and beyond chance.

    Chance among all candidates, or, where it falls much every way, its own.
    """
    joints = list(candidate.columns.joints)
    least = _least(joints, stage.evidence.structure)
    if candidate.held_out_by_joint[joints].sum() < least * stage.views[0].loss[joints].sum():
        return False
    falls = [float(_falls(candidate, view).sum() / view.loss[joints].sum()) for view in stage.views]
    if any(fall < share for fall, share in zip(falls, (least, least, HALVES), strict=False)):
        return False
    chance = _chance(candidate, stage)
    return chance * len(stage.candidates) <= CHANCE or (min(falls) >= MUCH and chance <= OWN_CHANCE)


def _least(joints: Sequence[int], structure: Structure) -> float:
    """Return the share of the error that a further member at some joints must remove."""
    held = added(structure)
    return AGAIN if any(effect.whole or effect.joint in joints for effect in held) else FALL


def _falls(candidate: Score, view: _View) -> Array:
    """Return the fall of the held-out squared error in blocks of half a second, at a candidate's setting."""
    evidence, joints = view.evidence, list(candidate.columns.joints)
    columns = columns_of(candidate.effect, evidence, evidence.torques)
    inner = gram(columns, evidence)
    falls: list[float] = []
    for left, fit in enumerate(view.folds.without):
        t, phi = evidence.trajectories[left], evidence.phi[left][:, joints]
        addition = add(inner, fit, candidate.effect.signs)
        before = t.y[:, joints] - phi @ fit.values
        after = t.y[:, joints] - phi @ addition.values - columns.parts[left] @ addition.coefficients
        seen = t.weight[:, joints].any(axis=1)
        fall = np.sum(before**2 - after**2, axis=1)[seen]
        size = max(1.0, BLOCK / (t.measured.dt * t.measured.decimate))
        falls += [float(block.sum()) for block in np.array_split(fall, max(1, round(len(fall) / size)))]
    return np.array(falls)


def _p_value(candidate: Score, stage: _Stage) -> float:
    """Return the chance that the error of any candidate falls so by accident (Bonferroni)."""
    return min(1.0, _chance(candidate, stage) * len(stage.candidates))


def _chance(candidate: Score, stage: _Stage) -> float:
    """Return the chance that a candidate's error falls so, in blocks of half a second, by accident."""
    from scipy.stats import t as student

    falls = _falls(candidate, stage.views[0])
    spread = float(np.std(falls, ddof=1)) if len(falls) > 1 else 0.0
    if spread <= 0.0:
        return 1.0
    z = float(falls.mean()) / spread * np.sqrt(len(falls))
    return float(student.sf(z, len(falls) - 1))


def _harms(found: Score, members: Sequence[Score], whole: Evidence, validation: Sequence[Measurement]) -> bool:
    """Return whether a validation recording is predicted worse with an effect than without."""
    if not validation:
        return False
    names = [whole.structure.robot.joints[joint] for joint in found.columns.joints]
    before = errors(extended(whole, [m.effect for m in members]), validation)
    after = errors(extended(whole, [*(m.effect for m in members), found.effect]), validation)
    return sum(after[name] for name in names) > (1.0 + VALIDATION) * sum(before[name] for name in names)


def _needed(first: _Stage, members: list[Score]) -> list[Score]:
    """Return the members without which the held-out error rises clearly, given the others."""
    for member in list(members):
        others = [m for m in members if m is not member]
        joints = list(member.columns.joints)
        views = zip(_extended(first.views, members), _extended(first.views, others), _SHARES, strict=False)
        if any(
            lacking.loss[joints].sum() - having.loss[joints].sum() < share * lacking.loss[joints].sum()
            for having, lacking, share in views
        ):
            members = others
    return members


def _conclude(
    whole: Evidence,
    first: _Stage,
    members: list[Score],
    validation: Sequence[Measurement],
    measurements: Sequence[Measurement],
) -> Diagnosis:
    final = extended(whole, [m.effect for m in members])
    labels = {m.label for m in members}
    missing = [_suspect(first, whole, m, [o for o in members if o is not m], validation) for m in members]
    others = [s for s in first.scores if s.label not in labels and _share(s, first.views[0]) > 0.5 * FALL]
    left = mean_squares(final)
    worst = _worst(final)
    cut = final if len(final.trajectories) > 1 else split(final, _PARTS, _BLOCK)
    rest = explain_by_variables(cut, worst, floor=False)
    structured = max(rest.depends_on.values(), default=0.0) >= _STRUCTURE
    verdict: Verdict = "missing" if members else "unexplained" if structured else "not_decidable"
    return Diagnosis(
        verdict=verdict,
        missing=tuple(missing),
        others=tuple(_suspect(first, whole, s, [], validation) for s in others[:_LISTED]),
        remaining_rms={name: float(np.sqrt(value)) for name, value in left.items()},
        unexplained=rest if structured else None,
        notes=_notes(measurements),
    )


def _worst(evidence: Evidence) -> int:
    """Return the joint whose residual is the largest share of its torque."""
    share = np.zeros(evidence.structure.robot.n)
    power = np.sum([np.sum(t.y**2, axis=0) for t in evidence.trajectories], axis=0)
    for r in evidence.residual:
        share += np.sum(r**2, axis=0) / np.maximum(power, 1e-300)
    return int(np.argmax(share))


def _share(candidate: Score, view: _View) -> float:
    joints = list(candidate.columns.joints)
    return float(candidate.held_out_by_joint[joints].sum() / max(view.loss[joints].sum(), 1e-300))


def _suspect(
    first: _Stage, whole: Evidence, found: Score, fellows: Sequence[Score], validation: Sequence[Measurement]
) -> Suspect:
    """Return a candidate with what it does beside its fellow members, before and after."""
    before = extended(whole, [m.effect for m in fellows])
    after = extended(before, [found.effect])
    stage = _stage(_extended(first.views, fellows)) if fellows else first
    mine = next((s for s in stage.scores if s.label == found.label), found)
    view = stage.views[0]
    rivals = tied(mine, stage.scores, view.evidence, view.folds)
    return Suspect(
        effect=found.effect,
        p_value=_p_value(mine, stage),
        explained=float(np.clip(_share(mine, view), 0.0, 1.0)),
        mse_before=mean_squares(before),
        mse_after=mean_squares(after),
        validation_before=errors(before, validation) if validation else None,
        validation_after=errors(after, validation) if validation else None,
        parameters=estimates(after, found.effect),
        tied_with=tuple(rival.label for rival in rivals),
        experiment=experiment_between(found.effect, [rival.effect for rival in rivals], whole.structure.robot),
    )


def _notes(measurements: Sequence[Measurement]) -> tuple[str, ...]:
    silent = ", ".join(measured.source for measured in measurements if not tells_noise(measured))
    notes = [
        f"{silent}: without periods the noise is unknown: nothing can be called adequate, what remains includes the"
        " noise, and effects are judged by the error on data left out; record 8 or more periods of a motion for a floor"
    ]
    if len(measurements) < 2:
        notes.append(
            "one recording only: judged by parts of its own motion, which tells causes from proxies less well;"
            " record another motion"
        )
    return tuple(notes)
