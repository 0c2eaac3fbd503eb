"""Effects with a past, against brute force and closed forms."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from scipy import signal

from robot_ident.effects import Torques, make_effect
from robot_ident.effects.effort_filter import EffortFilter
from robot_ident.effects.hysteresis import ELEMENTS, behind_play, dahl, maxwell_slip, stretches
from robot_ident.robot import load_robot
from robot_ident.signals.derivatives import delayed, derivatives
from robot_ident.signals.filters import driven, ringing
from robot_ident.signals.motion import Array, Motion
from robot_ident.trajectories.fourier_series import FourierSeries

SERIES = FourierSeries(0.1, np.array([0.1, 0.0, 0.2]), *0.25 * np.random.default_rng(3).normal(size=(2, 3, 5)))


def one_period(samples: int = 1500, *, later: float = 0.0) -> Motion:
    dt = SERIES.period / samples
    m = SERIES.motion(np.arange(samples) * dt - later)
    return Motion(m.q, m.dq, m.ddq, dt=dt, periodic=True)


def integrated_dahl(scale: float, periods: int) -> Array:
    """Return the last of some periods of dz/dt = |dq| (sign(dq) - z) / scale from z = 0, by small steps in time."""
    fine, dt = 60_000, SERIES.period / 60_000
    speed = SERIES.motion((np.arange(fine) + 0.5) * dt).dq[:, 0]
    rate, s = np.abs(speed) * dt / scale, np.sign(speed)
    z, out = 0.0, np.empty(fine)
    for _ in range(periods):
        for k, (r, sign) in enumerate(zip(rate.tolist(), s.tolist(), strict=True)):
            out[k] = z
            z = (z * (1 - r / 2) + r * sign) / (1 + r / 2)  # the trapezoidal rule
    return out[:: fine // 1500]


@pytest.mark.parametrize("scale", [0.002, 0.02, 0.5])
def test_dahl_is_in_the_steady_state_of_many_periods(scale: float) -> None:
    z = dahl(one_period().q[:, 0], scale, periodic=True)
    expected = integrated_dahl(scale, 5 if scale > 0.1 else 2)
    assert np.abs(z - expected).max() < 0.02  # a reversal falls between two samples
    assert np.sqrt(np.mean((z - expected) ** 2)) < 2e-3


def test_dahl_forgets_where_it_started_over_a_period() -> None:
    q = one_period().q[:, 0]
    again = dahl(np.tile(q, 3), 0.5, periodic=False)[-len(q) :]
    np.testing.assert_allclose(dahl(q, 0.5, periodic=True), again, atol=1e-6)


def test_maxwell_slip_is_elements_that_slide_one_after_another() -> None:
    scale, q = 0.01, np.tile(one_period().q[:, 0], 2)
    z = np.zeros(len(ELEMENTS))
    out = []
    for step in np.diff(q, prepend=q[0]):
        z = np.clip(z + step / (np.array(ELEMENTS) * scale), -1.0, 1.0)
        out.append(z.mean())
    np.testing.assert_allclose(maxwell_slip(q, scale, periodic=False), out, atol=1e-12)
    np.testing.assert_allclose(maxwell_slip(q[:1500], scale, periodic=True), out[1500:], atol=1e-12)


def test_friction_behind_a_play_is_met_once_the_gap_is_crossed() -> None:
    gap, rise, q = 0.05, 0.01, np.tile(one_period().q[:, 0], 2)
    d, out = 0.0, []
    for step in np.diff(q, prepend=q[0]):
        d = min(max(d + step, -gap / 2 - rise), gap / 2 + rise)
        out.append(np.sign(d) * min(max((abs(d) - gap / 2) / rise, 0.0), 1.0))
    np.testing.assert_allclose(behind_play(q, gap, rise, periodic=False), out, atol=1e-12)
    np.testing.assert_allclose(behind_play(q[:1500], gap, rise, periodic=True), out[1500:], atol=1e-12)
    turn = np.concatenate([np.linspace(0.0, 0.2, 201), np.linspace(0.199, 0.1, 100)])  # a millirad a sample
    z = behind_play(turn, gap, rise, periodic=False)
    assert z[200] == 1.0 and np.all(z[211:259] == 0.0) and np.all(z[271:] == -1.0)


def test_stretches_end_at_reversals() -> None:
    q = np.array([0.0, 0.0, 1.0, 2.0, 2.0, 1.0, 1.0, 3.0])
    assert list(stretches(q)) == [(0, 4, 1.0), (4, 6, -1.0), (6, 7, 1.0)]
    assert list(stretches(np.ones(4))) == []


@pytest.mark.parametrize("form", [0.0, 1.0])
def test_presliding_leaves_the_sliding_level_to_coulomb(form: float) -> None:
    robot = load_robot()
    motion = one_period()
    column = make_effect("presliding@joint_1", robot, {"form": form, "x0": 0.005}).columns(motion)[:, 0, 0]
    assert np.all(np.sign(motion.dq[:, 0]) * column <= 1e-12)  # it only lacks friction
    path = np.concatenate([np.linspace(0, 0.5, 300), np.linspace(0.5, 0.0, 300)])
    alone = Motion(np.tile(path[:, None], 3), np.tile(np.gradient(path)[:, None], 3), np.zeros((600, 3)), dt=0.01)
    away = make_effect("presliding@joint_1", robot, {"form": form, "x0": 0.005}).columns(alone)[:, 0, 0]
    assert away[1] < -0.4 and abs(away[299]) < 1e-3 and abs(away[-1]) < 1e-3
    assert away[301] > 1.2  # after a reversal the whole swing of friction is missing


def test_derivatives_along_a_period_are_exact_and_close_without_it() -> None:
    motion = one_period()
    dq, ddq = derivatives(motion.q, motion)
    np.testing.assert_allclose(dq, motion.dq, atol=1e-9)
    np.testing.assert_allclose(ddq, motion.ddq, atol=1e-7)
    open_ended = Motion(motion.q, motion.dq, motion.ddq, dt=motion.dt)
    dq, ddq = derivatives(open_ended.q, open_ended)
    np.testing.assert_allclose(dq, motion.dq, atol=2e-3)
    np.testing.assert_allclose(ddq[2:-2], motion.ddq[2:-2], atol=2e-2)


@pytest.mark.parametrize("delay", [0.0, 0.0031, -0.0127, 0.5])
@pytest.mark.parametrize("periodic", [True, False])
def test_a_delayed_signal_is_the_signal_of_then(delay: float, periodic: bool) -> None:
    motion, then = one_period(), one_period(later=delay)
    motion = Motion(motion.q, motion.dq, motion.ddq, dt=motion.dt, periodic=periodic)
    inside = slice(None) if periodic else slice(80, -80)
    np.testing.assert_allclose(delayed(motion.dq, motion, delay)[inside], then.dq[inside], atol=5e-5)


def test_delayed_steps_do_not_ring() -> None:
    motion = one_period()
    shifted = delayed(np.sign(motion.dq), motion, 0.004)
    assert np.abs(shifted).max() <= 1.0


@pytest.mark.parametrize("delay", [0.004, -0.009])
def test_time_delay_is_found_in_milliseconds(delay: float) -> None:
    motion, robot = one_period(), load_robot()
    tau = 100.0 * motion.dq + 20.0 * motion.ddq + 15.0 * np.sign(motion.dq)
    measured = one_period(later=delay)
    late = 100.0 * measured.dq + 20.0 * measured.ddq + 15.0 * np.sign(measured.dq)
    effect = make_effect("time_delay", robot, {"shift": delay})
    column = effect.columns(motion, Torques(tau, tau, None, 15.0 * np.sign(motion.dq))).ravel()
    change = (late - tau).ravel()
    found = float(column @ change / (column @ column))
    assert found == pytest.approx(1000.0 * delay, rel=1e-3)
    assert np.abs(change - found * column).max() < 0.1, "steps of friction fall between the right samples"
    smooth = Torques(tau, 100.0 * motion.dq + 20.0 * motion.ddq)
    exact = 1000.0 * delay * effect.columns(motion, smooth)[:, :, 0]
    expected = 100.0 * (measured.dq - motion.dq) + 20.0 * (measured.ddq - motion.ddq)
    np.testing.assert_allclose(exact, expected, atol=2e-2)


@pytest.mark.parametrize("order", [1, 2])
def test_an_effort_filter_is_the_butterworth_filter_that_is_as_late(order: int) -> None:
    """Its column is (F[tau] - tau) / T in Nm per ms; by scipy, line by line, below a tenth of the sample rate."""
    motion, robot, late = one_period(), load_robot(), 0.014
    tau = 100.0 * motion.dq + 20.0 * motion.ddq + 15.0 * np.sign(motion.dq)
    effect = EffortFilter(robot, None).at({"T": late, "order": float(order)})
    corner = {1: 1.0, 2: np.sqrt(2.0)}[order] / late  # rad/s at which |F| = 1 / sqrt(2)
    frequency = np.fft.rfftfreq(len(tau), motion.dt)
    slow = frequency < 15.0
    _, response = signal.freqs(*signal.butter(order, corner, analog=True), worN=2.0 * np.pi * frequency[slow])
    expected = np.fft.rfft(tau, axis=0)[slow] * (response[:, None] - 1.0) / (1000.0 * late)
    found = np.fft.rfft(effect.columns(motion, Torques(tau, tau))[:, :, 0], axis=0)[slow]
    assert np.abs(found - expected).max() < 0.02 * np.abs(expected).max()
    assert np.linalg.norm(found - expected) < 0.02 * np.linalg.norm(expected)


def test_drift_shows_in_a_long_recording_alone() -> None:
    robot, motion = load_robot(), one_period()
    effect = make_effect("temperature_drift@joint_1", robot, {"T0": 5.0})
    assert "from period to period" in str(effect.hidden_in(motion))
    assert not np.any(effect.columns(motion))
    long = Motion(motion.q, motion.dq, motion.ddq, dt=motion.dt)
    assert effect.hidden_in(long) is None
    expected = motion.dq[:, 0] * np.exp(-np.arange(1500) * motion.dt / 5.0)
    np.testing.assert_allclose(effect.columns(long)[:, 0, 0], expected)
    assert "nothing drifts" in str(effect.at({"T0": 3000.0}).hidden_in(long))


def test_drift_of_an_average_is_the_mean_of_its_periods() -> None:
    robot, motion = load_robot(), one_period()
    effect = make_effect("temperature_drift@joint_1", robot, {"T0": 25.0})
    began = (3.0, 13.0, 33.0)
    single = [effect.columns(replace(motion, began=(start,))) for start in began]
    np.testing.assert_allclose(effect.columns(replace(motion, began=began)), np.mean(single, axis=0), atol=1e-12)
    t = 13.0 + np.arange(1500) * (motion.dt or 0.0)
    np.testing.assert_allclose(single[1][:, 0, 0], motion.dq[:, 0] * np.exp(-t / 25.0))


@pytest.mark.parametrize(("frequency", "damping"), [(0.7, 0.002), (2.0, 0.2), (9.0, 0.02)])
def test_a_driven_mass_moves_as_its_frequency_response_says(frequency: float, damping: float) -> None:
    """Settled over a period, however little damped: X = F / (k - m w^2 + i d w)."""
    motion, m, w = one_period(6000), 1.7, 2.0 * np.pi * frequency
    one = np.ones(motion.samples)
    k, d = m * w**2, 2.0 * damping * m * w
    force = motion.ddq[:, 0] + 3.0
    found = driven(motion, force, m * one, d * one, k * one)
    at = 2.0 * np.pi * np.fft.rfftfreq(motion.samples, motion.dt)
    line = np.fft.rfft(force) / (k - m * at**2 + 1j * d * at)
    for order, x in enumerate(found):
        true = np.fft.irfft(line * (1j * at) ** order, motion.samples)
        assert np.abs(x - true).max() < 2e-3 * np.abs(true).max()


@pytest.mark.parametrize("periodic", [True, False])
def test_a_mass_rings_at_its_frequency_where_samples_are_few(periodic: bool) -> None:
    """At 9 Hz, sampled at 125 Hz, under a force of 8.9 Hz that the rule of constant acceleration sees 1.6 % higher."""
    motion, w = replace(one_period(1250), periodic=periodic), 2.0 * np.pi * 9.0
    assert motion.dt is not None
    one, at, t = np.ones(motion.samples), 2.0 * np.pi * 8.9, np.arange(motion.samples) * motion.dt
    made = 0.7 * np.exp(1j * at * t) / (w**2 - at**2 + 2j * 0.02 * w * at)
    parts = (0.7 * np.cos(at * t), one, 2.0 * 0.02 * w * one, w**2 * one)
    true, settled = np.real(made), slice(None) if periodic else slice(625, None)
    finely, coarsely = (f(motion, *parts)[0][settled] for f in (ringing, driven))
    size = np.linalg.norm(true[settled])
    assert np.linalg.norm(finely - true[settled]) < 0.05 * size
    assert np.linalg.norm(coarsely - true[settled]) > 0.2 * size


def test_a_mass_that_changes_settles_to_the_same_motion_after_many_periods() -> None:
    motion = one_period(2000)
    periods = 12
    inertia = 2.0 + np.sin(motion.q[:, 1])
    stiffness = 2.0 * (2.0 * np.pi * 3.0) ** 2 + 20.0 * np.cos(motion.q[:, 0])
    parts = (motion.ddq[:, 2], inertia, np.full(2000, 2.0), stiffness)
    settled = driven(motion, *parts)
    long = Motion(*(np.tile(x, (periods, 1)) for x in (motion.q, motion.dq, motion.ddq)), dt=motion.dt)
    slowly = driven(long, *(np.tile(x, periods) for x in parts))
    for once, many in zip(settled, slowly, strict=True):
        np.testing.assert_allclose(many[-1500:-500], once[500:1500], atol=1e-5 * np.abs(once).max())


def test_a_mass_at_rest_stays_where_its_force_holds_it() -> None:
    motion = one_period(500)
    once, one = replace(motion, periodic=False), np.ones(500)
    x, dx, ddx = driven(once, 6.0 * one, 2.0 * one, 0.1 * one, 30.0 * one)
    np.testing.assert_allclose(x, 0.2, rtol=1e-9)
    assert max(np.abs(dx).max(), np.abs(ddx).max()) < 1e-6
