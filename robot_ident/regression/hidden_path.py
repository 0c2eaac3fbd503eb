"""What the part of a path that hides in the noise of its positions may do to the torque.

A drive that sticks or gives way as it reverses bends its path within milliseconds. Lines of that kink which don't stand
above the noise are missing from the acceleration: a torque remains at every reversal, of the shape of an effect around
reversals, in rows of every trajectory alike, so that prediction doesn't refute it. A fast effect shakes its drive as
well, faster than the servo follows: what it gives way is missing from the acceleration too, and makes the effect seem
to lag and to fade.

Nuisance columns K whose coefficients h are known beforehand to be 0 +- 1 count as noise of covariance K K'. The least
of |r - K h|^2 + |h|^2 over h is r' (I + K K')^-1 r, so that whatever is fitted beside them is fitted by the products
phi' (I + K K')^-1 phi = phi' phi - (K' phi)' (I + K' K)^-1 (K' phi): a base of p columns stays one of p, however many
the nuisance has.
"""

from __future__ import annotations

from collections.abc import Hashable, Iterable, Iterator, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import NamedTuple

import numpy as np

from robot_ident.regression.evidence import Evidence, Trajectory, weighed_once
from robot_ident.regression.normal_equations import pseudo_inverse
from robot_ident.regression.spectrum import inertia_along
from robot_ident.signals.fourier import Lines, evaluate, least_above_noise, lines_of_grid
from robot_ident.signals.motion import Array, Mask


@dataclass(frozen=True)
class Nuisance:
    """Columns K [N n, k] of the trajectories at `places`, parts of one, in units of its noise; square: K' K [k, k]."""

    places: tuple[int, ...]
    parts: tuple[Trajectory, ...]
    columns: Array
    square: Array

    @classmethod
    def of(
        cls, places: Sequence[int], parts: Sequence[Trajectory], torques: Iterable[Array], least: float = 0.0
    ) -> Nuisance | None:
        """Return the nuisance of torques [N, n, c], few at once, whose columns are of more than a least square; None
        where none is.
        """
        kept: list[Array] = []
        for some in torques:
            seen = parts[0].uncut.in_noise(some).reshape(-1, some.shape[2])
            matter = np.einsum("ij,ij->j", seen, seen) > least
            if matter.any():
                kept.append(seen[:, matter])
        if not kept:
            return None
        columns = np.concatenate(kept, axis=1)
        return cls(tuple(places), tuple(parts), columns, columns.T @ columns)

    @cached_property
    def _root(self) -> Array:
        """The lower triangular root L [k, k] of I + K' K."""
        return np.asarray(np.linalg.cholesky(np.eye(len(self.square)) + self.square))

    def onto(self, rows: Array) -> Array:
        """Return L^-1 K' X [k, c] for X [N, n, c] of the whole."""
        from scipy.linalg import solve_triangular

        x = rows.reshape(len(self.columns), -1)
        return np.asarray(solve_triangular(self._root, self.columns.T @ x, lower=True))

    def without(self, parts: Sequence[Array]) -> list[Array]:
        """Return r - K h by place for r [N, n] each, h = (I + K' K)^-1 K' r: what the nuisance most likely has not
        made.
        """
        from scipy.linalg import solve_triangular

        mine = [parts[place] for place in self.places]
        rows = np.sum(mine, axis=0)
        sizes = solve_triangular(self._root, self.onto(rows[:, :, None]), lower=True, trans="T")
        made = (self.columns @ sizes).reshape(rows.shape)
        return [t.cut(rows - made) for t in self.parts]


def without(groups: Sequence[Nuisance], parts: Sequence[Array]) -> tuple[Array, ...]:
    """Return parts [N, n] of all trajectories, each without the nuisance of its group."""
    out = list(parts)
    for group in groups:
        for place, part in zip(group.places, group.without(parts), strict=True):
            out[place] = part
    return tuple(out)


def products(groups: Sequence[Nuisance], trajectories: Sequence[Trajectory], parts: Iterable[Array]) -> Array:
    """Return X' (I + K K')^-1 X [c, c] for X given by trajectory, each [N, n, c], with the nuisance of all groups."""
    square, joined = np.zeros(()), [np.zeros(()) for _ in groups]
    of = {place: k for k, group in enumerate(groups) for place in group.places}
    for place, (t, part) in enumerate(zip(trajectories, parts, strict=True)):
        rows = t.stacked(part)
        square = square + rows.T @ rows
        if place in of:
            joined[of[place]] = joined[of[place]] + part
    for group, whole in zip(groups, joined, strict=True):
        seen = group.onto(whole)
        square -= seen.T @ seen
    return square


_MATTERS = 1.0  # chi-square units that a hidden part must make, at its usual size, to be reckoned with
_LAST = 0.5  # of the number of lines that stand above the noise, from which on they tell how large the next ones are
_MOST = 2.0  # times the smallest line that stands above the noise: were they larger, the next would stand above it, too
_AT_ONCE = 64  # kinks that are looked at together
_KEY = "hidden path"


def note(joints: Iterable[str]) -> str:
    """Return a line on joints where no more is left over than the hidden path may make."""
    return (
        f"{', '.join(joints)}: all that is left beyond the noise may be bends of the path that the noise of the"
        " positions hides, and steps of friction between two samples; no effect is told from that: record at a higher"
        " rate, or leave out the rows around reversals with identify --minimum-speed"
    )


def residual_beside_hidden_path(evidence: Evidence) -> tuple[Array, ...]:
    """Return the weighed residual [N, n] of each trajectory without what the hidden path may have made of it."""
    beside = _beside(evidence)
    if beside is None:
        return evidence.residual
    own, further = np.split(beside.values, [evidence.phi[0].shape[2]])
    parts = zip(evidence.trajectories, evidence.phi, beside.given_way, strict=True)
    return without(beside.kinks, [t.y - phi @ own - given @ further for t, phi, given in parts])


def misfit_beside_hidden_path(evidence: Evidence) -> tuple[Array, ...]:
    """Return the weighed residual [N, n] of a model as it stands, without what the hidden path may have made of it."""
    beside = _beside(evidence)
    if beside is None:
        return evidence.residual
    residual = evidence.residual
    triples = zip(evidence.trajectories, beside.given_way, residual, strict=True)
    square = products(beside.kinks, evidence.trajectories, (t.beside(g, r[:, :, None]) for t, g, r in triples))
    sizes = np.linalg.solve(square[:-1, :-1] + np.eye(len(square) - 1), square[:-1, -1])
    return without(beside.kinks, [r - g @ sizes for g, r in zip(beside.given_way, residual, strict=True)])


class _Beside(NamedTuple):
    """What an evidence does not resolve: kinks of each measurement, given_way: columns [N, n, g] of each trajectory;
    values [p + g]: parameters of the base and of the latter, fitted in units of noise and kinks.
    """

    kinks: tuple[Nuisance, ...]
    given_way: tuple[Array, ...]
    values: Array


def _beside(evidence: Evidence) -> _Beside | None:
    """Return the evidence beside the hidden path, computed once; None where none of it matters."""
    key: Hashable = (_KEY, evidence.structure.labels, evidence.values.tobytes())
    if key not in evidence.memory:
        evidence.memory[key] = _with_hidden_path(evidence)
    found = evidence.memory[key]
    assert found is None or isinstance(found, _Beside)
    return found


def _with_hidden_path(evidence: Evidence) -> _Beside | None:
    if any(t.measured.position_lines is None or t.measured.decimate != 1 for t in evidence.trajectories):
        return None
    kinks = _kinks_by_measurement(evidence)
    given = weighed_once(evidence.trajectories, lambda place: _given_way(place, evidence))
    matter = np.sum([np.sum(part**2, axis=(0, 1)) for part in given], axis=0) > _MATTERS
    if not kinks and not matter.any():
        return None
    given_way = tuple(part[:, :, matter] for part in given)
    triples = zip(evidence.trajectories, evidence.phi, given_way, strict=True)
    every = (t.beside(phi, given, t.y[:, :, None]) for t, phi, given in triples)
    square = products(kinks, evidence.trajectories, every)
    further = np.arange(evidence.phi[0].shape[2], len(square) - 1)
    square[further, further] += 1.0
    return _Beside(kinks, given_way, pseudo_inverse(square[:-1, :-1]) @ square[:-1, -1])


def _kinks_by_measurement(evidence: Evidence) -> tuple[Nuisance, ...]:
    """Return the weighed kinks of every measurement that has any that matter; each has its own."""
    key: Hashable = (_KEY, "weighed", tuple(id(t) for t in evidence.trajectories))
    if key not in evidence.memory:  # with the trajectories, so that no other ones can have their ids
        evidence.memory[key] = (evidence.trajectories, _weighed_kinks(evidence))
    found = evidence.memory[key]
    assert isinstance(found, tuple)
    return tuple(found[1])


def _weighed_kinks(evidence: Evidence) -> tuple[Nuisance, ...]:
    places: dict[int, list[int]] = {}
    for place, t in enumerate(evidence.trajectories):
        places.setdefault(id(t.uncut), []).append(place)
    out = []
    for mine in places.values():
        parts = [evidence.trajectories[place] for place in mine]
        kinks = _kinks(parts[0], inertia_along(parts[0], evidence))
        torques = (parts[0].measured.passed(some) for some in kinks)
        out.append(Nuisance.of(mine, parts, torques, _MATTERS))  # of hundreds on a fine grid, few may matter
    return tuple(one for one in out if one is not None)


def _kinks(t: Trajectory, inertia: Array) -> Iterator[Array]:
    """Yield the torques [N, n, k] Nm of the hidden kinks of usual size of all reversals, few at once, by the inertia
    [N, n, n] that they move: the lag of the servo turns their phase.
    """
    for joint in range(inertia.shape[2]):
        lines = _hidden_lines(t, joint)
        for first in range(0, lines.shape[1], _AT_ONCE):
            some = lines[:, first : first + _AT_ONCE]
            hidden = evaluate(some, t.motion.samples, t.measured.base_frequency or 0.0, 2)
            yield np.asarray(inertia[:, :, [joint]] * hidden[:, None, :])


def _given_way(place: int, evidence: Evidence) -> Array:
    """Return the torque [N, n, 4 k] Nm by which the drives may give way to k added effects, unseen in their positions,
    along the trajectory of a place.

    Lines of the effect's own torque where the position shows none, in phase and in quadrature, as they are and falling
    with frequency.
    """
    structure, t = evidence.structure, evidence.trajectories[place]
    kept = t.measured.position_lines
    assert kept is not None
    columns = structure.columns(t.motion, evidence.values, evidence.rigid[place])
    mine = {effect.label for effect in structure.added}
    out = [np.zeros((*t.motion.q.shape, 0))]
    for effect, own in structure.placed:
        if effect.label not in mine:
            continue
        lines = lines_of_grid(columns[:, :, own] @ evidence.values[own])
        lines[: len(kept)][kept[: len(lines)]] = 0.0
        falling = kept.sum(axis=0) / np.maximum(np.arange(len(lines)), 1)[:, None]
        turned = [lines, 1j * lines, falling * lines, 1j * falling * lines]
        out.append(np.stack([evaluate(part, t.motion.samples, 1.0) for part in turned], axis=2))
    return np.concatenate(out, axis=2)


def _hidden_lines(t: Trajectory, joint: int) -> Lines:
    """Return the lines [K + 1, 3 R + S] that noise hides of kinks at each of a joint's R reversals and the others' S.

    A step of the acceleration has lines over k, its position over k^3. Each may be as large where the last lines end
    that stand above the noise as all of these are, and at least as the smallest that would; in phase with the reversal,
    in quadrature, and not quite at its time, which what is hidden shifts. The reversals of others jerk it, too.
    """
    measured, motion = t.measured, t.motion
    variance, kept = measured.averaged_position_variance, measured.position_lines
    count = np.arange(motion.samples // 2 + 1)
    if variance is None or kept is None:
        return np.zeros((len(count), 0), dtype=complex)
    there: Mask = np.zeros(len(count), dtype=bool)
    there[: len(kept)] = kept[: len(there), joint]
    held = there.astype(float)
    if measured.line_share is not None:
        held[: len(kept)] = measured.line_share[: len(held), joint]
    edge = max(1, int(there.sum()) - 1)
    least = float(least_above_noise(len(kept), variance, motion.samples)[joint])
    last = there & (count > _LAST * edge)
    seen = np.abs(lines_of_grid(motion.q[:, [joint]])[last, 0]) * (count[last] / edge) ** 3
    largest = float(np.clip(np.sqrt(np.mean(seen**2)) if len(seen) else 0.0, least, _MOST * least))
    size = largest * np.minimum(1.0, (edge / np.maximum(count, 1)) ** 3) * (1.0 - held)
    turns = [np.exp(-2j * np.pi * np.outer(count, _reversals(v)) / motion.samples) for v in motion.dq.T]
    steps = [1j * size[:, None] * turn for turn in turns]
    own = steps.pop(joint)
    return np.hstack([own, 1j * own, 2j * np.pi / motion.samples * count[:, None] * own, *steps])


def _reversals(speed: Array) -> Array:
    """Return the places [R] in samples, parts of them included, where a periodic speed [N] passes zero."""
    before = np.flatnonzero(np.sign(speed) * np.sign(np.roll(speed, -1)) < 0)
    ahead = np.roll(speed, -1)[before]
    return np.asarray(before + speed[before] / (speed[before] - ahead))
