"""Hypotheses whose form is read off what a model leaves of a joint: the orders of a ripple, off its spectrum over the
joint's angle; a backlash, off its impacts.
"""

from __future__ import annotations

from collections.abc import Collection, Iterable, Sequence

import numpy as np

from robot_ident.diagnosis.selection.fitted_set import FittedSet
from robot_ident.effects.backlash import Backlash
from robot_ident.effects.catalogue import RIPPLES
from robot_ident.effects.torque_ripple import TorqueRipple
from robot_ident.recording.measurement import Measurement
from robot_ident.regression.evidence import Evidence
from robot_ident.signals.motion import Array, joined

_MOST_ROWS = 0.9  # of the rows, in which a low pass must let it through


def add_ripples(given: FittedSet, joints: Iterable[int]) -> None:
    """Add the highest lines of what a set leaves of some joints, where a joint fails."""
    data = given.data
    excess, dof = given.excess(), data.dof[: data.training].sum(axis=0)
    for joint in joints:
        if data.floor and excess[joint] < 3.0 * np.sqrt(2.0 * dof[joint]):
            continue
        effects = [kind(data.structure.robot, joint) for kind in RIPPLES]
        add_lines(given, [e for e in effects if not e.unseen and e.label not in data.structure.labels])


def add_lines(given: FittedSet, effects: Sequence[TorqueRipple]) -> None:
    """Add the highest lines of what a set leaves of a joint, at their orders, as each of some effects of that joint."""
    if not effects:
        return
    data, joint = given.data, effects[0].joint
    folds = data.folds[: data.training]
    kept = [t.weight[t.rows, joint] > 0.0 for t in folds]
    moved = joined([t.motion[t.measured.rows][t.rows][rows] for t, rows in zip(folds, kept, strict=True)])
    left = np.concatenate([given.residual(joint, f)[rows] for f, rows in enumerate(kept)])
    orders = effects[0].lines(moved, left, min(t.measured.fastest for t in folds))
    for effect in effects:
        tried = {h.effect.setting["h"] for h in data.hypotheses.get(effect.label, ())}
        for order in orders:
            if order not in tried:
                data.add(effect.at({"h": order}))
        if effect.label in data.hypotheses:
            data.grid[effect.label] = len(data.hypotheses[effect.label])


def hidden_lines(evidence: Evidence, named: Collection[TorqueRipple]) -> list[str]:
    """Return a line for each joint whose unfiltered torque ripples with its angle faster than the low pass lets
    through: the orders that are not named, how large they are at least, and the low pass that shows them. Only whole
    orders, and lines that either half of the rows predicts of the other: what is slow over time looks like some line.
    """
    structure, recordings = evidence.structure, evidence.recordings
    if all(measured.low_pass is None for measured in recordings):
        return []
    motion = joined([measured.motion for measured in recordings])
    left = np.concatenate([_unfiltered(measured, evidence) for measured in recordings])
    fastest = 0.5 / max(measured.dt for measured in recordings)
    band = min(measured.fastest for measured in recordings)
    out = []
    for joint, name in enumerate(structure.robot.joints):
        ripple, kept = TorqueRipple(structure.robot, joint), np.isfinite(left[:, joint])
        if ripple.unseen or not kept.any() or not ripple.whole_orders(motion):
            continue
        known = [effect.setting["h"] for effect in named if effect.joint == joint]
        rows = left[kept, joint]
        falls = ripple.certain_lines(motion[kept], rows, fastest)
        lines = {h: float(np.sqrt(2.0 * fall / len(rows))) for h, fall in falls.items() if h not in known}
        speed = ripple.ratio * float(np.quantile(np.abs(motion.dq[kept, joint]), _MOST_ROWS)) / (2.0 * np.pi)
        asked = min(0.8 * fastest, max(lines, default=0.0) * speed)
        if asked > band:
            unit, turn = structure.robot.torque_unit(joint), "motor" if ripple.geared else "joint"
            sizes = ", ".join(f"order {h:.4g} ({size:.2g} {unit} or more)" for h, size in sorted(lines.items()))
            out.append(
                f"{name}: its unfiltered torque ripples with the angle of the {turn}: {sizes}; rows low-passed at"
                f" {band:.3g} Hz hide it: identify with --low-pass {asked:.2g} and diagnose again"
            )
    return out


def _unfiltered(measured: Measurement, evidence: Evidence) -> Array:
    """Return what a model leaves of the torque [N, n] Nm before any low pass, nan where rows do not count."""
    model = evidence.structure.columns(measured.motion, evidence.values) @ evidence.values
    return np.where(measured.used, measured.torque - model, np.nan)


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
    """Add backlash at those of some joints whose excess is fast, further values where a first look gains.

    The link behind a clearance crosses it as the load reverses and meets the other flank: an impact of a few
    milliseconds that rings above 5 Hz. Where less of a joint's excess lies there, no clearance made it; nor where less
    lies there of what the effect leaves that explains most of the joint.
    """
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
