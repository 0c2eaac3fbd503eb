"""Which physical effect is missing: found by what predicts a motion that it has not seen.

Once a model misfits, almost every column is significant, so significance decides only whether something is missing.
What is missing is decided by held-out prediction: the true cause keeps its coefficient on another trajectory, a
proxy's changes. Effects are added one by one, each chosen on what the earlier ones leave, and the earlier ones are
chosen again in its light.
"""

from __future__ import annotations

from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from robot_ident.diagnosis.backlash import burst_cause
from robot_ident.diagnosis.candidates import Candidate, Folds, Score, enumerate_candidates, score, score_grams
from robot_ident.diagnosis.diagnosis import Diagnosis, Estimate, Suspect, Verdict
from robot_ident.diagnosis.drift import drift_gain
from robot_ident.diagnosis.evidence import Evidence, fitted, gather
from robot_ident.diagnosis.lack_of_fit import LackOfFit, joint_noise, lack_of_fit
from robot_ident.diagnosis.scan import add, base_gram, columns_of, gram
from robot_ident.diagnosis.ties import tied
from robot_ident.diagnosis.unexplained import explain_by_variables
from robot_ident.effects import Effect, make_effect
from robot_ident.model.structure import Structure
from robot_ident.motion import Array
from robot_ident.recording.measurement import Measurement

GAIN = 40.0  # chi-square units that a member must gain
SHARE = 0.35  # of a joint's excess that its members must explain on trajectories not seen
STRICTER = 0.45  # more than that where what remains is far above the noise: a proxy leaves much, a cause little
PART = 0.35  # of the present excess on its joints that every member must explain, seen by trajectories left out
AGAIN = 0.5  # the same where a joint has a member already: what an imperfect column leaves looks like another effect
LEAST = 0.25  # Nm rms (times the torque scale of the joint over 400 Nm) that every member must remove
MOST = 6  # members
_LISTED = 6  # candidates reported beside the members


@dataclass(frozen=True)
class _Stage:
    """Evidence on the model with the members found so far, and all that follows from it."""

    evidence: Evidence
    fits: tuple[LackOfFit, ...]
    folds: Folds
    candidates: dict[str, Candidate]
    scores: list[Score]

    @property
    def excess(self) -> Array:
        """Held-out squared error [n] beyond the noise."""
        dof = np.array([sum(t.dof[j] for t in self.evidence.trajectories) for j in range(len(self.fits))])
        return np.maximum(self.folds.loss.sum(axis=0) - dof, 0.0)


def diagnose(
    measurements: Sequence[Measurement], structure: Structure, validation: Sequence[Measurement] = ()
) -> Diagnosis:
    """Return what is missing from a model, judged on several periodic recordings.

    validation: measurements that never enter a fit; their error before and after each candidate is evidence. Raises
    InputError where no recording tells the noise.
    """
    notes: list[str] = []
    evidence = gather(measurements, structure)
    if len(evidence.trajectories) < 2:
        evidence = _split(evidence)
        notes.append(
            "one trajectory only: judged by parts of its own motion, which tells causes from proxies less well;"
            " record another motion"
        )
    first = _stage(evidence)
    stage = first
    members: list[Score] = []
    rattling: dict[int, int] = {}
    while len(members) < MOST and _doubtful(stage):
        for joint in (j for j, fit in enumerate(stage.fits) if fit.fails):
            cause = burst_cause(stage.evidence, joint)
            if cause is not None:
                rattling[joint] = cause
        found = _choose(stage, rattling)
        if found is None:
            break
        members.append(found)
        stage = _stage(_with(evidence, [m.effect for m in members]))
        members, stage = _reconsider(evidence, members, stage, rattling)
    return _conclude(evidence, first, stage, members, rattling, validation, notes)


def _doubtful(stage: _Stage) -> bool:
    """Return whether a joint lacks fit, or a single effect gains more than chance ever would."""
    return any(fit.fails for fit in stage.fits) or any(s.gain >= GAIN and s.held_out >= GAIN / 2 for s in stage.scores)


def _split(evidence: Evidence, parts: int = 4) -> Evidence:
    """Return the evidence with its one trajectory cut into parts of time that can be left out in turn."""
    (whole,) = evidence.trajectories
    rows = np.arange(len(whole.y))
    pieces = []
    for block in np.array_split(rows, parts):
        weight = np.zeros_like(whole.weight)
        weight[block] = whole.weight[block]
        share = (weight > 0).sum(axis=0) / np.maximum(1, (whole.weight > 0).sum(axis=0))
        pieces.append(replace(whole, weight=weight, y=np.where(weight > 0, whole.y, 0.0), dof=whole.dof * share))
    return fitted(evidence.structure, tuple(pieces), evidence.rigid * parts)


def _stage(evidence: Evidence) -> _Stage:
    base = base_gram(evidence)
    folds = Folds.of(base)
    candidates = {candidate.label: candidate for candidate in enumerate_candidates(evidence)}
    scores = [score(candidate, evidence, folds) for candidate in candidates.values()]
    scores.sort(key=lambda s: -s.held_out)
    return _Stage(evidence, lack_of_fit(evidence, base), folds, candidates, scores)


def _with(evidence: Evidence, effects: Sequence[Effect]) -> Evidence:
    """Return the evidence on the model with further effects."""
    structure = Structure.build(evidence.structure.robot, [*_extra(evidence.structure), *effects])
    return fitted(structure, evidence.trajectories, evidence.rigid, evidence.memory)


def _extra(structure: Structure) -> list[Effect]:
    """Return the effects of a structure that its robot doesn't bring along."""
    usual = Structure.build(structure.robot).labels
    return [effect for effect in structure.effects if effect.label not in usual]


def _choose(stage: _Stage, known: Collection[int]) -> Score | None:
    """Return the next member: the best on trajectories left out, the simplest of those that tie with it, refined.

    known: joints whose error is explained already by an effect without columns.
    """
    for best in stage.scores:
        if best.held_out <= 0.0:
            return None
        if not _worthwhile(best, stage, known):
            continue
        rivals = tied(best, stage.scores, stage.candidates, stage.evidence, stage.folds)
        equals = [best, *(r for r in rivals if _worthwhile(r, stage, known))]
        return _refined(min(equals, key=lambda s: (_size(s.effect), -s.held_out)), stage)
    return None


def _size(effect: Effect) -> int:
    """Return the number of an effect's parameters, inner ones included."""
    return len(effect.coefficients) + len(effect.inner)


def _worthwhile(candidate: Score, stage: _Stage, known: Collection[int]) -> bool:
    """Return whether a candidate gains enough, explains enough of its joints' excess, and removes enough torque."""
    gains, added = candidate.held_out_by_joint, _extra(stage.evidence.structure)
    joints = [
        j
        for j in candidate.columns.joints
        if j not in known and (stage.fits[j].fails or (gains[j] >= GAIN / 2 and not _touched(added, [j])))
    ]
    if candidate.gain < GAIN or not joints:
        return False
    excess, removed = stage.excess[joints].sum(), candidate.held_out_by_joint[joints].sum()
    if removed < (AGAIN if _touched(added, joints) else PART) * excess:
        return False
    weights = [np.mean([np.mean(t.weight[:, j] ** 2) for t in stage.evidence.trajectories]) for j in joints]
    rows = [sum(len(t.y) for t in stage.evidence.trajectories)] * len(joints)
    mean_square = sum(
        candidate.held_out_by_joint[j] / max(w * r, 1e-300) for j, w, r in zip(joints, weights, rows, strict=True)
    )
    limit = stage.evidence.structure.robot.limits.torque[joints]
    scale = float(np.min(np.where(np.isfinite(limit), limit, 400.0))) / 400.0
    return bool(np.sqrt(max(mean_square, 0.0)) >= LEAST * scale)


def _touched(effects: Sequence[Effect], joints: Collection[int]) -> bool:
    """Return whether an effect is at one of some joints, or everywhere."""
    return any(effect.joint in joints or effect.place is None for effect in effects)


def _refined(found: Score, stage: _Stage) -> Score:
    """Return the score with its continuous inner parameters at the best place between the grid's points."""
    from scipy.optimize import minimize

    free = [inner for inner in found.effect.inner if inner.continuous]
    if not free:
        return found
    evidence = stage.evidence
    torques = [evidence.structure.torques(t.motion, evidence.values) for t in evidence.trajectories]
    positive = stage.candidates[found.label].positive
    start = np.array([found.effect.setting[inner.name] for inner in free])
    unit = np.array([_unit(inner, value) for inner, value in zip(free, start, strict=True)])

    def effect_at(x: Array) -> Effect:
        values = np.clip(start + unit * x, [i.lower for i in free], [i.upper for i in free])
        return found.effect.at({inner.name: float(v) for inner, v in zip(free, values, strict=True)})

    def loss(x: Array) -> float:
        columns = columns_of(effect_at(x), evidence, torques)
        return -add(gram(columns, evidence), stage.folds.whole, positive).gain if columns.joints else 0.0

    best = minimize(
        loss, np.zeros(len(free)), method="Nelder-Mead", options={"maxfev": 40, "xatol": 0.05, "fatol": 0.1}
    )
    if -best.fun <= found.gain:
        return found
    columns = columns_of(effect_at(best.x), evidence, torques)
    candidate = Candidate(found.label, (columns,), positive)
    return score_grams(candidate, [gram(columns, evidence)], stage.folds)


def _unit(inner: object, value: float) -> float:
    """Return a step that is a third of the way to the next grid point."""
    grid = np.array(getattr(inner, "grid"))  # noqa: B009
    others = np.abs(grid[grid != value] - value)
    return float(others.min() / 3.0) if len(others) else 0.1 * max(abs(value), 1e-3)


def _reconsider(
    evidence: Evidence, members: list[Score], stage: _Stage, known: Collection[int]
) -> tuple[list[Score], _Stage]:
    """Choose every earlier member again, given the others; drop one that explains nothing any more."""
    for place in range(len(members) - 1):
        others = [m for k, m in enumerate(members) if k != place]
        without = _stage(_with(evidence, [m.effect for m in others]))
        again = _choose(without, known)
        if again is None:
            return others, without
        if again.label != members[place].label:
            changed = [*members[:place], again, *members[place + 1 :]]
            if len({m.label for m in changed}) == len(changed):
                fresh = _stage(_with(evidence, [m.effect for m in changed]))
                if fresh.folds.loss.sum() < stage.folds.loss.sum() - GAIN / 4:
                    members, stage = changed, fresh
    return members, stage


def _conclude(
    evidence: Evidence,
    first: _Stage,
    last: _Stage,
    members: list[Score],
    rattling: Mapping[int, int],
    validation: Sequence[Measurement],
    notes: list[str],
) -> Diagnosis:
    """Weigh what was found against what remains, and put it into words and figures."""
    robot = evidence.structure.robot
    failing = [j for j, fit in enumerate(first.fits) if fit.fails]
    failing += [j for m in members for j in m.columns.joints if j not in failing and m.held_out_by_joint[j] >= GAIN / 2]
    drifting = [j for j, gain in enumerate(drift_gain(evidence)) if gain >= GAIN]
    share = 1.0 - last.excess / np.maximum(first.excess, 1e-300)
    left = np.array([fit.excess for fit in last.fits])
    needed = SHARE + STRICTER * left / (left + joint_noise(evidence))
    trusted = [m for m in members if _trusted(m, share - needed, failing)]
    if len(trusted) < len(members):
        last = _stage(_with(evidence, [m.effect for m in trusted])) if trusted else first
    gaps = sorted({cause for joint, cause in rattling.items() if last.fits[joint].fails})
    rest = [fit.excess for fit in last.fits]
    remaining = {name: float(np.sqrt(rest[j])) for j, name in enumerate(robot.joints)}
    verdict: Verdict = "adequate" if not failing else "missing" if trusted or gaps else "unexplained"
    if drifting:
        verdict = "missing"
    suspects = [_suspect(evidence, first, m, trusted, validation) for m in trusted]
    suspects += [_recognised(last, "backlash", j) for j in gaps]
    suspects += [_recognised(last, "temperature_drift", j) for j in drifting]
    further = _further(evidence, first, last, [m.label for m in trusted], failing, validation)
    open_joints = [j for j, fit in enumerate(last.fits) if fit.fails and j not in rattling]
    worst = max(open_joints, key=lambda j: last.fits[j].statistic, default=None)
    unexplained = None if worst is None else explain_by_variables(last.evidence, worst)
    return Diagnosis(verdict, tuple(suspects), tuple(further), remaining, unexplained, tuple(notes))


def _trusted(member: Score, surplus: Array, failing: list[int]) -> bool:
    """Return whether all members together explain more than needed of the excess on one of a member's joints."""
    joints = [j for j in member.columns.joints if j in failing]
    return bool(joints) and float(np.max(surplus[joints])) >= 0.0


def _recognised(stage: _Stage, name: str, joint: int) -> Suspect:
    """Return an effect that is recognised by a test of its own: backlash by its bursts, drift by the trend of the
    periods.
    """
    evidence = stage.evidence
    effect = make_effect(f"{name}@{evidence.structure.robot.joints[joint]}", evidence.structure.robot)
    after = _with(evidence, [effect]) if name == "backlash" else evidence
    return Suspect(
        effect=effect,
        p_value=stage.fits[joint].p_value if name == "backlash" else 0.0,
        explained=1.0,
        mse_before=_mean_squares(evidence),
        mse_after=_mean_squares(after),
        validation_before=None,
        validation_after=None,
        parameters=_estimates(after, effect) if name == "backlash" else (),
        tied_with=(),
        experiment=None,
    )


def _further(
    evidence: Evidence,
    first: _Stage,
    last: _Stage,
    named: list[str],
    failing: list[int],
    validation: Sequence[Measurement],
) -> list[Suspect]:
    """Return the best of the other candidates, on the model as it was."""
    if not failing:
        return []
    best = [s for s in first.scores if s.label not in named and s.held_out > 0.0 and s.gain >= GAIN]
    best = [s for s in best if set(s.columns.joints) & set(failing)]
    return [_suspect(evidence, first, s, [], validation) for s in best[:_LISTED]]


def _suspect(
    evidence: Evidence, first: _Stage, found: Score, members: Sequence[Score], validation: Sequence[Measurement]
) -> Suspect:
    """Return a candidate with all that is known of it: alone among its fellow members, before and after."""
    from scipy.stats import chi2

    fellows = [m for m in members if m.label != found.label]
    before = _with(evidence, [m.effect for m in fellows]) if fellows else evidence
    stage = _stage(before) if fellows else first
    mine = next((s for s in stage.scores if s.label == found.label), found)
    rivals = tied(mine, stage.scores, stage.candidates, stage.evidence, stage.folds) if mine in stage.scores else []
    after = _with(before, [found.effect])
    joints = list(mine.columns.joints)
    excess = float(stage.excess[joints].sum())
    dof = len(found.effect.coefficients) + len(found.effect.inner)
    labels = tuple(r.label for r in rivals)
    experiment = found.effect.experiment if rivals else ""
    return Suspect(
        effect=found.effect,
        p_value=min(1.0, float(chi2.sf(max(mine.gain, 0.0), dof)) * len(stage.candidates)),
        explained=float(np.clip(mine.held_out_by_joint[joints].sum() / excess, 0.0, 1.0)) if excess > 0 else 0.0,
        mse_before=_mean_squares(before),
        mse_after=_mean_squares(after),
        validation_before=_errors(before, validation) if validation else None,
        validation_after=_errors(after, validation) if validation else None,
        parameters=_estimates(after, found.effect),
        tied_with=labels,
        experiment=experiment or None,
    )


def _mean_squares(evidence: Evidence) -> dict[str, float]:
    """Return the mean square of the residual of every joint, (Nm)^2."""
    out = {}
    for joint, name in enumerate(evidence.structure.robot.joints):
        total, rows = 0.0, 0
        for t, residual in zip(evidence.trajectories, evidence.residual, strict=True):
            used = t.weight[:, joint] > 0
            scale = np.sqrt(t.measured.independent) / t.weight[used, joint]
            total += float(np.sum((residual[used, joint] * scale) ** 2))
            rows += int(used.sum())
        out[name] = total / max(rows, 1)
    return out


def _errors(evidence: Evidence, validation: Sequence[Measurement]) -> dict[str, float]:
    """Return the mean square error of every joint on measurements that were not fitted, (Nm)^2."""
    structure = evidence.structure
    total, rows = np.zeros(structure.robot.n), np.zeros(structure.robot.n)
    for measured in validation:
        predicted = structure.columns(measured.motion, evidence.values) @ evidence.values
        error = measured.passed(measured.torque - predicted)
        used = measured.used[measured.rows]
        total += np.sum(np.where(used, error**2, 0.0), axis=0)
        rows += used.sum(axis=0)
    return {name: float(total[j] / max(rows[j], 1)) for j, name in enumerate(structure.robot.joints)}


def _estimates(evidence: Evidence, effect: Effect) -> tuple[Estimate, ...]:
    """Return the coefficients of an effect with their standard deviations, and its inner parameters."""
    stacked = np.concatenate([phi.reshape(-1, phi.shape[2]) for phi in evidence.phi])
    scale = np.maximum(np.linalg.norm(stacked, axis=0), 1e-300)
    covariance = np.linalg.pinv((stacked / scale).T @ (stacked / scale), rcond=1e-11, hermitian=True)
    std = np.sqrt(np.diag(covariance)) / scale
    place = {name: k for k, name in enumerate(evidence.structure.names)}
    linear = [
        Estimate(name, float(evidence.values[place[name]]), float(std[place[name]]), unit)
        for name, unit in zip(effect.parameter_names(), effect.parameter_units(), strict=True)
    ]
    inner = [
        Estimate(name, float(effect.setting[i.name]), 0.0, unit)
        for name, unit, i in zip(effect.inner_names(), effect.inner_units(), effect.inner, strict=True)
    ]
    return (*linear, *inner)
