"""What a session works on: its recordings, read and processed once, and the model that it began with."""

from __future__ import annotations

import json
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

from robot_ident.bags import read_for
from robot_ident.diagnosis.progress import Tell, silent
from robot_ident.effects import load_effects, register
from robot_ident.estimation.prediction import measured_for
from robot_ident.model.model import Model
from robot_ident.model.model_file import read_model
from robot_ident.provenance import fingerprint
from robot_ident.provenance import provenance as _provenance
from robot_ident.recording.measurement import Measurement, Source
from robot_ident.recording.process import process
from robot_ident.recording.recording import Recording
from robot_ident.robot import Robot, load_robot
from robot_ident.robot.robot_file import definition_of
from robot_ident.workbench.session import Session


class Inputs:
    """The inputs of one session; what was read is kept."""

    def __init__(self, session: Session, effects_from: Sequence[str] = ()) -> None:
        """Make the user's own effects known; effects_from: the files that the command line named.

        InputError where the session asks for another one: what it holds may be anybody's.
        """
        self.session = session
        self._read: list[tuple[Recording, str]] = []
        self._measured: dict[str, list[Source]] = {}
        for path in session.own_effects(effects_from):
            register(load_effects(path))

    def provenance(self) -> dict[str, Any]:
        """Return where the first model comes from; recordings by the names they were given, as `identify` has them."""
        choice = self.session.choice
        made = _provenance([str(self.path(name)) for name in choice.recordings], {"topic": choice.topic})
        named = zip(made["recordings"], choice.recordings, strict=True)
        return {**made, "recordings": [{**one, "path": name} for one, name in named]}

    def path(self, name: str) -> Path:
        """Return where a file is that was named in the folder of the start."""
        return Path(self.session.choice.folder, name)

    def brought(self) -> tuple[Model | None, Robot]:
        """Return the model that the session began with (None: it is identified) and its robot."""
        choice = self.session.choice
        if choice.model is None:
            name = choice.robot or "kuka_ir361"
            return None, load_robot(self.path(name) if self.path(name).is_file() else name)
        model = read_model(self.path(choice.model))
        return model, model.robot

    def measurements(
        self, tell: Tell, model: Model | None, robot: Robot
    ) -> tuple[list[Measurement], list[Measurement]]:
        """Return all recordings as they are measured, those of validation apart."""
        training, validation = self.sources(tell, model, robot)
        return [source.measured for source in training], [source.measured for source in validation]

    def recordings(self, robot: Robot) -> list[Recording]:
        """Return the recordings that models are fitted to, as they were read."""
        return [recording for recording, _ in self._recordings(silent, robot)][: self._fitted]

    def sources(self, tell: Tell, model: Model | None, robot: Robot) -> tuple[list[Source], list[Source]]:
        """Read and process all recordings, as the model says; those of validation apart."""
        key = _measured_by(model, robot)
        if key not in self._measured:
            made = []
            for recording, digest in self._recordings(tell, robot):
                measured = process(recording, robot) if model is None else measured_for(model, recording)
                made.append(Source(recording.source, digest, recording, measured))
            self._measured[key] = made
        sources = self._measured[key]
        return sources[: self._fitted], sources[self._fitted :]

    @property
    def _fitted(self) -> int:
        return len(self.session.choice.recordings)

    def _recordings(self, tell: Tell, robot: Robot) -> list[tuple[Recording, str]]:
        """Read all recordings, those of validation last, with their sha256."""
        choice = self.session.choice
        names = [*choice.recordings, *choice.validation]
        for count in range(len(self._read), len(names)):
            name = names[count]
            tell(0.5 * count / len(names), f"reading {name}")
            read = read_for(self.path(name), robot, topic=choice.topic)
            self._read.append((replace(read, source=name), fingerprint(self.path(name))))
        return self._read


def _measured_by(model: Model | None, robot: Robot) -> str:
    """Return what tells measurements for one model of a session from those for another: gains and payloads."""
    joints = definition_of(robot if model is None else model.robot).yaml.get("joints")
    return json.dumps([joints, [] if model is None else model.payloads], sort_keys=True, default=str)
