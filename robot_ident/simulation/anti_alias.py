"""The low pass in front of the torque converter: a causal filter with a real delay."""

from __future__ import annotations

import numpy as np

from robot_ident.errors import InputError
from robot_ident.robot.robot import AntiAlias, Robot
from robot_ident.signals.motion import Array
from robot_ident.simulation.sensors import Sensors

PAPER = AntiAlias(order=8, cutoff=40.0)
"""The filter of the paper's section V: a delay of 20 ms at low frequency."""


def anti_alias_of(robot: Robot, rate: float) -> tuple[AntiAlias | None, ...]:
    """Return the filter [n] of each joint, or the paper's on all where the robot declares none.

    InputError when a cutoff isn't below half of `rate` [Hz].
    """
    kinds = robot.anti_alias if any(robot.anti_alias) else (PAPER,) * robot.n
    for kind in kinds:
        if kind and kind.cutoff >= rate / 2:
            raise InputError(
                f"anti-alias filter: cutoff {kind.cutoff:g} Hz is not below half of the step rate, {rate:g} Hz"
            )
    return kinds


def low_pass(kind: AntiAlias, values: Array, rate: float) -> Array:
    """Return values [N, n], sampled at `rate` [Hz], behind the Butterworth filter, which has settled on the first
    value.

    Discretised by the bilinear rule with its -3 dB kept in place; `rate` far above the cutoff.
    """
    from scipy import signal

    sections = signal.butter(kind.order, kind.cutoff, fs=rate, output="sos")
    settled = signal.sosfilt_zi(sections)[:, :, None] * values[0]
    filtered, _ = signal.sosfilt(sections, values, axis=0, zi=settled)
    return np.asarray(filtered)


def filtered(
    robot: Robot, torque: Array, rate: float, per_sample: int, sensors: Sensors, rng: np.random.Generator
) -> Array:
    """Return the noisy torque [N, n] at the samples behind the filter, of the torque at steps of `rate` [Hz].

    The noise is that of the samples without a filter, from the same generator, as the smooth signal through them that
    holds nothing above half of the sample rate (Shannon): inverting the filter gives the very same noise back.
    """
    kinds = anti_alias_of(robot, rate)
    samples = len(torque) // per_sample
    noise = sensors.read_torque(np.zeros((samples, torque.shape[1])), rng)
    fine = torque + _through(noise, len(torque))
    settled = np.concatenate([torque[:1], fine])  # the filter has settled on the first torque, not on its noise
    columns = [low_pass(k, x[:, None], rate) if k else x[:, None] for k, x in zip(kinds, settled.T, strict=True)]
    return np.hstack(columns)[1::per_sample]


def _through(x: Array, steps: int) -> Array:
    """Return the band-limited signal through samples x [N, n] at `steps` even instants, a multiple of N."""
    lines = np.fft.rfft(x, axis=0)
    if len(x) % 2 == 0:
        lines[-1] *= 0.5
    return np.fft.irfft(lines, steps, axis=0) * (steps / len(x))
