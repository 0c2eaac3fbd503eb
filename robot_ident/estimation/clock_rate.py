"""Weight as the URDF has it beside inertia far from it, on every joint alike: the clock of the stamps runs wrong.

Stamps that run r times too fast make accelerations r^2 and products of speeds r^2 times too small; the weight knows
no time: k_g = 1, k_i = r^2 on all joints. A URDF's inertias are rarely all wrong by one factor beside right weights.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from robot_ident.estimation.declared import Declared

_WEIGHT = 0.15  # by which shares of gravity may be off 1
_ALIKE = 0.15  # by which the logarithms of the joints' shares of inertia may be off their middle
_FAR = 1.4  # factor of inertia from which on it is the clock rather than the URDF: stamps 18 % off
_CLOSELY = 0.05  # by which logarithms may be off their middle where three joints or more tell a smaller one
_NEAR = 1.1  # that smaller factor: stamps 5 % off
_LEAST = 0.7  # part of the effort that the URDF's torque must account for


def by_clock(judged: Sequence[Declared]) -> list[Declared]:
    """Return judgements of all joints of a recording, those that a wrong clock explains together with the verdict
    `clock`: two or more joints that tell of inertia, one or more that tell of weight.
    """
    told = [d for d in judged if np.isfinite(d.inertia) and d.explained > _LEAST]
    weights = [d.gravity for d in told if np.isfinite(d.gravity)]
    if len(told) < 2 or not weights or min(d.inertia for d in told) <= 0.0:
        return list(judged)
    sizes = np.log([d.inertia for d in told])
    middle = float(np.median(sizes))
    apart = float(np.abs(sizes - middle).max())
    closely = len(told) > 2 and apart < _CLOSELY and abs(middle) > np.log(_NEAR)
    alike = apart < _ALIKE and abs(middle) > np.log(_FAR)
    if np.abs(np.array(weights) - 1.0).max() > _WEIGHT or not (closely or alike):
        return list(judged)
    rate = float(np.exp(abs(middle) / 2.0))
    way = "fast" if middle > 0 else "slow"
    hint = (
        f"weight is right and inertia {np.exp(middle):.3g} times the URDF's on every joint: the stamps' clock runs"
        f" {rate:.3g} times too {way} (or all the URDF's inertias are wrong alike)"
    )
    return [replace(d, verdict="clock", hint=hint) if d in told else d for d in judged]
