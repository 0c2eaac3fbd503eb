"""What an export that can't carry an effect costs in torque."""

from __future__ import annotations

from collections.abc import Collection

import numpy as np

from robot_ident.model.model import Model
from robot_ident.motion import Array, Motion


def torque_of(model: Model, labels: Collection[str], motion: Motion) -> dict[str, Array]:
    """Return the rms torque [n] of the effects `labels` of a model along a motion."""
    columns = model.structure.columns(motion, model.linear)
    return {
        effect.label: np.sqrt(np.mean((columns[:, :, own] @ model.linear[own]) ** 2, axis=0))
        for effect, own in model.structure.placed
        if effect.label in labels
    }
