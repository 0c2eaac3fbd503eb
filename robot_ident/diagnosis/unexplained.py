"""What a residual depends on when no known effect explains it: curves over a variable, judged on other motion."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np

from robot_ident.diagnosis.diagnosis import EVERYWHERE, Unexplained
from robot_ident.regression.evidence import Evidence
from robot_ident.residuals.curves import Variable, held_out_share, own, variables
from robot_ident.residuals.regions import Region, densest

_MOVING = ("velocity", "speed", "time_since_reversal")  # variables that are zero as the joint reverses
_MOST = 0.5  # of the excess, that sits there
_SLOW = 0.02  # rad/s or m/s: slower than this a joint may stick
_OTHERS = 0.02  # of the error that another joint's motion must explain to be listed


def explain_by_variables(evidence: Evidence, joint: int, *, floor: bool = True) -> Unexplained:
    """Return which variable predicts a joint's residual on trajectories left out, and where along it the error sits.

    floor: whether the weights of the evidence are the noise's, so that only what exceeds it counts.
    """
    robot = evidence.structure.robot
    residual = [r[:, joint] for r in evidence.residual]
    used = [t.weight[:, joint] > 0 for t in evidence.trajectories]
    dof = float(sum(t.dof[joint] for t in evidence.trajectories)) if floor else 0.0
    excess = max(sum(float(np.sum(r**2)) for r in residual) - dof, 1e-12)
    seen = _along(evidence, joint)
    names = [name for name in seen[0] if all(name in one for one in seen)]
    shares = {name: held_out_share([one[name] for one in seen], residual, used, excess) for name in names}
    level = [
        float(t.dof[joint]) / max(1, int(u.sum())) if floor else 0.0
        for t, u in zip(evidence.trajectories, used, strict=True)
    ]
    region = _densest(seen, shares, residual, used, level)
    listed = own(shares, _OTHERS)
    where = EVERYWHERE if region is None else region.in_words(robot, joint)
    return Unexplained(robot.joints[joint], listed, where, region is not None and _around_reversals(region))


def _around_reversals(region: Region) -> bool:
    return region.what in _MOVING and region.lower <= 0.0 <= region.upper and region.share >= _MOST


def stiction_note(found: Unexplained, evidence: Evidence) -> list[str]:
    """Return how to leave out the rows near rest, where what remains follows a joint's reversals and they are used.

    A joint that sticks rests on an undetermined torque, and breaks away with a jerk that noise hides.
    """
    joint = evidence.structure.robot.joint_index(found.joint)
    first = max(found.depends_on, key=lambda name: found.depends_on[name])
    speeds = [np.abs(t.motion.dq[t.measured.rows, joint])[t.weight[:, joint] > 0] for t in evidence.trajectories]
    slow = any(np.any(speed < _SLOW) for speed in speeds)
    follows = first == "time_since_reversal" and found.depends_on[first] > 0.0
    if not slow or not (follows or found.around_reversals):
        return []
    return [
        f"what remains of {found.joint} follows its reversals; where it sticks there, no model tells its torque, and"
        f" steps of friction fall between two samples: identify with --minimum-speed {_SLOW:g} (rad/s or m/s) and"
        " diagnose again, or record at a higher rate"
    ]


def _along(evidence: Evidence, joint: int) -> list[dict[str, Variable]]:
    """Return the variables of every trajectory on its rows, computed once for all parts of one measurement."""
    known: dict[int, dict[str, Variable]] = {}
    for t in evidence.trajectories:
        if id(t.measured) not in known:
            found = variables(evidence.structure, evidence.values, t.motion, joint)
            known[id(t.measured)] = {name: variable[t.measured.rows] for name, variable in found.items()}
    return [known[id(t.measured)] for t in evidence.trajectories]


def _densest(
    seen: Sequence[Mapping[str, Variable]],
    shares: Mapping[str, float],
    residual: Sequence[np.ndarray],
    used: Sequence[np.ndarray],
    level: Sequence[float],
) -> Region | None:
    """Return the region that holds most error beyond its share of the time, along the variables that explain most."""
    squared = [r**2 for r in residual]
    ranked = sorted((name for name in shares if not name.endswith("_and_direction")), key=lambda name: -shares[name])
    for name in ranked:
        region = densest(name, [one[name].signed(name) for one in seen], squared, used, level)
        if region is not None:
            return region
    return None
