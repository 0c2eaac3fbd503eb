"""What an export that can't carry an effect costs in torque."""

from __future__ import annotations

from collections.abc import Collection

import numpy as np

from robot_ident.model.model import Model
from robot_ident.signals.motion import Array, Motion


def torque_of(model: Model, labels: Collection[str], motion: Motion) -> dict[str, Array]:
    """Return the rms torque [n] that a model loses along a motion without each of the effects `labels`."""
    columns, linked = model.structure.columns(motion, model.linear), len(model.structure.base.columns)
    links, scales = columns[:, :, :linked] @ model.linear[:linked], model.structure.scales
    out = {}
    for effect, own in model.structure.placed:
        if effect.label not in labels:
            continue
        torque = columns[:, :, own] @ model.linear[own]
        if effect.scales_links:  # it has no column: what it makes of the links' torque, a tauL - tauL
            torque = torque.copy()
            torque[:, effect.joint] = links[:, effect.joint] * (1.0 - 1.0 / scales[effect.joint])
        out[effect.label] = np.sqrt(np.mean(torque**2, axis=0))
    return out
