"""Real recordings against their published results."""

from __future__ import annotations

import shutil
from pathlib import Path

import numpy as np
import pytest

from robot_ident.estimation.identify import identify
from robot_ident.estimation.validate import validate
from robot_ident.model.structure import Structure
from robot_ident.recording import Processing, Recording
from robot_ident.robot import load_robot

EMPS = {"M": 95.1089, "viscous@slide": 203.5034, "coulomb@slide": 20.3935, "torque_offset@slide": -3.1648}
TX40_VISCOUS = [8.107054, 5.60096, 1.978, 1.10695, 1.857995, 0.643794]
TX40_COULOMB = [6.966832, 8.123402, 6.307204, 2.484089, 3.025972, 0.243976]


@pytest.fixture(scope="module")
def emps(shared_data: Path) -> tuple[Recording, Recording]:
    z = np.load(shared_data / "emps/data.npz")
    return (
        Recording(("slide",), z["t"], z["q"], z["tau"], source="emps"),
        Recording(("slide",), z["val_t"], z["val_q"], z["val_tau"], source="pulses"),
    )


def test_emps_has_its_published_parameters_and_residual(emps: tuple[Recording, Recording], checkout: Path) -> None:
    robot = load_robot(checkout / "examples/emps/robot.yaml")
    processing = Processing(periodic=False, low_pass=60.0)
    model = identify([emps[0]], robot, processing=processing)
    found = dict(zip(model.structure.names, model.values, strict=True))
    assert found.keys() == EMPS.keys()
    for name, value in EMPS.items():
        assert found[name] == pytest.approx(value, rel=0.01), name
    assert 100 * model.residual["slide"].relative == pytest.approx(4.0834, abs=0.5)


def test_emps_pulses_are_predicted_as_published(emps: tuple[Recording, Recording], checkout: Path) -> None:
    robot = load_robot(checkout / "examples/emps/robot.yaml")
    model = identify([emps[0]], robot, processing=Processing(periodic=False, low_pass=60.0))
    result = validate(model, emps[1], low_pass=60.0)
    assert 100 * result.residual["slide"].relative == pytest.approx(5.9824, abs=0.7)


def test_emps_repeats_every_6240_samples(emps: tuple[Recording, Recording], checkout: Path) -> None:
    model = identify([emps[0]], load_robot(checkout / "examples/emps/robot.yaml"))
    assert (model.noise.periods, model.noise.samples_per_period) == (3, 6240)
    fit = model.residual["slide"]
    assert fit.noise_variance is not None
    # the friction is not Coulomb and viscous: the residual is far above the noise, and the tool has to say so
    assert fit.mse / fit.noise_variance > 30


def test_staubli_has_61_base_parameters_and_its_published_friction(
    shared_data: Path, checkout: Path, tmp_path: Path
) -> None:
    shutil.copy(checkout / "examples/staubli_tx40/robot.yaml", tmp_path)
    shutil.copy(shared_data / "staubli_tx40/tx40_mdh_modified.urdf", tmp_path)
    robot = load_robot(tmp_path / "robot.yaml")
    assert len(Structure.build(robot).parameters) == 61
    z = np.load(shared_data / "staubli_tx40/data.npz")
    recording = Recording(robot.joints, z["t"], z["q"], z["tau"], source="tx40")
    model = identify([recording], robot, estimator="ls", processing=Processing(low_pass=100.0, decimate=10))
    found = dict(zip(model.structure.names, model.values, strict=True))
    np.testing.assert_allclose([found[f"viscous@{joint}"] for joint in robot.joints], TX40_VISCOUS, rtol=0.05)
    np.testing.assert_allclose([found[f"coulomb@{joint}"] for joint in robot.joints], TX40_COULOMB, rtol=0.05)
    assert found["wrist_coupling.viscous@joint_6"] == pytest.approx(0.597492, rel=0.05)
    assert found["wrist_coupling.coulomb@joint_6"] == pytest.approx(2.033376, rel=0.05)
