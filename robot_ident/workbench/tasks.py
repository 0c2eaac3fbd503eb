"""The slow part: what is computed for a session, step by step, and written beside its models.

Each task is a handful of the calls that the verbs `identify`, `compare`, `diagnose` and `add` make, so that what the
browser shows is what they print.
"""

from __future__ import annotations

import json
from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from itertools import count
from pathlib import Path
from typing import Any

import numpy as np

from robot_ident.bags import read_for
from robot_ident.configuration import to_yaml
from robot_ident.diagnosis.diagnosis import Tell, after, silent
from robot_ident.effects import load_effects, make_effect, register
from robot_ident.errors import InputError
from robot_ident.estimation.effort_checks import contradictions
from robot_ident.estimation.identify import extended, measured_anew, with_base
from robot_ident.estimation.prediction import measured_for
from robot_ident.files import whole, write_text
from robot_ident.model.model import Model
from robot_ident.model.model_file import read_model, write_model
from robot_ident.model.structure import Structure
from robot_ident.provenance import fingerprint, provenance
from robot_ident.recording.measurement import Measurement, Processing, Source
from robot_ident.recording.process import process
from robot_ident.recording.recording import Recording
from robot_ident.residuals.beside import Beside, beside
from robot_ident.residuals.comparison import compare, judged
from robot_ident.residuals.curves import since_reversal
from robot_ident.residuals.residual_lines import residual_lines
from robot_ident.robot import Robot, load_robot
from robot_ident.robot.robot_file import definition_of
from robot_ident.signals.motion import Array
from robot_ident.workbench import records
from robot_ident.workbench.allowed_paths import BUILT_IN, Stamp, stamp
from robot_ident.workbench.records import Lines, Rows, to_arrays, write_arrays
from robot_ident.workbench.session import Session, StepFile, model_name, now
from robot_ident.workflow.preview import Forecast, Preview
from robot_ident.workflow.steps import find_missing

_OTHERWISE = ", or bring the model of robot_ident identify --as-declared"


class Work:
    """The tasks of one session; what was read once is kept. said: what the latest task has to say when it is done;
    wrote: the files that it has saved, and how it left them.
    """

    def __init__(self, session: Session, effects_from: Sequence[str] = ()) -> None:
        """Make the user's own effects known; effects_from: the files of effects that the command line named.

        InputError where the session asks for another one: what it holds may be anybody's.
        """
        self.session = session
        self.said = ""
        self.wrote: dict[str, Stamp | None] = {}
        self._read: list[tuple[Recording, str]] = []
        self._measured: dict[str, list[Source]] = {}
        for path in session.own_effects(effects_from):
            register(load_effects(path))

    def do(self, task: Mapping[str, Any], tell: Tell) -> None:
        """Do a task by its name."""
        every: tuple[Callable[..., None], ...] = (self.open, self.diagnose, self.preview, self.add, self.report)
        tasks = {one.__name__: one for one in every}
        name, self.said, self.wrote = str(task["task"]), "", {}
        if name not in tasks:
            raise InputError(f"unknown task {name!r}")
        tasks[name](tell, **{key: value for key, value in task.items() if key != "task"})

    def open(self, tell: Tell) -> None:
        """Read the recordings, identify the first model (or take the one that was brought), and compare it."""
        if (self.session.step_folder(0) / "step.yaml").is_file():
            return
        brought = self.session.choice.model
        model = read_model(self._file(brought)) if brought is not None else self._identified(tell)
        training, validation = self._measurements(tell, model)
        every = (*training, *validation)
        found = [beside(model, measured) for measured in every]
        rows = [_rows(one, measured, model) for one, measured in zip(found, every, strict=True)]
        write_arrays(self.session.folder / "rows.npz", to_arrays(Rows, rows))
        lines = [residual_lines(one, measured) for one, measured in zip(found, every, strict=True)]
        write_arrays(self.session.folder / "lines.npz", to_arrays(Lines, lines))
        about = {"recordings": [records.about(m, k >= len(training)) for k, m in enumerate(every)]}
        records.write_json(self.session.folder / "recordings.json", about)
        self._write_step(0, StepFile(made=now()), model, tell)

    def _identified(self, tell: Tell) -> Model:
        """Return the first model, with gains of drives that the robot's files don't give, as `identify` finds it."""
        choice = self.session.choice
        name = choice.robot or BUILT_IN[0]
        robot = load_robot(self._file(name) if self._file(name).is_file() else name)
        training, _ = self._measurements(tell, robot)
        tell(0.6, "identifying the model")
        doubts = contradictions(training, robot, otherwise=_OTHERWISE)
        chosen = with_base(self._fitted(robot), training, Structure.build(robot), Processing())
        model = chosen.model(estimator="wls", physical=False, notes=doubts)
        made = provenance([str(self._file(name)) for name in choice.recordings], {"topic": choice.topic})
        named = zip(made["recordings"], choice.recordings, strict=True)  # by the names they were given
        return replace(model, provenance={**made, "recordings": [{**one, "path": name} for one, name in named]})

    def _file(self, name: str) -> Path:
        """Return where a file is that was named in the folder of the start."""
        return Path(self.session.choice.folder, name)

    def _recordings(self, tell: Tell, robot: Robot) -> list[tuple[Recording, str]]:
        """Read all recordings, those of validation last, with their sha256."""
        choice = self.session.choice
        names = [*choice.recordings, *choice.validation]
        for place, name in list(enumerate(names))[len(self._read) :]:
            tell(0.5 * place / len(names), f"reading {name}")
            read = read_for(self._file(name), robot, topic=choice.topic)
            self._read.append((replace(read, source=name), fingerprint(self._file(name))))
        return self._read

    def _fitted(self, robot: Robot) -> list[Recording]:
        """Return the recordings that models are fitted to, as they were read."""
        return [recording for recording, _ in self._recordings(silent, robot)][: len(self.session.choice.recordings)]

    def _sources(self, tell: Tell, given: Model | Robot) -> tuple[list[Source], list[Source]]:
        """Read and process all recordings, as the model says where there is one: anew for other gains and payloads.
        Those of validation apart.
        """
        robot, payloads = (given.robot, given.payloads) if isinstance(given, Model) else (given, [])
        key = json.dumps([definition_of(robot).yaml.get("joints"), payloads], sort_keys=True, default=str)
        if key not in self._measured:
            sources = []
            for read, digest in self._recordings(tell, robot):
                measured = measured_for(given, read) if isinstance(given, Model) else process(read, robot)
                sources.append(Source(read.source, digest, read, measured))
            self._measured[key] = sources
        every, fitted = self._measured[key], len(self.session.choice.recordings)
        return every[:fitted], every[fitted:]

    def _measurements(self, tell: Tell, given: Model | Robot) -> tuple[list[Measurement], list[Measurement]]:
        training, validation = self._sources(tell, given)
        return [source.measured for source in training], [source.measured for source in validation]

    def diagnose(self, tell: Tell, number: int) -> None:
        """Find what a step's model lacks, and what each candidate would do."""
        training, validation, model = self._given(tell, number)
        found = find_missing(model, training, validation, lambda share, what: tell(0.3 + 0.5 * share, what))
        listed = [s for s in (*found.missing, *found.others) if s.effect.regression]
        forecast = Forecast(training, model.structure, validation)
        for place, finding in enumerate(listed):
            tell(0.8 + 0.2 * place / len(listed), f"what {finding.label} would do")
            self._write_preview(number, forecast.of(finding.effect), model)
        saved = model_name(self.session, len(self.session.added(number)))
        told = records.diagnosis(found, {str(self.session.model_file(number)): saved})
        records.write_json(self.session.step_folder(number) / "diagnosis.json", told)

    def preview(self, tell: Tell, number: int, label: str) -> None:
        """Work out what any effect of the catalogue would do to a step's model."""
        training, validation, model = self._given(tell, number)
        tell(0.5, f"what {label} would do")
        self._write_preview(number, Forecast(training, model.structure, validation).named(label), model)

    def add(self, tell: Tell, number: int, label: str, new: int) -> None:
        """Fit a step's model with one effect more, as the verb `add` does, and compare it."""
        training, _, model = self._given(tell, number)
        effect = make_effect(label, model.robot)
        tell(0.3, f"fitting the model with {label}")
        better = extended(model, training, lambda: self._fitted(model.robot), [effect])[-1]
        self._write_step(new, StepFile(parent=number, added=label, made=now()), better, tell)
        self.session.go(new)

    def report(self, tell: Tell, number: int, path: str, shown: str, left: Stamp | None) -> None:
        """Write the report on all models from the first one to a step's, as the verb `report` does.

        left: of the file that it replaces; InputError where another one has come into its place.
        """
        from robot_ident.report.sections import write_report
        from robot_ident.workflow.findings import gather

        numbers = self.session.path(number)
        models = [read_model(self.session.model_file(k)) for k in numbers]
        names = [model_name(self.session, added) for added in range(len(numbers))]
        training, validation = self._sources(tell, models[0])
        steps = count(1)

        def heard(what: str) -> None:
            tell(after(next(steps), 0.5, 1.0), f"report: {what}")

        own = self.session.choice.effects_from
        found = gather(list(zip(names, models, strict=True)), training, validation, effects_from=own, heard=heard)
        heard("drawing")
        if stamp(Path(path)) not in (left, None):
            raise InputError(f"{shown} was changed by someone else meanwhile and was left as it is; give another name")
        write_report(path, found, force=left is not None)
        self.wrote[path] = stamp(Path(path))
        self.said = f"The report is written: {shown}"

    def _given(self, tell: Tell, number: int) -> tuple[list[Measurement], list[Measurement], Model]:
        model = read_model(self.session.model_file(number))
        return (*self._measurements(tell, model), model)

    def _write_step(self, number: int, step: StepFile, model: Model, tell: Tell) -> None:
        """Write a step's folder whole: the model, its torque along the recordings, its errors, the comparison."""
        tell(0.8, "comparing the model with the recordings")
        training, validation = self._measurements(tell, model)
        compared = compare(model, training)
        arrays: dict[str, Array] = {}
        for k, measured in enumerate((*training, *validation)):
            found = beside(model, measured)
            arrays |= _along(k, found, measured)
            arrays[f"{k}.load"] = found.load
            if measured_anew(model):
                arrays[f"{k}.measured"] = found.measured
        with whole(self.session.step_folder(number)) as folder:
            folder.mkdir()
            write_model(model, folder / "model.yaml")
            write_arrays(folder / "series.npz", arrays)
            records.write_json(folder / "comparison.json", records.comparison(compared, model, validation))
            records.write_json(folder / "errors.json", records.errors(model, compared, validation))
            write_text(folder / "step.yaml", to_yaml(step.model_dump()))

    def _write_preview(self, number: int, preview: Preview, model: Model) -> None:
        training, validation = self._measurements(silent, model)
        arrays: dict[str, Array] = {}
        for k, (measured, predicted) in enumerate(zip((*training, *validation), preview.predicted, strict=True)):
            arrays |= _along(k, replace(beside(model, measured), predicted=predicted), measured)
        label = preview.effect.label
        write_arrays(self.session.preview_file(number, label, ".npz"), arrays)
        records.write_json(self.session.preview_file(number, label, ".json"), records.preview_of(preview))


def _along(place: int, found: Beside, measured: Measurement) -> dict[str, Array]:
    """Return what is kept of a model along a recording: its torque, and the lines of its residual."""
    return {f"{place}.predicted": found.predicted, f"{place}.lines": residual_lines(found, measured).residual}


def _rows(found: Beside, measured: Measurement, model: Model) -> Rows:
    """Return the rows of a measurement as they are compared: low-passed and thinned."""
    motion, told = measured.motion, judged(measured, model)
    since = [since_reversal(dq, measured.dt, periodic=motion.periodic) for dq in motion.dq.T]
    since_rows = np.column_stack(since)[measured.rows]
    return Rows(found.t, found.q, found.dq, found.ddq, since_rows, found.measured, told.weight, told.dof)
