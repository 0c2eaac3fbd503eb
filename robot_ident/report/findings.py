"""All that a report tells, read from disk and gathered through the core's one-call steps before a word of it is
written.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from robot_ident.bags import read_for
from robot_ident.diagnosis.diagnose import diagnose
from robot_ident.diagnosis.diagnosis import Diagnosis
from robot_ident.diagnosis.kept_aside import misfit_aside
from robot_ident.diagnosis.staircase import Foreseen, Level, Step, foresee, staircase
from robot_ident.estimation.effort_checks import taken_as_declared
from robot_ident.estimation.for_model import measured_for
from robot_ident.estimation.unusable import refuse_misdeclared, unusable_on
from robot_ident.limits.certifier import Margins, certify
from robot_ident.model.model import Model
from robot_ident.provenance import fingerprint
from robot_ident.recording.measurement import Source
from robot_ident.robot.robot import Robot
from robot_ident.trajectories.excitation import Excitation


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
    from 0. command: what was typed; effects_from: the files of a user's own effects that it named. troubles: a line for
    each validation on which the last model is worse than none, and one where it is adequate but for what is kept
    aside.
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
    refuse_misdeclared(steps[0].model, seen)
    declared = taken_as_declared(steps[0].model.notes)
    diagnoses = {}
    for place in sorted({0, len(steps) - 1}):
        heard(f"diagnosing {steps[place].name}")
        diagnoses[place] = diagnose(seen, steps[place].model.structure, unseen, as_declared=declared)
    played = []
    for path, excitation in excitations:
        heard(f"certifying {path}")
        played.append(Played(path, excitation, certify(excitation, steps[0].model.robot)))
    last, aside = steps[-1].model, [one.measured for one in validation]
    troubles = unusable_on(last, aside)
    if diagnoses[len(steps) - 1].verdict == "adequate":
        troubles = (*troubles, *misfit_aside(last, aside))
    return Findings(
        steps, tuple(training), tuple(validation), diagnoses, tuple(played), command, troubles, tuple(effects_from)
    )


def read_sources(
    bags: Sequence[str], model: Model, *, topic: str | None = None, heard: Callable[[str], None] = lambda what: None
) -> tuple[Source, ...]:
    """Return recordings as read and as measured for a model; InputError where one can't be used."""
    out = []
    for bag in bags:
        heard(f"reading {bag}")
        recording = read_for(bag, model.robot, topic=topic)
        out.append(Source(str(bag), fingerprint(bag), recording, measured_for(model, recording)))
    return tuple(out)


def read_excitations(named: Sequence[str], models: Sequence[Model]) -> list[tuple[str, Excitation]]:
    """Return the excitations that are named; where none is, those that the models say and that are still there."""
    paths = list(named)
    if not paths:
        noted = [model.provenance.get("options", {}).get("trajectory") or () for model in models]
        files = [file for one in noted for file in ([one] if isinstance(one, str) else one)]
        paths = list(dict.fromkeys(str(path) for path in files if Path(str(path)).is_file()))
    return [(path, Excitation.read(path)) for path in paths]
