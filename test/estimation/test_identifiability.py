"""What the data cannot say is said: which parameters, which pairs, which excitation."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from robot_ident.estimation.identifiability import identifiability
from robot_ident.estimation.identify import identify
from robot_ident.estimation.solve import solve
from robot_ident.model.structure import Structure
from robot_ident.recording import Recording, process
from robot_ident.robot import load_robot
from robot_ident.trajectories.fourier_series import FourierSeries


def recording_of(arm: Any, series: FourierSeries, seed: int = 0, periods: int = 16) -> Recording:
    rng = np.random.default_rng(seed)
    t = np.arange(1500 * periods) / 150.0
    motion = series.motion(t)
    tau = arm.structure.columns(motion) @ arm.structure.true_values()
    tau = tau + rng.normal(size=tau.shape) * np.sqrt(arm.robot.noise.torque_variance)
    return Recording(arm.robot.joints, t, motion.q + 1e-5 * rng.normal(size=tau.shape), tau, source="weak")


def test_a_good_motion_draws_no_complaint(arm: Any) -> None:
    measured = process(arm.record(0), arm.robot)
    found = identifiability(solve([measured], arm.structure, "wls"), [measured])
    assert found.notes == found.warnings == ()


def test_slow_motion_leaves_the_inertias_open(arm: Any) -> None:
    slow = FourierSeries(0.1, arm.series.q0, 0.1 * arm.series.a, 0.1 * arm.series.b)
    measured = process(recording_of(arm, slow), arm.robot)
    found = identifiability(solve([measured], arm.structure, "wls"), [measured])
    assert found.warnings
    assert {"p5", "p6"} & set(found.open)
    assert any("the data cannot give" in note for note in found.warnings)
    assert "p10" not in found.open  # gravity needs no speed


def test_joints_in_phase_are_a_pair_that_is_named(arm: Any) -> None:
    a, b = np.array(arm.series.a), np.array(arm.series.b)
    a[2], b[2] = -a[1], -b[1]
    measured = process(recording_of(arm, FourierSeries(0.1, arm.series.q0, a, b)), arm.robot)
    found = identifiability(solve([measured], arm.structure, "wls"), [measured])
    assert found.pairs
    assert any("can hardly be told apart" in note for note in found.notes)


def test_ten_seconds_of_a_kuka_kr300_are_called_too_little(shared_data: Path) -> None:
    z = np.load(shared_data / "kuka_kr300/data.npz")
    robot = load_robot(shared_data / "kuka_kr300/kr300_dh.urdf")
    q, tau = z["A__q_motor_side"] + z["q_home"], z["A__tau_motor"] * z["gear_ratio"]
    recording = Recording(robot.joints, z["A__t"], q, tau, source="kr300")
    assert "badly excited" in identify([recording], robot, as_declared=True).notes[0]
    model = identify([recording], replace(robot, base="declared"), as_declared=True)
    assert any("badly excited" in note for note in model.notes)
    # ten seconds hold fewer independent stretches than parameters: no direction may look exactly known for that
    correlation = model.covariance / np.outer(model.std, model.std)
    assert np.linalg.eigvalsh(correlation).min() > 1e-6
    (line,) = [note for note in model.notes if "the data cannot give" in note]
    for name in ("Izz1", "Ixy2", "Iyz2", "mx3"):
        assert name in line
    for name in ("my5", "coulomb@joint_1", "viscous@joint_6"):
        assert name not in line


def test_misfit_is_said_and_so_is_position_noise(arm: Any) -> None:
    r = arm.record(0)
    lacking = identify([Recording(r.names, r.t, r.q, r.tau + [8.0, 0.0, 0.0])], arm.robot)
    (line,) = [note for note in lacking.notes if "residual exceeds the noise" in note]
    assert "joint_1" in line
    assert "joint_3" not in line
    t = np.arange(800) / 100.0
    motion = FourierSeries(0.5, arm.series.q0, 1.44 * arm.series.a, 1.44 * arm.series.b).motion(t)
    rng = np.random.default_rng(0)
    tau = arm.structure.columns(motion) @ arm.structure.true_values() + rng.normal(size=motion.q.shape)
    coarse = Recording(r.names, t, motion.q + 2e-3 * rng.normal(size=motion.q.shape), tau, source="coarse")
    assert any("--estimator ml" in note for note in identify([coarse], arm.robot).notes)
    assert not any("--estimator ml" in note for note in identify([r], arm.robot).notes)


@pytest.mark.parametrize("label", ["rotor_inertia@joint_3", "presliding@joint_1", "load_friction@joint_2"])
def test_effects_are_judged_too(arm: Any, label: str) -> None:
    """Those with memory and those that depend on torque included."""
    structure = Structure.build(arm.robot, [label])
    measured = process(arm.record(0), arm.robot)
    found = identifiability(solve([measured], structure, "wls"), [measured])
    assert len(found.influence) == len(structure.names) > 21
    assert np.all(found.influence > 0)
    assert np.all(found.uncertainty < 0.25)
