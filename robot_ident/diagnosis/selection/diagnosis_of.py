"""The selection of a data set as a diagnosis: verdict, named effects, what adding them does, alternatives, notes."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from robot_ident.design.discrimination import experiment_between
from robot_ident.diagnosis.before_after import errors, estimates, mean_squares
from robot_ident.diagnosis.candidates import Folds
from robot_ident.diagnosis.diagnosis import Diagnosis, Suspect, Verdict, either
from robot_ident.diagnosis.drift import UNSEEN_IN_MEANS, drift_suspect, drift_tests
from robot_ident.diagnosis.evidence import Evidence, extended
from robot_ident.diagnosis.lack_of_fit import LackOfFit, lack_of_fit
from robot_ident.diagnosis.measuring.finding import with_columns
from robot_ident.diagnosis.measuring.first import CORRECT, exact_fault, fault_beyond, undecidable, validated
from robot_ident.diagnosis.measuring.jitter import with_jitter
from robot_ident.diagnosis.measuring.lookalikes import with_line, with_low_pass
from robot_ident.diagnosis.power import unseen_below, with_doubt
from robot_ident.diagnosis.progress import Tell, silent
from robot_ident.diagnosis.scan import base_gram
from robot_ident.diagnosis.selection.constants import ALTERNATIVE, FORMULA_ERROR, NAMED, SIZE_ERROR
from robot_ident.diagnosis.selection.hypotheses import Hypothesis
from robot_ident.diagnosis.selection.select import Selection, select
from robot_ident.diagnosis.unexplained import explain_by_variables
from robot_ident.diagnosis.weighed_by_residual import tells_noise
from robot_ident.model.structure import Structure
from robot_ident.recording.measurement import Measurement


def diagnose_by_sets(
    measurements: Sequence[Measurement],
    structure: Structure,
    validation: Sequence[Measurement] = (),
    tell: Tell = silent,
) -> Diagnosis:
    """Return what is missing from a model, as the set of effects that predicts motion which was not fitted best.

    The recordings tell their noise; validation recordings never enter a fit. An effect is named at a probability of .8
    and more; below, it is listed, and the verdict is `not_decidable` where nothing else is named.
    """
    found = select(measurements, structure, [one for one in validation if tells_noise(one)], tell)
    named = [h for h in found.selected if found.probability(h.label) >= NAMED]
    unsure = [h for h in found.selected if h not in named]
    evidence = found.tested
    with_all, fits = _fitted(found, named)
    failing = any(fit.fails for fit in found.fits)
    left = any(fit.fails for fit in (_fitted(found, found.selected)[1] if unsure else fits))
    fault = None
    if failing and (found.withheld or left):
        fault = fault_beyond(evidence, [h.effect for h in found.selected], validation, found.data.tells_filter)
    if fault is not None:
        others = tuple(_finding(found, h, validation) for h in found.selected)
        only = Diagnosis("missing", (fault.suspect,), others, fault.remaining, None, (fault.note,))
        return with_doubt(with_jitter(only, evidence), evidence)
    findings = {h.label: _finding(found, h, validation) for h in (*found.selected, *found.vague)}
    drifts = [drift_suspect(with_all, j, test, validation) for j, test in enumerate(drift_tests(evidence)) if test.told]
    verdict: Verdict = "missing" if named or drifts else "unexplained" if failing else "adequate"
    if not named and not drifts and (unsure or found.vague):
        verdict = "not_decidable"
    worst = max((j for j, fit in enumerate(fits) if fit.fails), key=lambda j: fits[j].statistic, default=None)
    rest = None if worst is None else explain_by_variables(with_all, worst)
    whole = Diagnosis(
        verdict,
        (*(findings[h.label] for h in named), *drifts),
        tuple(findings[h.label] for h in (*unsure, *found.vague)),
        {name: float(np.sqrt(fit.excess)) for name, fit in zip(structure.robot.joints, fits, strict=True)},
        rest,
        (*_notes(found, evidence, verdict), *(f"{one.label}: {UNSEEN_IN_MEANS}" for one in drifts)),
        tied_sets=_alternatives(found),
    )
    return with_doubt(with_jitter(whole, evidence), evidence)


def _fitted(found: Selection, some: Sequence[Hypothesis]) -> tuple[Evidence, Sequence[LackOfFit]]:
    """Return the recordings on the model with some effects, and its lack of fit."""
    if not some:
        return found.tested, found.fits
    evidence = extended(found.tested, [h.effect for h in some])
    return evidence, lack_of_fit(evidence, base_gram(evidence))


def _finding(found: Selection, h: Hypothesis, validation: Sequence[Measurement]) -> Suspect:
    """Return a selected effect with what adding it beside the others does."""
    from scipy.special import chdtrc

    others = [x for x in found.selected if x is not h]
    before = extended(found.tested, [x.effect for x in others]) if others else found.tested
    fault = exact_fault(h.effect, before) if h.effect.measuring else None
    after = extended(before, [h.effect]) if fault is None else with_columns(before, fault.columns)
    if fault is not None:
        seen_before, seen_after = validated(fault, before, after, validation)
    else:
        seen_before, seen_after = (errors(x, validation) if validation else None for x in (before, after))
    given = found.search.given(others)
    instead = sorted({label for labels in _instead_of(found, h.label) for label in labels})
    effects = [settings[0].effect for label in instead if (settings := found.data.hypotheses.get(label))]
    suspect = Suspect(
        effect=h.effect,
        p_value=min(1.0, float(chdtrc(h.effect.size, max(given.gain(h), 0.0))) * len(found.data.hypotheses)),
        explained=float(np.clip(found.search.share(h, others), 0.0, 1.0)),
        mse_before=mean_squares(before),
        mse_after=mean_squares(after),
        validation_before=seen_before,
        validation_after=seen_after,
        parameters=estimates(after, h.effect) if fault is None else fault.parameters,
        fix=None if fault is None else fault.fix,
        tied_with=tuple(instead),
        experiment=experiment_between(h.effect, effects, found.data.structure.robot),
        probability=None if h in found.vague else found.probability(h.label),
    )
    return with_low_pass(with_line(suspect), before, after)


def _instead_of(found: Selection, label: str) -> list[list[str]]:
    """Return what other sets hold in the place of an effect."""
    if found.election is None:
        return []
    mine = {h.label for h in found.selected}
    return [
        [other for other in labels if other not in mine]
        for labels, share in found.election.alternatives.items()
        if share >= ALTERNATIVE and label not in labels
    ]


def _alternatives(found: Selection) -> tuple[tuple[str, ...], ...]:
    """Return the sets that the data can't tell from the selected one, itself first; empty where there is none."""
    if found.election is None:
        return ()
    mine = tuple(sorted(h.label for h in found.selected))
    others = [
        labels for labels, share in found.election.alternatives.items() if share >= ALTERNATIVE and labels != mine
    ]
    return (mine, *others) if others else ()


def _notes(found: Selection, evidence: Evidence, verdict: Verdict) -> list[str]:
    notes = [f"{one.label} is not named: {one.why}" for one in found.withheld]
    tied = _alternatives(found)
    if verdict == "missing" and tied:
        notes.append(f"these recordings do not tell the sets apart: {either(tied)}")
    given = found.search.given(found.selected)
    notes += [
        f"{h.label} may be missing: its size is known to {100 * given.size_error(h):.0f} %, and no name is given beyond"
        f" {100 * SIZE_ERROR * h.formula_error / FORMULA_ERROR:.0f} %; record more periods or another motion"
        for h in found.vague
    ]
    notes += [f"{h.label}{CORRECT}" for h in found.selected if h.effect.measuring]
    notes += undecidable(evidence, Folds.of(base_gram(evidence)))
    if verdict == "adequate":
        notes.append(unseen_below(evidence))
    return list(dict.fromkeys(notes))
