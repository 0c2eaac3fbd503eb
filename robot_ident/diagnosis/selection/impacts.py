"""Backlash as a hypothesis: dear to compute, so that it is tried where a joint's excess is fast.

The link behind a clearance crosses it as the load reverses and meets the other flank: an impact of a few milliseconds
that rings above 5 Hz. Where less of a joint's excess lies there, no clearance made it; nor where less lies there of
what the effect leaves that explains most of the joint.
"""

from __future__ import annotations

from collections.abc import Iterable

import numpy as np

from robot_ident.diagnosis.selection.fitted_set import FittedSet
from robot_ident.effects.backlash import Backlash

_FAST = 5.0  # Hz
_SHARE = 0.35  # of a joint's excess above that from which on a clearance is tried


def _fast_joints(given: FittedSet, joints: Iterable[int]) -> list[int]:
    """Return those of some joints of which so much of the excess lies above 5 Hz."""
    data = given.data
    out = []
    for joint in joints:
        excess = fast = 0.0
        for f in range(data.training):
            t = data.folds[f]
            error = given.residual(joint, f)
            power = 2.0 * np.abs(np.fft.rfft(error)) ** 2 / len(error)
            rate = np.fft.rfftfreq(len(error), t.measured.dt * t.measured.decimate)
            above = rate > _FAST
            excess += float(power.sum()) - data.dof[f, joint]
            fast += float(power[above].sum()) - float(np.mean(above)) * data.dof[f, joint]
        if excess > 3.0 * np.sqrt(2.0 * data.dof[: data.training, joint].sum()) and fast > _SHARE * excess:
            out.append(joint)
    return out


def add_backlash(given: FittedSet, joints: Iterable[int]) -> None:
    """Add backlash at those of some joints whose excess is fast, further values where a first look gains."""
    data, robot = given.data, given.data.structure.robot
    for joint in _fast_joints(given, joints):
        effect = Backlash(robot, joint)
        known = effect.label in data.structure.labels or effect.label in data.hypotheses
        if Backlash.available(robot, joint) or effect.unseen or known:
            continue
        settings = effect.settings()
        first = settings[0]
        plain = [s for s in settings if all(s[name] == first[name] for name in s if name != "gap")]
        looked = [h for h in (data.add(effect.at(setting)) for setting in plain) if h is not None]
        if not looked:
            continue
        best = max(looked, key=given.gain)
        if given.gain(best) > 2.0 * np.log(len(data.hypotheses)):
            for setting in settings:
                if setting["gap"] == best.effect.setting["gap"] and setting not in plain:
                    data.add(effect.at(setting))
        data.grid[effect.label] = len(data.hypotheses[effect.label])
