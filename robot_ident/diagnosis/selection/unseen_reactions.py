"""Reactions that no position shows: joints that give way, faster than their noise lets us see, to others that shake.

At frequencies where less than half of the path of joints U stands above the noise, and accelerations a of the others K
are known: as far as the drives of U let go, M_UU a_U = -M_UK a. The torque of U is 0 then, where the model has M_UK a,
and that of K smaller by M_KU a_U. A line of the torque is as uncertain as that is large, and what is missing there, of
all joints at once, looks like a delay or an elastic gear.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from scipy.ndimage import uniform_filter1d

from robot_ident.diagnosis.evidence import Trajectory
from robot_ident.effects import Torques
from robot_ident.signals.motion import Array

_BAND, _NEAR = 25, 5  # lines over which the share of a path that is known, and the power of a torque, are averaged


def with_unseen_reactions(t: Trajectory, whitening: Array | None, torques: Torques) -> tuple[Trajectory, Array]:
    """Return a trajectory whose lines have a whitening [K + 1, n] and weigh less where reactions may move them; and the
    squared error [n] that these may leave then.
    """
    measured, share = t.measured, t.measured.line_share
    by_lines = measured.base_frequency is not None and measured.decimate == 1 and measured.low_pass is None
    if share is None or not by_lines or torques.rigid is None:
        return replace(t, whitening=whitening).weighed_by(t.weight), np.zeros(t.motion.joints)
    inertia, samples = torques.rigid.inertia, t.motion.samples
    lines = np.fft.rfft(t.motion.ddq, axis=0)
    held = np.zeros(lines.shape)
    held[: len(share)] = share[: len(lines)]
    unseen = uniform_filter1d(held, _BAND, axis=0) < 0.5
    power = np.zeros(lines.shape)
    for pattern in np.unique(unseen, axis=0):
        still, known = np.flatnonzero(pattern), np.flatnonzero(~pattern)
        if not (len(still) and len(known)):
            continue
        band = np.where((unseen == pattern).all(axis=1)[:, None], lines[:, known], 0.0)
        asked = np.einsum("Nuk,Nk->Nu", inertia[:, still[:, None], known], np.fft.irfft(band, samples, axis=0))
        given = np.linalg.solve(inertia[:, still[:, None], still], asked[:, :, None])[:, :, 0]
        missing = np.empty((samples, t.motion.joints))
        missing[:, still], missing[:, known] = asked, np.einsum("Nku,Nu->Nk", inertia[:, known[:, None], still], given)
        power += np.abs(np.fft.rfft(missing, axis=0)) ** 2
    if not power.any():
        return replace(t, whitening=whitening).weighed_by(t.weight), np.zeros(t.motion.joints)
    moved = uniform_filter1d(power, _NEAR, axis=0) / (samples * measured.averaged_variance)
    noise = moved + (1.0 if whitening is None else whitening**-2.0)
    made = np.mean(moved / noise, axis=0) * np.sum(t.weight > 0, axis=0)
    return replace(t, whitening=1.0 / np.sqrt(noise)).weighed_by(t.weight), made
