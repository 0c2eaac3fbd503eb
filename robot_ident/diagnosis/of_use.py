"""Names at a joint where efforts and positions do not belong together.

Where a model misses most of a joint's torque, and with what would be named still does, whatever follows part of the
error is no physics.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from robot_ident.diagnosis.diagnosis import Diagnosis, Finding
from robot_ident.model.model import is_poor
from robot_ident.recording.measurement import Measurement
from robot_ident.signals.motion import Array


def of_use(found: Diagnosis, measurements: Sequence[Measurement]) -> Diagnosis:
    """Return a diagnosis without the names at joints of which the model misses most of the torque before and after: rms
    beyond half of that of the torque, which stands above its noise.
    """
    torque = np.mean([_mean_squares(measured) for measured in measurements], axis=0)
    noise = np.mean([measured.averaged_variance for measured in measurements], axis=0)
    told = {
        name: (float(torque[k]), float(noise[k]) if np.isfinite(noise[k]) else None)
        for k, name in enumerate(measurements[0].joints)
    }
    useless = []
    for one in found.missing:
        joint = one.place
        after = found.remaining_rms[joint] ** 2
        if is_poor(one.mse_before[joint], *told[joint]) and is_poor(after, *told[joint]):
            share = (after / told[joint][0]) ** 0.5
            useless.append(
                (
                    one,
                    f"{one.label} is not named: with it the model still misses {100 * share:.0f} % of the"
                    f" torque of {joint}; efforts and positions of that joint don't belong together",
                )
            )
    if not useless:
        return found
    left = tuple(one for one in found.missing if one not in [finding for finding, _ in useless])
    others: tuple[Finding, ...] = (*(finding for finding, _ in useless), *found.others)
    notes = (*found.notes, *(note for _, note in useless))
    return replace(found, verdict="missing" if left else "unexplained", missing=left, others=others, notes=notes)


def _mean_squares(measured: Measurement) -> Array:
    """Return the mean square torque [n] of the rows that count, as it is compared."""
    torque, used = measured.passed(measured.torque), measured.used[measured.rows]
    return np.asarray(np.sum(torque**2 * used, axis=0) / np.maximum(used.sum(axis=0), 1))
