"""Results in words, alike in all sections: what was added, what it did to the error, and what the model still lacks."""

from __future__ import annotations

import math
from collections.abc import Sequence

from robot_ident.diagnosis.diagnosis import Diagnosis, Finding
from robot_ident.diagnosis.staircase import Level, Step
from robot_ident.robot.robot import Robot
from robot_ident.workflow.findings import Findings

NOTHING = "–"
_SMALL, _LARGE = 4, 6  # powers of ten below and from which on they are written


def short(value: float | None, digits: int = 3) -> str:
    """Return a number with so many digits, trailing zeros kept, a dash where there is none.

    Powers of ten stand only where the number is very small or very large.
    """
    if value is None:
        return NOTHING
    if not value:
        return "0"
    exponent = int(f"{value:.{digits - 1}e}".partition("e")[2])  # of the rounded number
    if -_SMALL <= exponent < _LARGE:
        return f"{value:.{max(0, digits - 1 - exponent)}f}"
    return f"{value:.{digits - 1}e}"


def with_sigma(value: float, std: float) -> str:
    """Return `35.1 ± 3.0`: a value to the place of the second digit of its standard deviation; 0: it has none."""
    if not std or not math.isfinite(std):
        return f"{value:.4g}"
    exponent = int(f"{std:.1e}".partition("e")[2])
    if -_SMALL <= exponent < _LARGE:
        places = 1 - exponent
        value, std = round(value, places), round(std, places)
        return f"{value:.{max(0, places)}f} ± {std:.{max(0, places)}f}"
    return f"{value:.4g} ± {std:.1e}"


def percent(share: float) -> str:
    """Return a share as a whole number of percent."""
    return f"{100.0 * share:.0f} %"


def joined(words: Sequence[str]) -> str:
    """Return `a`, `a and b` or `a, b and c`."""
    return " and ".join(filter(None, (", ".join(words[:-1]), words[-1]))) if words else ""


_AS_IT_IS = 1.2  # times what remains of the model identified anew: a model whose values fit leaves no more over


def verdict(found: Findings) -> str:
    """Return one sentence that a reader who stops here can act on; one before it where the model can't be used."""
    trouble = found.last.model.trouble
    parts = (_gained(found), _lacking(found), *(line for line in found.troubles if line != trouble))
    return " ".join(f"{text[0].upper()}{text[1:]}." for text in (trouble, "; ".join(filter(None, parts))) if text)


def fall(before: Level, after: Level, unit: str) -> str:
    """Return `from 8.1 to 5.2 Nm rms, where the noise alone leaves 5.0`."""
    floor = "" if after.noise is None else f", where noise alone leaves {short(after.noise)}"
    return f"from {short(before.rms)} to {short(after.rms)} {unit} rms{floor}"


def _gained(found: Findings) -> str:
    """Return what the last model has gained over the first; nothing where there is one model."""
    first, last = found.ends[0], found.ends[-1]
    added = [label for label in last.model.structure.labels if label not in first.model.structure.labels]
    if first is last or not added:
        return ""
    unseen = bool(last.validation)
    before, after = (first.validation, last.validation) if unseen else (first.training, last.training)
    joint = max(after, key=lambda name: (before[name].mse - after[name].mse) / before[name].mse)
    where = " on the validation motion" if unseen else ""
    unit = found.robot.torque_unit(found.robot.joint_index(joint))
    if after[joint].mse >= before[joint].mse:
        return f"adding {joined(added)} lowers no joint's error{where}"
    return f"adding {joined(added)} takes the error of {joint}{where} {fall(before[joint], after[joint], unit)}"


def _lacking(found: Findings) -> str:
    diagnosis, last = found.diagnosis, found.last
    if diagnosis.verdict == "missing":
        return _missing(diagnosis, last, found.robot)
    if diagnosis.verdict == "unexplained":
        return _unexplained(diagnosis, found.robot)
    if diagnosis.verdict == "not_decidable":
        why = f": {diagnosis.notes[0]}" if diagnosis.notes else ""
        return f"these recordings can't tell whether the model lacks anything{why}"
    best = diagnosis.remaining_rms
    failing = [j for j in last.comparison.joints if j.fails and j.excess > _AS_IT_IS * best.get(j.name, 0.0)]
    if not failing:
        return "the model is " + diagnosis.in_words
    worst = max(failing, key=lambda joint: joint.excess)
    unit = found.robot.torque_unit(found.robot.joint_index(worst.name))
    return (
        f"the model has all the effects it needs, but as it stands its values miss {worst.name} by"
        f" {worst.excess:.3g} {unit} excess rms: identify it again from these recordings"
    )


def _missing(diagnosis: Diagnosis, last: Step, robot: Robot) -> str:
    names = [finding.label for finding in diagnosis.missing]
    named = {name for finding in diagnosis.missing for name in finding.tied_with} - {*names}
    tied = f" (or {joined(sorted(named))}, indistinguishable on these recordings)" if named else ""
    text = f"the model lacks {joined(names)}{tied}"
    predicted = _predicted(diagnosis.missing, last, robot)
    rest = {joint: value for joint, value in diagnosis.remaining_rms.items() if value > 0.0}
    if diagnosis.unexplained is not None and rest:
        joint = diagnosis.unexplained.joint
        unit = robot.torque_unit(robot.joint_index(joint))
        size = rest.get(joint, max(rest.values()))
        predicted += f"; {size:.3g} {unit} rms of {joint} remain unexplained ({diagnosis.unexplained.where})"
    return text + predicted


def _predicted(missing: Sequence[Finding], last: Step, robot: Robot) -> str:
    """Return the predicted fall of the joint that gains most, nothing where no column shows the effect."""
    before, after = last.training, missing[0].mse_after
    joint = max(after, key=lambda name: (before[name].mse - after[name]) / before[name].mse)
    if after[joint] >= before[joint].mse:
        return ""
    unit = robot.torque_unit(robot.joint_index(joint))
    predicted = Level(after[joint], before[joint].noise_variance)
    them = "them" if len(missing) > 1 else "it"
    return f": adding {them} is predicted to take the residual of {joint} {fall(before[joint], predicted, unit)}"


def _unexplained(diagnosis: Diagnosis, robot: Robot) -> str:
    if diagnosis.unexplained is None:
        return "none of the known effects accounts for the error"
    found = diagnosis.unexplained
    remains = diagnosis.remaining_rms.get(found.joint, 0.0)
    unit = robot.torque_unit(robot.joint_index(found.joint))
    return (
        f"none of the known effects accounts for the error of {found.joint}, {remains:.3g} {unit} excess rms;"
        f" it {'is ' if found.everywhere else 'sits at '}{found.where}"
    )
