"""Recordings of different days: their scatter beside sigma, a warning where it is larger, `this day only` elsewhere."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from robot_ident.estimation.identify import identify
from robot_ident.recording import Recording
from robot_ident.recording.conditions import Conditions

DAY = 86_400 * 10**9
START = 1_780_000_000 * 10**9


@pytest.fixture(scope="module")
def runs(arm: Any) -> list[Recording]:
    """Return a recording of each of four days of the same robot."""
    out = [arm.record(k, periods=4, lead=0.0) for k in range(4)]
    return [replace(run, source=f"day {k}", start_ns=START + k * DAY) for k, run in enumerate(out)]


def test_days_that_noise_explains(arm: Any, runs: list[Recording]) -> None:
    model = identify(runs, arm.robot)
    assert model.days is not None
    assert model.days["intervals"] == "all days"
    assert len(model.days["days"]) == 4
    assert 0.6 < model.days["scatter_over_sigma"] < 1.4
    assert not any("scatter more than sigma says" in note for note in model.notes)
    one = model.days["parameters"]["viscous@joint_1"]
    assert len(one["values"]) == 4
    assert one["scatter"] == pytest.approx(np.std(one["values"], ddof=1))


def test_friction_that_differs_from_day_to_day(arm: Any, runs: list[Recording]) -> None:
    other = []
    for factor, run in zip((-1.0, 0.5, 1.0, -0.5), runs, strict=True):
        speed = arm.series.motion(run.t).dq
        other.append(replace(run, tau=run.tau + factor * np.array([0.0, 12.0, 0.0]) * speed))
    model = identify(other, arm.robot)
    note = next(note for note in model.notes if "scatter more than sigma says" in note)
    assert "4 days" in note
    assert "viscous@joint_2" in note
    assert "viscous@joint_1" not in note


def test_one_day_speaks_for_itself(arm: Any, runs: list[Recording]) -> None:
    for few in (runs[:2], [replace(run, start_ns=START) for run in runs], [replace(run, start_ns=0) for run in runs]):
        days = identify(few, arm.robot).days
        assert days is not None
        assert days["intervals"] == "this day only"
        assert days["scatter_over_sigma"] is None


def test_a_day_that_is_written_counts_before_the_stamps(arm: Any, runs: list[Recording]) -> None:
    written = [replace(run, conditions=Conditions(day=f"2026-03-0{k + 1}"), start_ns=0) for k, run in enumerate(runs)]
    days = identify(written, arm.robot).days
    assert days is not None
    assert days["days"] == ["2026-03-01", "2026-03-02", "2026-03-03", "2026-03-04"]
