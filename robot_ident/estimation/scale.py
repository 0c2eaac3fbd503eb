"""Whether what was estimated is the arm of the URDF at all, or the same in other units."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from robot_ident.estimation.problem import Solution
from robot_ident.recording.measurement import Measurement
from robot_ident.signals.motion import Motion

_FACTOR = 20.0  # by which the torque of the links may differ from the URDF's before a word is due
_SAMPLES = 200


def scale_notes(measurements: Sequence[Measurement], found: Solution) -> list[str]:
    """Return a line where the links' torque is a factor away from that of the URDF's masses, on every loaded joint.

    A URDF may be rough, or hold no inertias at all; a factor of a thousand is a unit (Nm for mNm, joint for motor
    side). The joints' ratios are rms over rms along the motion.
    """
    structure = found.structure
    motions = [m.motion for m in measurements]
    picked = [motion[np.linspace(0, motion.samples - 1, _SAMPLES).astype(int)] for motion in motions]
    q, dq, ddq = (np.concatenate([getattr(one, order) for one in picked]) for order in ("q", "dq", "ddq"))
    states = Motion(q, dq, ddq)
    ours = structure.reported(structure.rigid_columns(states)) @ found.values[: len(structure.base.columns)]
    theirs = structure.robot.rigid.inverse_dynamics(states)
    size, expected = (np.sqrt(np.mean(x**2, axis=0)) for x in (ours, theirs))
    loaded = expected > 0.01 * expected.max()
    if not loaded.any() or not np.all(size > 0):
        return []
    ratio = size[loaded] / expected[loaded]
    if not (np.all(ratio > _FACTOR) or np.all(ratio < 1.0 / _FACTOR)):
        return []
    return [
        f"the links' torque is about {float(np.exp(np.mean(np.log(ratio)))):.2g} times what the URDF's masses need:"
        " another unit, motor side instead of joint side, or a URDF without real masses?"
    ]
