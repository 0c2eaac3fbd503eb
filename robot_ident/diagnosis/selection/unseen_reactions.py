"""Reactions that no position shows: joints that give way, faster than their noise lets us see, to others that shake.

At frequencies where less than half of the path of joints U stands above the noise, and accelerations a of the others K
are known: as far as the drives of U let go, M_UU a_U = -M_UK a, within what the noise of their positions hides. The
model lacks the torque M a_U on all joints. A line of the torque is as uncertain as that is large, and what is missing
there, of all joints at once, looks like a delay or an elastic gear.
"""

from __future__ import annotations

import numpy as np
from scipy.ndimage import uniform_filter1d

from robot_ident.effects import Torques
from robot_ident.regression.evidence import Trajectory
from robot_ident.signals.fourier import least_above_noise
from robot_ident.signals.motion import Array

_STIFF = 1e-9  # of the largest inertia, which every joint has: one of which the model knows none stays where it is
_BAND, _NEAR = 25, 5  # lines over which the share of a path that is known, and the power of a torque, are averaged


def with_unseen_reactions(t: Trajectory, whitening: Array | None, torques: Torques) -> tuple[Trajectory, Array]:
    """Return a trajectory whose lines have a whitening [K + 1, n] and weigh less where reactions may move them; and the
    squared error [n] that these may leave then.
    """
    measured, share, variance = t.measured, t.measured.line_share, t.measured.averaged_position_variance
    by_lines = measured.decimate == 1 and measured.low_pass is None
    if share is None or variance is None or measured.base_frequency is None or not by_lines or torques.rigid is None:
        return t.whitened_by(whitening), np.zeros(t.motion.joints)
    inertia, samples = torques.rigid.inertia, t.motion.samples
    lines = np.fft.rfft(t.motion.ddq, axis=0)
    held = np.zeros(lines.shape)
    held[: len(share)] = share[: len(lines)]
    unseen = uniform_filter1d(held, _BAND, axis=0) < 0.5
    amplitude = least_above_noise(len(share), variance, samples)
    rate = 2.0 * np.pi * measured.base_frequency * np.arange(len(lines))[:, None]
    hidden = 0.5 * samples * rate**2 * amplitude
    power = np.zeros(lines.shape)
    for pattern in np.unique(unseen, axis=0):
        still, known = np.flatnonzero(pattern), np.flatnonzero(~pattern)
        if not (len(still) and len(known)):
            continue
        band = np.where((unseen == pattern).all(axis=1)[:, None], lines[:, known], 0.0)
        asked = np.einsum("Nuk,Nk->Nu", inertia[:, still[:, None], known], np.fft.irfft(band, samples, axis=0))
        own = inertia[:, still[:, None], still] + max(_STIFF * np.abs(inertia).max(), 1e-300) * np.eye(len(still))
        given = np.linalg.solve(own, asked[:, :, None])[:, :, 0]
        moved = np.fft.rfft(given, axis=0)
        size = np.abs(moved)
        moved *= np.minimum(size, hidden[:, still]) / np.maximum(size, 1e-300)
        missing = np.einsum("Nju,Nu->Nj", inertia[:, :, still], np.fft.irfft(moved, samples, axis=0))
        power += np.abs(np.fft.rfft(missing, axis=0)) ** 2
    if not power.any():
        return t.whitened_by(whitening), np.zeros(t.motion.joints)
    lost = uniform_filter1d(power, _NEAR, axis=0) / (samples * measured.averaged_variance)
    noise = lost + (1.0 if whitening is None else whitening**-2.0)
    made = np.mean(lost / noise, axis=0) * np.sum(t.weight > 0, axis=0)
    return t.whitened_by(1.0 / np.sqrt(noise)), made
