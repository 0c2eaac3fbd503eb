"""Recordings that don't repeat: differentiated and low-passed without phase."""

from __future__ import annotations

import numpy as np

from robot_ident.recording.clock import Clock, fill, roughness
from robot_ident.recording.measurement import Measurement, Processing
from robot_ident.recording.periodic import at_rest, trusted
from robot_ident.recording.recording import Recording
from robot_ident.recording.torque_channel import chain_of
from robot_ident.robot.robot import Robot
from robot_ident.signals.filters import ZeroPhaseLowPass
from robot_ident.signals.motion import Array, Mask, Motion

DEFAULT_LOW_PASS = 10.0  # Hz, the paper's choice for validation


def low_passed(recording: Recording, clock: Clock, robot: Robot, processing: Processing) -> Measurement:
    """Return a non-periodic recording with the derivatives of its low-passed positions.

    Positions pass a wider low pass (4 times the cutoff unless told) before they are differentiated; torque and
    columns then pass the same cutoff. Rows near gaps and near the ends, where the filter has no data, don't count.
    """
    q, tau, present = even_samples(recording, clock)
    nyquist = 0.5 / clock.dt
    cutoff = processing.low_pass or min(DEFAULT_LOW_PASS, 0.4 * nyquist)
    wide = processing.derivative_bandwidth or min(4.0 * cutoff, 0.8 * nyquist)
    chain = chain_of(robot, processing.anti_alias, recording.source, 1.0 / clock.dt, 1.0 / (len(q) * clock.dt))
    if not chain.trivial:
        chain.check_low_pass(cutoff, recording.source)
        tau = chain.undone(tau, 1.0 / clock.dt)
    smoother = ZeroPhaseLowPass(wide, clock.dt, len(q))
    motion = Motion(smoother.apply(q), smoother.apply(q, 1), smoother.apply(q, 2), dt=clock.dt)
    low_pass = ZeroPhaseLowPass(cutoff, clock.dt, len(q))
    speed_noise = roughness(q) * smoother.noise_gain(1)
    reach = low_pass.smear()
    missing = np.concatenate([[0], np.ones(reach), ~present, np.ones(reach)]).cumsum()  # beyond both ends as well
    whole = (missing[2 * reach + 1 :] - missing[: -2 * reach - 1] < 0.5)[:, None]  # no missing sample within reach
    notes = [f"taken as one pass, not by periods: low-passed at {cutoff:g} Hz, differentiated to {wide:g} Hz"]
    if chain.note:
        notes.append(chain.note)
    if not present.all():
        notes.append(f"{int((~whole).sum())} rows near gaps and ends left out")
    return Measurement(
        source=recording.source,
        joints=recording.names,
        dt=clock.dt,
        motion=motion,
        torque=tau,
        used=trusted(motion, robot, processing, speed_noise) & whole,
        standstill=at_rest(motion, robot),
        torque_variance=np.full(robot.n, np.nan),
        position_variance=np.full(robot.n, np.nan),
        low_pass=low_pass,
        samples_per_period=len(q),
        decimate=processing.decimate,
        notes=tuple(notes),
    )


def even_samples(recording: Recording, clock: Clock) -> tuple[Array, Array, Mask]:
    """Return positions, torques and which samples are real, on an even grid."""
    if clock.index is not None:
        present = np.zeros(clock.index[-1] - clock.index[0] + 1, dtype=bool)
        present[clock.index - clock.index[0]] = True
        return fill(recording.q, clock.index), fill(recording.tau, clock.index), present
    from scipy.interpolate import make_interp_spline

    grid = np.arange(clock.t[0], clock.t[-1], clock.dt)
    both = make_interp_spline(clock.t, np.hstack([recording.q, recording.tau]), k=3)(grid)
    nearest = np.searchsorted(clock.t, grid).clip(1, len(clock.t) - 1)
    present = clock.t[nearest] - clock.t[nearest - 1] < 2.5 * clock.dt
    n = recording.q.shape[1]
    return both[:, :n], both[:, n:], present
