"""Motions to choose from when two effects are to be told apart: random ones, slow, fast, small, at constant speed."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from robot_ident.excitation.fourier import FourierSeries
from robot_ident.excitation.setting import HARMONICS, Family
from robot_ident.robot.robot import Robot
from robot_ident.signals.motion import Array

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
    half = 0.5 * (robot.limits.upper - robot.limits.lower)
    table[0] = np.clip(table[0] + 0.5 * width * half * rng.normal(size=robot.n), *_inner(robot))
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


def _inner(robot: Robot) -> Sequence[Array]:
    """Return the position limits with a little room inside."""
    room = 0.02 * (robot.limits.upper - robot.limits.lower)
    return robot.limits.lower + room, robot.limits.upper - room
