"""Joints of which recordings tell nothing."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from robot_ident.errors import InputError
from robot_ident.motion import Mask
from robot_ident.recording.measurement import Measurement
from robot_ident.recording.period import AT_REST


def silent_joints(measurements: Sequence[Measurement]) -> Mask:
    """Return which joints [n] have no row that counts in any of some measurements, or stand still in all."""
    reach = np.max([np.ptp(measured.motion.q, axis=0) for measured in measurements], axis=0)
    told = np.any([measured.used[measured.rows].any(axis=0) for measured in measurements], axis=0)
    return np.asarray((reach < AT_REST) | ~told)


def still_notes(measured: Measurement) -> list[str]:
    """Return a line for each joint of which no row of a measurement counts."""
    return [
        f"{name} {'stands still' if far < AT_REST else 'moves no faster than its noise'} in {measured.source}: what its"
        " friction does there no model tells, and no verdict counts it"
        for name, far, yes in zip(
            measured.joints, np.ptp(measured.motion.q, axis=0), silent_joints([measured]), strict=True
        )
        if yes
    ]


def refuse_silent(measurements: Sequence[Measurement], remedy: str = "") -> None:
    """Raise InputError where a joint has no row that counts in any of some measurements, or stands still in all.

    remedy: what to do about it, with `{moving}` in the place of the other joints.
    """
    joints, still = measurements[0].joints, silent_joints(measurements)
    silent = [name for name, yes in zip(joints, still, strict=True) if yes]
    if not silent:
        return
    moving = [name for name in joints if name not in silent]
    hint = remedy.format(moving=",".join(moving)) if moving else ""
    source = ", ".join(measured.source for measured in measurements)
    raise InputError(
        f"{source}: {silent[0]} has no usable sample (it stands still, or is slower than the minimum speed){hint}"
    )
