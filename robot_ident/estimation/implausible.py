"""Base parameters that no arm of its size can have: their torque alone is many times what a joint gives."""

from __future__ import annotations

import numpy as np

from robot_ident.estimation.equations import Equations
from robot_ident.model.structure import Structure
from robot_ident.signals.motion import Array

_TIMES = 10.0  # of a joint's torque; the arms that we know stay below 2.5
_SURE = 2.0  # standard deviations, below which the value is said to be unknown anyhow
_NAMED = 3


def implausible_notes(structure: Structure, equations: Equations, values: Array, std: Array) -> list[str]:
    """Return a line on base parameters whose share of a joint's torque, rms of phi_k theta_k over rms of tau, is beyond
    any arm's: others take it off again, as they do where an axis of the URDF or the unit of an effort is wrong.
    """
    count, joints = len(structure.base.columns), range(structure.robot.n)
    share = np.zeros((structure.robot.n, count))
    for joint in joints:
        rows = equations.joint == joint
        torque = float(np.mean(equations.torque[rows] ** 2)) if rows.any() else 0.0
        if torque > 0.0:
            share[joint] = np.sqrt(np.mean((equations.phi[rows, :count] * values[:count]) ** 2, axis=0) / torque)
    worst, where = share.max(axis=0), share.argmax(axis=0)
    found = [
        k for k in np.argsort(-worst) if worst[k] > _TIMES and abs(values[k]) > _SURE * std[k] and np.isfinite(std[k])
    ]
    if not found:
        return []
    words = [
        f"{structure.names[k]} = {values[k]:.4g} ± {std[k]:.2g} {structure.parameters[k].unit}, whose torque would be"
        f" {worst[k]:.3g} times that of {structure.robot.joints[where[k]]}"
        for k in found[:_NAMED]
    ]
    more = f", and {len(found) - _NAMED} more" if len(found) > _NAMED else ""
    return [
        f"no arm of this size has {'; '.join(words)}{more}: others take it off again; check the URDF's axes and the"
        " effort's unit first (robot_ident info BAG --robot)"
    ]
