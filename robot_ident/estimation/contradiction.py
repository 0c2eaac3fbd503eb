"""Where the data contradict what a robot YAML declares of its effort: the entry to change, and its value; and whether
what was estimated is the arm of the URDF at all, or the same in other units.

A coupling: tau = C u, the drives' torques are u = D tau, D = C^-1. Every row of D comes from a fit of that drive's
torque to the torques of all joints by the URDF's masses, friction set apart. A row that points elsewhere than the
declared one is a wrong coupling; a row along it, longer or turned round, is a drive's gain or sign.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from robot_ident.configuration import line_of
from robot_ident.estimation.declaration import LOSSES, SHAPE, Declared, clustered
from robot_ident.estimation.problem import Solution
from robot_ident.recording.measurement import Measurement
from robot_ident.robot.robot import Robot
from robot_ident.signals.motion import Array, Motion

_FAR = 3.0  # factor by which no URDF with real masses is wrong
_NEAR = 0.35
_ALIKE = 0.5  # by which the shares of gravity and inertia may differ where one gain makes both
_LOST = 0.2  # share of friction that no bearing behind a gear has


@dataclass(frozen=True)
class Contradiction:
    """An entry of the robot YAML that the data contradict, on some joints: what stands there, and what it should be.

    `share`: of the URDF's torque that is found in the effort, by joint. found: what `share` is, in words. file: where
    the entry stands, of a recording's conditions; the robot's own where it is empty.
    """

    entry: str
    now: str
    change: str
    share: Mapping[str, float]
    found: str = "share of the URDF's torque in it"
    file: str = ""

    def told(self, robot: Robot) -> str:
        """Return the contradiction in one line, with the file and its line, and what to write there instead."""
        file = self.file or str(robot.source)
        line = line_of(file, self.entry)
        return f"{file if line is None else f'{file}:{line}'}: {self.in_words}; change it to '{self.change}'"

    @property
    def in_words(self) -> str:
        """The contradiction in one line."""
        shares = ", ".join(f"{joint} {share:.3g}" for joint, share in self.share.items())
        found = f"{self.found}: {shares}" if shares else self.found
        return f"{self.entry} is {self.now}, which the data contradict ({found})"


def contradiction(judged: Sequence[Declared], robot: Robot) -> Contradiction | None:
    """Return what the data contradict beyond what a URDF's masses may be wrong by, or None.

    A sign needs gravity and inertia turned round, and no friction that takes energy away; a factor beyond three needs
    both alike, and a torque of the URDF's shape; gravity taken out shows on every joint that carries some; a link-side
    sensor feels no friction to speak of on any joint.
    """
    trusted = [d for d in judged if d.verdict != "not_told" and d.explained > SHAPE]
    turned = [
        d for d in trusted if d.verdict == "sign" and d.friction < LOSSES and d.inertia < 0.0 and not d.gravity >= 0.0
    ]
    if turned:
        return _sign(turned, robot, alone=len(turned) == len(trusted))
    loaded = [d for d in trusted if np.isfinite(d.gravity)]
    for verdict, now, then in (("compensated", "included", "removed"), ("included", "removed", "included")):
        found = [d for d in loaded if d.verdict == verdict]
        if found and len(found) == len(loaded) and len(found) >= min(2, robot.n):
            change = f"effort: {{gravity: {then}}}"
            return Contradiction("effort.gravity", now, change, {d.joint: d.gravity for d in found})
    index = robot.joint_index
    behind = [d for d in judged if d.verdict != "not_told" and robot.side(index(d.joint)) == "link"]
    if behind and min(d.friction for d in behind) > _LOST:
        return Contradiction("effort.side", "link", "effort: {side: joint}", {d.joint: d.share for d in behind})
    scaled = [d for d in trusted if d.verdict == "factor" and _scaled(d) and not robot.in_ampere(index(d.joint))]
    alone = len(scaled) == len(trusted) or _one_message(scaled, trusted, robot)
    return _factor(scaled, robot, alone=alone) if scaled else None


def _one_message(scaled: Sequence[Declared], trusted: Sequence[Declared], robot: Robot) -> bool:
    """Return whether joints whose effort is far too small for Nm speak for all: several do, all efforts come by one
    message, and no other joint's weight is that of the URDF in Nm. Inertia alone says nothing against it, for it may be
    a rotor's.
    """
    effort = robot.effort
    alike = not effort.sources and all(effort.of(joint) == effort.common for joint in robot.joints)
    small = len(scaled) > 1 and all(d.share < 1.0 / _FAR for d in scaled)
    in_torque = [d for d in trusted if d not in scaled and np.isfinite(d.gravity) and abs(d.gravity - 1.0) < _NEAR]
    return alike and small and effort.common.quantity == "torque" and not in_torque


def _scaled(d: Declared) -> bool:
    far = not 1.0 / _FAR < d.share < _FAR
    both = np.isfinite(d.gravity) and np.isfinite(d.inertia)
    return d.share > 0 and far and (not both or abs(np.log(max(d.inertia, 1e-9) / d.gravity)) < _ALIKE)


def _sign(turned: Sequence[Declared], robot: Robot, *, alone: bool) -> Contradiction:
    share = {d.joint: d.share for d in turned}
    declared = {joint: robot.effort.of(joint) for joint in share}
    first = next(iter(share))
    sign = declared[first].sign
    if alone and len(turned) > 1 and all(effort == robot.effort.common for effort in declared.values()):
        return Contradiction("effort.sign", str(sign), f"effort: {{sign: {-sign}}}", share)
    change = ", ".join(f"{joint}: {{effort: {{sign: {-effort.sign}}}}}" for joint, effort in declared.items())
    return Contradiction(f"joints.{first}.effort.sign", str(sign), change, share)


def _factor(scaled: Sequence[Declared], robot: Robot, *, alone: bool) -> Contradiction:
    """Return what makes of the shares a torque: side, quantity, or the constants."""
    share = {d.joint: d.share for d in scaled}
    declared = [robot.effort.of(d.joint) for d in scaled]
    joints = [robot.joint_index(d.joint) for d in scaled]
    ratio = robot.drives.gear_ratio[joints]
    constant = robot.drives.torque_constant[joints]
    sizes = np.array(list(share.values()))
    common = (alone or robot.n == 1) and all(e == robot.effort.common for e in declared)
    where = "effort" if common and (len(scaled) > 1 or robot.n == 1) else f"joints.{scaled[0].joint}.effort"

    def change(*words: str) -> str:
        """Return the entry with a word for all of them, or that of each joint with its own."""
        if where == "effort":
            return f"effort: {words[0]}"
        own = words if len(words) == len(scaled) else words * len(scaled)
        return ", ".join(f"{d.joint}: {{effort: {word}}}" for d, word in zip(scaled, own, strict=True))

    if all(e.side != "motor" for e in declared) and _all_near(sizes * ratio):
        return Contradiction(f"{where}.side", declared[0].side, change("{side: motor}"), share)
    if all(e.side == "motor" for e in declared) and _all_near(sizes / ratio):
        return Contradiction(f"{where}.side", "motor", change("{side: joint}"), share)
    if all(e.quantity == "current" for e in declared):
        if _all_near(sizes / constant):
            return Contradiction(f"{where}.quantity", "current", change("torque"), share)
        first, now = scaled[0].joint, constant[0]
        if not np.isfinite(now):
            change_to = f"the curve's torques over {share[first]:.3g}"
            return Contradiction(f"joints.{first}.torque_curve", "a curve", change_to, share)
        change_to = f"{first}: {{torque_constant: {now / share[first]:.3g}}}"
        return Contradiction(f"joints.{first}.torque_constant", f"{now:g}", change_to, share)
    if np.all(sizes < 1.0 / _FAR) and np.ptp(np.log(sizes)) < np.log(_FAR * 10) and sizes.max() > 2e-3:
        fit = ", ".join(f"{d.joint} {1 / d.share:.3g}" for d in scaled)
        every = " for all joints of the message" if where == "effort" and len(scaled) < robot.n else ""
        hint = f"{change('current')}{every}, with torque_constant by joint if known ({fit} Nm/A would fit)"
        return Contradiction(f"{where}.quantity", "torque", hint, share)
    each = sizes if where != "effort" else np.exp(np.mean(np.log(sizes), keepdims=True))
    gains = np.array([effort.gain for effort in declared[: len(each)]]) / each
    power = 10.0 ** np.round(np.log10(gains))  # a unit, where one is near
    told = change(*(f"{{gain: {gain:.3g}}}" for gain in np.where(np.abs(gains / power - 1.0) < _NEAR, power, gains)))
    return Contradiction(f"{where}.gain", f"{declared[0].gain:g}", told, share)


def _all_near(values: np.ndarray) -> bool:
    return bool(np.all(np.isfinite(values)) and np.all(np.abs(values - 1.0) < _NEAR))


_ALONG = 0.9  # cosine of the angle between found and declared row from which on they are the same
_TOLD = 0.1  # sigma of an entry over the row's length up to which it is told
_SHAPE = 0.7  # part of a drive's torque, friction left aside, that the URDF's must account for
_BLOCK = 0.5  # s; within it residuals are not independent


def coupling_contradiction(measurements: Sequence[Measurement], robot: Robot) -> Contradiction | None:
    """Return that the declared coupling contradicts the data and the matrix that fits; None where nothing tells so.

    Judged on the recording that tells the rows best, where all of them are told.
    """
    declared = robot.effort.coupling
    if declared is None:
        return None
    expected = np.linalg.inv(declared)
    told = [rows for measured in measurements if (rows := _rows(measured, robot, declared)) is not None]
    if not told:
        return None
    found, _, explained = min(told, key=lambda one: float(one[1].max()))
    cosine = np.sum(found * expected, axis=1) / np.linalg.norm(found, axis=1) / np.linalg.norm(expected, axis=1)
    wrong = (np.abs(cosine) < _ALONG) & (explained > _SHAPE)
    if not wrong.any() or np.linalg.matrix_rank(found) < robot.n:
        return None
    fit = np.linalg.inv(np.where(wrong[:, None], found, expected))
    joints = [robot.joints[k] for k in np.flatnonzero(wrong)]
    share = {joint: float(abs(cosine[robot.joint_index(joint)])) for joint in joints}
    change = f"effort: {{coupling: {_text(fit)}}}"
    return Contradiction(
        "effort.coupling", _text(declared), change, share, "how far its drives' rows agree, 1 = wholly"
    )


def _rows(measured: Measurement, robot: Robot, coupling: Array) -> tuple[Array, Array, Array] | None:
    """Return D [n, n], the standard deviations of its entries over the rows' length, and the part [n] of each drive's
    torque beside friction that it accounts for; None where it isn't told.
    """
    rigid = robot.rigid.inverse_dynamics(measured.motion)
    v = measured.motion.dq
    columns = measured.passed(np.hstack([rigid, v, np.sign(v), np.ones((len(v), 1))]))
    used = measured.used[measured.rows].all(axis=1)
    torque = np.linalg.solve(coupling, measured.passed(measured.torque).T).T[used]
    columns, n = columns[used], robot.n
    scale = np.linalg.norm(columns, axis=0)
    if len(columns) < 10 * columns.shape[1] or not np.all(scale > 0):
        return None
    scaled = columns / scale
    values, *_ = np.linalg.lstsq(scaled, torque, rcond=1e-9)
    residual, plain = torque - scaled @ values, np.linalg.lstsq(scaled[:, n:], torque, rcond=1e-9)[0]
    without = np.sum((torque - scaled[:, n:] @ plain) ** 2, axis=0)
    explained = 1.0 - np.sum(residual**2, axis=0) / np.maximum(without, 1e-300)
    block = max(1, round(_BLOCK / (measured.dt * measured.decimate)))
    spread = np.column_stack([np.sqrt(np.maximum(np.diag(clustered(scaled, rest, block)), 0.0)) for rest in residual.T])
    found, std = (np.asarray((part / scale[:, None])[:n].T) for part in (values, spread))
    relative = std / np.linalg.norm(found, axis=1)[:, None]
    return (found, relative, explained) if np.all(relative < _TOLD) else None


def _text(matrix: Array) -> str:
    """Return a matrix as YAML, to two digits."""
    rows = ("[" + ", ".join(f"{round(float(x), 2) + 0.0:g}" for x in row) + "]" for row in matrix)
    return f"[{', '.join(rows)}]"


_FACTOR = 20.0  # by which the torque of the links may differ from the URDF's before a word is due
_SAMPLES = 200


def scale_notes(measurements: Sequence[Measurement], found: Solution) -> list[str]:
    """Return a line where the links' torque is a factor away from that of the URDF's masses, on every loaded joint.

    A URDF may be rough, or hold no inertias at all; a factor of a thousand is a unit (Nm for mNm, joint for motor
    side). The joints' ratios are rms over rms along the motion.
    """
    structure = found.structure
    motions = [m.motion for m in measurements]
    picked = [motion[np.linspace(0, motion.samples - 1, _SAMPLES).astype(int)] for motion in motions]
    q, dq, ddq = (np.concatenate([getattr(one, order) for one in picked]) for order in ("q", "dq", "ddq"))
    states = Motion(q, dq, ddq)
    ours = structure.reported(structure.rigid_columns(states)) @ found.values[: len(structure.base.columns)]
    theirs = structure.robot.rigid.inverse_dynamics(states)
    size, expected = (np.sqrt(np.mean(x**2, axis=0)) for x in (ours, theirs))
    loaded = expected > 0.01 * expected.max()
    if not loaded.any() or not np.all(size > 0):
        return []
    ratio = size[loaded] / expected[loaded]
    if not (np.all(ratio > _FACTOR) or np.all(ratio < 1.0 / _FACTOR)):
        return []
    return [
        f"the links' torque is about {float(np.exp(np.mean(np.log(ratio)))):.2g} times what the URDF's masses need:"
        " another unit, motor side instead of joint side, or a URDF without real masses?"
    ]
