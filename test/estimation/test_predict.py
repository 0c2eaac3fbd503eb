"""The band of a prediction holds what it promises: the torque of parameters drawn from the covariance."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from robot_ident.bags import read_recording, write_prediction
from robot_ident.errors import InputError
from robot_ident.estimation.identify import identify
from robot_ident.estimation.prediction import predict, predict_motion, standard_deviation
from robot_ident.recording.measurement import Processing
from robot_ident.recording.process import process
from robot_ident.trajectories.fourier_series import FourierSeries


@pytest.fixture(scope="module")
def model(arm: Any) -> Any:
    return identify([arm.record(1, periods=4)], arm.robot)


def test_the_torque_of_a_motion_that_was_not_seen(arm: Any, model: Any) -> None:
    recording = arm.record(2, periods=4)
    found = predict(model, recording)
    measured = process(recording, arm.robot, Processing(periodic=False))
    rows = slice(900, -100)  # its start-up, where the positions don't belong to the torque, is over
    off = (measured.passed(measured.torque) - found.torque)[rows]
    noise = np.sqrt(arm.robot.noise.torque_variance * measured.independent)
    assert np.all(np.std(off, axis=0) < 1.25 * noise), np.std(off, axis=0) / noise
    assert np.mean(np.abs(off) < found.band[rows] + 1.96 * noise) > 0.93


def test_the_standard_deviation_against_drawn_parameters(arm: Any, model: Any) -> None:
    motion = predict(model, arm.record(2, periods=2)).motion[::40]
    rng = np.random.default_rng(0)
    drawn = rng.multivariate_normal(model.values, model.covariance, size=4000)
    columns = model.structure.columns(motion, model.linear)
    spread = np.einsum("tjp,kp->ktj", columns, drawn).std(axis=0)
    np.testing.assert_allclose(standard_deviation(model, motion), spread, rtol=0.08)


def test_inner_parameters_count(arm: Any) -> None:
    """A Stribeck velocity that is badly known widens the band at low speed."""
    found = identify([arm.record(1, periods=4)], arm.robot, effects=["stribeck@joint_1"])
    motion = predict(found, arm.record(2, periods=2)).motion[::40]
    p = len(found.structure.parameters)
    known = found.covariance.copy()
    known[p:], known[:, p:] = 0.0, 0.0
    whole, without = standard_deviation(found, motion), standard_deviation(replace(found, covariance=known), motion)
    assert np.any(whole[:, 0] > 1.01 * without[:, 0])
    rng = np.random.default_rng(1)
    small = replace(found, covariance=found.covariance * 1e-6)  # where the torque is linear in all parameters
    drawn = rng.multivariate_normal(small.values, small.covariance, size=1500)
    torques = [replace(found, values=v, structure=found.structure.with_settings(v[p:])).predict(motion) for v in drawn]
    np.testing.assert_allclose(standard_deviation(small, motion), np.std(torques, axis=0), rtol=0.12)


@pytest.mark.parametrize("form", ["out.npz", "out.csv", "out.mcap", "out"])
def test_what_is_written(arm: Any, model: Any, tmp_path: Path, form: str) -> None:
    found = predict(model, arm.record(2, periods=2))
    write_prediction(tmp_path / form, found)
    topic = None if form.endswith(("npz", "csv")) else "/predicted"
    back = read_recording(tmp_path / form, topic=topic)
    assert back.names == found.joints
    np.testing.assert_allclose(back.tau, found.torque, rtol=1e-9, atol=1e-9)
    np.testing.assert_allclose(back.q, found.motion.q, rtol=1e-9, atol=1e-12)
    if topic:
        upper = read_recording(tmp_path / form, topic="/predicted_upper")
        np.testing.assert_allclose(upper.tau - back.tau, found.band, atol=1e-9)
    with pytest.raises(InputError, match="exists already"):
        write_prediction(tmp_path / form, found)


def test_the_band_holds_the_torque_of_a_planned_task(arm: Any) -> None:
    """Over many identifications the band holds 95 % of the torque that the task truly takes."""
    task = FourierSeries(0.1, arm.series.q0, 0.8 * arm.series.b, 0.8 * arm.series.a)
    t = np.arange(0.0, 10.0, 0.1)
    motion = task.motion(t)
    true = arm.structure.columns(motion) @ arm.structure.true_values()
    held = [
        np.abs(found.torque - true) <= found.band
        for seed in range(12)
        for found in [predict_motion(identify([arm.record(seed, periods=2, lead=0.0)], arm.robot), t, motion)]
    ]
    # states of one fit err together: 12 fits of 21 parameters, each of which a state sees but a part of
    assert 0.9 < np.mean(held) <= 1.0


def test_a_task_beyond_what_was_identified_is_said(arm: Any, model: Any) -> None:
    t = np.arange(0.0, 10.0, 0.1)
    assert predict_motion(model, t, arm.series.motion(t)).notes == ()
    fast = FourierSeries(0.3, arm.series.q0, 3.0 * arm.series.a, 3.0 * arm.series.b).motion(t)
    notes = predict_motion(model, t, fast).notes
    assert len(notes) == 3
    assert all("identified up to" in note for note in notes)
