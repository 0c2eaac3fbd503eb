"""Low passes over the effort, of the forms that drives have: told from friction that comes late, and from a delay."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from scipy import signal

from robot_ident.diagnosis.diagnose import diagnose
from robot_ident.diagnosis.diagnosis import FRICTION, Diagnosis
from robot_ident.diagnosis.measuring.filtered import LOW_PASSES, WITHOUT_PHASE, Passage
from robot_ident.diagnosis.measuring.lookalikes import with_line
from robot_ident.recording import process

RATE = 150.0
Filter = Callable[[np.ndarray], np.ndarray]


def butterworth(tau: np.ndarray) -> np.ndarray:
    """Return it as a script would filter what was recorded: second order, 10 Hz."""
    return np.asarray(signal.lfilter(*signal.butter(2, 10.0, fs=RATE), tau))


def smoothed(tau: np.ndarray) -> np.ndarray:
    """Return y_k = y_(k-1) + 0.4 (x_k - y_(k-1))."""
    y = np.empty_like(tau)
    y[0] = tau[0]
    for k in range(1, len(tau)):
        y[k] = y[k - 1] + 0.4 * (tau[k] - y[k - 1])
    return y


def averaged(tau: np.ndarray) -> np.ndarray:
    """Return the mean of the last nine samples."""
    return np.array([tau[max(0, k - 8) : k + 1].mean() for k in range(len(tau))])


def two_lags(tau: np.ndarray) -> np.ndarray:
    """Return it behind two lags of 12 ms, integrated in steps of a twentieth of a sample."""
    fine = np.interp(np.arange(20 * len(tau)) / 20.0, np.arange(len(tau)), tau)
    first, second, share, out = fine[0], fine[0], 1.0 / (20.0 * RATE * 0.012), []
    for k, x in enumerate(fine):
        first += share * (x - first)
        second += share * (first - second)
        if k % 20 == 0:
            out.append(second)
    return np.array(out)


def found_behind(bench: Any, filtered: Filter, joint: int, noise: float = 0.1) -> Diagnosis:
    """Return what is said of a joint's effort behind a filter that has settled for a period."""
    measured = []
    for motion in (0, 1, 2):
        recording = bench.record([], motion, noise=noise)
        tau = recording.tau.copy()
        tau[:, joint] = filtered(np.concatenate([tau[:1500, joint], tau[:, joint]]))[1500:]
        measured.append(process(replace(recording, tau=tau), bench.robot))
    return diagnose(measured, bench.structure)


@pytest.mark.parametrize(
    ("filtered", "cutoff"),
    [
        (butterworth, 10.0),
        *(pytest.param(*one, marks=pytest.mark.long) for one in ((smoothed, 12.2), (averaged, 7.4), (two_lags, 8.5))),
    ],
)
def test_a_low_pass_of_any_form_is_named_and_no_friction_is(bench: Any, filtered: Filter, cutoff: float) -> None:
    found = found_behind(bench, filtered, 0)
    assert [s.label for s in found.missing] == ["effort_filter@joint_1"]
    (named,) = found.missing
    assert named.parameters[0].value == pytest.approx(cutoff, rel=0.08)
    assert named.fix and "anti_alias" in named.fix


def test_a_delay_says_the_line_that_takes_it_out(bench: Any) -> None:
    found = found_behind(bench, lambda tau: np.concatenate([tau[:2], tau[:-2]]), 0)
    assert [s.label for s in found.missing] == ["time_delay@joint_1"]
    (named,) = found.missing
    value = named.parameters[0].value / 1000.0
    assert value == pytest.approx(2.0 / 150.0, rel=0.05)
    assert named.fix == f"joints: {{joint_1: {{torque_delay: {value:.4g}}}}}  # s, in the robot YAML"

    steps = replace(named.parameters[1], value=3.0 * value)
    both = with_line(replace(named, fix=None, parameters=(named.parameters[0], steps)))
    assert both.fix == f"{named.fix}: of the torque as a whole; its steps at reversals are late by {3 * value:.4g}"


@pytest.mark.long
def test_a_fast_low_pass_may_be_a_delay_but_no_friction(bench: Any) -> None:
    """A smoothing of 2 ms beside the noise of the paper: the data tell it from nothing that is late."""
    found = found_behind(bench, lambda x: np.asarray(signal.lfilter([0.75], [1.0, -0.25], x)), 0, noise=1.0)
    assert not {s.effect.name for s in found.missing} & FRICTION
    for one in found.missing:
        assert {"effort_filter@joint_1", "time_delay@joint_1"} <= {one.label, *one.tied_with}
        assert one.experiment


@pytest.mark.long
@pytest.mark.parametrize("effect", ["time_delay@joint_1:0.008", "presliding@joint_3"])
def test_what_looks_like_a_low_pass_keeps_its_name(bench: Any, effect: str) -> None:
    assert [s.label for s in bench.diagnose([effect]).missing] == [effect.partition(":")[0]]


def test_every_form_passes_what_is_slow_and_half_the_power_at_its_cutoff() -> None:
    for form in LOW_PASSES:
        low_pass = Passage(form, 9.0)
        slow, edge = low_pass.response(np.array([1e-6, 9.0]), RATE)
        assert abs(slow - 1.0) < 1e-6, form
        assert abs(edge) == pytest.approx(2**-0.5, rel=1e-4), form
        if form in WITHOUT_PHASE:
            assert low_pass.lag(RATE) == pytest.approx(0.0, abs=1e-12)
            continue
        assert low_pass.lag(RATE) > 0.0
        for other in [other for other in LOW_PASSES if other not in WITHOUT_PHASE]:
            assert low_pass.like(other, RATE).lag(RATE) == pytest.approx(low_pass.lag(RATE), rel=0.1), (form, other)


@pytest.mark.parametrize("order", [1, 2])
def test_filters_from_sample_to_sample_are_those_of_scipy(order: int) -> None:
    form = {1: "first order from sample to sample", 2: "second-order Butterworth from sample to sample"}[order]
    frequency = np.linspace(0.1, 70.0, 40)
    _, h = signal.freqz(*signal.butter(order, 9.0, fs=RATE), worN=frequency, fs=RATE)
    assert np.allclose(Passage(form, 9.0).response(frequency, RATE), h, atol=1e-9)


@pytest.mark.long
@pytest.mark.parametrize(
    ("form", "filtered"),
    [
        ("second-order Butterworth, forward and backward", lambda x: signal.filtfilt(*signal.butter(2, 6 / 75), x)),
        pytest.param(
            "fourth-order Butterworth, forward and backward",
            lambda x: signal.filtfilt(*signal.butter(4, 4 / 75), x),
            marks=pytest.mark.long,
        ),
        ("centred moving average", lambda x: np.convolve(x, np.ones(21) / 21, "same")),
    ],
)
def test_a_filter_without_phase_is_named_as_what_it_is(bench: Any, form: str, filtered: Filter) -> None:
    """A script that smooths a recording shifts nothing in time. Friction that turns smoothly may fit as well: both are
    said then.
    """
    found = found_behind(bench, filtered, 0)
    (named,) = found.missing
    assert "effort_filter@joint_1" in (named.label, *named.tied_with)
    assert named.fix and form in named.fix and "--low-pass" in named.fix
