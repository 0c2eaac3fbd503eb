"""What the part of a path that hides in the noise of its positions may do to the torque.

A drive that sticks or gives way as it reverses bends its path within milliseconds. Lines of that kink which don't stand
above the noise are missing from the acceleration: a torque remains at every reversal, of the shape of an effect around
reversals, in rows of every trajectory alike, so that prediction doesn't refute it. A fast effect shakes its drive as
well, faster than the servo follows: what it gives way is missing from the acceleration too, and makes the effect seem
to lag and to fade.

Nuisance columns K whose coefficients h are known beforehand to be 0 +- 1 count as noise of covariance K K'. The least
of |r - K h|^2 + |h|^2 over h is r' (I + K K')^-1 r, so that whatever is fitted beside them is fitted to W r, W = (I + K
K')^(-1/2), by columns W phi: a base of p columns stays one of p, however many the nuisance has.
"""

from __future__ import annotations

from collections.abc import Hashable, Iterable, Iterator, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import NamedTuple

import numpy as np

from robot_ident.regression.evidence import Evidence, Trajectory
from robot_ident.regression.gram import BaseFit, BaseGram, base_gram
from robot_ident.regression.spectrum import inertia_along
from robot_ident.signals.fourier import Lines, evaluate, least_above_noise, lines_of_grid
from robot_ident.signals.motion import Array, Mask


@dataclass(frozen=True)
class Nuisance:
    """Columns K [M, k] that the trajectories at `places` share, their rows of all joints stacked: M = n sum N."""

    places: tuple[int, ...]
    columns: Array

    @classmethod
    def of(cls, places: Sequence[int], parts: Sequence[Array]) -> Nuisance:
        """Return the nuisance with the columns [N, n, k] of each place."""
        return cls(tuple(places), np.concatenate([part.reshape(-1, part.shape[2]) for part in parts]))

    @cached_property
    def _axes(self) -> tuple[Array, Array]:
        """Eigenvalues s [k] of K' K and its eigenvectors V [k, k]."""
        values, vectors = np.linalg.eigh(self.columns.T @ self.columns)
        return np.maximum(values, 1e-12 * max(float(values[-1]), 1e-300)), vectors

    def whitened(self, parts: Sequence[Array]) -> list[Array]:
        """Return W x for x given by place, each [N, n, c] or [N, n]."""
        s = self._axes[0]
        root = np.sqrt(1.0 + s)
        return self._less(parts, 1.0 / (root * (1.0 + root)))  # (1 - 1 / root) / s

    def without(self, parts: Sequence[Array]) -> list[Array]:
        """Return x - K h by place, h = (I + K' K)^-1 K' x: what the nuisance most likely has not made."""
        return self._less(parts, 1.0 / (1.0 + self._axes[0]))

    def _less(self, parts: Sequence[Array], shares: Array) -> list[Array]:
        """Return x - K V diag(shares) V' K' x by place."""
        mine, vectors = [parts[place] for place in self.places], self._axes[1]
        x = np.concatenate([part.reshape(part.shape[0] * part.shape[1], -1) for part in mine])
        x = x - self.columns @ (vectors @ (shares[:, None] * (vectors.T @ (self.columns.T @ x))))
        ends = np.cumsum([part.shape[0] * part.shape[1] for part in mine])
        return [piece.reshape(part.shape) for piece, part in zip(np.split(x, ends[:-1]), mine, strict=True)]


def through(groups: Sequence[Nuisance], parts: Sequence[Array], *, whitened: bool) -> tuple[Array, ...]:
    """Return parts [N, n] or [N, n, c] of all trajectories, each whitened by, or without, the nuisance of its group."""
    out = list(parts)
    for group in groups:
        made = group.whitened(parts) if whitened else group.without(parts)
        for place, part in zip(group.places, made, strict=True):
            out[place] = part
    return tuple(out)


_MATTERS = 1.0  # chi-square units that a hidden part must make, at its usual size, to be reckoned with
_LAST = 0.5  # of the number of lines that stand above the noise, from which on they tell how large the next ones are
_MOST = 2.0  # times the smallest line that stands above the noise: were they larger, the next would stand above it, too
_AT_ONCE = 16  # kinks that are looked at together
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
    pairs = zip(evidence.trajectories, evidence.phi, beside.given_way, strict=True)
    rest = [t.y - np.concatenate([phi, given], axis=2) @ beside.fit.values for t, phi, given in pairs]
    return through(beside.kinks, rest, whitened=False)


def misfit_beside_hidden_path(evidence: Evidence) -> tuple[Array, ...]:
    """Return the weighed residual [N, n] of a model as it stands, without what the hidden path may have made of it."""
    beside = _beside(evidence)
    if beside is None:
        return evidence.residual
    white = through(beside.kinks, beside.given_way, whitened=True)
    rest = through(beside.kinks, evidence.residual, whitened=True)
    square = np.eye(white[0].shape[2]) + sum(np.einsum("tjk,tjl->kl", g, g, optimize=True) for g in white)
    right = sum(np.einsum("tjk,tj->k", g, r) for g, r in zip(white, rest, strict=True))
    sizes = np.linalg.solve(square, right)
    less = [r - g @ sizes for g, r in zip(beside.given_way, evidence.residual, strict=True)]
    return through(beside.kinks, less, whitened=False)


class _Beside(NamedTuple):
    """The hidden path of an evidence: kinks of each measurement, given_way: columns [N, n, g] of each trajectory.

    white: the evidence with the latter among its base columns, in units of noise and kinks; fit: the base fitted.
    """

    kinks: tuple[Nuisance, ...]
    given_way: tuple[Array, ...]
    white: Evidence
    fit: BaseFit


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
    given = [
        t.weighed(_given_way(t, rigid, evidence))
        for t, rigid in zip(evidence.trajectories, evidence.rigid, strict=True)
    ]
    matter = np.sum([np.sum(part**2, axis=(0, 1)) for part in given], axis=0) > _MATTERS
    if not kinks and not matter.any():
        return None
    given_way = tuple(part[:, :, matter] for part in given)
    phi = [np.concatenate(pair, axis=2) for pair in zip(evidence.phi, given_way, strict=True)]
    turned = through(kinks, [t.y for t in evidence.trajectories], whitened=True)
    white = replace(
        evidence,
        phi=through(kinks, phi, whitened=True),
        trajectories=tuple(replace(t, y=y) for t, y in zip(evidence.trajectories, turned, strict=True)),
    )
    base = base_gram(white)
    own = base.own.copy()
    further = np.arange(evidence.phi[0].shape[2], phi[0].shape[2])
    own[0, 0, further, further] += 1.0
    fit = BaseFit.of(BaseGram(own, base.torque, base.power), range(len(phi)))
    return _Beside(kinks, given_way, white, fit)


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
        places.setdefault(id(t.measured), []).append(place)
    out = []
    for mine in places.values():
        here = [evidence.trajectories[place] for place in mine]
        kept: list[list[Array]] = [[] for _ in here]
        inertia = inertia_along(here[0], evidence)
        for kinks in _kinks(here[0], inertia):  # of hundreds on a fine grid, few may matter
            parts = [t.weighed(kinks) for t in here]
            matter = np.sum([np.einsum("ijk,ijk->k", part, part) for part in parts], axis=0) > _MATTERS
            for part, own in zip(parts, kept, strict=True):
                own.append(part[:, :, matter])
        if any(part.shape[2] for part in kept[0]):
            out.append(Nuisance.of(mine, [np.concatenate(own, axis=2) for own in kept]))
    return tuple(out)


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


def _given_way(t: Trajectory, rigid: Array, evidence: Evidence) -> Array:
    """Return the torque [N, n, 4 k] Nm by which the drives may give way to k added effects, unseen in their positions.

    Lines of the effect's own torque where the position shows none, in phase and in quadrature, as they are and falling
    with frequency.
    """
    structure, kept = evidence.structure, t.measured.position_lines
    assert kept is not None
    columns = structure.columns(t.motion, evidence.values, rigid)
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
