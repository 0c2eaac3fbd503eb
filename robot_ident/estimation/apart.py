"""Periods taken apart again, for effects that change from one to the next."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from robot_ident.effects import Effect
from robot_ident.errors import InputError
from robot_ident.recording.measurement import Measurement

_GROUPS = 4  # of periods: enough to tell a level, a slope and a bend


def apart(measurements: Sequence[Measurement], effects: Sequence[Effect]) -> Sequence[Measurement]:
    """Return measurements whose periods are averaged in up to four groups, one after the other, where one of the
    effects trends; else the measurements as they are.

    Their mean tells the level of such an effect, only their differences its course. Raises InputError where every
    recording is an average whose periods are not known one by one.
    """
    trending = [effect.label for effect in effects if effect.trends]
    if not trending:
        return measurements
    parts = [group for measured in measurements for group in _groups(measured)]
    if all(one.motion.periodic for one in measurements) and len(parts) == len(measurements):
        sources = ", ".join(dict.fromkeys(measured.source for measured in measurements))
        raise InputError(
            f"{sources}: {', '.join(trending)} can't be estimated: it shows in what single periods differ by, and these"
            " are not known one by one; record at an even sample rate of which the period is a multiple"
        )
    return parts


def _groups(measured: Measurement) -> list[Measurement]:
    periods = measured.period_torque
    if periods is None or len(periods) < 2 or len(periods) != len(measured.motion.began):
        return [measured]
    out = []
    for rows in np.array_split(np.arange(len(periods)), min(_GROUPS, len(periods))):
        present = np.isfinite(periods[rows])
        torque = np.where(present, periods[rows], 0.0).sum(axis=0) / np.maximum(present.sum(axis=0), 1)
        share = len(rows) / len(periods)
        out.append(
            replace(
                measured,
                motion=replace(measured.motion, began=tuple(measured.motion.began[k] for k in rows)),
                torque=torque,
                used=measured.used & present.any(axis=0),
                periods=len(rows),
                averages=measured.averages * share,
                variance_dof=measured.variance_dof * share,
                period_torque=None,
            )
        )
    return out
