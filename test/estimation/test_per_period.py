"""Periods one by one: their scatter agrees with sigma, drift is seen where there is some and nowhere else."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from robot_ident.estimation.identify import identify
from robot_ident.estimation.repeatability import per_period
from robot_ident.estimation.solve import solve
from robot_ident.recording import Recording, process


def test_scatter_of_single_periods_is_what_sigma_says(arm: Any) -> None:
    measured = process(arm.record(0), arm.robot)
    found = solve([measured], arm.structure, "wls")
    (one,) = per_period([measured], found, "wls")
    assert one.values.shape == (16, 21)
    np.testing.assert_allclose(one.values.mean(axis=0), found.values, atol=1e-6)
    assert one.ratio == pytest.approx(1.0, abs=4 / np.sqrt(2 * 15 * 21))
    assert one.drift == ()


def test_no_drift_is_seen_in_steady_friction(arm: Any) -> None:
    for seed in range(15):
        model = identify([arm.record(seed, periods=8, lead=0.0)], arm.robot)
        assert model.per_period[0]["drift"] == []
        assert not any("friction of" in note for note in model.notes)


def test_friction_that_falls_as_the_gear_warms_is_reported(arm: Any) -> None:
    r = arm.record(1, lead=0.0)
    speed = np.gradient(arm.series.motion(r.t).q, r.t, axis=0)[:, 1]
    warm = np.linspace(0.5, -0.5, r.samples)
    tau = np.array(r.tau)
    tau[:, 1] += 0.4 * warm * 33.48 * speed
    model = identify([Recording(r.names, r.t, r.q, tau, source="warming")], arm.robot)
    (drift,) = model.per_period[0]["drift"]
    assert drift["joint"] == "joint_2"
    assert -0.55 < drift["change"] < -0.15
    assert any("friction of joint_2 falls" in note and "warm up" in note for note in model.notes)


def test_periods_that_differ_by_more_than_noise_are_reported(arm: Any) -> None:
    r = arm.record(2, lead=0.0, periods=12)
    rng = np.random.default_rng(0)
    speed = np.gradient(arm.series.motion(r.t).q, r.t, axis=0)
    each = np.repeat(rng.normal(size=(12, 3)) * [0.0, 12.0, 0.0], 1500, axis=0)
    model = identify([Recording(r.names, r.t, r.q, r.tau + each * speed, source="moody")], arm.robot)
    viscous = model.per_period[0]["parameters"]["viscous@joint_2"]
    assert viscous["of_mean"] > 2 * viscous["sigma"]
    (line,) = [note for note in model.notes if "trust that scatter" in note]
    assert "viscous@joint_2" in line
    assert "viscous@joint_1" not in line


def test_periods_that_differ_by_noise_alone_are_not(arm: Any) -> None:
    for seed in range(6):
        model = identify([arm.record(seed, periods=6, lead=0.0)], arm.robot)
        assert not any("trust that scatter" in note for note in model.notes)
