"""Drift: found in what periods differ by, added as an effect of its own time, gone from the error on other motion."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from robot_ident.diagnosis.diagnose import diagnose
from robot_ident.effects import make_effect
from robot_ident.errors import InputError
from robot_ident.estimation.apart import apart
from robot_ident.estimation.identify import estimate
from robot_ident.model.structure import Structure

DRIFT = ("temperature_drift@joint_1:temperature_drift=8,time_constant=40",)
COLUMN = "temperature_drift@joint_1"


def test_drift_is_found_added_and_gone(bench: Any) -> None:
    measured, (unseen,) = bench.measure(DRIFT, noise=1.0), bench.measure(DRIFT, [3])
    found = diagnose(measured, bench.structure, [unseen])
    (suspect,) = found.missing
    assert suspect.label == COLUMN
    assert suspect.validation_after["joint_1"] < suspect.validation_before["joint_1"]
    level, span = suspect.parameters
    assert level.value == pytest.approx(8.0, abs=4.0 * level.std)
    assert span.value == pytest.approx(40.0, abs=4.0 * span.std)
    plain, longer = (estimate(measured, s) for s in (bench.structure, Structure.build(bench.robot, [suspect.effect])))
    assert longer.residual["joint_1"].noise_variance == pytest.approx(plain.residual["joint_1"].noise_variance)
    began = replace(unseen.motion, began=unseen.motion.began[:1])
    assert unseen.period_torque is not None
    cold = unseen.period_torque[0]
    errors = [np.mean((cold - model.predict(began))[unseen.used[:, 0], 0] ** 2) for model in (plain, longer)]
    noise = unseen.torque_variance[0]
    assert errors[1] - noise < 0.1 * (errors[0] - noise), "the first period is the coldest"
    again = diagnose(measured, longer.structure)
    assert COLUMN not in {s.label for s in again.missing}


def test_periods_taken_apart_are_the_whole(bench: Any) -> None:
    (whole,) = bench.measure((), [0], noise=1.0)
    drift = make_effect(COLUMN, bench.robot)
    parts = apart([whole], [drift])
    assert len(parts) == 4
    assert apart([whole], []) == [whole]
    assert sum(part.periods for part in parts) == whole.periods
    assert tuple(t for part in parts for t in part.motion.began) == whole.motion.began
    weights = np.array([part.periods for part in parts]) / whole.periods
    np.testing.assert_allclose(np.einsum("g,gij->ij", weights, [part.torque for part in parts]), whole.torque)
    np.testing.assert_allclose(
        np.sum(1.0 / np.array([p.averaged_variance for p in parts]), axis=0), 1.0 / whole.averaged_variance
    )


def test_an_average_alone_shows_no_drift(bench: Any) -> None:
    (whole,) = bench.measure((), [0], noise=1.0)
    structure = Structure.build(bench.robot, [COLUMN])
    with pytest.raises(InputError, match=r"temperature_drift@joint_1 can't be estimated.*single periods"):
        estimate([replace(whole, period_torque=None)], structure)
