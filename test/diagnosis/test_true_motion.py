"""The motion on which models are judged: what encoders show without steps, and the torque that goes with it."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
import pytest

from robot_ident.estimation.identify import estimate
from robot_ident.recording.process import process
from robot_ident.signals.derivatives import derivatives
from robot_ident.testbed.phenomena import plant_physics
from robot_ident.testbed.servo import Servo
from robot_ident.testbed.simulation import Play
from robot_ident.testbed.trial import TrueMotion


def play_of(arm: Any, effects: Sequence[str]) -> Play:
    return Play.of(arm.robot, plant_physics(arm.robot, effects), arm.series, servo=Servo.make(arm.robot))


@pytest.fixture(scope="module")
def shaking(arm: Any) -> Play:
    """A ripple that shakes the first joint faster than its encoder can show."""
    return play_of(arm, ["torque_ripple@joint_1:torque_ripple=8.0,order=188.294"])


def test_right_model_has_no_error(arm: Any) -> None:
    play = play_of(arm, [])
    found = TrueMotion.of(play)
    model = estimate([process(play.record(2, noise=0.0), arm.robot)], arm.structure, estimator="ls")
    assert found.errors(model).max() < 1e-3
    assert 0.9 < found.moving.mean() < 1.0


def test_it_is_what_the_recording_shows_less_the_encoders_steps(arm: Any, shaking: Play) -> None:
    found, measured = TrueMotion.of(shaking), process(shaking.record(2, noise=0.0), arm.robot)
    np.testing.assert_array_equal(found.torque, measured.torque)
    step = arm.robot.drives.encoder_step
    assert np.all(np.abs(found.motion.q - measured.motion.q).max(axis=0) < 2.0 * step)
    dq, ddq = derivatives(found.motion.q, found.motion)
    assert np.abs(dq - found.motion.dq).max() < 2e-3
    assert np.sqrt(np.mean((ddq - found.motion.ddq) ** 2)) < 0.05


def test_encoder_steps_are_no_error_of_the_model(arm: Any, shaking: Play) -> None:
    """Where they hide accelerations, a model errs less along the true motion than along the one that they show."""
    found, measured = TrueMotion.of(shaking), process(shaking.record(2, noise=0.0), arm.robot)
    structure = type(arm.structure).build(arm.robot, ["torque_ripple@joint_1"])
    model = estimate([measured], structure, estimator="ls")
    shown = np.mean((measured.torque - model.predict(measured.motion))[found.moving] ** 2, axis=0)
    assert found.errors(model)[0] < 0.5 * shown[0]
