"""The rows of a selection: whitened torque and base columns, joint by joint and fold by fold."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from robot_ident.diagnosis.power import least_torque
from robot_ident.diagnosis.selection.constants import CREEP
from robot_ident.diagnosis.selection.hypotheses import Hypothesis, formula_error, hypotheses_of
from robot_ident.diagnosis.selection.reversals import near_reversals, unresolved_rows
from robot_ident.diagnosis.selection.unseen_reactions import with_unseen_reactions
from robot_ident.effects import Effect, Torques
from robot_ident.effects.effort_filter import EffortFilter
from robot_ident.model.structure import Structure
from robot_ident.recording.measurement import Measurement
from robot_ident.regression.block_jackknife import rows_in_block
from robot_ident.regression.evidence import Evidence, Trajectory, fitted, gather, split, trajectory, weighed_uncut
from robot_ident.regression.gram import FAINT
from robot_ident.regression.normal_equations import pseudo_inverse
from robot_ident.regression.spectrum import white_lines, whitened
from robot_ident.regression.weighed_by_residual import tells_noise, weighed_alike, weighed_by_residual
from robot_ident.signals.motion import Array, Mask, joined

_PARTS = 8  # of the only recording, each of which is left out in turn


@dataclass(frozen=True)
class Rows:
    """Recordings that are fitted, and recordings that only validate, as folds of whitened rows.

    tested: the training recordings in units of their noise, for tests of the model as it is. evidence, validation: the
    same with the path's lines taken as uncertain as their noise is large, for comparing sets: what does not stand above
    the noise may still be there, since fast effects shake the joint they act on. dof [F, n]: what the squared error of
    noise alone adds up to then; unseen [F, n]: what reactions that no position shows may add to it. floor: whether
    noise is known; else rows are in units of what the model leaves of a joint, and dof are the independent rows.
    """

    tested: Evidence
    evidence: Evidence
    validation: tuple[Trajectory, ...]
    dof: Array
    unseen: Array
    floor: bool = True

    @classmethod
    def of(
        cls,
        measurements: Sequence[Measurement],
        structure: Structure,
        validation: Sequence[Measurement] = (),
        *,
        floor: bool = True,
    ) -> Rows:
        """Put the rows in units of their noise where all tell it (unless floor is False), split the only recording."""
        if not floor or not all(tells_noise(measured) for measured in measurements):
            return cls._without_floor(measurements, structure, validation)
        kept = gather(measurements, structure)
        tested = whitened(kept)
        others = [trajectory(measured) for measured in validation if tells_noise(measured)]
        before = [*tested.trajectories, *white_lines(others, kept)]
        after = white_lines([_path_as_uncertain_as_seen(t) for t in (*kept.trajectories, *others)], kept)
        found = [
            with_unseen_reactions(t, white.whitening, structure.torques(t.motion, kept.values))
            for t, white in zip(before, after, strict=True)
        ]
        after = tuple(t for t, _ in found)
        training = after[: len(measurements)]
        evidence = fitted(structure, training, kept.rigid, kept.memory)
        unseen = np.array([power for _, power in found])
        dof = np.array([_left_of_noise(*pair) for pair in zip(before, after, strict=True)])
        if len(measurements) == 1:
            evidence, tested = split(evidence, _PARTS), split(tested, _PARTS)
            share = np.array([t.dof for t in evidence.trajectories]) / np.maximum(training[0].dof, 1e-300)
            dof, unseen = (np.concatenate([share * of_all[0], of_all[1:]]) for of_all in (dof, unseen))
        return cls(tested, evidence, after[len(training) :], dof, unseen)

    @classmethod
    def plain(cls, evidence: Evidence) -> Rows:
        """Take rows as an evidence weighs them."""
        dof = np.array([t.dof for t in evidence.trajectories])
        return cls(evidence, evidence, (), dof, np.zeros_like(dof), floor=False)

    @classmethod
    def _without_floor(
        cls, measurements: Sequence[Measurement], structure: Structure, validation: Sequence[Measurement]
    ) -> Rows:
        """Put the rows of recordings that do not tell their noise in units of what the model leaves of each joint."""
        kept = weighed_by_residual(measurements, structure)
        if len(measurements) == 1:
            kept = split(kept, _PARTS)
        aside = tuple(weighed_alike(measured, kept) for measured in validation)
        dof = np.array([t.dof for t in (*kept.trajectories, *aside)])
        return cls(kept, kept, aside, dof, np.zeros_like(dof), floor=False)


def _path_as_uncertain_as_seen(t: Trajectory) -> Trajectory:
    share = t.measured.line_share
    return t if share is None else replace(t, measured=replace(t.measured, line_share=np.ones_like(share)))


def _left_of_noise(before: Trajectory, after: Trajectory) -> Array:
    """Return the squared error [n] that noise makes of rows whose lines weigh less than in units of it."""
    if after.whitening is None:
        return after.dof
    full = np.ones_like(after.whitening) if before.whitening is None else before.whitening
    return np.asarray(after.dof * np.mean((after.whitening / full) ** 2, axis=0))


class DataSet:
    """Folds of whitened rows with the columns of the base and of all hypotheses.

    The first `training` folds are fitted, each of them left out in turn; the others only validate. Of N rows of a fold:
    base [n][F] of [N, p], y [n][F] of [N], blocks [F] of [N], the block of each row. dof [F, n]: independent rows.
    base_own [F, n, p, p], base_torque [F, n, p], power [F, n]: inner products. least [n]: the squared error of the
    least torque worth a name.
    known_errors: of each effect that the model has already, the squared error [n] that its formula may make of the
    first.
    """

    def __init__(self, rows: Rows, effects: Sequence[Effect] | None = None) -> None:
        """Take the rows apart by joint and compute the columns of some effects (None: of all hypotheses) once."""
        evidence = rows.evidence
        self.structure, self.n = evidence.structure, evidence.structure.robot.n
        self.folds = [*evidence.trajectories, *rows.validation]
        self.training = len(evidence.trajectories)
        self.torques, phi = self._seen(evidence, rows.validation)
        self.p = phi[0].shape[2]
        whose = list(zip(self.folds, phi, strict=True))
        self.base = [[np.ascontiguousarray(x[t.rows, j]) for t, x in whose] for j in range(self.n)]
        self.y = [[np.ascontiguousarray(t.y[t.rows, j]) for t in self.folds] for j in range(self.n)]
        self.base_own = np.array([[b.T @ b for b in of_joint] for of_joint in self.base]).swapaxes(0, 1)
        self.base_torque = np.array(
            [[b.T @ y for b, y in zip(*pair, strict=True)] for pair in zip(self.base, self.y, strict=True)]
        ).swapaxes(0, 1)
        self.power = np.array([[y @ y for y in of_joint] for of_joint in self.y]).T
        self.dof, self.unseen = rows.dof, rows.unseen
        sources = [id(t.measured) for t in self.folds[: self.training]]
        self.of_measurement = [[f for f, one in enumerate(sources) if one == of] for of in dict.fromkeys(sources)]
        self.blocks = [_blocks(t) for t in self.folds]
        self.floor = rows.floor
        self.resolved = self._resolved()
        speeds = [np.abs(t.motion.dq[t.measured.rows][t.rows]) for t in self.folds]
        creep = CREEP * np.max([speed.max(axis=0) for speed in speeds], axis=0)
        self.moving = [speed > creep for speed in speeds]
        self.weights = np.array([np.sum(t.weight**2, axis=0) for t in self.folds])
        self.least = np.array([least_torque(evidence, j) ** 2 for j in range(self.n)])
        self.known_errors = self._errors_of_known(evidence.values)
        self.pools = [GramPool(*pair) for pair in zip(self.base, self.y, strict=True)]
        self.hypotheses: dict[str, list[Hypothesis]] = {}
        self._add_all(evidence, effects)
        self.grid = {label: len(settings) for label, settings in self.hypotheses.items()}

    def _resolved(self) -> list[Mask]:
        """Return the samples [N, n] of every fold's motion that no unresolved motion at reversals spoils."""
        known: dict[int, Mask] = {}
        for t, torques in zip(self.folds, self.torques, strict=True):
            key, measured = id(t.measured), t.measured
            if key in known:
                continue
            if self.floor:
                assert torques.rigid is not None
                known[key] = ~unresolved_rows(measured, torques.rigid.inertia, np.sqrt(measured.averaged_variance))
            else:
                known[key] = ~near_reversals(measured)
        return [known[id(t.measured)] for t in self.folds]

    def _seen(self, evidence: Evidence, validation: Sequence[Trajectory]) -> tuple[list[Torques], list[Array]]:
        """Return torques and whitened base columns of every fold; torque scales are free to first order."""
        torques, phi, links = list(evidence.torques), list(evidence.phi), list(evidence.rigid)
        for t in validation:
            rigid = self.structure.rigid_columns(t.motion)
            phi.append(t.weighed(self.structure.columns(t.motion, evidence.values, rigid)))
            torques.append(self.structure.torques(t.motion, evidence.values, rigid))
            links.append(rigid)
        if self.structure.scaled:
            further = [self._by_scale(*pair, evidence.values) for pair in zip(self.folds, links, strict=True)]
            phi = [t.beside(*pair) for t, *pair in zip(self.folds, phi, further, strict=True)]
        return torques, phi

    def _by_scale(self, t: Trajectory, rigid: Array, values: Array) -> Array:
        """Return a fold's derivatives [N, n, scales] by the logarithm of each torque scale that is a parameter."""
        torque = self.structure.reported(rigid) @ values[: rigid.shape[2]]
        out = np.zeros((*torque.shape, len(self.structure.scaled)))
        for k, joint in enumerate(self.structure.scaled):
            out[:, joint, k] = torque[:, joint]
        return t.weighed(out)

    def _errors_of_known(self, values: Array) -> dict[str, Array]:
        """Return by label the squared error [n] that formulas of added effects may make of the training folds: a share
        of what the parameters of the model without them can't take.
        """
        own = self.base_own[: self.training].sum(axis=0)
        added = {effect.label for effect in self.structure.added}
        rest = np.ones(self.p, dtype=bool)
        rest[: len(values)] = ~self.structure.places_of(lambda effect: effect.label in added)
        square = pseudo_inverse(own[:, rest][:, :, rest].sum(axis=0))
        out = {}
        for effect, at in self.structure.placed:
            if effect.label in added and not effect.exact:
                c = np.zeros(self.p)
                c[at] = values[at]
                c[rest] = -square @ (own[:, rest][:, :, at].sum(axis=0) @ values[at])
                out[effect.label] = formula_error(effect) ** 2 * np.einsum("p,jpq,q->j", c, own, c)
        return out

    def kept(self, fold: int, joint: int) -> Mask:
        """Return the rows [N] of a joint that count and that no unresolved motion at reversals spoils."""
        t = self.folds[fold]
        return np.asarray((t.weight[t.rows, joint] > 0.0) & self.resolved[fold][t.measured.rows, joint][t.rows])

    def turns_resolved(self, joint: int) -> bool:
        """Return whether most of a joint's reversals are resolved, and tell a filter of effort from a delay.

        A filter rounds the steps of dry friction, a delay keeps them; a joint that sticks rounds them, too.
        """
        turns = resolved = 0
        for t, rows in zip(self.folds, self.resolved, strict=True):
            sign = np.sign(t.motion.dq[:, joint])
            at = np.flatnonzero(sign[1:] != sign[:-1])
            turns += len(at)
            resolved += int(np.sum(rows[at, joint] & rows[at + 1, joint]))
        return self.floor and 2 * resolved >= turns

    def tells_filter(self, place: str | None) -> bool:
        """Return whether the reversals of a joint (None: of all) tell a filter from a delay."""
        names = self.structure.robot.joints
        return all(self.turns_resolved(j) for j in range(self.n) if place in (None, names[j]))

    @property
    def noise(self) -> Array:
        """Squared error [n] of the training folds that noise alone makes; 0 where it is not known."""
        return np.asarray(self.floor * self.dof[: self.training].sum(axis=0))

    @property
    def block_count(self) -> int:
        """Number of blocks in all folds."""
        return sum(int(blocks[-1]) + 1 for blocks in self.blocks)

    def _add_all(self, evidence: Evidence, effects: Sequence[Effect] | None) -> None:
        """Add every hypothesis at every value of its nonlinear parameters, joint by joint at once."""
        reached = joined([measured.motion for measured in evidence.recordings])
        averaged = all(t.motion.periodic for t in evidence.trajectories)
        made: list[tuple[Effect, dict[int, list[Array]]]] = []
        for effect in hypotheses_of(self.structure, averaged=averaged) if effects is None else effects:
            if isinstance(effect, EffortFilter) and not self.tells_filter(effect.place):
                continue
            for setting in effect.settings(reached):
                at = effect.at(setting)
                columns = self.columns(at)
                if columns:
                    made.append((at, columns))
        places: list[dict[int, Array]] = [{} for _ in made]
        for joint in range(self.n):
            mine = [k for k, (_, columns) in enumerate(made) if joint in columns]
            if not mine:
                continue
            sizes = [made[k][1][joint][0].shape[1] for k in mine]
            together = [
                np.concatenate([made[k][1][joint][fold] for k in mine], axis=1) for fold in range(len(self.folds))
            ]
            added = self.pools[joint].add(together)
            for k, some in zip(mine, np.split(added, np.cumsum(sizes)[:-1]), strict=True):
                places[k][joint] = some
        for (effect, _), mine_at in zip(made, places, strict=True):
            self.hypotheses.setdefault(effect.label, []).append(Hypothesis(effect, mine_at, effect.ranges))

    def columns(self, effect: Effect, only: Sequence[Mask] | None = None) -> dict[int, list[Array]]:
        """Return an effect's whitened columns by joint that it touches: [N, k] of every fold.

        only: rows [N, n] of each fold's motion outside of which they are zero.
        """
        raw: dict[int, Array] = {}
        for number, (t, torques) in enumerate(zip(self.folds, self.torques, strict=True)):
            if id(t.measured) not in raw:
                made = self.structure.columns_of(effect, t.motion, torques)
                raw[id(t.measured)] = made if only is None else made * only[number][:, :, None]
        touched = np.flatnonzero(np.any([np.any(c != 0, axis=(0, 2)) for c in raw.values()], axis=0)).tolist()
        white = self.in_noise(lambda fold: raw[id(self.folds[fold].measured)][:, touched], touched)
        return {j: [rows[:, place] for rows in white] for place, j in enumerate(touched)}

    def in_noise(self, columns: Callable[[int], Array], joints: Sequence[int], count: int | None = None) -> list[Array]:
        """Return columns [N, joints, k] Nm low-passed and in units of the noise, in the rows of each fold (of the first
        `count`).
        """
        folds = self.folds[:count]
        return [rows[t.rows] for t, rows in zip(folds, weighed_uncut(folds, columns, joints), strict=True)]

    def add(self, effect: Effect) -> Hypothesis | None:
        """Add an effect at further values of its nonlinear parameters; None where its columns are zero."""
        columns = self.columns(effect)
        if not columns:
            return None
        at = {joint: self.pools[joint].add(some) for joint, some in columns.items()}
        made = Hypothesis(effect, at, effect.ranges)
        self.hypotheses.setdefault(effect.label, []).append(made)
        return made

    def left_out_weights(self) -> list[tuple[Array, list[int]]]:
        """Return weights [F] of every fit and the folds that it predicts: all but one, and all for the validation."""
        whole = np.zeros(len(self.folds))
        whole[: self.training] = 1.0
        out = []
        for fold in range(self.training):
            weights = whole.copy()
            weights[fold] = FAINT
            out.append((weights, [fold]))
        return [*out, (whole, list(range(self.training, len(self.folds))))]


def _blocks(t: Trajectory) -> NDArray[np.intp]:
    size = rows_in_block(t.measured)
    of_recording = np.arange(len(t.y))[t.rows] // size
    return of_recording - of_recording[:1]


_ROOM = 64  # columns by which a pool grows at least


class GramPool:
    """Whitened columns x of one joint's rows, fold by fold, and x'x, b'x, x'y with the base b and the torque y.

    A column of a joint is zero in other joints' rows, so that inner products of one joint stay in its pool. own [F, P,
    P], cross [F, p, P], torque [F, P]; F folds, p base parameters, P columns.
    """

    def __init__(self, base: Sequence[Array], y: Sequence[Array]) -> None:
        """Begin without columns; base [N, p] and y [N] of every fold."""
        self.base, self.y, self.count = list(base), list(y), 0
        self._rows: list[Array] = []
        self._grow(0)

    def _grow(self, room: int) -> None:
        folds, p, used = len(self.base), self.base[0].shape[1], self.count
        rows = [np.zeros((len(y), room)) for y in self.y]
        own, cross, torque = np.zeros((folds, room, room)), np.zeros((folds, p, room)), np.zeros((folds, room))
        if used:
            for new, old in zip(rows, self._rows, strict=True):
                new[:, :used] = old[:, :used]
            own[:, :used, :used] = self.own
            cross[:, :, :used] = self.cross
            torque[:, :used] = self.torque
        self._rows, self._own, self._cross, self._torque = rows, own, cross, torque

    def add(self, columns: Sequence[Array]) -> Array:
        """Add columns [N, k] of every fold; return their places [k]."""
        low, high = self.count, self.count + columns[0].shape[1]
        if high > self._own.shape[1]:
            self._grow(max(high, self.count + _ROOM))
        for fold, new in enumerate(columns):
            rows = self._rows[fold]
            rows[:, low:high] = new
            products = rows[:, :high].T @ new
            self._own[fold, :high, low:high] = products
            self._own[fold, low:high, :high] = products.T
            self._cross[fold, :, low:high] = self.base[fold].T @ new
            self._torque[fold, low:high] = new.T @ self.y[fold]
        self.count = high
        return np.arange(low, high)

    def rows(self, fold: int, places: Array | slice) -> Array:
        """Return the columns [N, k] at some places in a fold's rows."""
        return self._rows[fold][:, : self.count][:, places]

    @property
    def own(self) -> Array:
        """Inner products of the columns [F, P, P]."""
        return self._own[:, : self.count, : self.count]

    @property
    def cross(self) -> Array:
        """Inner products with the base [F, p, P]."""
        return self._cross[:, :, : self.count]

    @property
    def torque(self) -> Array:
        """Inner products with the torque [F, P]."""
        return self._torque[:, : self.count]
