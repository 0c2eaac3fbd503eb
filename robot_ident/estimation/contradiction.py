"""What the data contradict in the declaration of effort: the entry to change, and what to write there.

An advice holds all that is declared there already and stays, never what is declared as it is, and whoever follows it
is not told the opposite next. Where no one entry explains all joints, it names what to look at instead.

A coupling: tau = C u, the drives' torques are u = D tau, D = C^-1. Every row of D comes from a fit of that drive's
torque to the torques of all joints by the URDF's masses, friction set apart. A row that points elsewhere than the
declared one is a wrong coupling; a row along it, longer or turned round, is a drive's gain or sign.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, fields
from typing import Any

import numpy as np

from robot_ident.configuration import line_of
from robot_ident.estimation.declaration import LOSSES, SHAPE, USUAL, Declared, clustered
from robot_ident.recording.measurement import Measurement
from robot_ident.regression.block_jackknife import rows_in_block
from robot_ident.robot.drives import Effort
from robot_ident.robot.robot import Robot
from robot_ident.signals.motion import Array

_BEYOND = 3.0  # factor by which no URDF with real masses is wrong
_ONE_GAIN = 0.5  # by which the shares of gravity and inertia may differ where one gain makes both
_LOST = 0.2  # share of friction that no bearing behind a gear has
_MASSES = "the masses and inertias of the URDF"


@dataclass(frozen=True)
class Contradiction:
    """An entry of the robot YAML that the data contradict, on some joints: what stands there, and what it should be.

    change: what to write there, empty where no entry explains the data. look: what else to look at. `share`: of the
    URDF's torque that is found in the effort, by joint. found: what `share` is, in words. file: where the entry stands,
    of a recording's conditions; the robot's own where it is empty.
    """

    entry: str
    now: str
    change: str
    share: Mapping[str, float]
    found: str = "share of the URDF's torque in it"
    file: str = ""
    look: str = ""

    def told(self, robot: Robot) -> str:
        """Return the contradiction in one line, with the file and its line, and what to write there instead."""
        file = self.file or str(robot.source)
        line = line_of(file, self.entry)
        change = f"change it to '{self.change}'" if self.change else ""
        advice = "; ".join(text for text in (change, self.look) if text)
        return f"{file if line is None else f'{file}:{line}'}: {self.in_words}; {advice}"

    @property
    def of_weight(self) -> bool:
        """Whether it is about weight that a driver takes out of its efforts."""
        return self.entry.endswith("effort.gravity")

    @property
    def in_words(self) -> str:
        """The contradiction in one line."""
        found = f"{self.found}: {_by_joint(self.share)}" if self.share else self.found
        return f"{self.entry} is {self.now}, which the data contradict ({found})"


def contradiction(judged: Sequence[Declared], robot: Robot) -> Contradiction | None:
    """Return what the data contradict beyond what a URDF's masses may be wrong by, or None.

    Gravity taken out shows on every joint that carries some, and inertia then tells sign and gain; a sign needs gravity
    and inertia turned round, and no friction that takes energy away; a factor beyond three needs both alike, and a
    torque of the URDF's shape; a link-side sensor feels no friction to speak of on any joint.
    """
    trusted = [d for d in judged if d.verdict != "not_told" and d.explained > SHAPE]
    loaded = [d for d in trusted if np.isfinite(d.gravity)]
    turned = [d for d in trusted if _is_turned(d)]
    enough = min(2, robot.n)
    weightless = [d for d in loaded if d.verdict == "compensated"]
    if len(weightless) == len(loaded) >= enough:
        put_back = [d for d in weightless if robot.effort.of(d.joint).gravity == "removed"]
        if not put_back:
            return _weight_removed(trusted, turned, robot)
        if len(put_back) == len(loaded) and len(turned) == len(trusted):
            return _weight_turned(turned, robot)
    turned = [d for d in turned if d.verdict == "sign"]
    if turned:
        return _sign(turned, trusted, robot)
    twice = [d for d in loaded if d.verdict == "included"]
    if len(twice) == len(loaded) >= enough:
        words = {joint: {"gravity": "included"} for joint in robot.joints}
        return _entry(words, robot, {d.joint: d.gravity for d in twice}, "share of the URDF's weight in it")
    index = robot.joint_index
    behind = [d for d in judged if d.verdict != "not_told" and robot.side(index(d.joint)) == "link"]
    if behind and min(d.friction for d in behind) > _LOST:
        return _entry(
            {joint: {"side": "joint"} for k, joint in enumerate(robot.joints) if robot.side(k) == "link"},
            robot,
            {d.joint: d.friction for d in behind},
            "friction, which a link-side sensor hardly feels, takes this share of rms torque times rms speed",
        )
    scaled = [d for d in trusted if d.verdict == "factor" and _scaled(d) and not robot.in_ampere(index(d.joint))]
    if not scaled:
        return None
    share = {d.joint: d.share for d in scaled}
    reading = _of_factor(scaled, robot, alone=len(scaled) == len(trusted) or _one_message(scaled, trusted, robot))
    if reading.instead:
        return Contradiction(reading.entry, reading.now, reading.instead, share)
    if not reading.words:
        return Contradiction(reading.entry, reading.now, "", share, look=reading.look)
    return _entry(reading.words, robot, share, beside=reading.beside, look=reading.look)


def _is_turned(d: Declared) -> bool:
    """Return whether weight and inertia, or inertia alone where no weight tells, say that an effort is turned round."""
    return bool(d.verdict in ("sign", "compensated") and d.friction < LOSSES and d.inertia < 0.0) and not (
        d.verdict == "sign" and d.gravity >= 0.0
    )


def weight_removed(robot: Robot, found: str) -> Contradiction:
    """Return that the driver takes weight out of the efforts of all joints. found: what tells so, in words."""
    return _entry({joint: {"gravity": "removed"} for joint in robot.joints}, robot, {}, found)


def _weight_removed(trusted: Sequence[Declared], turned: Sequence[Declared], robot: Robot) -> Contradiction:
    """Return that weight is not in the efforts, with what inertia says of their sign and gain."""
    words: dict[str, dict[str, Any]] = {joint: {"gravity": "removed"} for joint in robot.joints}
    every = len(turned) == len(trusted) and _alike(robot)
    for joint in robot.joints if every else [d.joint for d in turned]:
        words[joint]["sign"] = -robot.effort.of(joint).sign
    in_ampere = [d for d in trusted if robot.in_ampere(robot.joint_index(d.joint))]
    scaled = [d for d in trusted if d.verdict in ("factor", "compensated") and _scaled(d) and d not in in_ampere]
    beside, look = "", ""
    if scaled:
        reading = _of_factor(scaled, robot, alone=len(scaled) == len(trusted))
        for joint, more in reading.words.items():
            words[joint] |= more
        beside, look = (f", {reading.instead}" if reading.instead else reading.beside), reading.look
    if in_ampere:
        fit = _by_joint({d.joint: 1.0 / abs(d.felt) for d in in_ampere if np.isfinite(d.felt)})
        beside = f", with torque_constant by joint ({fit} Nm/A would fit)"
    if any(own.get("quantity") == "current" for own in words.values()) or in_ampere:
        needs = "without torque_constant the weight, which is in Nm, can't be put back"
        look = "; ".join(text for text in (needs, look) if text)
    found = "share of the URDF's weight in it"
    if turned or scaled or in_ampere:
        inertia = _by_joint({d.joint: d.inertia for d in trusted if np.isfinite(d.inertia)})
        found = f"share of the URDF's inertial torque in it: {inertia}; of its weight"
    weight = {d.joint: round(d.gravity, 3) + 0.0 for d in trusted if np.isfinite(d.gravity)}
    return _entry(words, robot, weight, found, beside=beside, look=look)


def _weight_turned(turned: Sequence[Declared], robot: Robot) -> Contradiction:
    """Return that efforts hold their weight and are turned round, where what was put back cancels it."""
    joints = robot.joints if _alike(robot) else [d.joint for d in turned]
    words = {joint: {"gravity": "included", "sign": -robot.effort.of(joint).sign} for joint in joints}
    return _entry(words, robot, {d.joint: d.inertia for d in turned}, "share of the URDF's inertial torque in it")


def _alike(robot: Robot) -> bool:
    """Return whether all joints report what is declared once for all."""
    return all(robot.effort.of(joint) == robot.effort.common for joint in robot.joints)


def _by_joint(share: Mapping[str, float]) -> str:
    return ", ".join(f"{joint} {value:.3g}" for joint, value in share.items())


def _entry(
    words: Mapping[str, Mapping[str, Any]],
    robot: Robot,
    share: Mapping[str, float],
    found: str = Contradiction.found,
    *,
    beside: str = "",
    look: str = "",
) -> Contradiction:
    """Return the entries of the robot YAML that hold new words for joints beside all that stays.

    What holds for all joints goes to the section of all, unless joints have sections of their own. beside: what else to
    write with it.
    """
    effort = robot.effort
    words = {joint: _new(own, effort.of(joint)) for joint, own in words.items() if _new(own, effort.of(joint))}
    first, own = next(iter(words.items()))
    shared = {
        key: value
        for key, value in own.items()
        if _alike(robot) and all(words.get(joint, {}).get(key) == value for joint in robot.joints)
    }
    told = []
    if shared:
        kept: dict[str, Any] = {} if effort.topic is None else {"topic": effort.topic}
        kept |= {} if effort.coupling is None else {"coupling": effort.coupling}
        told.append(f"effort: {_yaml(_differing(effort.common, Effort()) | shared | kept)}")
    for joint, new in words.items():
        rest = {key: value for key, value in new.items() if key not in shared}
        if rest:
            told.append(f"{joint}: {{effort: {_yaml(_differing(effort.of(joint), effort.common) | rest)}}}")
    key = next(iter(own))
    where = f"effort.{key}" if key in shared else f"joints.{first}.effort.{key}"
    now = getattr(effort.of(first), key)
    if effort.sources and shared:
        look = "; ".join(text for text in (look, "topic and field stay") if text)
    return Contradiction(where, _word(now), ", ".join(told) + beside, share, found, look=look)


def _new(words: Mapping[str, Any], effort: Effort) -> dict[str, Any]:
    """Return the words that an effort isn't declared by already."""
    return {key: value for key, value in words.items() if getattr(effort, key) != value}


def _differing(effort: Effort, base: Effort) -> dict[str, Any]:
    """Return the keys of the robot YAML in which an effort differs from another."""
    differs = (f.name for f in fields(Effort) if getattr(effort, f.name) != getattr(base, f.name))
    return {"relative_gain" if name == "relative" else name: getattr(effort, name) for name in differs}


def _yaml(words: Mapping[str, Any]) -> str:
    """Return the section of an effort as YAML in one line."""
    if list(words) == ["quantity"]:
        return str(words["quantity"])
    return f"{{{', '.join(f'{key}: {_word(value)}' for key, value in words.items())}}}"


def _word(value: Any) -> str:
    if isinstance(value, bool):
        return str(value).lower()
    if isinstance(value, np.ndarray):
        return f"[{', '.join(map(_word, value))}]"
    return f"{value:.6g}" if isinstance(value, float) else str(value)


def _one_message(scaled: Sequence[Declared], trusted: Sequence[Declared], robot: Robot) -> bool:
    """Return whether joints whose effort is far too small for Nm speak for all: several do, all efforts come by one
    message, and no other joint's weight is that of the URDF in Nm. Inertia alone says nothing against it, for it may be
    a rotor's.
    """
    effort = robot.effort
    alike = not effort.sources and _alike(robot)
    small = len(scaled) > 1 and all(d.share < 1.0 / _BEYOND for d in scaled)
    in_torque = [d for d in trusted if d not in scaled and np.isfinite(d.gravity) and abs(d.gravity - 1.0) < USUAL]
    return alike and small and effort.common.quantity == "torque" and not in_torque


def _scaled(d: Declared) -> bool:
    if d.verdict == "compensated":
        return bool(np.isfinite(d.felt)) and not 1.0 / _BEYOND < abs(d.felt) < _BEYOND
    far = not 1.0 / _BEYOND < d.share < _BEYOND
    both = np.isfinite(d.gravity) and np.isfinite(d.inertia)
    return d.share > 0 and far and (not both or abs(np.log(max(d.inertia, 1e-9) / d.gravity)) < _ONE_GAIN)


def _sign(turned: Sequence[Declared], trusted: Sequence[Declared], robot: Robot) -> Contradiction:
    every = len(turned) == len(trusted) > 1 and _alike(robot)
    joints = robot.joints if every else [d.joint for d in turned]
    words = {joint: {"sign": -robot.effort.of(joint).sign} for joint in joints}
    return _entry(words, robot, {d.joint: d.share for d in turned})


@dataclass(frozen=True)
class _Reading:
    """What makes torques of efforts: words for the section of each joint, what else to write or to look at; or, of
    drives, an entry elsewhere that should be something else instead.
    """

    entry: str = ""
    now: str = ""
    words: Mapping[str, Mapping[str, Any]] = field(default_factory=dict)
    beside: str = ""
    look: str = ""
    instead: str = ""


def _of_factor(scaled: Sequence[Declared], robot: Robot, *, alone: bool) -> _Reading:
    """Return what makes of the shares a torque: side, quantity, or the constants."""
    sizes = {d.joint: abs(d.felt) for d in scaled}
    common = alone and _alike(robot) and (len(scaled) > 1 or robot.n == 1)
    geared = {joint: words for joint, size in sizes.items() if (words := _by_gear(joint, size, robot))}
    if geared:
        return _of_gears(geared, sizes, robot, common=common)
    kinds = {joint: robot.effort.of(joint).quantity for joint in sizes}
    if set(kinds.values()) == {"current"}:
        return _of_current(sizes, robot, common=common)
    sizes = {joint: size for joint, size in sizes.items() if kinds[joint] == "torque"}
    values = np.array(list(sizes.values()))
    joints = robot.joints if common else tuple(sizes)
    if np.all(values < 1.0 / _BEYOND) and np.ptp(np.log(values)) < np.log(_BEYOND * 10) and values.max() > 2e-3:
        fit = _by_joint({joint: 1.0 / size for joint, size in sizes.items()})
        every = " for all joints of the message" if common and len(sizes) < robot.n else ""
        beside = f"{every}, with torque_constant by joint if known ({fit} Nm/A would fit)"
        look = "" if _ratios_known(sizes, robot) else "a motor's torque needs {side: motor} and gear_ratio instead"
        return _Reading(words={joint: {"quantity": "current"} for joint in joints}, beside=beside, look=look)
    if common:
        return _one_gain(sizes, robot)
    return _own_gains(sizes, robot)


def _ratios_known(joints: Mapping[str, float], robot: Robot) -> bool:
    """Return whether the gear ratios of joints are declared: as 1, none is."""
    return all(robot.drives.gear_ratio[robot.joint_index(joint)] != 1.0 for joint in joints)


def _by_gear(joint: str, size: float, robot: Robot) -> dict[str, Any]:
    """Return what explains a share by the joint's gear ratio: the side, or a torque that was multiplied by it twice."""
    effort, ratio = robot.effort.of(joint), float(robot.drives.gear_ratio[robot.joint_index(joint)])
    if effort.side == "motor":
        return {"side": "joint"} if _near(size / ratio) else {}
    if _near(size * ratio):
        return {"side": "motor"}
    return {"gain": float(f"{effort.gain / ratio:.3g}")} if _near(size / ratio) else {}


def _of_gears(
    geared: Mapping[str, dict[str, Any]], sizes: Mapping[str, float], robot: Robot, *, common: bool
) -> _Reading:
    """Return the words of joints that a gear ratio explains, and beside them the gains of the others."""
    twice = [joint for joint, words in geared.items() if "gain" in words]
    look = f"the effort of {', '.join(twice)} seems to be multiplied by gear_ratio already" if twice else ""
    first = next(iter(geared.values()))
    if common and "side" in first and all(geared.get(joint) == first for joint in sizes):
        return _Reading(words=dict.fromkeys(robot.joints, first))
    others = {joint: size for joint, size in sizes.items() if joint not in geared}
    rest = _own_gains(others, robot) if others else _Reading()
    return _Reading(words={**geared, **rest.words}, look="; ".join(text for text in (look, rest.look) if text))


def _of_current(sizes: Mapping[str, float], robot: Robot, *, common: bool) -> _Reading:
    """Return what makes a torque of currents: they are torques already, or a drive's constant is another."""
    constant = robot.drives.torque_constant[[robot.joint_index(joint) for joint in sizes]]
    if all(_near(size / k) for size, k in zip(sizes.values(), constant, strict=True)):
        return _Reading(words=dict.fromkeys(robot.joints if common else sizes, {"quantity": "torque"}))
    (first, size), now = next(iter(sizes.items())), float(constant[0])
    if not np.isfinite(now):
        return _Reading(f"joints.{first}.torque_curve", "a curve", instead=f"the curve's torques over {size:.3g}")
    wanted = f"{first}: {{torque_constant: {now / size:.3g}}}"
    return _Reading(f"joints.{first}.torque_constant", f"{now:g}", instead=wanted)


def _one_gain(sizes: Mapping[str, float], robot: Robot) -> _Reading:
    """Return the gain of all efforts that leaves no joint beyond what masses may be wrong by; without words, what to
    look at where there is none.
    """
    now, values = robot.effort.common.gain, np.array(list(sizes.values()))
    gain = now / float(np.exp(np.mean(np.log(values))))
    for one in (_unit(gain), gain):
        after = values * one / now
        if one and np.all((after > 1.0 / _BEYOND) & (after < _BEYOND)):
            words = dict.fromkeys(robot.joints, {"gain": float(f"{one:.3g}")})
            return _Reading(words=words, look="" if _unit(gain) else _OTHERWISE)
    apart = float(values.max() / values.min())
    look = (
        f"no one gain explains all joints, whose shares differ by a factor of {apart:.3g}: look at gear_ratio,"
        f" torque_constant and side of {', '.join(sizes)}, and at {_MASSES}"
    )
    return _Reading("effort.gain", _word(now), look=look)


_OTHERWISE = (
    "where a reported unit is not that, look at side and gear_ratio (a torque of the motor needs {side: motor} and"
    f" gear_ratio), at quantity, and at {_MASSES}"
)


def _own_gains(sizes: Mapping[str, float], robot: Robot) -> _Reading:
    """Return a gain for each joint: a unit, where one is near; else with what to look at before it is believed."""
    gains = {joint: robot.effort.of(joint).gain / size for joint, size in sizes.items()}
    words = {joint: {"gain": float(f"{_unit(gain) or gain:.3g}")} for joint, gain in gains.items()}
    return _Reading(words=words, look="" if all(map(_unit, gains.values())) else _OTHERWISE)


def _unit(gain: float) -> float:
    """Return the power of ten that is near a gain, 0 where none is."""
    power = float(10.0 ** np.round(np.log10(gain)))
    return power if abs(gain / power - 1.0) < USUAL else 0.0


def _near(value: float) -> bool:
    return bool(np.isfinite(value) and abs(value - 1.0) < USUAL)


_ALONG = 0.9  # cosine of the angle between found and declared row from which on they are the same
_TOLD = 0.1  # sigma of an entry over the row's length up to which it is told


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
    wrong = (np.abs(cosine) < _ALONG) & (explained > SHAPE)
    if not wrong.any() or np.linalg.matrix_rank(found) < robot.n:
        return None
    fit = np.linalg.inv(np.where(wrong[:, None], found, expected))
    joints = [robot.joints[k] for k in np.flatnonzero(wrong)]
    share = {joint: float(abs(cosine[robot.joint_index(joint)])) for joint in joints}
    change = f"effort: {{coupling: {_matrix(fit)}}}"
    return Contradiction(
        "effort.coupling", _matrix(declared), change, share, "how far its drives' rows agree, 1 = wholly"
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
    block = rows_in_block(measured)
    spread = np.column_stack([np.sqrt(np.maximum(np.diag(clustered(scaled, rest, block)), 0.0)) for rest in residual.T])
    found, std = (np.asarray((part / scale[:, None])[:n].T) for part in (values, spread))
    relative = std / np.linalg.norm(found, axis=1)[:, None]
    return (found, relative, explained) if np.all(relative < _TOLD) else None


def _matrix(matrix: Array) -> str:
    """Return a matrix as YAML, to two digits."""
    rows = ("[" + ", ".join(f"{round(float(x), 2) + 0.0:g}" for x in row) + "]" for row in matrix)
    return f"[{', '.join(rows)}]"
