"""How far positions are differentiated for a prediction: what the low pass takes from the motion, and what it leaves of
the encoders' noise, weighed by the torque that both make.
"""

from __future__ import annotations

import numpy as np

from robot_ident.model.derivatives import torque_derivatives
from robot_ident.model.structure import Structure
from robot_ident.recording.clock import read_clock, roughness
from robot_ident.recording.measurement import Processing
from robot_ident.recording.non_periodic import even_samples
from robot_ident.recording.recording import Recording
from robot_ident.signals.filters import ZeroPhaseLowPass
from robot_ident.signals.motion import Array, Motion

_FINER = 0.84  # from one bandwidth to the next
_LEAST = 0.02  # of the widest bandwidth, where the search ends
_IDLE = 1e-6  # of the largest variance of a joint's torque: a joint that does less counts as if it did so much
_ROWS = 200  # of the motion, over which the torque's derivatives are averaged


def prediction_bandwidth(
    recording: Recording, structure: Structure, values: Array, processing: Processing
) -> float | None:
    """Return to how many Hz positions are differentiated so that the torque of a structure with values [p] errs least:
    `band_derivative` at most, and what `processing` states where it has none.

    Position noise of variance s^2 a sample, white (third differences tell it), reaches the torque through M(q) ddq; the
    low pass H, without phase, takes its share of the motion itself. Of both together Stein's estimate of the squared
    error ("Estimation of the mean of a multivariate normal distribution", 1981) needs nothing but the record: up to a
    constant, sum over f of w^4 ((H^2 - 2 H) |Q|^2 + 2 H s^2). Joints count by the variance of their torque.
    """
    if processing.band_derivative is None:
        return processing.derivative_bandwidth
    joints = structure.robot.joints
    own = recording.with_joints(joints)
    clock = read_clock(own)
    widest = min(processing.band_derivative, 0.4 / clock.dt)
    q, _, _ = even_samples(own, clock)
    smooth = ZeroPhaseLowPass(widest, clock.dt, len(q))
    step = max(1, len(q) // _ROWS)
    motion = Motion(q[::step], smooth.apply(q, 1)[::step], smooth.apply(q, 2)[::step], dt=clock.dt * step)
    inertia = torque_derivatives(structure, motion, values).acceleration
    torque = (structure.columns(motion, values) @ values).var(axis=0)
    # what an error of each joint's acceleration is worth, in shares of all joints' torque
    worth = np.mean(inertia**2, axis=0).T @ (1.0 / np.maximum(torque, max(_IDLE * torque.max(), 1e-300)))
    window = np.hanning(len(q))[:, None]
    power = np.abs(np.fft.rfft((q - q.mean(axis=0)) * window, axis=0)) ** 2 / np.sum(window**2)
    frequency = np.fft.rfftfreq(len(q), clock.dt)
    scale = (2.0 * np.pi * frequency) ** 4
    moved, noise = scale * (power @ worth), scale * float(roughness(q) ** 2 @ worth)

    def error(cutoff: float) -> float:
        gain = 1.0 / (1.0 + (frequency / cutoff) ** 8)
        return float(np.sum((gain**2 - 2.0 * gain) * moved + 2.0 * gain * noise))

    count = int(np.log(_LEAST) / np.log(_FINER)) + 1
    return min((widest * _FINER**k for k in range(count)), key=error)
