"""Friction with memory of the path: a state that follows reversals, run to its steady state over a period.

Between reversals both laws have a closed solution over the path travelled, so that a whole stretch is one expression.
"""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

import numpy as np

from robot_ident.effects.effect import Effect, Mathematics, Signals
from robot_ident.signals.motion import Array

_TURN = 0.2  # how sharply expressions tell before from after a reversal

ELEMENTS = (0.2, 0.5, 1.0, 2.0)
"""Breakaway of the Maxwell-slip elements over their scale; their mean, nearly one, is comparable to Dahl's."""


def stretches(q: Array) -> Iterator[tuple[int, int, float]]:
    """Yield (first, last, direction) of the stretches of path q [N] between reversals: samples first..last."""
    moves = np.sign(np.diff(q))
    moving = np.flatnonzero(moves)
    if not len(moving):
        return
    turns = moving[1:][moves[moving[1:]] != moves[moving[:-1]]]
    directions = moves[[moving[0], *turns]]
    for first, last, direction in zip([0, *turns], [*turns, len(q) - 1], directions, strict=True):
        yield int(first), int(last), float(direction)


def dahl(q: Array, scale: float, periodic: bool) -> Array:
    """Return the state z [N] of dz = (s - z) |dq| / scale, s = sign(dq) (Dahl 1968), |z| <= 1.

    Between reversals z = s + (z0 - s) exp(-path / scale). It starts at 0, or in its periodic steady state.
    """
    if not periodic:
        return _dahl(q, scale, 0.0)
    loop = np.append(q, q[0])
    after = _dahl(loop, scale, 0.0)[-1]
    faded = np.exp(-np.abs(np.diff(loop)).sum() / scale)
    start = after / -np.expm1(np.log(faded)) if 0.0 < faded < 1.0 else after
    return _dahl(loop, scale, float(start))[:-1]


def _dahl(q: Array, scale: float, start: float) -> Array:
    z = np.full(len(q), start)
    for first, last, s in stretches(q):
        path = np.abs(q[first : last + 1] - q[first])
        z[first : last + 1] = s + (z[first] - s) * np.exp(-path / scale)
    return z


def maxwell_slip(q: Array, scale: float, periodic: bool) -> Array:
    """Return the mean state z [N] of elastic elements that slide when stretched by r_i = `ELEMENTS` times the scale.

    dz_i = dq / (r_i scale) while |z_i| < 1 (Iwan 1966; the rate-independent limit of the generalized Maxwell-slip
    model of Al-Bender, Lampaert and Swevers 2005). It starts at 0, or in its periodic steady state.
    """
    if not periodic:
        return _slip(q, scale, np.zeros(len(ELEMENTS))).mean(axis=1)
    loop = np.append(q, q[0])
    start = _slip(loop, scale, np.zeros(len(ELEMENTS)))[-1]
    return _slip(loop, scale, start)[:-1].mean(axis=1)


def behind_play(q: Array, gap: float, rise: float, periodic: bool) -> Array:
    """Return z [N] of friction that is met behind a play: 0 while the gap is crossed, then up to sign(dq) over a path
    `rise`.

    An elastic element that slides, with a dead zone: z = clip((|d| - gap / 2) / rise, 0, 1) sign(d), where d follows q
    within |d| <= gap / 2 + rise. It starts in the middle, or in its periodic steady state.
    """
    if not periodic:
        return _met(_apart(q, gap / 2.0 + rise, 0.0), gap, rise)
    loop = np.append(q, q[0])
    start = float(_apart(loop, gap / 2.0 + rise, 0.0)[-1])
    return _met(_apart(loop, gap / 2.0 + rise, start), gap, rise)[:-1]


def _apart(q: Array, most: float, start: float) -> Array:
    """Return d [N], which follows a path within -most..most (play operator)."""
    d = np.full(len(q), start)
    for first, last, _ in stretches(q):
        d[first : last + 1] = np.clip(d[first] + q[first : last + 1] - q[first], -most, most)
    return d


def _met(d: Array, gap: float, rise: float) -> Array:
    return np.asarray(np.sign(d) * np.clip((np.abs(d) - gap / 2.0) / rise, 0.0, 1.0))


def _slip(q: Array, scale: float, start: Array) -> Array:
    z = np.tile(start, (len(q), 1))
    reach = np.array(ELEMENTS) * scale
    for first, last, _ in stretches(q):
        path = q[first : last + 1] - q[first]
        z[first : last + 1] = np.clip(z[first] + path[:, None] / reach, -1.0, 1.0)
    return z


def since_reversal(effect: Effect, x: Signals, m: Mathematics, reach: float) -> tuple[Any, Any, Any]:
    """Return as expressions of the present state, for designs: the direction of a joint after its last reversal, the
    path since then over a `reach`, dq^2 / (2 |ddq| reach) as near a reversal, and 1 after it, 0 before.

    An acceleration below 2 % of the joint's largest counts as that: such a reversal has no definite end.
    """
    v, a = x.dq[effect.joint], x.ddq[effect.joint]
    largest = float(effect.robot.limits.acceleration[effect.joint])
    size = m.sqrt(a**2 + (0.02 * largest if np.isfinite(largest) else 0.05) ** 2)
    onward = a / size
    since = v * onward / m.sqrt(2.0 * size * reach)  # time since the reversal over that in which the reach is travelled
    return onward, v**2 / (2.0 * size * reach), 0.5 * (1.0 + m.tanh(since / _TURN))
