"""All that a report tells, read from disk and gathered through the core's one-call steps before a word of it is
written.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

from robot_ident.diagnosis.diagnosis import Diagnosis
from robot_ident.diagnosis.staircase import Foreseen, Level, Step, foresee, staircase
from robot_ident.estimation.validation import unusable_on
from robot_ident.limits.certifier import Margins, certify
from robot_ident.model.model import Model
from robot_ident.recording.measurement import Source
from robot_ident.residuals.comparison import misfit_aside
from robot_ident.robot.robot import Robot
from robot_ident.trajectories.excitation import Excitation
from robot_ident.workflow.steps import find_missing


@dataclass(frozen=True)
class Played:
    """An excitation that was played, and how far it stays from the robot's limits."""

    path: str
    excitation: Excitation
    margins: Margins


@dataclass(frozen=True)
class Findings:
    """Models in their order beside recordings, and what the first and the last of them lack.

    training: recordings to compare with; validation: those that no fit has seen. diagnoses: by the number of the model,
    from 0. command: what was typed; effects_from: the files of a user's own effects that it named. troubles: a line
    where the last model can't be used at all, one for each validation on which it is worse than none, and one where it
    is adequate but for validation.
    """

    steps: tuple[Step, ...]
    training: tuple[Source, ...]
    validation: tuple[Source, ...]
    diagnoses: Mapping[int, Diagnosis]
    played: tuple[Played, ...] = ()
    command: str = ""
    troubles: tuple[str, ...] = ()
    effects_from: tuple[str, ...] = ()

    @property
    def robot(self) -> Robot:
        """The robot of all models."""
        return self.steps[0].model.robot

    @property
    def last(self) -> Step:
        """The last model, which the verdict is about."""
        return self.steps[-1]

    @property
    def ends(self) -> tuple[Step, ...]:
        """The first and the last model, or the only one."""
        return self.steps if len(self.steps) == 1 else (self.steps[0], self.steps[-1])

    @property
    def diagnosis(self) -> Diagnosis:
        """What the last model lacks."""
        return self.diagnoses[len(self.steps) - 1]

    @property
    def foreseen(self) -> Foreseen | None:
        """What adding that to the last model is predicted to do."""
        return foresee(self.last, self.diagnosis, self.validation)

    def to_dict(self) -> dict[str, Any]:
        """Return the steps with their errors, and where they come from, as plain data."""
        foreseen = self.foreseen
        return {
            "steps": [
                {"model": step.path, "added": list(step.added)} | _errors(step.training, step.validation)
                for step in self.steps
            ],
            "predicted": None
            if foreseen is None
            else {"added": list(foreseen.added)} | _errors(foreseen.training, foreseen.validation),
            "remaining_rms": dict(self.diagnosis.remaining_rms),
            "recordings": [_source(source) for source in self.training],
            "validation": [_source(source) for source in self.validation],
            "excitations": [{"path": one.path, "kept": one.margins.kept} for one in self.played],
            "notes": list(dict.fromkeys((*self.troubles, *self.diagnosis.notes, *self.last.comparison.notes))),
        }


def _errors(training: Mapping[str, Level], validation: Mapping[str, Level]) -> dict[str, Any]:
    out: dict[str, Any] = {}
    for key, levels in (("", training), ("validation_", validation)):
        out[f"{key}mse"] = {joint: level.mse for joint, level in levels.items()} or None
        out[f"{key}noise_variance"] = {joint: level.noise_variance for joint, level in levels.items()} or None
    return out


def _source(source: Source) -> dict[str, Any]:
    rows = source.measured.motion.samples
    return {"path": source.path, "sha256": source.sha256, "samples": source.recording.samples, "rows": rows}


def gather(
    models: Sequence[tuple[str, Model]],
    training: Sequence[Source],
    validation: Sequence[Source] = (),
    excitations: Sequence[tuple[str, Excitation]] = (),
    *,
    command: str = "",
    effects_from: Sequence[str] = (),
    heard: Callable[[str], None] = lambda what: None,
) -> Findings:
    """Return what models (path, model) tell beside recordings; InputError where they are of several robots.

    excitations: (path, excitation) that were played. effects_from: files of effects that are not the catalogue's.
    heard: is told what is done next.
    """
    heard("comparing")
    steps = staircase(models, training, validation)
    seen, unseen = ([source.measured for source in sources] for sources in (training, validation))
    diagnoses = {}
    for place in sorted({0, len(steps) - 1}):
        heard(f"diagnosing {steps[place].name}")
        diagnoses[place] = find_missing(steps[place].model, seen, unseen)
    played = []
    for path, excitation in excitations:
        heard(f"certifying {path}")
        played.append(Played(path, excitation, certify(excitation, steps[0].model.robot)))
    last = steps[-1].model
    troubles = last.leading(unusable_on(last, unseen))
    if diagnoses[len(steps) - 1].verdict == "adequate":
        troubles = (*troubles, *misfit_aside(last, unseen))
    return Findings(
        steps, tuple(training), tuple(validation), diagnoses, tuple(played), command, troubles, tuple(effects_from)
    )
