"""Is it the measuring rather than the arm? A fault of what is measured comes before any physics is doubted.

A wrong gain, a filter or a load that nobody wrote down spoils every joint's fit, and some effect always follows part
of what it leaves. Each fault is therefore tried with all parameters fitted again, and is named where it explains most
of the error on trajectories left out, and clearly more than the best effect of the catalogue does.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from robot_ident.diagnosis.before_after import mean_squares
from robot_ident.diagnosis.diagnosis import Finding
from robot_ident.diagnosis.measuring.axes import wrong_axes
from robot_ident.diagnosis.measuring.filtered import NAME, exact, filters, place_of
from robot_ident.diagnosis.measuring.fitted_fault import FittedFault, fitted_loss, with_columns
from robot_ident.diagnosis.measuring.further import link_lengths, payloads
from robot_ident.diagnosis.measuring.gain import gains, single_gains, undecidable_gains
from robot_ident.effects import Effect
from robot_ident.recording.measurement import Measurement
from robot_ident.regression.evidence import Evidence, extended, gather
from robot_ident.regression.gram import BaseGram, Folds, base_gram
from robot_ident.regression.misfit import lack_of_fit

GAIN = 40.0  # chi-square units that a fault must gain
MOSTLY = 0.5  # of the excess that it must explain
LEAD = 0.05  # of its own gain by which it must beat the best effect
CORRECT = " is a fault of what is measured: correct it, identify anew and diagnose again"
_Z = 2.0  # standard deviations of a difference of two gains that are no lead
_CHANCE = 3.0  # standard deviations by which noise may be smaller than its mean


@dataclass(frozen=True)
class Fault:
    """A fault of what is measured: as a finding, what it leaves by joint [Nm rms beyond the noise], and a note."""

    finding: Finding
    remaining: Mapping[str, float]
    note: str


def exact_fault(effect: Effect, evidence: Evidence) -> FittedFault | None:
    """Return the gain or the low pass of an effort as a fault at its exact values; None of any other effect.

    evidence: on the model with all other effects, whose parameters are fitted again.
    """
    base = base_gram(evidence)
    if effect.name == NAME:
        found = [exact(one, evidence, base) for one in filters(evidence, base, [place_of(effect)])]
    else:
        found = [one for one in gains(evidence, base) if one.label == effect.label]
    return found[0] if found else None


def fault_beyond(
    evidence: Evidence,
    selected: Sequence[Effect],
    validation: Sequence[Measurement],
    tells_filter: Callable[[str | None], bool],
) -> Fault | None:
    """Return the fault of measuring that explains clearly more than a selected set does; None where none does.

    evidence: on the model as it was given; tells_filter: whether it tells a filter at a place from a delay. The fall of
    the squared error of trajectories left out is compared; of all data where one recording alone has the fault.
    """
    base = base_gram(evidence)
    given = Folds.of(base)
    after = base_gram(extended(evidence, selected)) if selected else base
    if _no_fault_leads(given, after, evidence):
        return None
    passes = filters(evidence, base) if any(map(tells_filter, evidence.structure.robot.joints)) else []
    found = _best_first(evidence, given, [one for one in passes if tells_filter(one.effect.place)])
    if not found:
        return None
    found = _sharpened(found, evidence, given)
    best, held_out = found[0], float(given.loss.sum())
    instead = _fall(base, after, left_out=best.single is None)
    excess = held_out - sum(float(t.dof.sum()) for t in evidence.trajectories)
    enough = best.held_out >= max(GAIN / 2, MOSTLY * _excess(best, evidence, excess)) and best.gain >= GAIN
    if not enough or best.held_out - instead < _lead(best.held_out):
        return None
    return _fault(best, found, evidence, excess, validation)


def _no_fault_leads(given: Folds, after: BaseGram, evidence: Evidence) -> bool:
    """Return whether a selected set leaves so little that a fault without any error left would not lead it clearly."""
    dof = sum(float(t.dof.sum()) for t in evidence.trajectories)
    everything = range(len(given.base.power))
    for before, left_out in ((float(given.loss.sum()), True), (fitted_loss(given.base, everything), False)):
        most = max(before - dof + _CHANCE * float(np.sqrt(2.0 * dof)), 0.0)
        if most - _fall(given.base, after, left_out=left_out) >= _lead(most):
            return False
    return True


def _fall(before: BaseGram, after: BaseGram, *, left_out: bool) -> float:
    """Return the fall of the squared error of trajectories left out, or of all data, from one model to another."""
    if left_out:
        return float(Folds.of(before).loss.sum() - Folds.of(after).loss.sum())
    everything = range(len(before.power))
    return fitted_loss(before, everything) - fitted_loss(after, everything)


def _best_first(evidence: Evidence, given: Folds, passes: Sequence[FittedFault]) -> list[FittedFault]:
    """Return some low passes and all other faults, those first that gain most on trajectories left out."""
    base = given.base
    found = [*gains(evidence, base), *passes, *link_lengths(evidence, given), *payloads(evidence, base)]
    found += [*single_gains(evidence, base), *wrong_axes(evidence, base)]
    return sorted(found, key=lambda f: -f.held_out)


def _sharpened(found: Sequence[FittedFault], evidence: Evidence, folds: Folds) -> list[FittedFault]:
    """Return the findings, best first, with low passes that come near the best at their exact values."""
    least = found[0].held_out - _lead(found[0].held_out)
    sharp = (exact(f, evidence, folds.base) if f.effect.name == NAME and f.held_out >= least else f for f in found)
    return sorted(sharp, key=lambda f: -f.held_out)


def _excess(found: FittedFault, evidence: Evidence, held_out: float) -> float:
    """Return the squared error beyond the noise: of all data where no trajectory left out can tell of the fault."""
    if found.single is None:
        return max(held_out, 0.0)
    dof = sum(float(t.dof.sum()) for t in evidence.trajectories)
    return max(sum(float(np.sum(r**2)) for r in evidence.residual) - dof, 0.0)


def _lead(gain: float) -> float:
    """Return by how much a fault of some gain must beat another explanation."""
    return max(LEAD * gain, _Z * float(np.sqrt(max(gain, 0.0))))


def _fault(
    best: FittedFault,
    found: Sequence[FittedFault],
    evidence: Evidence,
    excess: float,
    validation: Sequence[Measurement],
) -> Fault:
    from scipy.special import chdtrc

    after = with_columns(evidence, best.columns)
    names = evidence.structure.robot.joints
    rest = lack_of_fit(after, base_gram(after))
    own = _excess(best, evidence, excess)
    near = [f.label for f in found[1:] if best.held_out - f.held_out < _lead(best.held_out) and f.label != best.label]
    alone = f" in recording {best.single} alone" if best.single is not None else ""
    before_seen, after_seen = validated(best, evidence, after, validation)
    finding = Finding(
        effect=best.effect,
        p_value=min(1.0, float(chdtrc(best.more, best.gain)) * len(found)),
        explained=float(np.clip(best.held_out / own, 0.0, 1.0)) if own > 0.0 else 1.0,
        mse_before=mean_squares(evidence),
        mse_after=mean_squares(after),
        validation_before=before_seen,
        validation_after=after_seen,
        parameters=best.parameters,
        tied_with=tuple(dict.fromkeys(near)),
        experiment=None,
        fix=best.fix,
    )
    return Fault(
        finding,
        {name: float(np.sqrt(fit.excess)) for name, fit in zip(names, rest, strict=True)},
        f"{best.label}{alone}{CORRECT}; until then no effect is named, since what it leaves looks like many",
    )


def validated(
    best: FittedFault, evidence: Evidence, after: Evidence, validation: Sequence[Measurement]
) -> tuple[dict[str, float] | None, dict[str, float] | None]:
    """Return the mean squares of recordings that no fit has seen, before and after; None where nobody knows whether
    they have the fault.
    """
    noise = [m.averaged_variance for m in validation]
    if not noise or best.single is not None or not all(np.all(np.isfinite(v) & (v > 0)) for v in noise):
        return None, None
    seen = replace(gather(validation, evidence.structure), values=evidence.values, memory={})
    with_fault = replace(seen, phi=best.columns(seen), values=after.values)
    return mean_squares(seen), mean_squares(with_fault)


def undecidable(evidence: Evidence, folds: Folds) -> list[str]:
    """Return a note on joints whose gain these recordings can't tell."""
    names = undecidable_gains(evidence, folds.base)
    if not names:
        return []
    return [
        f"a wrong gain of the effort of {', '.join(names)} is not decidable: their own parameters absorb it to 5 % and"
        " more; a recording with a known payload tells it"
    ]
