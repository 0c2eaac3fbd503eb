"""What no effect of the catalogue is gets no name, though some effect explains half of it."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from robot_ident.diagnosis.diagnose import diagnose
from robot_ident.recording import process
from robot_ident.recording.recording import Recording

PERIOD = 1500
Torque = Callable[[np.ndarray, np.ndarray, np.ndarray], np.ndarray]


def of_two_speeds(q: np.ndarray, dq: np.ndarray, tau: np.ndarray) -> np.ndarray:
    """Return friction of joint 3 that rises with the speed of joint 2."""
    return 9.0 * dq[:, 2] * np.abs(dq[:, 1])


def with_hidden(recording: Recording, joint: int, hidden: Torque) -> Recording:
    """Return a recording with more torque at a joint, by the mean of its periods, differentiated by differences."""
    q = recording.q.reshape(-1, PERIOD, 3).mean(axis=0)
    dq = (np.roll(q, -3, axis=0) - np.roll(q, 3, axis=0)) / (6.0 / 150.0)
    tau = recording.tau.copy()
    tau[:, joint] += np.tile(hidden(q, dq, tau[:PERIOD]), len(tau) // PERIOD)
    return replace(recording, tau=tau)


def torque_wave(q: np.ndarray, dq: np.ndarray, tau: np.ndarray) -> np.ndarray:
    """Return the error of a gear that gives 4 % more and less, seven times a turn of joint 3."""
    return 0.04 * tau[:, 2] * np.sin(7.0 * q[:, 2] + 0.4)


def coupled(q: np.ndarray, dq: np.ndarray, tau: np.ndarray) -> np.ndarray:
    """Return what joint 3 feels of the friction of joint 2."""
    return 4.0 * dq[:, 1] + 2.0 * np.sign(dq[:, 1])


def dent(q: np.ndarray, dq: np.ndarray, tau: np.ndarray) -> np.ndarray:
    """Return the torque of a dent in a gear at one place of joint 3."""
    return -14.0 / np.cosh((q[:, 2] - 0.5) / 0.12) ** 2


def cogging(q: np.ndarray, dq: np.ndarray, tau: np.ndarray) -> np.ndarray:
    """Return a wave over the position of joint 3, of which the motions see little more than a turn."""
    return 6.0 * np.sin(3.0 * q[:, 2] + 0.7)


def hose(q: np.ndarray, dq: np.ndarray, tau: np.ndarray) -> np.ndarray:
    """Return a hose that pulls in proportion."""
    return 8.0 * (q[:, 2] - 0.1)


def named(bench: Any, hidden: Torque) -> list[str]:
    """Return what is named where something is hidden at joint 3."""
    measured = [process(with_hidden(bench.record([], k), 2, hidden), bench.robot) for k in (0, 1, 2)]
    return [one.label for one in diagnose(measured, bench.structure).missing]


@pytest.mark.parametrize(
    "hidden", [dent, *(pytest.param(one, marks=pytest.mark.long) for one in (of_two_speeds, torque_wave, cogging))]
)
def test_what_no_effect_of_the_catalogue_is_gets_no_name(bench: Any, hidden: Torque) -> None:
    assert named(bench, hidden) == []


@pytest.mark.parametrize(
    ("hidden", "name"), [(coupled, "joint_coupling"), pytest.param(hose, "cable", marks=pytest.mark.long)]
)
def test_a_cause_keeps_its_name(bench: Any, hidden: Torque, name: str) -> None:
    assert named(bench, hidden) == [f"{name}@joint_3"]
