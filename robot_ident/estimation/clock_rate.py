"""What is off the URDF alike on every joint: inertia beside weight as it should be, or weight and inertia both.

Stamps that run r times too fast make accelerations r^2 and products of speeds r^2 times too small; the weight knows
no time: k_g = 1, k_i = r^2 on all joints. A URDF's inertias are rarely all wrong by one factor beside right weights.
Where both shares are off by one factor, all efforts may have a wrong gain: a fit takes it for heavier links.
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
    weight = float(np.median(np.log(np.maximum(weights, 1e-12))))  # nearer to the URDF's than inertia is, by half
    if np.abs(np.array(weights) - 1.0).max() > _WEIGHT or abs(weight) > abs(middle) / 2.0 or not (closely or alike):
        return list(judged)
    rate = float(np.exp(abs(middle) / 2.0))
    way = "fast" if middle > 0 else "slow"
    hint = (
        f"weight is right and inertia {np.exp(middle):.3g} times the URDF's on every joint: the stamps' clock runs"
        f" {rate:.3g} times too {way} (or all the URDF's inertias are wrong alike)"
    )
    return [replace(d, verdict="clock", hint=hint) if d in told else d for d in judged]


def gain_of_all(judged: Sequence[Declared]) -> list[str]:
    """Return a line where weight and inertia are off the URDF's by one factor, k_g = k_i = g, on two joints or more.

    Data can't say whether all efforts or all masses are off.
    """
    told = [d for d in judged if np.isfinite(d.share) and d.explained > _LEAST and d.verdict == "consistent"]
    shares = np.array([x for d in told for x in (d.gravity, d.inertia) if np.isfinite(x)])
    if len(told) < 2 or min(shares) <= 0.0:
        return []
    factor = float(np.exp(np.median(np.log(shares))))
    if np.abs(np.log(shares / factor)).max() > _CLOSELY or abs(np.log(factor)) < np.log(_NEAR):
        return []
    return [
        f"weight and inertia are {factor:.3g} times the URDF's on every joint alike: a gain of all efforts, or masses"
        " of the URDF that are all wrong by that; these data can't tell which, a known payload can"
    ]
