"""Lines of a period in units of the noise that each of them has: of its torque, whatever its colour, and of its
acceleration.

A line of the position with variance s^2 gives the acceleration (2 pi f)^4 s^2, which the inertia M turns into torque.
It grows fast with frequency: of a stiff path known to many lines it is what is left over, and no effect.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from robot_ident.diagnosis.evidence import Evidence, Trajectory, fitted, kept_between_parts
from robot_ident.diagnosis.spectrum import relative_density
from robot_ident.signals.motion import Array

_LEAST = 0.1  # of the noise's mean density: where a filter leaves less, a line is no better proof than one there
_MATTERS = 0.05  # of the torque's noise in a line: less from the positions' noise changes nothing


def whitened(evidence: Evidence) -> Evidence:
    """Return the evidence fitted again with every line in units of its own noise; itself where all are alike."""
    trajectories = white_lines(evidence.trajectories, evidence)
    if all(t.whitening is None for t in trajectories):
        return evidence
    return fitted(evidence.structure, trajectories, evidence.rigid, kept_between_parts(evidence))


def white_lines(trajectories: Sequence[Trajectory], evidence: Evidence) -> tuple[Trajectory, ...]:
    """Return trajectories with their lines in units of the noise, by the inertia that an evidence's model has."""
    return tuple(_white(t, evidence) for t in trajectories)


def inertia_along(t: Trajectory, evidence: Evidence) -> Array:
    """Return the torque [N, n, n] Nm of each joint that each one's acceleration of 1 rad/s^2 takes, along a motion."""
    structure, values = evidence.structure, evidence.values
    plain = structure.torques(t.motion, values).total
    out = []
    for joint in range(t.motion.joints):
        ddq = t.motion.ddq.copy()
        ddq[:, joint] += 1.0
        out.append(structure.torques(replace(t.motion, ddq=ddq), values).total - plain)
    return np.stack(out, axis=2)


def _white(t: Trajectory, evidence: Evidence) -> Trajectory:
    measured = t.measured
    if measured.base_frequency is None or measured.decimate != 1 or measured.low_pass is not None:
        return t
    noise = np.column_stack([np.maximum(relative_density(t, joint), _LEAST) for joint in range(t.motion.joints)])
    path = _of_the_path(t, evidence)
    if np.max(path) >= _MATTERS:
        noise = noise + path
    return t if np.all(noise == 1.0) else replace(t, whitening=1.0 / np.sqrt(noise)).weighed_by(t.weight)


def _of_the_path(t: Trajectory, evidence: Evidence) -> Array:
    """Return the square [K + 1, n] that the positions' noise makes of the torque's lines, over that of its own."""
    measured, samples = t.measured, len(t.y)
    variance, share = measured.averaged_position_variance, measured.line_share
    out = np.zeros((samples // 2 + 1, t.motion.joints))
    if variance is None or share is None or not np.all(np.isfinite(variance)):
        return out
    count = min(len(out), len(share))
    second = (2.0 * np.pi * (measured.base_frequency or 0.0) * np.arange(count)[:, None]) ** 4
    inertia = np.mean(inertia_along(t, evidence) ** 2, axis=0)
    out[:count] = second * share[:count] * variance @ inertia.T / measured.averaged_variance
    return out
