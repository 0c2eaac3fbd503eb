"""One case of the second simulator, judged; apart from the tests, since processes that run it import it by name."""

from __future__ import annotations

import time
from pathlib import Path

import numpy as np
import yaml

from foreign.cases import make_case
from robot_ident.diagnosis.diagnose import diagnose
from robot_ident.estimation.identify import estimate
from robot_ident.model.structure import Structure
from robot_ident.recording import Recording, process
from robot_ident.recording.measurement import Measurement
from robot_ident.robot import load_robot
from robot_ident.signals.motion import Array
from robot_ident.testbed.trial import Outcome

KINDS = {"known": "single", "unknown": "unknown", "null": "null"}


def run_case(seed: int, kind: str, files: list[Path]) -> Outcome:
    """Hide, record, diagnose, add: the last motion is unseen by any fit, and without noise."""
    robot = load_robot("kuka_ir361")
    structure = Structure.build(robot)
    motions = [yaml.safe_load(file.read_text(encoding="utf-8")) for file in files]
    case = make_case(seed, kind, motions, clean=1)
    *training, unseen = (process(Recording(robot.joints, *data), robot) for data in case.recordings)
    started = time.process_time()
    found = diagnose(training, structure)
    seconds = time.process_time() - started
    errors = None
    if found.missing and kind == "known":
        longer = Structure.build(robot, [finding.effect for finding in found.missing])
        before, after = (_errors(training, s, unseen) for s in (structure, longer))
        errors = (before, after)
    return Outcome.of(
        found,
        robot,
        seed=seed,
        kind=KINDS[kind],
        hidden=(case.what,),
        truth=(case.truth,) if case.truth else (),
        visible=case.visible,
        seconds=seconds,
        errors=errors,
    )


def _errors(training: list[Measurement], structure: Structure, unseen: Measurement) -> Array:
    model = estimate(training, structure)
    rows = (unseen.used & ~unseen.standstill).all(axis=1)
    return np.asarray(np.mean((unseen.torque - model.predict(unseen.motion))[rows] ** 2, axis=0))
