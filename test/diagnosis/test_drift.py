"""Drift: found in what periods differ by, added as an effect of its own time, gone from the error on other motion."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from robot_ident.diagnosis.diagnose import diagnose
from robot_ident.diagnosis.drift import drift_tests
from robot_ident.effects import make_effect
from robot_ident.errors import InputError
from robot_ident.estimation.equations import apart
from robot_ident.estimation.identify import estimate
from robot_ident.model.structure import Structure
from robot_ident.recording.measurement import Measurement
from robot_ident.regression.evidence import gather
from robot_ident.signals.motion import Array

DRIFT = ("temperature_drift@joint_1:temperature_drift=8,time_constant=40",)
COLUMN = "temperature_drift@joint_1"


def test_drift_is_found_added_and_gone(bench: Any) -> None:
    measured, (unseen,) = bench.measure(DRIFT, noise=1.0), bench.measure(DRIFT, [3])
    found = diagnose(measured, bench.structure, [unseen])
    (finding,) = found.missing
    assert finding.label == COLUMN
    assert finding.validation_after["joint_1"] < finding.validation_before["joint_1"]
    level, span = finding.parameters
    assert level.value == pytest.approx(8.0, abs=4.0 * level.std)
    assert span.value == pytest.approx(40.0, abs=4.0 * span.std)
    plain, longer = (estimate(measured, s) for s in (bench.structure, Structure.build(bench.robot, [finding.effect])))
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


WARMING, LASTS = 4.0, 12.0  # Nm s/rad above the warm friction, s


def with_friction(measured: Measurement, joint: int, extra: Array) -> Measurement:
    """Return a measurement whose periods have `extra` [M, N] Nm s/rad more viscous friction at a joint."""
    assert measured.period_torque is not None
    periods = measured.period_torque.copy()
    periods[:, :, joint] += extra * measured.motion.dq[:, joint]
    return replace(measured, period_torque=periods, torque=np.nanmean(periods, axis=0))


def clock(measured: Measurement) -> Array:
    """Return when each sample [M, N] was taken, s after the first of the recording."""
    return np.array(measured.motion.began)[:, None] + np.arange(measured.motion.samples) * measured.dt


def test_a_warming_that_soon_ends_is_told_where_a_straight_line_is_not(bench: Any) -> None:
    cold = [with_friction(m, 1, WARMING * np.exp(-clock(m) / LASTS)) for m in bench.measure((), noise=1.0)]
    tests = drift_tests(gather(cold, bench.structure))
    assert [test.told for test in tests] == [False, True, False]
    straight = 0.0
    for m in cold:
        assert m.period_torque is not None
        v = m.motion.dq[:, 1]
        friction = m.period_torque[:, :, 1] @ v / (v @ v)
        slope = np.polyfit(np.arange(m.periods), friction, 1)[0]
        straight += (
            slope**2 * np.sum((np.arange(m.periods) - (m.periods - 1) / 2) ** 2) * (v @ v) / m.torque_variance[1]
        )
    assert straight < 0.85 * tests[1].gain
    rising = [with_friction(m, 1, -WARMING * np.exp(-clock(m) / LASTS)) for m in bench.measure((), noise=1.0)]
    assert not any(test.told for test in drift_tests(gather(rising, bench.structure)))


def test_friction_that_scatters_from_period_to_period_is_no_warming(bench: Any) -> None:
    plain = bench.measure((), noise=1.0)
    told = gains = 0
    for seed in range(20):
        rng = np.random.default_rng(seed)
        restless = [with_friction(m, 0, 3.0 * rng.standard_normal((m.periods, 1))) for m in plain]
        found = drift_tests(gather(restless, bench.structure))[0]
        told, gains = told + found.told, gains + (found.gain > 40.0)
    assert gains >= 2, "beside the noise of all lines it would be taken for a trend"
    assert told == 0


def test_a_warming_of_no_torque_to_speak_of_gets_no_name(bench: Any) -> None:
    """However surely a quiet sensor shows it."""
    faint, clear = (
        [with_friction(m, 1, size * np.exp(-clock(m) / LASTS)) for m in bench.measure((), noise=1e-6)]
        for size in (WARMING / 100.0, WARMING)
    )
    few, many = (drift_tests(gather(measured, bench.structure))[1] for measured in (faint, clear))
    assert few.p_value < 1e-12
    assert not few.told
    assert many.told
    assert many.torque == pytest.approx(100.0 * few.torque, rel=0.05)  # the time constant is found to a tenth
    extra = [(WARMING * np.exp(-clock(m) / LASTS), m.motion.dq[:, 1]) for m in bench.measure((), noise=1e-6)]
    changes = [(friction - friction.mean(axis=0)) * v for friction, v in extra]
    assert many.torque == pytest.approx(float(np.sqrt(np.mean(np.square(np.concatenate(changes))))), rel=0.05)
