"""Backlash as a hypothesis: dear to compute, so that it is tried where a joint's excess is fast.

The link behind a clearance crosses it as the load reverses and meets the other flank: an impact of a few milliseconds
that rings above 5 Hz. Where less of a joint's excess lies there, no clearance made it.
"""

from __future__ import annotations

import numpy as np

from robot_ident.diagnosis.selection.fitted_set import FittedSet
from robot_ident.effects.backlash import Backlash

_FAST = 5.0  # Hz
_SHARE = 0.35  # of a joint's excess above that from which on a clearance is tried


def fast_joints(given: FittedSet) -> list[int]:
    """Return the joints of which so much of the excess lies above 5 Hz."""
    data, v = given.data, given.whole.values[: given.data.p]
    out = []
    for joint in range(data.n):
        excess = fast = 0.0
        for f in range(data.training):
            t = data.folds[f]
            error = data.y[joint][f] - data.base[joint][f] @ v
            power = 2.0 * np.abs(np.fft.rfft(error)) ** 2 / len(error)
            rate = np.fft.rfftfreq(len(error), t.measured.dt * t.measured.decimate)
            above = rate > _FAST
            excess += float(power.sum()) - data.dof[f, joint]
            fast += float(power[above].sum()) - float(np.mean(above)) * data.dof[f, joint]
        if excess > 3.0 * np.sqrt(2.0 * data.dof[: data.training, joint].sum()) and fast > _SHARE * excess:
            out.append(joint)
    return out


def add_backlash(given: FittedSet) -> None:
    """Add backlash to the hypotheses at joints with a fast excess, further values where a first look gains."""
    data, robot = given.data, given.data.structure.robot
    for joint in fast_joints(given):
        effect = Backlash(robot, joint)
        if Backlash.available(robot, joint) or effect.unseen or effect.label in data.structure.labels:
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
