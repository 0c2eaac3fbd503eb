"""Samples that weren't measured, or not on one robot, are refused; odd ones that were are not."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from robot_ident.errors import InputError
from robot_ident.recording import Recording
from robot_ident.recording.checks import check_samples, refuse_same_rows

NAMES = ("a", "b", "c")


def recorded(rate: float, seed: int = 0, seconds: float = 20.0, phase: float = 0.0, step: float = 1e-5) -> Recording:
    """Return a smooth motion as an encoder and a noisy sensor of torque report it."""
    random, t = np.random.default_rng(seed), np.arange(0.0, seconds, 1.0 / rate)
    frequency = np.array([0.2, 0.3, 0.5])
    q = np.round(np.sin(2 * np.pi * t[:, None] * frequency + phase) / step) * step
    return Recording(NAMES, t, q, 20.0 * q + random.normal(0.0, 0.3, q.shape), source=f"seed {seed}")


def at_rate(recording: Recording, rate: float, kind: str) -> Recording:
    from scipy.interpolate import interp1d

    t = np.arange(recording.t[0], recording.t[-1], 1.0 / rate)
    q, tau = (interp1d(recording.t, x, kind=kind, axis=0)(t) for x in (recording.q, recording.tau))
    return replace(recording, t=t, q=q, tau=tau)


@pytest.mark.parametrize(("measured", "told"), [(150.0, 4000.0), (100.0, 1000.0), (125.0, 500.0), (100.0, 777.0)])
def test_interpolated(measured: float, told: float) -> None:
    with pytest.raises(InputError, match="interpolated from about") as caught:
        check_samples(at_rate(recorded(measured), told, "linear"))
    assert abs(float(str(caught.value).split("from about ")[1].split()[0]) / measured - 1.0) < 0.05
    only = at_rate(recorded(measured), told, "linear")
    noisy = replace(only, q=only.q + np.random.default_rng(1).normal(0.0, 1e-4, only.q.shape))
    with pytest.raises(InputError, match="the efforts lie on straight lines"):
        check_samples(noisy)
    check_samples(noisy, motion_only=True)


def two_robots(fast: float, slow: float) -> Recording:
    one, other = recorded(fast), recorded(slow, 1, phase=1.0)
    t = np.concatenate([one.t, other.t + 0.4 / fast])
    order = np.argsort(t)
    q, tau = np.vstack([one.q, other.q])[order], np.vstack([one.tau, other.tau])[order]
    return Recording(NAMES, t[order], q, tau)


@pytest.mark.parametrize(("fast", "slow"), [(100.0, 100.0), (500.0, 100.0), (200.0, 150.0)])
def test_two_robots_on_one_topic(fast: float, slow: float) -> None:
    with pytest.raises(InputError, match="two publishers"):
        check_samples(two_robots(fast, slow))


@pytest.mark.parametrize("sign", [1.0, -1.0])
def test_one_effort_under_two_names(sign: float) -> None:
    recording = recorded(100.0)
    tau = np.array(recording.tau)
    tau[:, 2] = sign * tau[:, 0]
    with pytest.raises(InputError, match="the effort of c is that of a"):
        check_samples(replace(recording, tau=tau))


@pytest.mark.parametrize("bits", [12, 16])
@pytest.mark.parametrize("share", [0.2, 0.25, 1 / 3, 0.4001])
def test_steady_speeds_on_an_encoder_are_taken(bits: int, share: float) -> None:
    """At so many counts and a share of one a sample the positions bend every so many samples, by one count."""
    step = 2.0 * np.pi / 2**bits
    speeds = np.repeat((np.array([7, -11, 19, -27, 9]) + share) * step, 1400)
    q = np.round(np.cumsum(speeds) / step)[:, None] * step
    tau = np.sign(speeds)[:, None] + np.random.default_rng(1).normal(0.0, 0.1, q.shape)
    check_samples(Recording(("shaft",), np.arange(len(q)) / 250.0, q, tau))


@pytest.mark.parametrize("step", [1e-5, 1e-3, 1e-2])
@pytest.mark.parametrize("rate", [20.0, 100.0, 1000.0])
def test_what_was_measured_is_taken(step: float, rate: float) -> None:
    """Coarse encoders, joints at rest, positions without noise, quantised and smooth torques."""
    recording = recorded(rate, step=step)
    check_samples(recording)
    check_samples(replace(recording, tau=np.round(recording.tau)))
    check_samples(replace(recording, tau=20.0 * recording.q))
    still = np.array(recording.q)
    still[:, 1] = step * np.random.default_rng(2).integers(0, 2, len(still))
    check_samples(replace(recording, q=still))
    trapezoid = np.clip(np.abs((recording.t[:, None] * [0.2, 0.3, 0.5]) % 2.0 - 1.0), 0.1, 0.9)
    check_samples(replace(recording, q=trapezoid))
    if rate < 1000.0:
        check_samples(at_rate(recording, 10.0 * rate, "cubic"))  # a smooth path says nothing of its rate


@pytest.mark.parametrize("rows", [slice(None, None, 2), slice(500, 1500), slice(None, None, 3)])
def test_a_part_of_a_recording_beside_it(rows: slice) -> None:
    recording = recorded(100.0)
    part = replace(recording[rows], t=recording.t[rows] - 3.0)
    with pytest.raises(InputError, match="holds the samples of"):
        refuse_same_rows([recorded(100.0, 3), recording, part])


def test_repetitions_are_no_copies() -> None:
    """Positions of a servo may repeat to the last digit, and a robot may stand."""
    one, other = recorded(100.0, 0), recorded(100.0, 1)
    refuse_same_rows([one, other])
    rest = [replace(x, q=np.where(x.t[:, None] < 15.0, x.q[0], x.q)) for x in (one, other)]
    refuse_same_rows([replace(x, tau=np.where(x.t[:, None] < 15.0, 1.0, x.tau)) for x in rest])
