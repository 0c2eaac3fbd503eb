"""Real recordings against their published results."""

from __future__ import annotations

import shutil
from pathlib import Path

import numpy as np
import pytest

from robot_ident.estimation.equations import stack
from robot_ident.estimation.identify import identify
from robot_ident.estimation.validation import validate
from robot_ident.model.structure import Structure
from robot_ident.recording import Processing, Recording, process
from robot_ident.robot import load_robot

EMPS = {"M": 95.1089, "viscous@slide": 203.5034, "coulomb@slide": 20.3935, "torque_offset@slide": -3.1648}
EMPS_SIGMA = {"M": 0.1085, "viscous@slide": 1.146, "coulomb@slide": 0.1012, "torque_offset@slide": 0.0444}
TX40_VISCOUS = [8.107054, 5.60096, 1.978, 1.10695, 1.857995, 0.643794]
TX40_VISCOUS_PERCENT = np.array([0.51, 0.84, 1.67, 2.95, 2.27, 3.29])
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


def test_emps_standard_deviations_are_the_published_ones_where_its_residual_is_called_white(
    emps: tuple[Recording, Recording], checkout: Path
) -> None:
    """The authors decimate to 100 Hz and take the residual as independent; it isn't, and ours say so."""
    robot = load_robot(checkout / "examples/emps/robot.yaml")
    processing = Processing(periodic=False, low_pass=60.0, decimate=10)
    model = identify([emps[0]], robot, estimator="ls", processing=processing)
    equations = stack([process(emps[0], robot, processing)], model.structure)
    residual = equations.torque - equations.phi @ model.values
    variance = residual @ residual / (len(residual) - 4)
    white = np.sqrt(variance * np.diag(np.linalg.inv(equations.phi.T @ equations.phi)))
    found = dict(zip(model.structure.names, white, strict=True))
    for name, sigma in EMPS_SIGMA.items():
        assert found[name] == pytest.approx(sigma, rel=0.02), name
    assert np.sqrt(variance) == pytest.approx(2.1843, rel=0.02)
    assert np.linalg.norm(residual) == pytest.approx(108.7569, rel=0.02)
    assert np.linalg.cond(equations.phi) == pytest.approx(25.9883, rel=0.02)
    assert np.all(model.std > 1.5 * white)
    assert np.all(model.std < 6.0 * white)


@pytest.mark.parametrize("estimator", ["wls", pytest.param("ml", marks=pytest.mark.long)])
def test_emps_by_its_periods_agrees_with_what_is_published(
    emps: tuple[Recording, Recording], checkout: Path, estimator: str
) -> None:
    """Its noise is coloured and its residual a hundred times that noise: colour must not rule the weights."""
    robot = load_robot(checkout / "examples/emps/robot.yaml")
    as_they_are = identify([emps[0]], robot, estimator=estimator, processing=Processing(periodic=True))
    chosen = identify([emps[0]], robot, estimator=estimator)  # low-passed besides
    for model in (as_they_are, chosen):
        found = dict(zip(model.structure.names, model.values, strict=True))
        for name, value in EMPS.items():
            assert found[name] == pytest.approx(value, rel=0.025), name
    assert any("not by its colour" in note for note in as_they_are.notes)


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
    processing = Processing(low_pass=100.0, decimate=10)
    model = identify([recording], robot, estimator="ls", processing=processing)
    found = dict(zip(model.structure.names, model.values, strict=True))
    std = dict(zip(model.structure.names, model.std, strict=True))
    published = np.array(TX40_VISCOUS) * TX40_VISCOUS_PERCENT / 100.0
    # ours count in that the residual is not white, and that halves of the recording differ
    ratio = np.array([std[f"viscous@{joint}"] for joint in robot.joints]) / published
    assert ratio.min() > 0.75
    middle = len(recording.t) // 2
    halves = [
        identify([half], robot, estimator="ls", processing=processing)
        for half in (recording[:middle], recording[middle:])
    ]
    apart = (halves[1].values - halves[0].values) / np.hypot(halves[0].std, halves[1].std)
    assert 0.6 < np.sqrt(np.mean(apart**2)) < 1.2
    np.testing.assert_allclose([found[f"viscous@{joint}"] for joint in robot.joints], TX40_VISCOUS, rtol=0.05)
    np.testing.assert_allclose([found[f"coulomb@{joint}"] for joint in robot.joints], TX40_COULOMB, rtol=0.05)
    assert found["wrist_coupling.viscous@joint_6"] == pytest.approx(0.597492, rel=0.05)
    assert found["wrist_coupling.coulomb@joint_6"] == pytest.approx(2.033376, rel=0.05)
