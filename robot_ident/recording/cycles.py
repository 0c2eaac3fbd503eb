"""Production data: cycles of moves that repeat with pauses of any length between them, found and aligned.

A robot at work rests between moves, waits as long as it must, and starts again whenever it may: nothing is periodic,
but every move is the same each time. The recording is cut at its rests; moves that begin and end alike and follow the
same course get one letter; the sequence of letters whose repetition covers the recording is the cycle.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np

from robot_ident.recording.clock import roughness
from robot_ident.recording.period import runs
from robot_ident.signals.motion import Array

_SPAN = 0.04  # s over which speed is judged
_SLOW = 0.01  # of the top speed: below it a joint rests
_NOISE = 8.0  # times the noise of a sample: a difference that is motion
_REST = 0.12  # s that a rest lasts; shorter ones are reversals within a move
_SHORT = 0.05  # s: no move is shorter
_MARGIN = 0.5  # s of rest kept on either side of a move, at most
_SAME = 0.01  # of a joint's range: how far moves that are the same may stray
_LENGTH = 0.03  # of its duration by which the same move may take longer, or four samples
_COVERED = 0.5  # of the time in motion that cycles must account for
_FEW = 0.8  # the same where there are two of them only
_ROUNDING = 1e-9  # rad or m: a joint that never moves has neither range nor noise
_ALL = 0.97  # of the time in motion: a cycle that covers so much needs no rival
_LONGEST = 100  # moves of a cycle


@dataclass(frozen=True)
class Cycles:
    """M repetitions of a cycle of K moves.

    begins [M, K] s: when the window of each move begins, rest before it included, aligned to a small part of a sample;
    samples [K]: of each window, the same in all repetitions; what was longer of the pauses between them is left out.
    pieces: moves that belong to no whole cycle. moves: all that there are.
    """

    begins: Array
    samples: tuple[int, ...]
    dt: float
    pieces: int
    moves: int

    @property
    def count(self) -> int:
        """Number of repetitions M."""
        return len(self.begins)

    @property
    def length(self) -> float:
        """Length [s] of a cycle without what its pauses vary by."""
        return sum(self.samples) * self.dt

    def to_dict(self) -> dict[str, Any]:
        """Return plain data."""
        return {"count": self.count, "length": self.length, "moves": len(self.samples), "moves_left_out": self.pieces}

    @property
    def times(self) -> Array:
        """When the samples of every repetition were taken [M, N] s."""
        windows = [
            begin[:, None] + self.dt * np.arange(count)
            for begin, count in zip(self.begins.T, self.samples, strict=True)
        ]
        return np.concatenate(windows, axis=1)

    def phase(self, t: Array) -> Array:
        """Return the time within the cycle [s] at instants t [N]; nan between cycles and in pauses that were cut."""
        out = np.full(len(t), np.nan)
        offsets = self.dt * np.concatenate([[0], np.cumsum(self.samples)[:-1]])
        for begins in self.begins:
            for begin, samples, offset in zip(begins, self.samples, offsets, strict=True):
                inside = slice(*np.searchsorted(t, [begin - 0.5 * self.dt, begin + (samples - 0.5) * self.dt]))
                out[inside] = t[inside] - begin + offset
        return out


@dataclass(frozen=True)
class _Move:
    """Samples [first, last) in motion, and of the rests before and after."""

    first: int
    last: int
    before: int
    after: int

    @property
    def samples(self) -> int:
        return self.last - self.first


def find_cycles(q: Array, dt: float, start: float = 0.0) -> Cycles | None:
    """Return the cycles of positions q [N, n] on an even grid from time `start` [s], or None where none repeat."""
    moves = _moves(q, dt)
    if len(moves) < 2:
        return None
    from scipy.interpolate import make_interp_spline

    spline = make_interp_spline(np.arange(float(len(q))), q, k=5)
    curve = _Curve(spline, spline.derivative())
    tolerance = _SAME * np.ptp(q, axis=0) + _NOISE * roughness(q) + _ROUNDING
    labels = _labels(moves, curve, q, tolerance)
    found = _motif(labels, moves, q, tolerance)
    if found is None:
        return None
    starts, size = found
    cycles = [[moves[begin + k] for k in range(size)] for begin in starts]
    covered = sum(move.samples for cycle in cycles for move in cycle) / sum(move.samples for move in moves)
    if covered < (_FEW if len(starts) < 3 else _COVERED):
        return None
    return _aligned(cycles, curve, q, dt, start, len(moves))


def _moves(q: Array, dt: float) -> list[_Move]:
    """Return the stretches of motion between rests of all joints."""
    from scipy.ndimage import uniform_filter1d

    half = max(1, round(0.5 * _SPAN / dt))
    if len(q) < 8 * half:
        return []
    smooth = uniform_filter1d(q, half + 1, axis=0, mode="nearest")
    step = np.abs(smooth[2 * half :] - smooth[: -2 * half])
    noise = _NOISE * roughness(q) / np.sqrt(half + 1.0)
    awake = np.any(step > np.maximum(noise, _SLOW * np.percentile(step, 99.0, axis=0)), axis=1)
    awake = np.concatenate([np.zeros(half, dtype=bool), awake, np.zeros(half, dtype=bool)])
    moves: list[list[int]] = []
    for first, last in runs(awake).tolist():
        if moves and first - moves[-1][1] < _REST / dt:
            moves[-1][1] = last
        else:
            moves.append([first, last])
    moves = [move for move in moves if move[1] - move[0] >= _SHORT / dt]
    rests = [0, *(move[1] for move in moves)], [*(move[0] for move in moves), len(q)]
    return [_Move(first, last, first - rests[0][k], rests[1][k + 1] - last) for k, (first, last) in enumerate(moves)]


class _Curve(NamedTuple):
    """Positions [N, n] as a spline of the sample number, and its slope."""

    at: Callable[[Array], Array]
    slope: Callable[[Array], Array]


def _labels(moves: Sequence[_Move], curve: _Curve, q: Array, tolerance: Array) -> list[int]:
    """Return a number for each move, the same for those that are the same: as long, from and to the same pose, on the
    same course.
    """
    labels: list[int] = []
    models: list[_Move] = []
    ends = np.array([[q[move.first], q[move.last - 1]] for move in moves])
    lengths = np.array([move.samples for move in moves])
    first: list[int] = []
    for number, move in enumerate(moves):
        near = np.abs(lengths[first] - move.samples) <= np.maximum(4.0, _LENGTH * lengths[first])
        near &= np.all(np.abs(ends[first] - ends[number]) <= 2.0 * tolerance, axis=(1, 2))
        found = next((k for k in np.flatnonzero(near).tolist() if _alike(models[k], move, curve, tolerance)), None)
        if found is None:
            found = len(models)
            models.append(move)
            first.append(number)
        labels.append(found)
    return labels


def _alike(model: _Move, move: _Move, curve: _Curve, tolerance: Array) -> bool:
    """Return whether two moves take the same course once they are aligned."""
    grid = np.arange(model.first, model.last, dtype=float)
    begin = _shifted(curve.at(grid), grid - model.first, float(move.first), curve, 1.0 / np.maximum(tolerance, 1e-12))
    stray = np.sqrt(np.mean((curve.at(grid - model.first + begin) - curve.at(grid)) ** 2, axis=0))
    return bool(np.all(stray < tolerance))


def _shifted(model: Array, place: Array, begin: float, curve: _Curve, weight: Array) -> float:
    """Return where a move begins whose samples `place` after that follow `model` [W, n]: least squares, Gauss-Newton.

    shift = - sum v (q - model) / sum v^2, joints weighed by `weight` [n].
    """
    first = begin
    for _ in range(6):
        v = curve.slope(place + begin) * weight
        gap = (curve.at(place + begin) - model) * weight
        power = float(np.sum(v * v))
        step = -float(np.sum(v * gap)) / power if power > 0.0 else 0.0
        begin += float(np.clip(step, -4.0, 4.0))
        if abs(step) < 1e-6:
            break
    return begin if abs(begin - first) < 0.1 * len(place) + 8.0 else first


def _motif(labels: Sequence[int], moves: Sequence[_Move], q: Array, tolerance: Array) -> tuple[list[int], int] | None:
    """Return (first move of every repetition, moves of a cycle): the shortest sequence of labels that ends where it
    began and covers nearly as much of the time in motion as any.
    """
    options: list[tuple[float, int, list[int]]] = []
    total = float(sum(move.samples for move in moves))
    for size in range(1, min(len(labels) // 2, _LONGEST) + 1):
        best: tuple[float, list[int]] = 0.0, []
        words = Counter(tuple(labels[k : k + size]) for k in range(len(labels) - size + 1))
        for word in (word for word, count in words.items() if count > 1):
            starts: list[int] = []
            for place in range(len(labels) - size + 1):
                if (not starts or place >= starts[-1] + size) and tuple(labels[place : place + size]) == word:
                    starts.append(place)
            if len(starts) < 2:
                continue
            first, last = moves[starts[0]].first, moves[starts[0] + size - 1].last - 1
            if np.any(np.abs(q[first] - q[last]) > 2.0 * tolerance):
                continue
            covered = float(sum(moves[begin + k].samples for begin in starts for k in range(size)))
            if covered > best[0]:
                best = covered, starts
        if best[1]:
            options.append((best[0], size, best[1]))
            if best[0] > _ALL * total:
                break
    if not options:
        return None
    most = max(option[0] for option in options)
    _, size, starts = next(option for option in options if option[0] >= 0.9 * most)
    return starts, size


def _aligned(
    cycles: Sequence[Sequence[_Move]], curve: _Curve, q: Array, dt: float, start: float, total: int
) -> Cycles | None:
    """Return the cycles with every move aligned to the mean of its repetitions, and windows that all of them have."""
    weight = 1.0 / np.maximum(roughness(q), 1e-9)
    begins, samples = [], []
    for column in zip(*cycles, strict=True):
        begin, length = _together(column, curve, weight)
        # half of a rest belongs to one of the two moves beside it, what alignment may take left out
        before, after = (
            min(int(_MARGIN / dt), max(0, min(rests) // 2 - 2))
            for rests in zip(*((move.before, move.after) for move in column), strict=True)
        )
        begins.append(begin - before)
        samples.append(before + length + after)
    places = np.array(begins).T
    inside = (places[:, 0] >= 0.0) & (places[:, -1] + samples[-1] <= len(q))
    if inside.sum() < 2:
        return None
    kept = places[inside]
    return Cycles(start + dt * kept, tuple(samples), dt, total - kept.size, total)


def _together(column: Sequence[_Move], curve: _Curve, weight: Array) -> tuple[Array, int]:
    """Return where each repetition of a move begins [M], to a part of a sample, and its length [samples]."""
    first = column[0]
    place = np.arange(float(first.samples))
    begin = np.array([float(move.first) for move in column])
    model = curve.at(place + first.first)
    for _ in range(2):
        begin = np.array([_shifted(model, place, one, curve, weight) for one in begin])
        model = np.mean([curve.at(place + one) for one in begin], axis=0)
    return begin, first.samples
