"""Positions that something has rounded on the way: the step is read from them, and counts as noise of the motion."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from robot_ident.recording import Recording, process
from robot_ident.recording.resolution import coarse_notes, position_step

T = np.arange(3000) / 150.0


def rounded(q: np.ndarray, step: float) -> np.ndarray:
    return np.asarray(np.round(q / step) * step)


@pytest.mark.parametrize("step", [1e-5, 4e-4, 1e-3, 1e-2, 5e-2])
def test_the_step_of_rounded_positions(step: float) -> None:
    """Fine ones, of which a sample moves many, and so coarse ones that no sample moves by two."""
    rng = np.random.default_rng(0)
    q = 0.7 * np.sin(0.8 * T) + 0.2 * np.cos(2.1 * T) + 2e-5 * rng.standard_normal(len(T))
    assert position_step(rounded(q, step)[:, None])[0] == pytest.approx(step, rel=1e-6)


def test_no_step_where_nothing_is_rounded() -> None:
    """Smooth, noisy, at rest, at constant speed, repeated to the last digit, and of a few values at odd distances."""
    rng = np.random.default_rng(0)
    odd = np.sort(rng.uniform(0, 1, 40))
    columns = [
        np.sin(0.8 * T),
        np.sin(0.8 * T) + 1e-4 * rng.standard_normal(len(T)),
        np.full(len(T), 0.3),
        0.1 * T,
        np.tile(np.sin(2 * np.pi * np.arange(300) / 300), 10),
        odd[rng.integers(40, size=len(T))],
    ]
    assert not position_step(np.column_stack(columns)).any()


def test_only_what_is_far_coarser_than_declared_is_said() -> None:
    q = np.column_stack([rounded(np.sin(0.8 * T + k), step) for k, step in enumerate((1e-3, 1e-3, 1e-3))])
    (line,) = coarse_notes(position_step(q), np.array([2e-5, 5e-4, 0.0]), ("first", "second", "third"))
    assert "first 0.001 (50 times)" in line
    assert "second" not in line and "third" not in line
    assert coarse_notes(position_step(q), np.array([1e-3, 1e-3, 1e-3]), ("first", "second", "third")) == []


@pytest.mark.parametrize("step", [1e-3, 1e-2])
def test_rounding_does_not_reach_the_acceleration(arm: Any, step: float) -> None:
    """As good as from what the encoder itself reads; its own lines beyond the motion's would be many times as large."""
    fine: Recording = arm.record(1, periods=4, lead=0.0)
    coarse = replace(fine, q=rounded(fine.q, step), dq=None)
    right, found = process(fine, arm.robot), process(coarse, arm.robot)
    off = np.sqrt(np.mean((found.motion.ddq - right.motion.ddq) ** 2, axis=0))
    assert np.all(off < 0.02 * np.sqrt(np.mean(right.motion.ddq**2, axis=0)))
    raw = np.gradient(np.gradient(coarse.q[:1500], 1 / 150.0, axis=0), 1 / 150.0, axis=0)
    assert np.all(np.sqrt(np.mean((raw - right.motion.ddq[:1500]) ** 2, axis=0)) > 50 * off)
    assert found.averaged_position_variance is not None and right.averaged_position_variance is not None
    share = found.averaged_position_variance / (step**2 / 12.0)  # noise dithers some of it away
    assert np.all((share > 0.2) & (share < 1.2))
    assert np.all(right.averaged_position_variance < 0.1 * found.averaged_position_variance)
    assert any("positions stand on steps far larger than encoder_step" in note for note in found.notes)
    assert not any("encoder_step" in note for note in right.notes)
