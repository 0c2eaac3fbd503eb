"""Does a selected effect keep its size all over the motion and on every joint? A cause does, its likeness doesn't.

A column x is split in two: where another joint stands in one half of its range or the other, where the joint turns one
way or the other; a column of several joints is split by joint as well. Where the parts, each with a linear parameter of
its own, predict motion that was not fitted better than the whole, the effect changes with something it does not depend
on: what acts there is another cause.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np

from robot_ident.diagnosis.selection.data_set import DataSet
from robot_ident.diagnosis.selection.fitted_set import FittedSet, standard_errors
from robot_ident.diagnosis.selection.hypotheses import Hypothesis
from robot_ident.regression.gram import HELD
from robot_ident.regression.normal_equations import least_solution
from robot_ident.signals.motion import Mask

_FREE = (-np.inf, np.inf)


@dataclass(frozen=True)
class Split:
    """How an effect was split, in words, and by how much more its parts explain of motion that was not fitted.

    more: fall of the squared error beyond that of the whole effect, and over its standard error in blocks; parameters:
    how many more there are.
    """

    words: str
    more: float
    errors: float
    parameters: int


def splits(given: FittedSet, h: Hypothesis) -> Iterator[Split]:
    """Yield what each split of an effect predicts beside a set without it.

    It is split where the motion is resolved; at reversals that it does not resolve the effect has a size of its own.
    """
    data = given.data
    here = _part(data, h, data.resolved)
    if here is None:
        return
    beside = _part(data, h, [~resolved for resolved in data.resolved])
    whole = [here] if beside is None else [here, beside]
    before = given.block_losses(*whole)

    def split(words: str, parameters: int, *parts: Hypothesis) -> Split:
        pairs = zip(before, given.block_losses(*parts), given.dispersion, strict=True)
        falls = np.concatenate([((loss - after) / phi).sum(axis=1) for loss, after, phi in pairs])
        return Split(words, float(falls.sum()), standard_errors(falls), parameters)

    if len(here.joints) > 1:
        parts = [Hypothesis(h.effect, {joint: at}, here.ranges) for joint, at in here.at.items()]
        yield split("from joint to joint", len(h.ranges) * (len(parts) - 1), *parts, *whole[1:])
    for k, name in enumerate(data.structure.robot.joints):
        for words, rows in (("position", _upper_half(data, k)), ("direction", _forward(data, k))):
            masks = [half[:, None] & resolved for half, resolved in zip(rows, data.resolved, strict=True)]
            half = _part(data, h, masks)
            own = words == "direction" and k in h.joints
            if half is not None and not (own and _held(given, h, rows)):
                yield split(f"with the {words} of {name}", len(h.ranges), *whole, half)


def _held(given: FittedSet, h: Hypothesis, rows: Sequence[Mask]) -> bool:
    """Return whether the model and an effect hold the half of the effect already, as friction of another size forwards
    and backwards does that of friction which differs between the directions.
    """
    half = _part(given.data, h, [np.repeat(mask[:, None], given.data.n, axis=1) for mask in rows])
    if half is None:
        return True
    made = given.addition(-1, h, half)
    own, more = np.split(np.arange(len(made.size)), [len(h.ranges)])
    onto = least_solution(made.square[np.ix_(own, own)], made.square[np.ix_(own, more)])
    left = np.diag(made.square)[more] - np.sum(made.square[np.ix_(own, more)] * onto, axis=0)
    return bool(np.all(left <= HELD * made.size[more]))


def _upper_half(data: DataSet, joint: int) -> list[Mask]:
    together = np.concatenate([t.motion.q[:, joint] for t in data.folds[: data.training]])
    middle = float(np.median(together))
    return [np.asarray(t.motion.q[:, joint] > middle) for t in data.folds]


def _forward(data: DataSet, joint: int) -> list[Mask]:
    return [np.asarray(t.motion.dq[:, joint] > 0.0) for t in data.folds]


def _part(data: DataSet, h: Hypothesis, rows: Sequence[Mask]) -> Hypothesis | None:
    """Return an effect in some rows [N, n] of each fold's motion, as a hypothesis of its own with free parameters."""
    columns = data.columns(h.effect, rows)
    at = {joint: data.pools[joint].add(some) for joint, some in columns.items() if joint in h.at}
    return Hypothesis(h.effect, at, (_FREE,) * len(h.ranges)) if at else None
