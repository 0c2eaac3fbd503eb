"""Whether anything beside the stamps tells how fast they run."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from robot_ident.bags import JOINT_STATE, BagWriter, Topic, read_recording
from robot_ident.bags.cdr import serialise
from robot_ident.recording.measurement import time_scale_notes
from robot_ident.recording.process import process


def recorded(path: Path, recording: Any, pace: float, jitter: float) -> Any:
    """Write a bag whose messages came at a pace beside their stamps, and read it."""
    stamps = 1_700_000_000_000_000_000 + np.rint(1e9 * recording.t).astype(np.int64)
    late = np.random.default_rng(0).uniform(0.0, jitter, len(stamps))
    received = stamps[0] + np.rint(1e9 * (pace * (recording.t - recording.t[0]) + late)).astype(np.int64)
    rows = serialise(recording.names, stamps, recording.q, None, recording.tau)
    with BagWriter(path, [Topic("/joint_states", JOINT_STATE)]) as bag:
        for row, time in zip(rows, received.tolist(), strict=True):
            bag.write("/joint_states", row.tobytes(), time)
    return read_recording(path)


@pytest.fixture
def recording(arm: Any) -> Any:
    return arm.record(1, periods=3)


def test_messages_that_were_received_tell(recording: Any, arm: Any, tmp_path: Path) -> None:
    read = recorded(tmp_path / "bag", recording, 1.0, 2e-3)
    assert read.pace == pytest.approx(1.0, abs=1e-3)
    measured = process(read, arm.robot)
    assert measured.time_scale == "received" and time_scale_notes([measured]) == []


def test_a_clock_that_runs_wrong_is_told(recording: Any, arm: Any, tmp_path: Path) -> None:
    read = recorded(tmp_path / "bag", recording, 1.1, 2e-3)
    assert read.pace == pytest.approx(1.1, abs=1e-3)
    measured = process(read, arm.robot)
    assert measured.facts()["time_scale"] == "apart"
    (note,) = time_scale_notes([measured])
    assert "contradicted" in note and "another pace than their stamps" in note


def test_a_table_and_a_bag_made_of_stamps_tell_nothing(recording: Any, arm: Any, tmp_path: Path) -> None:
    read = recorded(tmp_path / "bag", recording, 1.0, 0.0)
    assert read.pace is None
    for one in (read, recording):
        measured = process(one, arm.robot)
        assert measured.time_scale == "" and "not verified" in time_scale_notes([measured])[0]


def test_a_declared_period_tells(recording: Any, arm: Any) -> None:
    from robot_ident.recording.measurement import Processing

    declared = Processing(base_frequency=arm.series.base_frequency, periodic=True)
    assert process(recording, arm.robot, declared).time_scale == "period"
    assert process(replace(recording, pace=None), arm.robot).time_scale == ""
