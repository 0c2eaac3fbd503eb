"""Causes that follow other formulas than the catalogue's, by torques that are written down here."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from robot_ident.diagnosis.diagnose import diagnose
from robot_ident.effects import make_effect
from robot_ident.recording.measurement import Measurement
from robot_ident.signals.motion import Array

Law = Callable[[Array, Array, Array], Array]  # of position, velocity and torque of a joint


def plateau(q: Array) -> Array:
    """Return a triangle over a turn, cut off at its top."""
    return np.clip(2 / np.pi * np.arcsin(np.cos(q - 1)), -1.0, 0.6)


LAWS: dict[str, Law] = {
    "stribeck@joint_2": lambda q, v, tau: 20 * np.sign(v) / (1 + np.abs(v) / 0.1) ** 2,
    "viscous_nonlinear@joint_2": lambda q, v, tau: 20 * np.sign(v) * (1 - np.exp(-np.abs(v) / 0.3)),
    "position_friction@joint_1": lambda q, v, tau: 10 * np.sign(v) * plateau(q),
    "torque_ripple@joint_2": lambda q, v, tau: 2 * np.sin(2 * 103.235 * q + 1) + 0.3 * np.sin(4 * 103.235 * q),
    "torque_saturation@joint_2": lambda q, v, tau: 0.1 * tau * np.abs(np.tanh(tau / 200)),
}


def with_law(measured: Measurement, label: str, law: Law) -> Measurement:
    """Return a measurement to whose averaged torque a law is added."""
    joint = measured.joints.index(label.partition("@")[2])
    torque = measured.torque.copy()
    torque[:, joint] += law(measured.motion.q[:, joint], measured.motion.dq[:, joint], torque[:, joint])
    return replace(measured, torque=torque)


FAST = "viscous_nonlinear@joint_2", "torque_ripple@joint_2"


@pytest.mark.parametrize(
    "label", [label if label in FAST else pytest.param(label, marks=pytest.mark.long) for label in LAWS]
)
def test_other_formulas_get_the_name_of_their_cause(bench: Any, label: str) -> None:
    found = diagnose([with_law(m, label, LAWS[label]) for m in bench.measure(())], bench.structure)
    assert [finding.label for finding in found.missing] == [label]


def test_friction_that_sets_in_rises_and_what_bends_at_speed_may_bend_either_way(bench: Any) -> None:
    effect = make_effect("viscous_nonlinear@joint_1", bench.robot)
    assert effect.at({"form": 1.0, "bend": 0.1}).ranges == ((0.0, np.inf),)
    assert effect.at({"form": 0.0, "bend": 0.6}).ranges == ((0.0, np.inf),)
    assert effect.at({"form": 0.0, "bend": 2.0}).ranges == ((-np.inf, np.inf),)


def test_direction_is_known_but_beside_reversals_of_a_drive_that_sticks(bench: Any) -> None:
    smooth, sticky = bench.measure(())[0], bench.measure(("stribeck@joint_3:stribeck=20,speed=0.1",))[0]
    rows = ~sticky.used[:, 2]
    assert 5 < rows.sum() < 60
    assert rows.sum() > 2 * (~smooth.used[:, 2]).sum()
    assert sticky.used[:, 0].mean() > 0.99
    gained = np.sqrt(np.mean(sticky.motion.ddq[:, 2] ** 2)) * sticky.dt
    assert np.abs(sticky.motion.dq[rows, 2]).max() < gained
