"""Does the effort mean what the robot YAML declares? Held against the rigid model of the URDF.

What is off alike on every joint is no drive's matter. Stamps that run r times too fast make accelerations r^2 and
products of speeds r^2 times too small; the weight knows no time: k_g = 1, k_i = r^2 on all joints. A URDF's inertias
are rarely all wrong by one factor beside right weights. Where both shares are off by one factor, all efforts may have a
wrong gain: a fit takes it for heavier links.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import asdict, dataclass, replace
from typing import Any

import numpy as np

from robot_ident.estimation.problem import Solution
from robot_ident.recording.measurement import Measurement, Processing
from robot_ident.recording.process import process
from robot_ident.recording.recording import Recording
from robot_ident.regression.block_jackknife import rows_in_block
from robot_ident.robot.robot import Robot
from robot_ident.signals.motion import Array, joined

NOT_TOLD = float("nan")


@dataclass(frozen=True)
class Declared:
    """What a recording says of a joint's effort: `share` of the URDF's gravity torque (of the inertial one where the
    joint carries no gravity) that is found in it, with its standard deviation, the verdict, and what to look at.

    verdict: consistent, compensated (gravity is taken out, whatever sign and gain inertia shows), included (though
    declared to be taken out), sign, factor, driven where friction gives energy, clock where time explains all joints,
    or not_told where the motion loads the joint too little, or the URDF's torque is hardly in its effort. gravity,
    inertia: both shares, nan where not told.
    friction: power that is lost over the product of rms torque and rms speed; negative where effort has the wrong sign.
    explained: part of the effort, friction left aside, that the URDF's torque times those shares accounts for.
    felt: the share that tells sign and gain of the effort: of inertia where gravity is taken out, 1 at most where a
    rotor may be in it.
    """

    joint: str
    share: float
    std: float
    verdict: str
    hint: str
    gravity: float = NOT_TOLD
    inertia: float = NOT_TOLD
    friction: float = 0.0
    explained: float = 0.0
    felt: float = NOT_TOLD

    def to_dict(self) -> dict[str, Any]:
        """Return it as `info --json` prints it: null where nothing is told."""
        values = {key: value for key, value in asdict(self).items() if key != "felt"}
        return {key: None if isinstance(v, float) and not np.isfinite(v) else v for key, v in values.items()}


_WEIGHT = 0.15  # by which shares of gravity may be off 1
_ALIKE = 0.15  # by which the logarithms of the joints' shares of inertia may be off their middle
_FAR = 1.4  # factor of inertia from which on it is the clock rather than the URDF: stamps 18 % off
_CLOSELY = 0.05  # by which logarithms may be off their middle where three joints or more tell a smaller one
_NEAR = 1.1  # that smaller factor: stamps 5 % off


def by_clock(judged: Sequence[Declared]) -> list[Declared]:
    """Return judgements of all joints of a recording, those that a wrong clock explains together with the verdict
    `clock`: two or more joints that tell of inertia, one or more that tell of weight.
    """
    told = [d for d in judged if np.isfinite(d.inertia) and d.explained > SHAPE]
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


def gain_of_all(judged: Sequence[Declared], robot: Robot) -> list[str]:
    """Return a line where weight and inertia are off the URDF's by one factor, k_g = k_i = g, on two joints or more.

    Data can't say whether all efforts or all masses are off. A current in ampere is off by its torque constant.
    """
    in_torque = {name for j, name in enumerate(robot.joints) if not robot.in_ampere(j)}
    telling = [d for d in judged if d.verdict == "consistent" or (d.verdict == "factor" and d.joint in in_torque)]
    told = [d for d in telling if np.isfinite(d.share) and d.explained > SHAPE]
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


USUAL = 0.35  # a URDF's masses are seldom better than that
_LITTLE = 0.15  # share below which next to nothing of it is found
_SURE = 4.0  # standard deviations
_HARDLY = 0.1  # sigma of the share from which on the motion loads a joint well enough to tell
_CONSTANT = 0.01  # of gravity's rms torque that changes along the motion
_ROWS = 20_000  # that are looked at, at most
_ROTOR = 5  # column of the rotor's inertia, after the URDF's torques, friction and offset
_APART = 0.2  # of the URDF's inertial torque that no rotor could make
_DRIVES = 5.0  # standard deviations by which friction must be seen to give energy
SHAPE = 0.7  # part of the effort beside friction that the URDF's torque must make, lest nothing is said of the effort
LOSSES = 0.02  # share of the torque from which on friction tells a sign


def judge_declaration(recording: Recording, robot: Robot) -> list[Declared]:
    """Return by joint how effort and rigid model go together, from a recording taken as one pass.

    Raises InputError where the recording isn't of this robot. See `judge_measured`.
    """
    return judge_measured(process(recording, robot, Processing(periodic=False)), robot)


def judge_measured(measured: Measurement, robot: Robot) -> list[Declared]:
    """Return by joint how effort and rigid model go together.

    tau = k_g g(q) + k_i (tau_rigid - g(q)) + b dq + c sign(dq) + offset + r ddq, the rotor's r where the URDF's inertia
    is not of the same shape: k_g near 1 is consistent; near 0 beside k_i near 1 the driver has taken gravity out; below
    0 the sign is wrong; any other constant is a gain, a gear ratio or a current in ampere. Needs masses in the URDF.
    """
    samples = measured.motion.samples
    every = max(1, samples // _ROWS)
    thin = measured.motion[slice(None, None, every)]
    still = np.zeros_like(thin.q)
    gravity = at_all_rows(robot.rigid.inverse_dynamics(replace(thin, dq=still, ddq=still)), samples, every)
    inertial = at_all_rows(robot.rigid.inverse_dynamics(thin), samples, every) - gravity
    return by_clock([_judge(robot, measured, gravity[:, j], inertial[:, j], j) for j in range(robot.n)])


def at_all_rows(torque: Array, samples: int, every: int) -> Array:
    """Return a torque [K, n] of every so many rows at all of them [N, n], linear between."""
    if every == 1:
        return torque
    at = np.arange(0, samples, every)
    return np.column_stack([np.interp(np.arange(samples), at, column) for column in torque.T])


def _judge(robot: Robot, measured: Measurement, gravity: Array, inertial: Array, joint: int) -> Declared:
    motion, name = measured.motion, robot.joints[joint]
    v = motion.dq[:, joint]
    whole = np.column_stack([gravity, inertial, v, np.sign(v), np.ones(len(v)), motion.ddq[:, joint]])
    rows = measured.used[measured.rows, joint]
    columns, tau = measured.passed(whole)[rows], measured.passed(measured.torque)[rows, joint]
    size = np.linalg.norm(columns, axis=0)
    size = np.where(size > 1e-9 * size.max(initial=1.0), size, np.inf)  # a column of nothing tells nothing
    if len(columns) < 10:
        return Declared(name, NOT_TOLD, float("inf"), "not_told", "it hardly moves")
    if np.std(columns[:, 0]) < _CONSTANT * np.sqrt(np.mean(columns[:, 0] ** 2)):
        size[0] = np.inf  # weight that does not change, of a vertical slide, is an offset
    scaled = columns / size
    apart = _apart_from_rotor(scaled)
    scaled = scaled if apart else scaled[:, :_ROTOR]
    solved, *_ = np.linalg.lstsq(scaled, tau, rcond=1e-9)
    covariance = clustered(scaled, tau - scaled @ solved, rows_in_block(measured))
    spread = np.sqrt(np.maximum(np.diag(covariance), 0.0))
    found = {k: (float(solved[k] / size[k]), float(spread[k] / size[k])) for k in (0, 1) if np.isfinite(size[k])}
    told = {k: (s, std) for k, (s, std) in found.items() if 0.0 < std < _HARDLY or abs(s) > _SURE * std > 0.0}
    if robot.effort.of(name).gravity == "removed" and len(told) == 2 and abs(told[0][0] - 1.0) < USUAL:
        told = {1: told[1]}  # the weight was put back from the URDF: it tells nothing of the effort
    power = float(np.linalg.norm(tau - np.mean(tau)) * np.linalg.norm(columns[:, 2]))
    taken = columns[:, 2] @ scaled[:, 2:4]  # by friction, per unit of its coefficients
    lost, lost_std = float(taken @ solved[2:4]), np.sqrt(max(float(taken @ covariance[2:4, 2:4] @ taken), 0.0))
    friction = lost / power if power > 0 else 0.0
    if not told:
        return Declared(name, NOT_TOLD, float("inf"), "not_told", "the motion loads it too little", friction=friction)
    beside = tau - scaled[:, 2:_ROTOR] @ solved[2:_ROTOR]
    left, whole_power = np.sum((beside - scaled[:, :2] @ solved[:2]) ** 2), np.sum(beside**2)
    explained = float(1.0 - left / whole_power) if whole_power > 0 else 0.0
    share, std = told.get(0) or told[1]
    hidden_rotor = not apart and 0 not in told
    verdict, hint = _verdict(robot, joint, told, apart=apart, hidden_rotor=hidden_rotor)
    if verdict == "factor" and hidden_rotor and share > 1.0 and not robot.in_ampere(joint):
        verdict = "not_told"  # a rotor that the URDF lacks makes just that
    gravity_share, inertia_share = (told[k][0] if k in told else NOT_TOLD for k in (0, 1))
    felt, felt_std = told[1] if verdict == "compensated" else (share, std)
    if verdict == "compensated" and not apart:
        felt = float(np.clip(felt, -1.0, 1.0))
    off = verdict in ("sign", "factor") or (verdict == "compensated" and abs(felt - 1.0) > USUAL)
    if off and (explained <= SHAPE or abs(felt) <= _SURE * felt_std):
        part = 100.0 * max(explained, 0.0)
        hint = f"not decidable: the URDF's torque makes {part:.0f} % of the effort beside friction here"
        return Declared(name, NOT_TOLD, float("inf"), "not_told", hint, friction=friction, explained=explained)
    if felt > 0 and friction < -LOSSES and lost < -_DRIVES * lost_std:
        verdict, hint = "driven", "friction drives it: effort, position or time has the wrong sign"
    return Declared(name, share, std, verdict, hint, gravity_share, inertia_share, friction, explained, felt)


def _apart_from_rotor(columns: Array) -> bool:
    """Return whether what the URDF's inertia needs (second column) can be told from a rotor of the drive (last one),
    friction and gravity aside: that of an axis that turns one and the same inertia can't.
    """
    inertial, others = columns[:, 1], np.delete(columns, 1, axis=1)
    beside, *_ = np.linalg.lstsq(others, inertial, rcond=1e-9)
    return bool(np.linalg.norm(inertial - others @ beside) > _APART * np.linalg.norm(inertial))


def _verdict(
    robot: Robot, joint: int, told: dict[int, tuple[float, float]], *, apart: bool, hidden_rotor: bool
) -> tuple[str, str]:
    """Return verdict and hint for the shares (value, sigma) that are told: 0 of gravity, 1 of inertia.

    apart: the share of inertia holds no rotor. hidden_rotor: it holds that of a rotor that the URDF lacks, if there is
    one.
    """
    (share, std), (inertia, _) = told.get(0) or told[1], told.get(1) or told[0]
    unit = "N" if robot.prismatic[joint] else "Nm"
    declared = robot.effort.of(robot.joints[joint])
    if declared.gravity == "removed" and 0 in told and abs(share - 2.0) < max(USUAL, _SURE * std):
        return "included", "gravity is in it already: effort: {gravity: included}"
    if abs(share - 1.0) < max(USUAL, _SURE * std):
        return "consistent", ""
    if 0 in told and 1 in told and share < -max(_LITTLE, _SURE * std) and inertia > _LITTLE:
        return "sign", "weight is turned round and inertia is not: does gravity point the wrong way?"
    if share < -max(_LITTLE, _SURE * std):
        return "sign", "it grows where the rigid torque falls: opposite sign"
    weightless = abs(share) < max(_LITTLE, _SURE * std) and abs(inertia) > 1.0 - USUAL
    of_a_gain = apart and max(abs(share), std) < _LITTLE * abs(inertia)
    if 0 in told and 1 in told and (weightless or of_a_gain):
        off = "" if inertia > 1.0 - USUAL else f", and inertia is {inertia:.3g} times the URDF's: sign, gain or ampere"
        return "compensated", f"gravity is not in it: effort: {{gravity: removed}}{off}"
    if robot.in_ampere(joint):
        size = f"{1.0 / share:.3g} {'or more' if hidden_rotor else f'+- {2.0 * std / share**2:.1g}'} {unit} per A"
        rotor = "; a rotor that the URDF lacks can't be told apart here" if hidden_rotor else ""
        return "factor", f"{size} would fit the URDF's masses (torque_constant){rotor}"
    current = declared.quantity == "current"
    asked = "torque_constant, or effort: torque" if current else "effort: current, or side: motor"
    rotor = ", a rotor that the URDF lacks" if hidden_rotor else ""
    size = f"{share:.3g} +- {2.0 * std:.1g} times the URDF's {unit}"
    return "factor", f"{size}: a gain{rotor}, a gear ratio or ampere ({asked})?"


def clustered(columns: Array, residual: Array, block: int) -> Array:
    """Return the covariance [k, k] that holds when errors within a block depend on each other."""
    inverse = np.linalg.pinv(columns.T @ columns)
    pieces = np.array_split(columns * residual[:, None], max(2, len(residual) // block))
    scores = np.array([piece.sum(axis=0) for piece in pieces])
    return np.asarray(inverse @ scores.T @ scores @ inverse)


def judge_all(measurements: Sequence[Measurement], robot: Robot) -> list[Declared]:
    """Return by joint the judgement of the recording that tells its share best."""
    judged = [judge_measured(measured, robot) for measured in measurements]
    return [min((one[joint] for one in judged), key=lambda d: d.std) for joint in range(robot.n)]


def clock_notes(measurements: Sequence[Measurement], robot: Robot) -> list[str]:
    """Return what the stamps' clock seems to be off by, where recordings of an arm without unknown payload tell."""
    told = [measured for measured in measurements if not measured.conditions.estimated]
    judged = judge_all(told, robot) if told else []
    return list(dict.fromkeys(one.hint for one in judged if one.verdict == "clock"))


def scale_notes(measurements: Sequence[Measurement], robot: Robot) -> list[str]:
    """Return what time or all efforts seem to be off by, where recordings of an arm without payload tell."""
    bare = [measured for measured in measurements if measured.conditions.payload is None]
    return [*clock_notes(measurements, robot), *(gain_of_all(judge_all(bare, robot), robot) if bare else [])]


_FACTOR = 20.0  # by which the torque of the links may differ from the URDF's before a word is due
_SAMPLES = 200


def unit_notes(measurements: Sequence[Measurement], found: Solution) -> list[str]:
    """Return a line where the links' torque is a factor away from that of the URDF's masses, on every loaded joint.

    A URDF may be rough, or hold no inertias at all; a factor of a thousand is a unit (Nm for mNm, joint for motor
    side). The joints' ratios are rms over rms along the motion.
    """
    structure = found.structure
    picked = [m.motion[np.linspace(0, m.motion.samples - 1, _SAMPLES).astype(int)] for m in measurements]
    states = replace(joined(picked), gravity=None)
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
