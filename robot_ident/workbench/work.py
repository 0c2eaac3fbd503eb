"""The slow part: what is computed for a session, step by step, and written beside its models.

Each task is a handful of the calls that the verbs `identify`, `compare`, `diagnose` and `add` make, so that what the
browser shows is what they print.
"""

from __future__ import annotations

import json
from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from robot_ident.bags import read_recording
from robot_ident.configuration import to_yaml
from robot_ident.diagnosis.comparison import Comparison, compare, judged
from robot_ident.diagnosis.curves import since_reversal
from robot_ident.diagnosis.diagnose import diagnose
from robot_ident.diagnosis.diagnosis import Diagnosis
from robot_ident.effects import candidates_of, load_effects, make_effect, register
from robot_ident.errors import InputError
from robot_ident.estimation.extend import extend, mean_square_errors
from robot_ident.estimation.identify import estimate
from robot_ident.files import whole, write_text
from robot_ident.model.model import Model
from robot_ident.model.model_file import read_model, write_model
from robot_ident.model.structure import Structure
from robot_ident.motion import Array
from robot_ident.provenance import fingerprint, provenance
from robot_ident.recording.measurement import Measurement, Processing
from robot_ident.recording.process import process
from robot_ident.recording.source import Source
from robot_ident.robot import Robot, load_robot
from robot_ident.workbench.commands import model_name
from robot_ident.workbench.preview import Forecast, Preview
from robot_ident.workbench.series import Rows, rows_to_arrays, write_arrays
from robot_ident.workbench.session import Session, StepFile, now

Tell = Callable[[float, str], None]
"""Reports progress: the share that is done, and what is being done."""


class Work:
    """The tasks of one session; what was read once is kept. said: what the latest task has to say when it is done."""

    def __init__(self, session: Session) -> None:
        self.session = session
        self.said = ""
        self._read: list[Source] = []
        for path in session.choice.effects_from:
            register(load_effects(self._path(path)))

    def open(self, tell: Tell) -> None:
        """Read the recordings, identify the first model (or take the one that was brought), and compare it."""
        if (self.session.step_folder(0) / "step.yaml").is_file():
            return
        model, robot = self._brought()
        training, validation = self._measurements(tell, model, robot)
        if model is None:
            tell(0.6, "identifying the model")
            model = estimate(training, Structure.build(robot))
            model = replace(model, provenance=self._provenance())
        rows = [_rows(measured, model) for measured in (*training, *validation)]
        write_arrays(self.session.folder / "rows.npz", rows_to_arrays(rows))
        about = {"recordings": [_about(m, k >= len(training)) for k, m in enumerate((*training, *validation))]}
        _write_json(self.session.folder / "recordings.json", about)
        self._write_step(0, StepFile(made=now()), model, tell)

    def diagnose(self, tell: Tell, number: int) -> None:
        """Find what a step's model lacks, and what each candidate would do."""
        training, validation, model = self._inputs(tell, number)
        tell(0.3, "trying every effect of the catalogue on motion that it was not fitted to")
        found = diagnose(training, model.structure, validation)
        listed = [s for s in (*found.missing, *found.others) if s.effect.regression]
        forecast = Forecast(training, model.structure, validation)
        for count, suspect in enumerate(listed):
            tell(0.8 + 0.2 * count / len(listed), f"what {suspect.label} would do")
            self._write_preview(number, forecast.of(suspect.effect))
        _write_json(self.session.step_folder(number) / "diagnosis.json", _diagnosis(found))

    def preview(self, tell: Tell, number: int, label: str) -> None:
        """Work out what any effect of the catalogue would do to a step's model."""
        training, validation, model = self._inputs(tell, number)
        tell(0.5, f"what {label} would do")
        self._write_preview(number, Forecast(training, model.structure, validation).named(label))

    def add(self, tell: Tell, number: int, label: str, new: int) -> None:
        """Fit a step's model with one effect more, as the verb `add` does, and compare it."""
        training, _, model = self._inputs(tell, number)
        effect = make_effect(label, model.robot)
        tell(0.3, f"fitting the model with {label}")
        better = extend(model, training, [effect])[-1]
        self._write_step(new, StepFile(parent=number, added=label, made=now()), better, tell)
        self.session.go(new)

    def report(self, tell: Tell, number: int, path: str, shown: str, force: bool) -> None:
        """Write the report on all models from the first one to a step's, as the verb `report` does."""
        from robot_ident.report.findings import gather
        from robot_ident.report.page import write_page
        from robot_ident.report.report import report_sections, report_title

        numbers = self.session.path(number)
        models = [read_model(self.session.model_file(k)) for k in numbers]
        names = [model_name(self.session, count) for count in range(len(numbers))]
        training, validation = self._sources(tell, models[0], models[0].robot)
        found = gather(
            list(zip(names, models, strict=True)), training, validation, heard=lambda what: tell(0.6, f"report: {what}")
        )
        title, subtitle = report_title(found)
        write_page(path, title, report_sections(found), subtitle=subtitle, force=force)
        self.said = f"The report is written: {shown}"

    def _provenance(self) -> dict[str, Any]:
        """Return where the first model comes from; recordings by the names they were given, as `identify` has them."""
        choice = self.session.choice
        made = provenance([str(self._path(name)) for name in choice.recordings], {"topic": choice.topic})
        named = zip(made["recordings"], choice.recordings, strict=True)
        return {**made, "recordings": [{**one, "path": name} for one, name in named]}

    def _inputs(self, tell: Tell, number: int) -> tuple[list[Measurement], list[Measurement], Model]:
        model = read_model(self.session.model_file(number))
        return (*self._measurements(tell, model, model.robot), model)

    def _path(self, name: str) -> Path:
        return Path(self.session.choice.folder, name)

    def _brought(self) -> tuple[Model | None, Robot]:
        choice = self.session.choice
        if choice.model is None:
            name = choice.robot or "kuka_ir361"
            return None, load_robot(self._path(name) if self._path(name).is_file() else name)
        model = read_model(self._path(choice.model))
        return model, model.robot

    def _measurements(
        self, tell: Tell, model: Model | None, robot: Robot
    ) -> tuple[list[Measurement], list[Measurement]]:
        """Return all recordings as they are measured, those of validation apart."""
        training, validation = self._sources(tell, model, robot)
        return [source.measured for source in training], [source.measured for source in validation]

    def _sources(self, tell: Tell, model: Model | None, robot: Robot) -> tuple[list[Source], list[Source]]:
        """Read and process all recordings, as the model says; those of validation apart."""
        choice = self.session.choice
        if not self._read:
            processing = Processing() if model is None else Processing(**dict(model.processing))
            names = [*choice.recordings, *choice.validation]
            for count, name in enumerate(names):
                tell(0.5 * count / len(names), f"reading {name}")
                recording = replace(read_recording(self._path(name), topic=choice.topic), source=name)
                measured = process(recording, robot, processing)
                self._read.append(Source(name, fingerprint(self._path(name)), recording, measured))
        return self._read[: len(choice.recordings)], self._read[len(choice.recordings) :]

    def _write_step(self, number: int, step: StepFile, model: Model, tell: Tell) -> None:
        """Write a step's folder whole: the model, its torque along the recordings, its errors, the comparison."""
        tell(0.8, "comparing the model with the recordings")
        training, validation = self._measurements(tell, model, model.robot)
        compared = compare(model, training)
        arrays: dict[str, Array] = {}
        for k, measured in enumerate((*training, *validation)):
            arrays[f"{k}.predicted"] = measured.passed(model.predict(measured.motion))
            arrays[f"{k}.load"] = model.structure.torques(measured.motion, model.linear).load[measured.rows]
        with whole(self.session.step_folder(number)) as folder:
            folder.mkdir()
            write_model(model, folder / "model.yaml")
            write_arrays(folder / "series.npz", arrays)
            _write_json(folder / "comparison.json", _comparison(compared, model))
            _write_json(folder / "errors.json", _errors(model, compared, validation))
            write_text(folder / "step.yaml", to_yaml(step.model_dump()))

    def _write_preview(self, number: int, preview: Preview) -> None:
        label = preview.effect.label
        arrays = {f"{k}.predicted": one for k, one in enumerate(preview.predicted)}
        write_arrays(self.session.preview_file(number, label, ".npz"), arrays)
        _write_json(self.session.preview_file(number, label, ".json"), _preview(preview))


def _rows(measured: Measurement, model: Model) -> Rows:
    """Return the rows of a measurement as they are compared: low-passed and thinned."""
    motion, kept, t = measured.motion, measured.rows, judged(measured, model)
    since = [since_reversal(dq, measured.dt, periodic=motion.periodic) for dq in motion.dq.T]
    return Rows(
        t=np.asarray(np.arange(motion.samples) * measured.dt)[kept],
        q=motion.q[kept],
        dq=motion.dq[kept],
        ddq=motion.ddq[kept],
        since=np.column_stack(since)[kept],
        measured=measured.passed(measured.torque),
        weight=t.weight,
        dof=t.dof,
    )


def _about(measured: Measurement, validation: bool) -> dict[str, Any]:
    """Return what the figures say of a recording."""
    known = np.isfinite(measured.averaged_variance)
    variance = [float(v) if yes else None for v, yes in zip(measured.averaged_variance, known, strict=True)]
    return {
        "name": measured.source,
        "validation": validation,
        "periods": measured.periods,
        "base_frequency": measured.base_frequency,
        "dt": measured.dt * measured.decimate,
        "samples": measured.motion.samples,
        "noise_variance": variance,
        "lines": None if measured.position_lines is None else measured.position_lines.astype(int).tolist(),
        "notes": list(measured.notes),
    }


def _comparison(found: Comparison, model: Model) -> dict[str, Any]:
    """Return a comparison as `compare --json` prints it, with its regions in words."""
    joints = []
    for number, joint in enumerate(found.joints):
        words = [region.in_words(model.robot, number) for region in joint.worst]
        joints.append({**joint.to_dict(), "worst_in_words": words})
    robot = model.robot
    return {
        "joints": joints,
        "notes": list(found.notes),
        "units": [robot.torque_unit(k) for k in range(robot.n)],
        "prismatic": [bool(one) for one in robot.prismatic],
        "effects": list(model.structure.labels),
        "possible": [effect.label for effect in candidates_of(model.structure)],
        "parameters": [
            {"name": p.name, "value": float(v), "std": float(s), "unit": p.unit, "effect": p.effect, "joint": p.joint}
            for p, v, s in zip(model.parameters, model.values, model.std, strict=True)
        ],
    }


def _errors(model: Model, compared: Comparison, validation: Sequence[Measurement]) -> dict[str, Any]:
    """Return the mean square errors by joint [(Nm)^2] and the noise of both: on training as `compare` has them, on
    validation as `add` does, the mean over recordings.
    """

    def mean(values: Sequence[Array]) -> dict[str, float] | None:
        if not values:
            return None
        return {name: float(v) for name, v in zip(model.robot.joints, np.mean(values, axis=0), strict=True)}

    return {
        "training": {joint.name: joint.residual_mse for joint in compared.joints},
        "noise": {joint.name: joint.noise_variance for joint in compared.joints},
        "validation": mean([mean_square_errors(model, m) for m in validation]),
        "validation_noise": mean([m.averaged_variance for m in validation]),
    }


def _diagnosis(found: Diagnosis) -> dict[str, Any]:
    """Return a diagnosis as `diagnose --json` prints it, with the labels and words of its candidates."""
    data = found.to_dict()
    for suspect, candidate in zip((*found.missing, *found.others), data["candidates"], strict=True):
        effect = suspect.effect
        candidate |= {"label": effect.label, "meaning": effect.meaning, "equation": effect.equation}
        candidate |= {"can_be_added": effect.regression, "evidence": effect.evidence}
    return {**data, "in_words": found.in_words, "named": [suspect.label for suspect in found.missing]}


def _preview(preview: Preview) -> dict[str, Any]:
    effect = preview.effect
    return {
        "label": effect.label,
        "meaning": effect.meaning,
        "equation": effect.equation,
        "before": preview.before,
        "after": preview.after,
        "validation_before": preview.validation_before,
        "validation_after": preview.validation_after,
        "parameters": [{"name": p.name, "value": p.value, "std": p.std, "unit": p.unit} for p in preview.parameters],
    }


def _write_json(path: Path, data: Mapping[str, Any]) -> None:
    write_text(path, json.dumps(_finite(data), indent=1), force=True)


def _finite(value: Any) -> Any:
    """Return data with null for numbers that aren't finite."""
    if isinstance(value, Mapping):
        return {str(key): _finite(item) for key, item in value.items()}
    if isinstance(value, (list, tuple)):
        return [_finite(item) for item in value]
    if isinstance(value, float) and not np.isfinite(value):
        return None
    return value


def run(session: Session, work: Work | None, task: Mapping[str, Any], tell: Tell) -> Work:
    """Do a task by its name; return the work with what was read for it."""
    work = work or Work(session)
    tasks: dict[str, Callable[..., None]] = {
        "open": work.open,
        "diagnose": work.diagnose,
        "preview": work.preview,
        "add": work.add,
        "report": work.report,
    }
    name, work.said = str(task["task"]), ""
    if name not in tasks:
        raise InputError(f"unknown task {name!r}")
    tasks[name](tell, **{key: value for key, value in task.items() if key != "task"})
    return work
