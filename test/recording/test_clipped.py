"""Efforts that a driver cuts off are seen, and what was cut off enters no fit."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from robot_ident.diagnosis.diagnose import diagnose
from robot_ident.errors import InputError
from robot_ident.estimation.identify import estimate
from robot_ident.recording import Processing, Recording, process
from robot_ident.recording.saturation import find_clipped
from robot_ident.recording.summary import summarise


def clipped(recording: Recording, share: float) -> Recording:
    """Return a recording whose efforts stop at a share of each joint's largest."""
    bound = share * np.abs(recording.tau).max(axis=0)
    return replace(recording, tau=np.clip(recording.tau, -bound, bound), source="c.npz")


def test_the_rest_gives_the_same_arm(arm: Any) -> None:
    whole = arm.record(1, periods=16, noise=0.2)
    cut = clipped(whole, 0.7)
    truth = arm.structure.true_values()
    measured = process(cut, arm.robot)
    assert len(measured.clipped) == 3
    assert "clipped by its driver; what lies within 0.1 s of it is left out" in measured.clipped[0]
    assert any("the effort of joint_2 stands at" in note for note in summarise(cut).notes)
    np.testing.assert_allclose(measured.torque_variance, process(whole, arm.robot).torque_variance, rtol=0.1)
    found = estimate([measured], arm.structure)
    assert np.all(np.abs(found.values - truth) < 5.0 * found.std)
    assert found.chi_square / found.dof < 1.15
    said = diagnose([measured], arm.structure)
    assert said.verdict == "adequate", "and no torque_saturation"
    assert any("c.npz: the effort of joint_1 stands at" in note for note in said.notes)


def test_where_too_little_is_left(arm: Any) -> None:
    with pytest.raises(
        InputError, match="c.npz: the effort of joint_1 stands at .* clipped .* too little of the motion"
    ):
        process(clipped(arm.record(1, periods=4), 0.1), arm.robot)


def test_one_pass(arm: Any) -> None:
    cut = clipped(arm.record(1, periods=4, noise=0.2), 0.8)
    measured = process(cut, arm.robot, Processing(periodic=False))
    at, _ = find_clipped(cut)
    assert at.any(axis=0).all()
    assert not (measured.used & at).any()


@pytest.mark.parametrize("step", [0.0, 0.5, 5.0, 20.0])
def test_whole_efforts_are_not_clipped(arm: Any, step: float) -> None:
    """Neither as they are, nor rounded, nor with a brake on that leaves no effort."""
    recording = arm.record(1, periods=4)
    tau = np.round(recording.tau / step) * step if step else np.array(recording.tau)
    assert find_clipped(replace(recording, tau=tau))[1] == {}
    q = np.array(recording.q)
    q[:2000], tau[:2000] = q[0], tau.max(axis=0) + 5.0
    assert find_clipped(replace(recording, q=q, tau=tau))[1] == {}
