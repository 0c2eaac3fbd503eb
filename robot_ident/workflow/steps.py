"""A model with one effect more each time: what it lacks, and the fits until nothing is named."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from contextlib import AbstractContextManager, nullcontext
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np

from robot_ident.diagnosis.diagnose import diagnose
from robot_ident.diagnosis.diagnosis import Diagnosis, Tell, silent
from robot_ident.effects import Effect
from robot_ident.errors import InputError
from robot_ident.estimation.effort_checks import taken_as_declared
from robot_ident.estimation.identify import extended
from robot_ident.estimation.validation import mean_square_errors, refuse_misdeclared, unusable_on
from robot_ident.model.model import Model
from robot_ident.recording.measurement import Measurement
from robot_ident.residuals.comparison import misfit_aside
from robot_ident.workflow.inputs import Inputs

_ROUNDS = 5  # of adding; a robot lacks less than that, and each costs a diagnosis


def find_missing(
    model: Model,
    measurements: Sequence[Measurement],
    validation: Sequence[Measurement] = (),
    tell: Tell = silent,
) -> Diagnosis:
    """Return what a model lacks, judged on its recordings; InputError where their efforts contradict its declaration.

    validation: recordings that never enter a fit. An adequate model that misfits them gets a note that says where.
    """
    refuse_misdeclared(model, measurements)
    declared = taken_as_declared(model.notes)
    found = diagnose(measurements, model.structure, validation, tell, as_declared=declared)
    if found.verdict == "adequate":
        found = replace(found, notes=(*found.notes, *misfit_aside(model, validation)))
    return found


@dataclass(frozen=True)
class Step:
    """A model and, by joint, its mean square error (Nm)^2 over the validation recordings; None without.

    troubles: a line for each of those on which it is worse than none, before them one where it can't be used at all.
    """

    model: Model
    unseen: dict[str, float] | None
    troubles: tuple[str, ...]


def steps_of(inputs: Inputs, effects: Sequence[Effect]) -> list[Step]:
    """Return the model refitted as it is, then with one effect more each time."""
    fitted = extended(inputs.models[0], inputs.measurements, inputs.recordings, effects)
    unseen = [inputs.validated_for(model) for model in fitted]
    return [
        Step(m, unseen_errors(m, aside), m.leading(unusable_on(m, aside)))
        for m, aside in zip(fitted, unseen, strict=True)
    ]


def unseen_errors(model: Model, validation: Sequence[Measurement]) -> dict[str, float] | None:
    """Return the mean square error by joint over validation recordings, (Nm)^2; None where there are none."""
    if not validation:
        return None
    total = np.mean([mean_square_errors(model, measured) for measured in validation], axis=0)
    return {joint: float(value) for joint, value in zip(model.robot.joints, total, strict=True)}


@dataclass
class Additions:
    """The model refitted as it was and with one effect more each time, and what was said of it after every round.

    foreseen: steps of the first round. stopped: why the last round's effects were left out, empty where none was.
    """

    said: list[Diagnosis]
    steps: list[Step] = field(default_factory=list)
    foreseen: int = 0
    stopped: str = ""

    @property
    def last(self) -> Diagnosis:
        """What is said of the model with all that was added."""
        return self.said[-1]

    def to_dict(self) -> dict[str, Any]:
        """Return the error after each addition, and what is said of the model with all of them, as plain data."""
        stairs = [
            {
                "added": None if number == 0 else step.model.structure.labels[-1],
                "residual_mse": {joint: fit.mse for joint, fit in step.model.residual.items()},
                "validation_mse": step.unseen,
            }
            for number, step in enumerate(self.steps)
        ]
        after = {key: value for key, value in self.last.to_dict().items() if key != "schema"}
        return {"staircase": stairs, "after_adding": {**after, "stopped": self.stopped}}


def _unheard(what: str) -> AbstractContextManager[Tell]:
    return nullcontext(silent)


def add_until_adequate(
    found: Diagnosis,
    inputs: Inputs,
    progress: Callable[[str], AbstractContextManager[Tell]] = _unheard,
) -> Additions:
    """Return what adding the effects that a diagnosis names comes to, and those that the next ones name.

    Effects that a later round names are kept where they lower the error on the validation recordings, if there are any.
    progress: what hears of a further diagnosis how far it has come.
    """
    out = Additions([found])
    if not _columns(found):
        out.steps = steps_of(inputs, ())
    for number in range(_ROUNDS + 1):
        effects = _columns(out.last)
        if not effects:
            break
        if number == _ROUNDS:
            out.stopped = f"{_listed(effects)} named after {_ROUNDS} rounds of adding, and not added"
            break
        try:
            steps = steps_of(inputs, effects)
        except InputError as error:
            if not number:
                raise
            out.stopped = f"{_listed(effects)}: can't be added: {error}"
            break
        if number and not _lower(steps):
            out.stopped = f"{_listed(effects)}: left out, adding it does not lower the error on the validation"
            break
        out.steps += steps[1:] if number else steps
        out.foreseen = out.foreseen or len(steps) - 1
        model = out.steps[-1].model
        inputs = inputs.with_model(model)
        with progress("diagnose again") as tell:
            again = find_missing(model, inputs.measurements, inputs.validation, tell)
            out.said.append(again)
    return out


def _columns(found: Diagnosis) -> list[Effect]:
    return [finding.effect for finding in found.missing if not finding.effect.measuring]


def _listed(effects: Sequence[Effect]) -> str:
    return ", ".join(effect.label for effect in effects)


def _lower(steps: Sequence[Step]) -> bool:
    """Return whether the last of the steps errs less than the first on the validation; True without one."""
    first, last = steps[0].unseen, steps[-1].unseen
    return first is None or last is None or sum(last.values()) < sum(first.values())
