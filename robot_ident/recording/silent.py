"""Joints of which recordings tell nothing."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from robot_ident.errors import InputError
from robot_ident.recording.measurement import Measurement

_STILL = 1e-3  # rad or m: what strays less stands still


def refuse_silent(measurements: Sequence[Measurement], remedy: str = "") -> None:
    """Raise InputError where a joint has no row that counts in any of some measurements, or stands still in all.

    remedy: what to do about it, with `{moving}` in the place of the other joints.
    """
    joints = measurements[0].joints
    reach = np.max([np.ptp(measured.motion.q, axis=0) for measured in measurements], axis=0)
    told = np.any([measured.used[measured.rows].any(axis=0) for measured in measurements], axis=0)
    silent = [name for name, far, yes in zip(joints, reach, told, strict=True) if far < _STILL or not yes]
    if not silent:
        return
    moving = [name for name in joints if name not in silent]
    hint = remedy.format(moving=",".join(moving)) if moving else ""
    source = ", ".join(measured.source for measured in measurements)
    raise InputError(
        f"{source}: {silent[0]} has no usable sample (it stands still, or is slower than the minimum speed){hint}"
    )
