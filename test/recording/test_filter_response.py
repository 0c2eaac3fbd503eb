"""The anti-alias filter from its frequency response, and what undoing it is worth."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from robot_ident.errors import InputError
from robot_ident.estimation.identify import estimate
from robot_ident.model.structure import Structure
from robot_ident.planning.blends import Playback
from robot_ident.recording.process import process
from robot_ident.recording.torque_channel import FrequencyResponse, between, identify_filter
from robot_ident.robot.anti_alias import AntiAlias
from robot_ident.testbed.simulation import simulate
from robot_ident.trajectories.excitation import Excitation

TRUE = AntiAlias.of_sections([(41.0, 0.52), (39.5, 0.63), (40.6, 0.88), (39.9, 2.4)])


def measured(filter_: AntiAlias, seed: int, noise: float = 0.005, gain: float = 1.02) -> FrequencyResponse:
    rng = np.random.default_rng(seed)
    f = np.geomspace(1.0, 110.0, 120)
    error = noise * (rng.standard_normal(120) + 1j * rng.standard_normal(120))
    return FrequencyResponse(f, gain * filter_.response(f) * (1.0 + error), np.ones(120, dtype=bool), None, "analyser")


def test_sections_of_a_butterworth_filter_are_that_filter() -> None:
    from scipy import signal

    for order in (1, 2, 5, 8):
        plain = AntiAlias(order, 40.0)
        z, p, k = signal.butter(order, 2 * np.pi * 40.0, analog=True, output="zpk")
        f = np.linspace(0.1, 120.0, 50)
        _, h = signal.freqs_zpk(z, p, k, 2 * np.pi * f)
        np.testing.assert_allclose(plain.response(f), h, rtol=1e-9)
        pairs = [pole for pole in p if pole.imag > 1.0]
        sections = [(abs(pole) / (2 * np.pi), abs(pole) / (-2 * pole.real)) for pole in pairs] + [(40.0,)] * (order % 2)
        same = AntiAlias.of_sections(sections)
        np.testing.assert_allclose(same.response(f), h, rtol=1e-9)
        assert same.order == order
        assert same.cutoff == pytest.approx(40.0, rel=1e-9)
        assert same.passes(0.5) == pytest.approx(plain.passes(0.5), rel=1e-9)
    assert AntiAlias(8, 40.0).delay == pytest.approx(0.0204, abs=1e-4)  # the paper's filter: a delay of 20 ms


@pytest.mark.long
def test_order_and_response_are_found_with_honest_uncertainty() -> None:
    orders, far = [], []
    for seed in range(20):
        found = identify_filter(measured(TRUE, seed))
        orders.append(found.filter.order)
        fixed = identify_filter(measured(TRUE, seed), order=8)
        far.append((fixed.gain - 1.02) / fixed.gain_deviation)
        f = np.array([0.5, 5.0, 20.0, 40.0])
        np.testing.assert_allclose(found.filter.response(f), TRUE.response(f), rtol=0.01)
        assert found.misfit == pytest.approx(0.005, rel=0.3)
    assert orders.count(8) >= 18
    assert 0.5 < np.std(far) < 1.6


@pytest.mark.long
def test_bessel_and_chebyshev_filters_are_found_too() -> None:
    from scipy import signal

    for z, p, _ in (signal.bessel(4, 2 * np.pi * 25.0, analog=True, output="zpk", norm="mag"), cheby()):
        assert not len(z)
        pairs = [pole for pole in p if pole.imag > 1e-6]
        true = AntiAlias.of_sections([(abs(x) / (2 * np.pi), abs(x) / (-2 * x.real)) for x in pairs])
        found = identify_filter(measured(true, 1))
        assert found.filter.order == len(p)
        assert found.filter.delay == pytest.approx(true.delay, rel=0.01)


def cheby() -> Any:
    from scipy import signal

    return signal.cheby1(6, 1.0, 2 * np.pi * 50.0, analog=True, output="zpk")


def test_a_file_is_read_as_it_was_written(tmp_path: Path) -> None:
    path = tmp_path / "response.csv"
    made = replace(measured(TRUE, 3), deviation=np.full(120, 0.005))
    gain, phase = np.abs(made.value), np.rad2deg(np.angle(made.value))
    rows = zip(made.frequency, gain, phase, 0.005 * gain, strict=True)
    path.write_text(
        "frequency,gain,phase,deviation\n" + "".join(f"{','.join(map(repr, map(float, row)))}\n" for row in rows)
    )
    read = FrequencyResponse.read(path)
    np.testing.assert_allclose(read.value, made.value, rtol=1e-6)
    found = identify_filter(read)
    assert found.chi_square is not None
    assert 0.7 < found.chi_square / found.dof < 1.3


@pytest.mark.parametrize(
    ("text", "told"),
    [
        ("f,gain\n1,2\n", "no column frequency, phase"),
        ("frequency,gain,phase\n1,1,0\n", "1 points"),
        ("frequency,gain,phase\n" + "".join(f"{k},{-k},0\n" for k in range(1, 9)), "must be positive"),
        ("frequency,gain,phase\n" + "".join(f"{k},x,0\n" for k in range(1, 9)), "line 2"),
        ("frequency,gain,phase\n" + "".join(f"{k},1,0\n" for k in range(1, 9)), "measure beyond"),
    ],
)
def test_what_is_no_response_is_refused(text: str, told: str, tmp_path: Path) -> None:
    path = tmp_path / "bad.csv"
    path.write_text(text)
    with pytest.raises(InputError, match=told):
        identify_filter(FrequencyResponse.read(path))


def test_two_recordings_tell_the_filter_and_undoing_it_leaves_no_misfit(arm: Any) -> None:
    off, real = (replace(arm.robot, anti_alias=kinds) for kinds in ((), (TRUE,) * 3))
    motion = Excitation(off.name, off.joints, arm.series, 150.0)
    played = Playback(motion, off, 8)
    steady = (played.transient, motion.period, 8)
    plain = simulate(off, played, sample_rate=150.0, steady=steady, seed=1).recording
    filtered = simulate(real, played, sample_rate=150.0, steady=steady, seed=2, anti_alias=True).recording
    response = between(process(filtered, off), process(plain, off))
    assert response.with_phase.any()
    assert not response.with_phase.all(), "the noise tells the gain above the lines"
    found = identify_filter(response)
    assert found.filter.delay == pytest.approx(TRUE.delay, rel=0.03)
    f = np.array([1.0, 5.0, 10.0])
    np.testing.assert_allclose(found.filter.response(f), TRUE.response(f), rtol=0.03)

    def ratio(kinds: tuple[AntiAlias | None, ...]) -> float:
        robot = replace(arm.robot, anti_alias=kinds)
        model = estimate([process(filtered, robot)], Structure.build(robot))
        assert model.chi_square and model.dof
        return model.chi_square / model.dof

    assert ratio((found.filter,) * 3) < 1.15
    assert ratio(()) > 1.5
