"""One case of the MuJoCo world, judged: the one place that knows both the world and the product."""

from __future__ import annotations

import time
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np
import yaml
from arms import JOINTS, WRIST, write_arm
from arms_of_wheel import urdf_of
from table import FOLDER

from mujoco_world.arm import Arm, Motion, motion_of
from mujoco_world.cases import make_case
from robot_ident.cli.main import main
from robot_ident.diagnosis.diagnose import diagnose
from robot_ident.diagnosis.diagnosis import Diagnosis
from robot_ident.errors import InputError
from robot_ident.estimation.identify import estimate, identify
from robot_ident.estimation.prediction import measured_for
from robot_ident.recording import Recording
from robot_ident.recording.measurement import Measurement
from robot_ident.robot import load_robot
from robot_ident.testbed.trial import Outcome

ARMS = ("ur5", "panda")
MOTIONS = 4
"""Three that are measured, one that no fit sees."""


def prepare() -> None:
    """Write the robot files and design the motions that are not there yet."""
    for name in ARMS:
        robot = write_arm(name, FOLDER)
        for number in range(1, MOTIONS + 1):
            file = _motion(name, number)
            if not file.exists():
                words = ["design", "--robot", robot, "--seed", number, "--starts", 1, "--time-limit", 25]
                assert main([str(w) for w in (*words, "--accept-unchecked", "-o", file)]) == 0


def run_case(seed: int, kind: str) -> Outcome:
    """Hide, record, identify without an option, diagnose, add."""
    name = ARMS[seed % len(ARMS)]
    arm, motions = _arm(name), _motions(name)
    robot = load_robot(FOLDER / f"{name}.yaml")
    case = make_case(seed, kind, arm, motions)
    recordings = [Recording(robot.joints, *data, source=f"run_{k}") for k, data in enumerate(case.recordings, 1)]
    trouble, errors = "", None
    started = time.process_time()
    try:
        model = identify(recordings[:-1], robot)
        *training, unseen = (measured_for(model, recording) for recording in recordings)
        started = time.process_time()
        found = diagnose(training, model.structure)
    except InputError as error:  # sound recordings that are refused: nothing is named, and the reason is kept
        trouble, rest = str(error), dict.fromkeys(robot.joints, float(np.nan))
        found = Diagnosis("unexplained", (), (), rest, None, (trouble,))
    seconds = time.process_time() - started
    columns = [one.effect for one in found.missing if not one.effect.measuring]
    if columns:
        both = (model.structure, model.structure.with_further(columns))
        before, after = (_errors(estimate(training, structure), unseen) for structure in both)
        errors = (before, after)
    return Outcome.of(
        found, robot, seed=seed, kind="pair_other_joints" if kind == "pair" else kind, hidden=case.what,
        truth=case.truth, visible=case.visible, seconds=seconds, errors=errors,
        trouble=trouble,
    )  # fmt: skip


def _errors(model: Any, unseen: Measurement) -> np.ndarray:
    rows = (unseen.used & ~unseen.standstill).all(axis=1)
    return np.asarray(np.mean((unseen.torque - model.predict(unseen.motion))[rows] ** 2, axis=0))


def _motion(name: str, number: int) -> Path:
    return FOLDER / f"{name}_mujoco_{number}.yaml"


@cache
def _motions(name: str) -> list[Motion]:
    return [motion_of(yaml.safe_load(_motion(name, k).read_text("utf-8"))) for k in range(1, MOTIONS + 1)]


@cache
def _arm(name: str) -> Arm:
    """Return the arm whose drives `arms.write_arm` describes."""
    large = np.arange(len(JOINTS[name])) < WRIST[name]
    friction = np.where(large, 3.0, 0.8)
    return Arm(
        name, urdf_of(name), tuple(JOINTS[name]), friction, friction.copy(), np.full(len(large), 0.1),
        np.where(large, 2.0, np.sqrt(0.4)), np.sqrt(1e-9),
    )  # fmt: skip
