"""A motion that repeats while its torque doesn't is not averaged: pushes are no noise."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from robot_ident.recording import Processing, Recording, process
from robot_ident.robot import Robot, load_robot


def axis(pushes: float, seed: int = 0) -> Recording:
    """Return three periods of a sliding axis, pushed at instants of no period."""
    rng = np.random.default_rng(seed)
    dt, samples = 2e-3, 1500
    t = np.arange(3 * samples) * dt
    w = 2 * np.pi / (samples * dt)
    q, dq, ddq = 0.1 * np.sin(w * t), 0.1 * w * np.cos(w * t), -0.1 * w**2 * np.sin(w * t)
    force = np.zeros_like(t)
    for start in rng.uniform(0.0, t[-1] - 0.1, 4):
        force += pushes * ((t > start) & (t < start + 0.05))
    stray = 5e-6 * np.convolve(force / max(pushes, 1.0), np.hanning(60) / 30, mode="same")  # the servo gives way
    tau = 95 * ddq + 200 * dq + 20 * np.sign(dq) + force + 0.5 * rng.standard_normal(len(t))
    return Recording(
        ("slide",), t, (q + stray + 1e-8 * rng.standard_normal(len(t)))[:, None], tau[:, None], source="axis"
    )


@pytest.fixture(scope="module")
def robot(checkout: Path) -> Robot:
    return load_robot(checkout / "examples/emps/robot.yaml")


def test_pushes_are_not_taken_for_noise(robot: Robot) -> None:
    measured = process(axis(150.0), robot)
    assert measured.base_frequency is None
    assert any("repeats every 3 s, but not the torque of slide" in note for note in measured.notes)


def test_what_repeats_is_averaged(robot: Robot) -> None:
    assert process(axis(0.0), robot).periods == 3


def test_whoever_asks_for_periods_gets_them(robot: Robot) -> None:
    assert process(axis(150.0), robot, Processing(periodic=True)).periods in (2, 3)


def test_less_than_two_periods_are_one_pass(robot: Robot) -> None:
    whole = axis(0.0)
    measured = process(whole[slice(0, 2990)], robot)
    assert measured.base_frequency is None
    assert measured.notes
