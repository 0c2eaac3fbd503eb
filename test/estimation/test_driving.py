"""Friction that drives is said, and no model that has some is called adequate."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from robot_ident.diagnosis.diagnose import diagnose
from robot_ident.estimation.driving import driven, negative_notes
from robot_ident.estimation.identify import estimate
from robot_ident.recording.process import process
from robot_ident.trajectories.fourier_series import FourierSeries


@pytest.fixture(scope="module")
def measured(arm: Any) -> tuple[Any, Any]:
    """One recording as it was, and the same backwards in time."""
    r = arm.record(1, periods=8)
    back = replace(r, q=r.q[::-1], tau=r.tau[::-1])
    return process(r, arm.robot), process(back, arm.robot)


def test_time_runs_backwards(arm: Any, measured: tuple[Any, Any]) -> None:
    right, reversed_ = (estimate([one], arm.structure) for one in measured)
    assert not any("drives" in note for note in right.notes)
    assert reversed_.chi_square / reversed_.dof < 1.2, "nothing else tells"
    assert reversed_.notes[0].startswith("friction that drives instead of braking: joint_1 (by ")
    assert "joint_3" in reversed_.notes[0] and "of time is wrong" in reversed_.notes[0]


def test_no_verdict_of_adequate(arm: Any, measured: tuple[Any, Any]) -> None:
    other = replace(arm, series=FourierSeries(0.1, -arm.series.q0, arm.series.b[::-1], -arm.series.a[:, ::-1]))
    r = other.record(2, periods=8)
    second = process(r, arm.robot), process(replace(r, q=r.q[::-1], tau=r.tau[::-1]), arm.robot)
    assert diagnose([measured[0], second[0]], arm.structure).verdict == "adequate"
    found = diagnose([measured[1], second[1]], arm.structure)
    assert found.verdict == "not_decidable"
    assert found.notes[0].startswith("friction that drives")


def test_an_effect_below_zero_is_another(arm: Any) -> None:
    structure = arm.structure.with_further(["stribeck@joint_2"])
    values, std = np.ones(len(structure.parameters)), np.ones(len(structure.parameters))
    place = structure.names.index("stribeck.level@joint_2")
    assert negative_notes(structure, values, std) == []
    values[place] = -6.0
    assert negative_notes(structure, values, std) == [
        "stribeck.level@joint_2 is -6 +- 1, and nothing of the kind is below zero: another effect is there"
    ]
    assert negative_notes(structure, values, 2.0 * std) == []


def test_a_coefficient_that_can_not_be_negative(arm: Any, measured: tuple[Any, Any]) -> None:
    values = arm.structure.true_values()
    place = arm.structure.names.index("viscous@joint_2")
    values[place] = -0.1
    covariance = 1e-4 * np.eye(len(values))
    found = driven(arm.structure, [measured[0]], values, covariance)
    assert found.joints == {} and found.coefficients == {"viscous@joint_2": pytest.approx(10.0)}
    assert "it can't be: viscous@joint_2 (by 10 sigma)" in found.notes[0]
    assert driven(arm.structure, [measured[0]], values, 9.0 * covariance).notes == ()


def test_a_moment_of_inertia_below_zero_is_said_and_a_product_is_not(arm: Any, measured: tuple[Any, Any]) -> None:
    """p15 is Izz3, p14 Iyz3: by the rules that the robot's base parameters print."""
    names, values = arm.structure.names, arm.structure.true_values()
    values[[names.index("p15"), names.index("p14")]] = -2.0
    found = driven(arm.structure, measured[:1], values, 1e-4 * np.eye(len(values)))
    assert list(found.coefficients) == ["p15"]
