"""The selection of a data set as a diagnosis: verdict, named effects, what adding them does, alternatives, notes."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from robot_ident.design.discrimination import experiment_between
from robot_ident.diagnosis.before_after import errors, estimates, mean_squares
from robot_ident.diagnosis.diagnosis import Diagnosis, Estimate, Finding, Tell, Verdict, either, silent
from robot_ident.diagnosis.drift import UNSEEN_IN_MEANS, drift_finding, drift_tests, with_jitter
from robot_ident.diagnosis.measuring.first import CORRECT, exact_fault, fault_beyond, undecidable, validated
from robot_ident.diagnosis.measuring.fitted_fault import with_columns
from robot_ident.diagnosis.measuring.lookalikes import with_line, with_low_pass
from robot_ident.diagnosis.power import too_little, unseen_below, with_doubt
from robot_ident.diagnosis.selection.constants import NAMED, SHARE
from robot_ident.diagnosis.selection.fitted_set import FittedSet
from robot_ident.diagnosis.selection.hypotheses import Hypothesis
from robot_ident.diagnosis.selection.read_off import hidden_lines
from robot_ident.diagnosis.selection.search import Selected
from robot_ident.diagnosis.selection.select import Selection, select
from robot_ident.diagnosis.unexplained import explain_by_variables, stiction_note
from robot_ident.effects import Effect
from robot_ident.effects.torque_ripple import TorqueRipple
from robot_ident.errors import InputError
from robot_ident.estimation.payload import solve_carrying
from robot_ident.estimation.problem import Solution
from robot_ident.model.structure import Structure
from robot_ident.recording.measurement import Measurement
from robot_ident.regression.evidence import Evidence, extended
from robot_ident.regression.gram import Folds, base_gram
from robot_ident.regression.misfit import LackOfFit, lack_of_fit
from robot_ident.signals.motion import Array

_LISTED = 3  # effects that are listed besides, those that explain most by themselves
_STRUCTURE = 0.1  # of the error that a curve over a variable must predict on unseen motion to call it unexplained


def diagnosis_of(
    measurements: Sequence[Measurement],
    structure: Structure,
    validation: Sequence[Measurement] = (),
    tell: Tell = silent,
) -> Diagnosis:
    """Return what is missing from a model, as the set of effects that predicts motion which was not fitted best.

    Validation recordings never enter a fit. An effect is named at a probability of .8 and more; below, it is listed,
    and the verdict is `not_decidable` where nothing else is named.
    """
    found = _looked_again(select(measurements, structure, validation, tell), measurements, validation)
    named = tuple(h for h in found.selected if found.probability(h.label) >= NAMED)
    unsure = tuple(h for h in found.selected if h not in named)
    said = (_beyond_noise if found.data.floor else _by_prediction)(found, named, unsure, validation)
    ripples = [
        effect for effect in (*(h.effect for h in named), *structure.effects) if isinstance(effect, TorqueRipple)
    ]
    said = replace(said, notes=(*said.notes, *hidden_lines(found.tested, ripples)))
    said = _as_fitted(said, measurements, structure)
    return replace(said, missing=tuple(map(with_line, said.missing)), others=tuple(map(with_line, said.others)))


def _looked_again(
    found: Selection, measurements: Sequence[Measurement], validation: Sequence[Measurement]
) -> Selection:
    """Return a selection, or what the same recordings select in units of what the model leaves, where that names more
    and predicts better: a joint on which several causes act is left more than noise until all of them are named, and
    its largest ones would not be.

    There, a joint's names count where together they explain most of it (SHARE).
    """
    search, labels = found.search, {h.label for h in found.selected}
    if not found.data.floor or found.complete:
        return found
    again = select(measurements, found.data.structure, validation, floor=False)
    effects = [h.effect for h in again.selected if again.probability(h.label) >= NAMED]
    made = tuple(h for h in map(found.data.add, effects) if h is not None)
    enough = found.shares_with(made)
    made = tuple(h for h in made if h.label in labels or enough[h.label] >= SHARE)
    if not labels < {h.label for h in made} or search.objective(made) >= search.objective(found.selected):
        return found
    named = {h.label for h in made}
    return replace(
        found,
        selected=made,
        vague=tuple(h for h in found.vague if h.label not in named),
        election=again.election,
        chances=again.chances,
        withheld=tuple(one for one in found.withheld if one.label not in named),
    )


def _as_fitted(said: Diagnosis, measurements: Sequence[Measurement], structure: Structure) -> Diagnosis:
    """Return a diagnosis whose named effects have the parameters, and their spread, that a model with all of them has:
    what `add` prints, with a note where another form of one fits nearly as well. One whose size is no more than two
    standard deviations there is listed, not named.
    """
    while True:
        selected = [one for one in said.missing if one.probability is not None]  # not what drifts from period to period
        effects = [one.effect for one in selected if not one.effect.measuring]
        if not effects:
            return said
        try:
            solution = solve_carrying(measurements, structure.with_further(effects), "wls").solution
        except InputError:  # what these recordings do not excite is told as far as the evidence does
            return said
        known = known_parameters(solution)
        said = replace(said, missing=tuple(_with_parameters(one, known) for one in said.missing))
        label = max((effect.label for effect in effects), key=lambda label: known[label].chance)
        if known[label].chance < TWO_SIGMA:
            of_forms = [note for note in solution.whichever_form().notes if note not in solution.notes]
            return replace(said, notes=(*said.notes, *of_forms))
        said = _listed(said, label, known[label].least)


def _with_parameters(one: Finding, known: Mapping[str, Fitted]) -> Finding:
    return replace(one, parameters=known[one.label].parameters) if one.label in known else one


def _listed(said: Diagnosis, label: str, zero: Estimate) -> Diagnosis:
    """Return a diagnosis in which an effect is listed, not named, since a parameter may be zero."""
    (one,) = (one for one in said.missing if one.label == label)
    missing = tuple(other for other in said.missing if other is not one)
    note = f"{label} is not named: {zero.in_words} may be zero; record more, or another motion"
    return replace(
        said,
        verdict=said.verdict if missing else "not_decidable",
        missing=missing,
        others=(replace(one, probability=None), *said.others),
        notes=(*said.notes, note),
        tied_sets=(),
    )


def _beyond_noise(found: Selection, named: Selected, unsure: Selected, validation: Sequence[Measurement]) -> Diagnosis:
    """Return the diagnosis of recordings that tell their noise: all that is left beyond it counts."""
    evidence, names = found.tested, found.data.structure.robot.joints
    with_all = extended(evidence, [h.effect for h in named]) if named else evidence
    fits = lack_of_fit(with_all, base_gram(with_all)) if named else found.fits
    failing = any(fit.fails for fit in found.fits)
    found = found if failing else replace(found, vague=())
    fault = None
    if failing and (found.withheld or _fails(found, fits, unsure)):
        fault = fault_beyond(evidence, [h.effect for h in found.selected], validation, found.data.tells_filter)
    if fault is not None:
        others = tuple(_finding(found, h, validation) for h in found.selected)
        only = Diagnosis("missing", (fault.finding,), others, fault.remaining, None, (fault.note,))
        return with_doubt(with_jitter(only, evidence), evidence)
    drifts = [drift_finding(with_all, j, test, validation) for j, test in enumerate(drift_tests(evidence)) if test.told]
    worst = max((j for j, fit in enumerate(fits) if fit.fails), key=lambda j: fits[j].statistic, default=None)
    rest = None if worst is None else explain_by_variables(with_all, worst)
    verdict = _verdict(found, unsure, bool(named or drifts), "unexplained" if failing else "adequate")
    notes = [*_notes(found, verdict), *undecidable(evidence, Folds.of(base_gram(evidence)))]
    if verdict == "adequate":
        notes.append(unseen_below(evidence))
    elif verdict == "unexplained":
        notes += stiction_note(rest, with_all) if rest is not None else []
        more = [] if found.withheld else found.within_formulas() or list(too_little(_best_gain(found), evidence))
        verdict, notes = ("not_decidable", [*notes, *more]) if more else (verdict, notes)
    whole = Diagnosis(
        verdict,
        (*(_finding(found, h, validation) for h in named), *drifts),
        _others(found, unsure, validation),
        {name: float(np.sqrt(fit.excess)) for name, fit in zip(names, fits, strict=True)},
        rest,
        (*notes, *(f"{one.label}: {UNSEEN_IN_MEANS}" for one in drifts)),
        tied_sets=_alternatives(found),
    )
    return with_doubt(with_jitter(whole, evidence), evidence)


def _by_prediction(found: Selection, named: Selected, unsure: Selected, validation: Sequence[Measurement]) -> Diagnosis:
    """Return the diagnosis of recordings that do not tell their noise: nothing says that a model is adequate, and what
    is left includes the noise.
    """
    with_all = extended(found.tested, [h.effect for h in named]) if named else found.tested
    left = mean_squares(with_all)
    rest = explain_by_variables(with_all, _worst(with_all), floor=False)
    structured = max(rest.depends_on.values(), default=0.0) >= _STRUCTURE
    verdict = _verdict(found, unsure, bool(named), "unexplained" if structured else "not_decidable")
    whole = Diagnosis(
        verdict,
        tuple(_finding(found, h, validation) for h in named),
        _others(found, unsure, validation),
        {name: float(np.sqrt(value)) for name, value in left.items()},
        rest if structured else None,
        tuple(_notes(found, verdict)),
        tied_sets=_alternatives(found),
    )
    return with_doubt(whole, found.tested)


def _verdict(found: Selection, unsure: Selected, named: bool, otherwise: Verdict) -> Verdict:
    if named:
        return "missing"
    return "not_decidable" if unsure or found.vague else otherwise


def _best_gain(found: Selection) -> float:
    """Return the most that any effect gains on a joint that fails, in units of chi-square."""
    failing = {j for j, fit in enumerate(found.fits) if fit.fails}
    given = FittedSet(found.data, (), np.ones_like(found.data.power))
    settings = (h for of in found.data.hypotheses.values() for h in of if failing & set(h.at))
    return max((given.gain(h) for h in settings), default=0.0)


def _fails(found: Selection, fits: Sequence[LackOfFit], unsure: Selected) -> bool:
    """Return whether the model fails with all that was selected; fits: of what was named."""
    if unsure:
        evidence = extended(found.tested, [h.effect for h in found.selected])
        fits = lack_of_fit(evidence, base_gram(evidence))
    return any(fit.fails for fit in fits)


def _worst(evidence: Evidence) -> int:
    """Return the joint whose residual is the largest share of its torque."""
    power, left = (
        np.sum([np.sum(rows**2, axis=0) for rows in of], axis=0)
        for of in ([t.y for t in evidence.trajectories], evidence.residual)
    )
    return int(np.argmax(left / np.maximum(power, 1e-300)))


def _others(found: Selection, unsure: Selected, validation: Sequence[Measurement]) -> tuple[Finding, ...]:
    """Return what may be missing, and the effects that explain most of the model's error by themselves."""
    known = {h.label for h in (*found.selected, *found.vague)}
    alone = [h for gain, h in found.search.ranked(()) if gain > 0.0 and h.label not in known]
    listed = [(h, found.selected) for h in (*unsure, *found.vague)] + [(h, ()) for h in alone[:_LISTED]]
    return tuple(_finding(found, h, validation, beside) for h, beside in listed)


def _finding(
    found: Selection, h: Hypothesis, validation: Sequence[Measurement], selected: Selected | None = None
) -> Finding:
    """Return an effect with what adding it beside the others of a set (None: the selected one) does."""
    from scipy.special import chdtrc

    others = [x for x in (found.selected if selected is None else selected) if x is not h]
    before = extended(found.tested, [x.effect for x in others]) if others else found.tested
    fault = exact_fault(h.effect, before) if h.effect.measuring else None
    after = extended(before, [h.effect]) if fault is None else with_columns(before, fault.columns)
    if fault is not None:
        seen_before, seen_after = validated(fault, before, after, validation)
    else:
        seen_before, seen_after = (errors(x, validation) if validation else None for x in (before, after))
    instead = sorted(found.election.instead_of(h.label)) if found.election and h in found.selected else []
    effects = [settings[0].effect for label in instead if (settings := found.data.hypotheses.get(label))]
    finding = Finding(
        effect=h.effect,
        p_value=min(1.0, float(chdtrc(1, found.search.size_error_of(h, others) ** -2.0)) * len(found.data.hypotheses)),
        explained=float(np.clip(found.search.share(h, others), 0.0, 1.0)),
        mse_before=mean_squares(before),
        mse_after=mean_squares(after),
        validation_before=seen_before,
        validation_after=seen_after,
        parameters=estimates(after, h.effect) if fault is None else fault.parameters,
        fix=None if fault is None else fault.fix,
        tied_with=tuple(instead),
        experiment=experiment_between(h.effect, effects, found.data.structure.robot),
        probability=found.probability(h.label) if h in found.selected else None,
    )
    return with_low_pass(finding, before, after) if found.data.floor and finding.probability is not None else finding


def _alternatives(found: Selection) -> tuple[tuple[str, ...], ...]:
    """Return the sets that the data can't tell from the selected one, itself first; empty where there is none.

    What may be missing besides, its size not being known, or is not named, is told by itself.
    """
    if found.election is None or not found.selected:
        return ()
    mine = tuple(sorted(h.label for h in found.selected))
    besides = {*mine, *(h.label for h in found.vague), *(one.label for one in found.withheld)}
    others = [labels for labels in found.election.tied if labels != mine and not (set(mine) <= set(labels) <= besides)]
    return (mine, *others) if others else ()


def _notes(found: Selection, verdict: Verdict) -> list[str]:
    notes = [f"{one.label} is not named: {one.why}" for one in found.withheld]
    tied = _alternatives(found)
    if verdict == "missing" and tied:
        notes.append(f"these recordings do not tell the sets apart: {either(tied)}")
    for h in found.vague:
        if found.search.size_known(h, found.selected):
            share = 100 * min(found.search.share(h, found.selected), 1.0)
            why = f"it explains {share:.0f} % of what is left, but along so few frequencies some effect may by chance"
            what = "record a motion with more harmonics, or further motions"
        else:
            known, asked = found.search.size_error_of(h, found.selected), found.search.largest_size_error(h)
            why = f"its size is known to {100 * known:.3g} %, and no name is given beyond {100 * asked:.3g} %"
            what = "record more periods or another motion"
        notes.append(f"{h.label} may be missing: {why}; {what}")
    notes += [f"{h.label}{CORRECT}" for h in found.selected if h.effect.measuring]
    return list(dict.fromkeys(notes))


TWO_SIGMA = 0.0455
"""Probability that a value of zero is estimated more than two standard deviations off."""


@dataclass(frozen=True)
class Fitted:
    """An effect's parameters, which of them is the least certain to differ from zero, and the probability that data of
    one which is zero give as large a value.
    """

    parameters: tuple[Estimate, ...]
    least: Estimate
    chance: float


def known_parameters(solution: Solution) -> Mapping[str, Fitted]:
    """Return by label the parameters of every effect of a solution, without the coefficients that others hold too."""
    model, out, form = solution.structure, {}, solution.whichever_form()
    noise, counted = (np.sqrt(np.diag(one.covariance)) for one in (form, form.whatever_is_missing()))
    first = len(model.parameters)
    for effect, own in model.placed:
        inner = np.arange(first, first + len(effect.inner))
        first += len(effect.inner)
        at_bound = [k for k, one in zip(inner, effect.inner, strict=True) if one.at_bound(effect.setting[one.name])]
        noise[at_bound] = counted[at_bound] = 0.0
        places = [*range(own.start, own.stop), *inner]
        names = (*effect.parameter_names(), *effect.inner_names())
        units = (*effect.parameter_units(), *effect.inner_units())
        found = tuple(
            Estimate(name, float(solution.values[k]), float(counted[k]), unit)
            for name, k, unit in zip(names, places, units, strict=True)
        )
        if found:
            out[effect.label] = _fitted(effect, found, noise[places], solution, places)
    return out


def _fitted(
    effect: Effect, found: tuple[Estimate, ...], noise: Array, solution: Solution, places: Sequence[int]
) -> Fitted:
    """Judge the linear parameters and those inside a column that define the effect, together (Wald's test): what is
    known of both may be their product alone. Each of the latter must be larger than its standard deviation besides, and
    than the least that it can be. By noise alone [k]: what is missing beside an effect makes its size uncertain, but is
    no reason that there be none.
    """
    from scipy.special import chdtrc

    count = len(effect.coefficients)
    defining = [(k, one) for k, one in enumerate(effect.inner, count) if one.defining]
    for k, one in defining:
        if one.at_least(found[k].value) or abs(found[k].value) < noise[k]:
            return Fitted(found, found[k], 1.0)
    judged = [*range(count), *(k for k, _ in defining if noise[k] > 0.0)]
    if not judged:
        return Fitted(found, found[0], 0.0)
    at = [places[k] for k in judged]
    scale = np.sqrt(np.maximum(np.diag(solution.covariance)[at], 1e-300))
    z, together = solution.values[at] / scale, solution.covariance[np.ix_(at, at)] / np.outer(scale, scale)
    least = min(judged, key=lambda k: abs(found[k].value) / max(float(noise[k]), 1e-300))
    return Fitted(found, found[least], float(chdtrc(len(judged), z @ np.linalg.pinv(together, hermitian=True) @ z)))
