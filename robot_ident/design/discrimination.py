"""Designs the motion that best tells two effects apart, among random ones, slow, fast, small, at constant speed.

The noncentrality of an effect against a rival is what its torque leaves after the model's columns and the rival's are
projected off, in units of the noise: the gain in chi-square by which the data would prefer it. The rival takes the
inner parameters that imitate it best. A motion is as good as the smaller of the two ways round.
"""

from __future__ import annotations

import pickle
import shlex
import time
from collections.abc import Callable, Sequence
from contextlib import closing
from dataclasses import dataclass, replace
from functools import lru_cache
from typing import Any

import numpy as np

from robot_ident.design.criteria import Evaluation
from robot_ident.design.family import HARMONICS, Family
from robot_ident.design.target import Target, values_of_files
from robot_ident.effects import Effect, make_effect
from robot_ident.errors import InputError
from robot_ident.limits.certifier import Certifier, Margins, certify
from robot_ident.limits.feasibility import allowed_poses, require_limits
from robot_ident.model.structure import Structure
from robot_ident.parallel import completed
from robot_ident.robot.robot import Robot, at_every_joint
from robot_ident.signals.motion import Array, Motion
from robot_ident.trajectories.excitation import Excitation
from robot_ident.trajectories.fourier_series import FourierSeries

MENU = (
    ("slow", 10),
    ("fast", 10),
    ("small reversals", 16),
    ("constant speed", 12),
    ("one joint", 16),
    ("symmetric", 8),
)
"""Kinds of motions and how many of each are tried."""

_SLOWER = 5.0
_FAST = 2.5  # Hz from which on flexibility and inertia rule
_SMALL = (0.01, 0.15)  # amplitude of small reversals as a share of what the limits allow
_WIDTHS = (0.05, 0.15, 0.4)  # of a local search, as shares of a motion's own coefficients


@dataclass(frozen=True)
class Sketch:
    """A motion still to be drawn: its kind, the key of its random numbers, and the joints that matter.

    parent: the series that it varies, None for a new one.
    """

    kind: str
    key: tuple[int, ...]
    base_frequency: float
    sample_rate: float
    joints: tuple[int, ...]
    parent: FourierSeries | None = None


def draw(sketch: Sketch, robot: Robot, poses: Array) -> tuple[Family, Array]:
    """Return a random motion of a kind, as large as position, velocity and acceleration allow (smaller by its kind)."""
    rng = np.random.default_rng([*sketch.key, *sketch.kind.encode()])
    family = _family(sketch)
    table = np.zeros((1 + 2 * family.harmonics, robot.n))
    table[0] = poses[rng.integers(len(poses))]
    waves = family.free[1:]
    if sketch.kind == "constant speed":
        _constant_speeds(table, family, rng)
    else:
        order = (waves - 1) % family.harmonics + 1
        table[waves] = rng.normal(size=(len(waves), robot.n)) / np.sqrt(order)[:, None]
    table[1:] *= _factors(family, table, robot)
    if sketch.kind == "small reversals":
        low, high = np.log(_SMALL)
        table[1:] *= np.exp(rng.uniform(low, high, robot.n))
    if sketch.kind == "one joint" and sketch.joints:
        moving = sketch.joints[int(rng.integers(len(sketch.joints)))]
        table[1:, [j for j in range(robot.n) if j != moving]] = 0.0
    return family, table


def perturbed(sketch: Sketch, robot: Robot) -> tuple[Family, Array]:
    """Return a neighbour of the parent, no larger than the limits of the joints allow."""
    assert sketch.parent is not None
    rng = np.random.default_rng([*sketch.key, 7])
    family, series = _family(sketch), sketch.parent
    table = np.vstack([series.q0, series.a.T, series.b.T])
    width = float(rng.choice(_WIDTHS))
    waves = family.free[1:]
    size = np.sqrt(np.mean(table[waves] ** 2, axis=0))
    table[waves] += width * size * rng.normal(size=(len(waves), robot.n))
    table[waves] *= np.exp(width * rng.normal(size=robot.n))
    lower, upper = robot.limits.lower, robot.limits.upper
    room = 0.02 * (upper - lower)
    moved = table[0] + 0.5 * width * (0.5 * (upper - lower)) * rng.normal(size=robot.n)
    table[0] = np.clip(moved, lower + room, upper - room)
    table[1:] *= np.minimum(1.0, _factors(family, table, robot))
    return family, table


def _family(sketch: Sketch) -> Family:
    f, orders, symmetric = sketch.base_frequency, range(1, HARMONICS + 1), sketch.kind == "symmetric"
    highest = int(np.ceil(sketch.sample_rate / f / 2)) - 1
    if sketch.kind == "slow":
        f /= _SLOWER
    elif sketch.kind == "fast":
        first = max(1, round(_FAST / f))
        orders = range(first, first + 5 * max(1, first // 8), max(1, first // 8))
    elif sketch.kind == "constant speed":
        orders = range(1, 4 * HARMONICS + 1)
    chosen = tuple(order for order in orders if order <= highest) or (1,)
    return Family(f, chosen, sketch.sample_rate, symmetric)


def _constant_speeds(table: Array, family: Family, rng: np.random.Generator) -> None:
    """Fill in triangles: dq is a square wave of a joint's own period, damped (Fejer) against overshoot."""
    orders = np.array(family.orders)
    for joint in range(table.shape[1]):
        first = int(rng.integers(1, 4))
        odd = np.arange(first, orders[-1] + 1, 2 * first)
        size = (1.0 - odd / (orders[-1] + 1.0)) / (odd / first)
        phase = rng.uniform(0.0, 2.0 * np.pi) * odd / first
        table[odd, joint] = size * np.sin(phase)
        table[family.harmonics + odd, joint] = size * np.cos(phase)


def _factors(family: Family, table: Array, robot: Robot) -> Array:
    """Return by joint the factor [n] that brings a motion to its nearest limit."""
    limits, extremes, q0 = robot.limits, family.series(table).extremes(), table[0]
    room = np.minimum(limits.upper - q0, q0 - limits.lower)
    used = [
        np.maximum(extremes.q.upper - q0, q0 - extremes.q.lower) / np.maximum(room, 1e-9),
        extremes.dq.largest / limits.velocity,
        extremes.ddq.largest / limits.acceleration,
    ]
    return np.asarray(0.98 / np.maximum(np.max(used, axis=0), 1e-12))


NEEDED = 25.0  # noncentrality from which two effects are told apart
_VISIBLE = 1.0  # Nm rms beyond the model of a typical effect on an industrial arm, a tenth of it on a light one
_INDUSTRIAL = 200.0  # Nm, median torque limit from which on an arm is industrial
_RANDOM = 100  # motions of the usual kind, beside the menu
_REFERENCE = 4  # of them that say what size an effect has where a usual motion shows it
_CHILDREN = 16  # motions a round of the local search
_ROUNDS = 12
_STALE = 3
_GAIN = 1.03
_RANK = 1e-6  # share of a column's norm that must remain for it to count


@dataclass(frozen=True)
class Telling:
    """A certified motion and how well it tells two effects apart.

    noncentrality: the smaller of both ways round, `of_each` [2]: of the first effect against the second, and the
    reverse. kind: what kind of motion it is. evaluation: what it tells of the model's own parameters. otherwise: by
    effect, the experiment that shows it, where no motion tells. pairs: of effects, of which the least counts.
    """

    excitation: Excitation
    noncentrality: float
    of_each: tuple[float, float]
    kind: str
    margins: Margins
    parameters: tuple[str, ...]
    evaluation: Evaluation
    otherwise: dict[str, str]
    seconds: float
    pairs: int = 1

    @property
    def separable(self) -> bool:
        """Whether it is enough to tell."""
        return self.noncentrality >= NEEDED


@dataclass(frozen=True)
class Pair:
    """Two effects beside a model, at their typical inner parameters and sizes [k] by coefficient.

    duration [s] of the experiment. poses [K, n]: where the workspace's rules are kept. prior: rows [p, p] whose squares
    are what is known of the model's parameters already.
    """

    target: Target
    effects: tuple[Effect, Effect]
    sizes: tuple[Array, Array]
    duration: float
    poses: Array
    prior: Array | None = None

    def noncentralities(self, excitation: Excitation) -> tuple[float, float]:
        """Return both noncentralities for an experiment of the same duration, whatever the motion's period."""
        motion, structure = excitation.samples(), self.target.structure
        repeats = self.duration / excitation.period
        weight = np.sqrt(repeats / self.target.torque_variance)
        base = structure.columns(motion, self.target.values) * weight[:, None]
        rows = base.reshape(-1, base.shape[2])
        known = _orthonormal(rows if self.prior is None else np.concatenate([rows, self.prior]))[: len(rows)]
        torques = None if self.target.values is None else structure.torques(motion, self.target.values)

        def free(effect: Effect) -> Array:
            columns = (structure.columns_of(effect, motion, torques) * weight[:, None]).reshape(len(rows), -1)
            return np.asarray(columns - known @ (known.T @ columns))

        own = [free(effect) * size for effect, size in zip(self.effects, self.sizes, strict=True)]
        out = []
        for mine, rival in zip(own, reversed(self.effects), strict=True):
            left = [_beyond(mine, free(rival.at(setting))) for setting in rival.settings(motion) or [{}]]
            out.append(min(left))
        return out[0], out[1]


@dataclass(frozen=True)
class Pairs:
    """Two effects at one joint or another: a motion tells them as well as the pair that it tells worst."""

    every: tuple[Pair, ...]

    @property
    def target(self) -> Target:
        """The model."""
        return self.every[0].target

    @property
    def poses(self) -> Array:
        """Poses [K, n] where the workspace's rules are kept."""
        return self.every[0].poses

    @property
    def effects(self) -> tuple[Effect, ...]:
        """The effects of all pairs."""
        return tuple(effect for pair in self.every for effect in pair.effects)

    def noncentralities(self, excitation: Excitation) -> tuple[float, float]:
        """Return both noncentralities, each of the pair where it is the least."""
        each = [pair.noncentralities(excitation) for pair in self.every]
        return min(first for first, _ in each), min(second for _, second in each)


def tell_command(first: str, second: str, robot: Robot) -> str:
    """Return the command that designs the motion which tells two effects (`name@joint`) of a robot apart."""
    name = robot.name if robot.definition is None else robot.source
    return f"robot_ident design --tell {first} {second} --robot {shlex.quote(name)} -o tell.yaml"


def experiment_between(effect: Effect, rivals: Sequence[Effect], robot: Robot) -> str | None:
    """Return what tells an effect from rivals that data tie it with, None without rivals.

    The command that designs a motion against the first rival which a periodic motion shows, else the experiment of the
    catalogue.
    """
    if not rivals:
        return None
    shown = [rival for rival in rivals if not rival.hidden_in(_standing(robot))]
    if not shown or effect.hidden_in(_standing(robot)):
        return effect.experiment or None
    return tell_command(effect.label, shown[0].label, robot)


def tell_apart(
    target: Target,
    first: str,
    second: str,
    *,
    base_frequency: float = 0.1,
    sample_rate: float = 150.0,
    prior: Array | None = None,
    seed: int = 0,
    deadline: float = float("inf"),
    workers: int | None = None,
    progress: Callable[[int, int, float], None] | None = None,
) -> Telling:
    """Return the motion with the largest noncentrality among random ones and a menu, polished by a local search.

    first, second: `name@joint`; `name@*` is the effect at every joint where it can show, each told apart from the other
    effect, at the same joint where that is `name@*` too. prior [p, p]: what is known of the model's parameters.
    progress: motions tried and planned, best so far. Raises InputError where the effects are the same, or part of every
    model of the robot.
    """
    started = time.monotonic()
    require_limits(target.robot)
    pair = _pairs(target, first, second, base_frequency, sample_rate, prior)
    joints = tuple(effect.joint for effect in pair.effects if not effect.whole) or tuple(range(target.robot.n))
    sketches = [
        Sketch(kind, (seed, k), base_frequency, sample_rate, joints)
        for kind, many in (("random", _RANDOM), *MENU)
        for k in range(many)
    ]
    planned = len(sketches) + _ROUNDS * _CHILDREN
    best, tried = _best(pair, sketches, None, deadline, workers)
    stale = 0
    for turn in range(_ROUNDS):
        if progress is not None and best is not None:
            progress(tried, planned, best.noncentrality)
        if best is None or stale >= _STALE or time.monotonic() > deadline:
            break
        children = [
            replace(best.sketch, key=(seed, 1 + turn, k), parent=best.excitation.series) for k in range(_CHILDREN)
        ]
        before = best.noncentrality
        best, more = _best(pair, children, best, deadline, workers)
        tried += more
        assert best is not None
        stale = 0 if best.noncentrality > _GAIN * before else stale + 1
    if best is None:
        raise InputError(f"{target.robot.name}: no motion was found within the limits")
    return _verdict(best, pair, (first, second), {"seed": seed, "motions": tried}, started)


def _verdict(best: _Tried, pair: Pairs, labels: Sequence[str], asked: dict[str, Any], started: float) -> Telling:
    """Return the best motion, certified anew as it is written, with what else there is to say."""
    target, robot = pair.target, pair.target.robot
    margins = certify(best.excitation, robot)
    if not margins.kept:  # every motion was certified, so this is a bug, never a result
        raise AssertionError(f"a trajectory that breaks a limit was kept: {margins.violations[0]}")
    telling = {"effects": list(labels), "noncentrality": best.noncentrality, "motion": best.sketch.kind}
    reproduce = {"robot": robot.name, "tell": list(labels)} | asked
    excitation = replace(best.excitation, criterion="tell", achieved=telling, reproduce=reproduce)
    otherwise = {effect.label: effect.experiment for effect in pair.effects}
    return Telling(
        excitation=excitation,
        noncentrality=best.noncentrality,
        of_each=best.of_each,
        kind=best.sketch.kind,
        margins=margins,
        parameters=target.structure.names,
        evaluation=target.judge([excitation]),
        otherwise={} if best.noncentrality >= NEEDED else otherwise,
        seconds=time.monotonic() - started,
        pairs=len(pair.every),
    )


@dataclass(frozen=True)
class _Tried:
    sketch: Sketch
    excitation: Excitation
    of_each: tuple[float, float]

    @property
    def noncentrality(self) -> float:
        return min(self.of_each)


def _try(case: tuple[bytes, Sketch]) -> _Tried | None:
    """Return a sketch's motion, within the limits, with its noncentralities."""
    pair, certifier = _unpacked(case[0])
    excitation = certified(case[1], pair.target.robot, pair.poses, certifier)
    return None if excitation is None else _Tried(case[1], excitation, pair.noncentralities(excitation))


@lru_cache(maxsize=2)
def _unpacked(packed: bytes) -> tuple[Pairs, Certifier]:
    pair: Pairs = pickle.loads(packed)
    return pair, Certifier(pair.target.robot)


def certified(sketch: Sketch, robot: Robot, poses: Array, certifier: Certifier) -> Excitation | None:
    """Return a sketch's motion as large as it may be, made smaller until it is certified; None where it never is."""
    family, coefficients = draw(sketch, robot, poses) if sketch.parent is None else perturbed(sketch, robot)
    for _ in range(10):
        excitation = family.excitation(robot, coefficients)
        if certifier.keeps(excitation):
            return excitation
        coefficients = np.concatenate([coefficients[:1], 0.7 * coefficients[1:]])
    return None


def _best(
    pair: Pairs, sketches: Sequence[Sketch], best: _Tried | None, deadline: float, workers: int | None
) -> tuple[_Tried | None, int]:
    """Return the best of the sketches' motions (and of one known already), and how many were tried."""
    tried, packed = 0, pickle.dumps(pair)
    found: dict[int, _Tried] = {} if best is None else {-1: best}
    with closing(completed(_try, [(packed, sketch) for sketch in sketches], workers)) as results:
        for index, one in results:
            tried += 1
            if one is not None:
                found[index] = one
            if found and time.monotonic() > deadline:
                break
    return max((found[k] for k in sorted(found)), key=lambda one: one.noncentrality, default=None), tried


def _places(target: Target, label: str) -> list[str]:
    """Return an effect as `name@joint`; `name@*` at every joint where it can show and is not part of every model."""
    robot = target.robot
    if not label.endswith("@*"):
        return [make_effect(label, robot).label]
    out, why = [], ""
    for one in at_every_joint([label], robot.joints):
        try:
            effect = make_effect(one, robot)
        except InputError as error:
            why = why or str(error)
            continue
        if (
            effect.unseen
            or effect.hidden_in(_standing(robot))
            or one in target.structure.labels[: target.structure.given]
        ):
            continue
        out.append(one)
    if not out:
        raise InputError(why or f"--tell {label}: no joint is left where it can show and is not in every model")
    return out


def _pairs(
    target: Target, first: str, second: str, base_frequency: float, sample_rate: float, prior: Array | None
) -> Pairs:
    robot = target.robot
    if first == second:
        raise InputError(f"--tell {first} {second}: two different effects were expected")
    mine, others = _places(target, first), _places(target, second)
    both = first.endswith("@*") and second.endswith("@*")
    labels = [
        (a, b) for a in mine for b in others if a != b and (not both or a.partition("@")[2] == b.partition("@")[2])
    ]
    if not labels:
        raise InputError(f"--tell {first} {second}: no joint is left where both can show")
    target = without(target, tuple(dict.fromkeys(label for pair in labels for label in pair)))
    effects = {label: make_effect(label, robot) for pair in labels for label in pair}
    if target.values is None and (dependent := [label for label, effect in effects.items() if effect.uses_torque]):
        values = values_of_files(target.structure, f"{dependent[0]} depends on the torque")
        target = replace(target, values=values)
    for effect in effects.values():
        if reason := effect.hidden_in(_standing(robot)):
            raise InputError(f"--tell: {effect.label} shows in no periodic motion: {reason}")
    sketches = [Sketch("random", (0, k), base_frequency, sample_rate, ()) for k in range(_REFERENCE)]
    certifier, poses = Certifier(robot), allowed_poses(robot)
    usual = [one for one in (certified(sketch, robot, poses, certifier) for sketch in sketches) if one is not None]
    if not usual:
        raise InputError(f"{robot.name}: no motion was found within the limits")
    sizes: dict[str, Array] = {}
    for label, effect in effects.items():
        try:
            sizes[label] = _size(target, effect, usual)
        except InputError:
            if label in (first, second):  # else other joints are left
                raise
    labels = [pair for pair in labels if all(label in sizes for label in pair)]
    if not labels:
        raise InputError(f"--tell {first} {second}: no usual motion shows both at any joint")
    duration, known = target.periods / base_frequency, _rows_of(prior)
    return Pairs(
        tuple(Pair(target, (effects[a], effects[b]), (sizes[a], sizes[b]), duration, poses, known) for a, b in labels)
    )


def _standing(robot: Robot) -> Motion:
    """Return a periodic motion, of which it is asked whether any shows an effect."""
    rest = np.zeros((2, robot.n))
    return Motion(rest, rest, rest, dt=0.1, periodic=True)


def _size(target: Target, effect: Effect, usual: Sequence[Excitation]) -> Array:
    """Return the typical size [k] of an effect's coefficients: each leaves the same visible torque on usual motions."""
    total = np.zeros(len(effect.coefficients))
    for excitation in usual:
        motion, structure = excitation.samples(), target.structure
        torques = None if target.values is None else structure.torques(motion, target.values)
        base = structure.columns(motion, target.values)
        known = _orthonormal(base.reshape(-1, base.shape[2]))
        columns = structure.columns_of(effect, motion, torques).reshape(len(known), -1)
        left = columns - known @ (known.T @ columns)
        total += np.sum(left**2, axis=0) / motion.samples / len(usual)
    if not np.any(total > 0.0):
        raise InputError(f"--tell: no usual motion shows {effect.label}")
    visible = _VISIBLE * (1.0 if float(np.median(target.robot.limits.torque)) >= _INDUSTRIAL else 0.1)
    return np.asarray(visible / np.sqrt(np.where(total > 0.0, total, np.inf) * len(total)))


def _beyond(mine: Array, rival: Array) -> float:
    """Return the squared norm of columns [R, k] after a rival's are projected off, summed over random directions."""
    length = np.linalg.norm(rival, axis=0)
    basis = _orthonormal(rival[:, length > _RANK * max(float(length.max(initial=0.0)), 1e-300)])
    return float(np.sum((mine - basis @ (basis.T @ mine)) ** 2))


def _orthonormal(columns: Array) -> Array:
    """Return an orthonormal basis [R, r] of columns [R, p]."""
    length = np.linalg.norm(columns, axis=0)
    kept = columns[:, length > 0] / length[length > 0]
    if not kept.shape[1]:
        return np.zeros((len(columns), 0))
    u, s, _ = np.linalg.svd(kept, full_matrices=False)
    return np.asarray(u[:, s > _RANK * s[0]])


def _rows_of(prior: Array | None) -> Array | None:
    if prior is None:
        return None
    values, vectors = np.linalg.eigh(prior)
    return np.asarray(np.sqrt(np.maximum(values, 0.0))[:, None] * vectors.T)


def without(target: Target, labels: Sequence[str]) -> Target:
    """Return a target whose model lacks some effects that it held; those that every model of the robot has stay."""
    structure = target.structure
    fixed = [label for label in labels if label in structure.labels[: structure.given]]
    if fixed:
        raise InputError(f"--tell: {fixed[0]} is part of every model of {structure.robot.name}")
    kept = [effect for effect in structure.added if effect.label not in labels]
    if len(kept) == len(structure.added):
        return target
    smaller, values = Structure.build(structure.robot, kept), target.values
    if values is not None:
        values = values[[structure.names.index(name) for name in smaller.names]]
    return replace(target, structure=smaller, values=values)
