"""Recordings of the simulated KUKA with something hidden, on four motions that a design had found."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
import pytest

from robot_ident.bags import write_recording
from robot_ident.diagnosis.diagnose import diagnose
from robot_ident.diagnosis.diagnosis import Diagnosis
from robot_ident.estimation.identify import estimate
from robot_ident.model.model import Model
from robot_ident.model.model_file import write_model
from robot_ident.model.structure import Structure
from robot_ident.recording import Recording, process
from robot_ident.recording.measurement import Measurement
from robot_ident.robot import Robot, load_robot
from robot_ident.testbed.phenomena import plant_physics
from robot_ident.testbed.servo import Servo
from robot_ident.testbed.simulation import Play
from robot_ident.trajectories.fourier_series import FourierSeries

MOTIONS = [  # q0 [rad], a, b [rad/s] by joint, base frequency 0.1 Hz
    (
        [0.005, -0.124, -0.205],
        [
            [-0.391, 0.273, -0.102, -0.114, -0.384],
            [0.41, 0.111, 0.104, 0.262, 0.446],
            [-0.041, 0.318, 0.385, -0.08, 0.408],
        ],
        [
            [-0.087, 0.313, -0.479, 0.493, 0.546],
            [-0.324, -0.06, 0.184, -0.288, 0.316],
            [-0.368, -0.062, -0.258, -0.484, 0.24],
        ],
    ),
    (
        [0.001, -0.046, -0.207],
        [
            [-0.247, -0.079, -0.349, 0.644, -0.254],
            [-0.19, 0.012, -0.2, 0.028, 0.8],
            [0.391, 0.294, 0.097, -0.175, 0.505],
        ],
        [
            [-0.232, -0.249, 0.401, 0.629, 0.294],
            [-0.581, 0.009, -0.192, 0.018, 0.279],
            [-0.385, -0.174, -0.496, -0.469, 0.391],
        ],
    ),
    (
        [-0.044, -0.028, -0.248],
        [
            [0.207, 0.239, -0.345, 0.989, 0.186],
            [-0.41, -0.014, -0.185, -0.01, -0.263],
            [-0.405, 0.274, -0.548, 0.14, -0.018],
        ],
        [
            [-0.028, -0.049, 0.104, -0.426, -0.11],
            [0.447, -0.028, -0.137, -0.017, 0.824],
            [0.224, 0.393, -0.37, 0.43, 0.556],
        ],
    ),
    (
        [-0.075, -0.01, -0.104],
        [
            [-0.406, -0.386, -0.982, 0.37, 0.017],
            [0.458, 0.202, -0.106, -0.178, 0.325],
            [-0.377, 0.0, 0.061, -0.289, 0.191],
        ],
        [
            [-0.087, 0.418, 0.524, -0.325, -0.07],
            [0.361, 0.24, 0.09, -0.113, 0.747],
            [0.554, -0.249, 0.15, 0.207, 0.685],
        ],
    ),
]
TRAINING, UNSEEN = (0, 1, 2), 3
PERIODS = 6
QUIET = 0.1  # of the noise's variance: what is hidden is seen clearly


@dataclass
class Bench:
    """A KUKA, its model, and recordings of it with something hidden; what was made once is kept."""

    robot: Robot
    structure: Structure
    motions: list[FourierSeries]

    def __post_init__(self) -> None:
        self._plays: dict[tuple[tuple[str, ...], int], Play] = {}
        self._diagnoses: dict[tuple[str, ...], Diagnosis] = {}

    def record(self, effects: Sequence[str], motion: int, *, noise: float = QUIET, seed: int = 1) -> Recording:
        key = (tuple(effects), motion)
        if key not in self._plays:
            self._plays[key] = Play.of(self.robot, plant_physics(self.robot, effects), self.motions[motion])
        return self._plays[key].record(PERIODS, noise=noise, seed=100 * seed + motion)

    def held(self, joint: str) -> Recording:
        """Record a motion in which one joint is held where it is."""
        series, moving = self.motions[0], np.array([[name != joint] for name in self.robot.joints], dtype=float)
        others = replace(series, a=series.a * moving, b=series.b * moving)
        return Play.of(self.robot, plant_physics(self.robot, ()), others).record(PERIODS, noise=QUIET, seed=7)

    def measure(
        self, effects: Sequence[str], motions: Sequence[int] = TRAINING, *, noise: float = QUIET, seed: int = 1
    ) -> list[Measurement]:
        return [process(self.record(effects, k, noise=noise, seed=seed), self.robot) for k in motions]

    def diagnose(self, effects: Sequence[str]) -> Diagnosis:
        key = tuple(effects)
        if key not in self._diagnoses:
            self._diagnoses[key] = diagnose(self.measure(effects), self.structure, self.measure(effects, [UNSEEN]))
        return self._diagnoses[key]

    def model(self, measurements: Sequence[Measurement]) -> Model:
        return estimate(measurements, self.structure)


@pytest.fixture(scope="session")
def bench() -> Bench:
    robot = load_robot()
    motions = [FourierSeries(0.1, np.array(q0), np.array(a), np.array(b)) for q0, a, b in MOTIONS]
    return Bench(robot, Structure.build(robot), motions)


@pytest.fixture(scope="session")
def sticking(bench: Bench) -> list[Measurement]:
    """A robot whose drives know nothing of friction: joints stick as they reverse, and break away with a jerk."""
    servo = Servo.make(bench.robot, "pd")
    plays = [Play.of(bench.robot, plant_physics(bench.robot, ()), motion, servo=servo) for motion in bench.motions[:2]]
    return [process(play.record(12, noise=1 / 16, seed=5 + k), bench.robot) for k, play in enumerate(plays)]


@dataclass(frozen=True)
class Files:
    """A model of a robot with Stribeck friction at joint 2, without that effect, and the recordings."""

    model: Path
    bags: tuple[Path, ...]
    unseen: Path


@pytest.fixture(scope="session")
def files(bench: Bench, tmp_path_factory: pytest.TempPathFactory) -> Files:
    folder = tmp_path_factory.mktemp("stribeck")
    bags = []
    for motion in (*TRAINING, UNSEEN):
        bags.append(folder / f"bag_{motion}.npz")
        write_recording(bags[-1], bench.record(STRIBECK, motion))
    write_model(bench.model(bench.measure(STRIBECK)), folder / "model.yaml")
    return Files(folder / "model.yaml", tuple(bags[:-1]), bags[-1])


STRIBECK = ("stribeck@joint_2:stribeck=20,speed=0.08",)


@pytest.fixture
def verb(capsys: pytest.CaptureFixture[str]) -> Callable[..., tuple[int, str, str]]:
    """Return a caller of verbs: (exit code, standard output, standard error)."""
    from robot_ident.cli.main import main

    def call(*words: object) -> tuple[int, str, str]:
        capsys.readouterr()
        code = main([str(word) for word in words])
        captured = capsys.readouterr()
        return code, captured.out, captured.err

    return call
