"""Where the data contradict what a robot YAML declares of its effort: the entry to change, and its value."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from robot_ident.configuration import line_of
from robot_ident.estimation.declaration import LOSSES, SHAPE
from robot_ident.estimation.declared import Declared
from robot_ident.robot.drives import Effort
from robot_ident.robot.robot import Robot

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
    turned = [d for d in trusted if d.verdict == "sign" and _turned(d)]
    if turned:
        return _sign(turned, robot, alone=len(turned) == len(trusted))
    loaded = [d for d in trusted if np.isfinite(d.gravity)]
    for verdict, now, then in (("compensated", "included", "removed"), ("included", "removed", "included")):
        found = [d for d in loaded if d.verdict == verdict]
        if found and len(found) == len(loaded) and len(found) >= min(2, robot.n):
            change = f"effort: {{gravity: {then}}}"
            return Contradiction("effort.gravity", now, change, {d.joint: d.gravity for d in found})
    behind = [d for d in judged if d.verdict != "not_told" and robot.side(_index(robot, d)) == "link"]
    if behind and min(d.friction for d in behind) > _LOST:
        return Contradiction("effort.side", "link", "effort: {side: joint}", {d.joint: d.share for d in behind})
    scaled = [d for d in trusted if d.verdict == "factor" and _scaled(d) and not robot.in_ampere(_index(robot, d))]
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


def _turned(d: Declared) -> bool:
    both = [share for share in (d.gravity, d.inertia) if np.isfinite(share)]
    return all(share < 0 for share in both) and d.friction < LOSSES and np.isfinite(d.inertia)


def _scaled(d: Declared) -> bool:
    far = not 1.0 / _FAR < d.share < _FAR
    both = np.isfinite(d.gravity) and np.isfinite(d.inertia)
    return d.share > 0 and far and (not both or abs(np.log(max(d.inertia, 1e-9) / d.gravity)) < _ALIKE)


def _index(robot: Robot, d: Declared) -> int:
    return robot.joint_index(d.joint)


def _sign(turned: Sequence[Declared], robot: Robot, *, alone: bool) -> Contradiction:
    share = {d.joint: d.share for d in turned}
    signs = {robot.effort.of(d.joint).sign for d in turned}
    sign = robot.effort.of(turned[0].joint).sign
    common = all(robot.effort.of(d.joint) == robot.effort.common for d in turned)
    if alone and common and len(signs) == 1 and len(turned) > 1:
        return Contradiction("effort.sign", str(sign), f"effort: {{sign: {-sign}}}", share)
    first = turned[0].joint
    change = ", ".join(f"{d.joint}: {{effort: {{sign: {-robot.effort.of(d.joint).sign}}}}}" for d in turned)
    return Contradiction(f"joints.{first}.effort.sign", str(sign), change, share)


def _factor(scaled: Sequence[Declared], robot: Robot, *, alone: bool) -> Contradiction:
    """Return what makes of the shares a torque: side, quantity, or the constants."""
    share = {d.joint: d.share for d in scaled}
    declared = [robot.effort.of(d.joint) for d in scaled]
    joints = [_index(robot, d) for d in scaled]
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
        return _constants(scaled, constant, share)
    if np.all(sizes < 1.0 / _FAR) and np.ptp(np.log(sizes)) < np.log(_FAR * 10) and sizes.max() > 2e-3:
        fit = ", ".join(f"{d.joint} {1 / d.share:.3g}" for d in scaled)
        every = " for all joints of the message" if where == "effort" and len(scaled) < robot.n else ""
        hint = f"{change('current')}{every}, with torque_constant by joint if known ({fit} Nm/A would fit)"
        return Contradiction(f"{where}.quantity", "torque", hint, share)
    each = sizes if where != "effort" else np.exp(np.mean(np.log(sizes), keepdims=True))
    gains = [_told_gain(effort, float(size)) for effort, size in zip(declared, each, strict=False)]
    told = change(*(f"{{gain: {gain:.3g}}}" for gain in gains))
    return Contradiction(f"{where}.gain", f"{declared[0].gain:g}", told, share)


def _constants(scaled: Sequence[Declared], constant: np.ndarray, share: Mapping[str, float]) -> Contradiction:
    first = scaled[0].joint
    if not np.isfinite(constant[0]):
        return Contradiction(
            f"joints.{first}.torque_curve", "a curve", f"the curve's torques over {share[first]:.3g}", share
        )
    now, fit = f"{constant[0]:g}", constant[0] / share[first]
    return Contradiction(f"joints.{first}.torque_constant", now, f"{first}: {{torque_constant: {fit:.3g}}}", share)


def _all_near(values: np.ndarray) -> bool:
    return bool(np.all(np.isfinite(values)) and np.all(np.abs(values - 1.0) < _NEAR))


def _told_gain(effort: Effort, share: float) -> float:
    """Return the gain with which the share would be 1, a power of ten where one is near: a unit."""
    gain = effort.gain / share
    power = 10.0 ** round(np.log10(gain))
    return float(power) if abs(gain / power - 1.0) < _NEAR else gain
