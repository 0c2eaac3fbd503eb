"""How much torque the noise of the positions is worth: whether least squares may take the columns as exact."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from robot_ident.estimation.problem import Solution
from robot_ident.model.structure import Structure
from robot_ident.recording.measurement import Measurement
from robot_ident.signals.motion import Array

_ACCELERATION = 1e-3  # of its rms: noise of the acceleration below which nothing needs to be computed
_TORQUE = 0.1  # of the torque's noise variance: more is worth a word


def acceleration_noise(measured: Measurement) -> Array:
    """Return the noise of the acceleration over its rms [n], from the lines of a periodic motion; 0 elsewhere."""
    lines, variance = measured.line_share, measured.averaged_position_variance
    if lines is None or variance is None or measured.base_frequency is None:
        return np.zeros(len(measured.joints))
    rates = (2.0 * np.pi * measured.base_frequency * np.arange(len(lines))) ** 4
    noise = np.sqrt((lines.T @ rates) * 2.0 * variance / measured.motion.samples)
    size = np.sqrt(np.mean(measured.motion.ddq**2, axis=0))
    return np.asarray(noise / np.maximum(size, 1e-12))


def torque_of_position_noise(measured: Measurement, structure: Structure, values: Array) -> Array:
    """Return the variance [n] (Nm)^2 that the noise of the motion's lines gives the model's torque, mean over time.

    Lines of equal noise sigma^2 / N (twice that but for the mean), cosine and sine alike, give the position a variance
    v_0 at every instant, the velocity v_1, the acceleration v_2, and position and acceleration the covariance -v_1:
    var tau = sum over joints of (dtau/dq)^2 v_0 + ((dtau/ddq)^2 - 2 dtau/dq dtau/dddq) v_1 + (dtau/dddq)^2 v_2.
    Lines count by the share of them that the motion holds, which is what is left of their variance, and by what the low
    pass of the measurement leaves of them.
    """
    from robot_ident.model.derivatives import torque_derivatives

    lines, noise = measured.line_share, measured.averaged_position_variance
    if lines is None or noise is None or measured.base_frequency is None:
        return np.zeros(len(measured.joints))
    rates = 2.0 * np.pi * measured.base_frequency * np.arange(len(lines))
    size = noise / measured.motion.samples
    weight = lines * _passed(measured, len(lines))[:, None] ** 2
    v0 = size * (2.0 * weight.sum(axis=0) - weight[0])
    v1, v2 = (2.0 * size * (weight.T @ rates**power) for power in (2, 4))
    slopes = torque_derivatives(structure, measured.motion, values)
    q, v, a = slopes.position, slopes.velocity, slopes.acceleration
    return np.asarray(np.mean(q**2 @ v0 + (v**2 - 2.0 * q * a) @ v1 + a**2 @ v2, axis=0))


def _passed(measured: Measurement, count: int) -> Array:
    """Return the gain [count] of a measurement's low pass on the lines of its period, 1 where it has none."""
    gain = getattr(measured.low_pass, "gain", None)
    return np.ones(count) if gain is None else np.asarray(gain, dtype=float)[:count]


def position_notes(measurements: Sequence[Measurement], found: Solution, estimator: str) -> list[str]:
    """Return a line for each measurement whose position noise biases least squares."""
    if estimator not in ("ls", "wls"):
        return []
    out = []
    values = found.values[: len(found.structure.parameters)]
    for measured in measurements:
        if acceleration_noise(measured).max() < _ACCELERATION:
            continue
        added, known = torque_of_position_noise(measured, found.structure, values), measured.averaged_variance
        share = np.divide(added, known, out=np.zeros_like(added), where=known > 0)  # of none nothing is a share
        worst = int(np.argmax(share))
        if share[worst] > _TORQUE:
            out.append(
                f"{measured.source}: position noise adds {100.0 * share[worst]:.0f} % to the torque noise variance of"
                f" {measured.joints[worst]} and biases {estimator}; --estimator ml takes it into account"
            )
    return out
