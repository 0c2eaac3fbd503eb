"""How sure a set is: the final set and its neighbours, elected anew on resamples of the blocks (RELL, Kishino 1990)."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from robot_ident.diagnosis.selection.constants import ALTERNATIVE, RESAMPLES
from robot_ident.diagnosis.selection.hypotheses import Hypothesis
from robot_ident.diagnosis.selection.search import Search, Selected, names


@dataclass(frozen=True)
class Election:
    """The set that wins most resamples, of those whose effects are worthwhile, and the share [0, 1] of the resamples
    that each set wins, by its labels.

    shares: what a set of several effects on a joint wins counts for one of fewer that predicts as well but for what its
    formulas may err, and what sets alike win for the winner; alternatives: every set's own share. alike: sets with
    another effect in the place of one of the winner's, where both predict as well but for what their formulas may err:
    real causes are no nearer to a formula.
    """

    winner: Selected
    shares: Mapping[tuple[str, ...], float]
    alternatives: Mapping[tuple[str, ...], float]
    alike: tuple[tuple[str, ...], ...] = ()

    @property
    def tied(self) -> tuple[tuple[str, ...], ...]:
        """Sets that these recordings don't tell from the winner: those that win often enough, and those alike."""
        often = tuple(key for key, share in self.alternatives.items() if share >= ALTERNATIVE)
        return (*often, *(key for key in self.alike if key not in often))

    def probability(self, label: str) -> float:
        """Return the share of the resamples won by sets that hold a label."""
        return sum(share for labels, share in self.shares.items() if label in labels)


def elect(search: Search, selected: Selected, seed: int = 0) -> Election:
    """Resample the held-out blocks of every fold; each resample elects the set of the least objective."""
    sets = _neighbours(search, selected)
    data = search.data
    labels = list(sets)
    costs = np.array([sum(search.cost(h) for h in sets[key]) for key in labels])
    losses = [search.given(sets[key]).block_losses() for key in labels]
    rng = np.random.default_rng(seed)
    objectives = np.zeros((RESAMPLES, len(labels)))
    for f in range(len(data.folds)):
        totals = np.array([(of_set[f] / search.dispersion[f]).sum(axis=1) for of_set in losses])
        count = totals.shape[1]
        if count:
            objectives += rng.multinomial(count, np.full(count, 1.0 / count), size=RESAMPLES) @ totals.T
    wins = np.bincount(np.argmin(objectives + costs, axis=1), minlength=len(labels)) / RESAMPLES
    own = {key: float(share) for key, share in zip(labels, wins, strict=True) if share > 0.0}
    own = dict(sorted(own.items(), key=lambda pair: -pair[1]))
    shares: dict[tuple[str, ...], float] = {}
    for key, share in own.items():
        simplest = _simplest(search, sets, key)
        shares[simplest] = shares.get(simplest, 0.0) + share
    ahead = [key for key in shares if shares[key] > shares.get(names(selected), 0.0)]
    best = next((key for key in sorted(ahead, key=lambda key: -shares[key]) if _tenable(search, sets[key])), None)
    winner = selected if best is None else sets[best]
    alike = [key for key in labels if _alike(search, winner, sets[key])]
    usual = next((key for key in alike if _but_for_one_cause(winner, sets[key]) and _tenable(search, sets[key])), None)
    if usual is not None:
        winner = sets[usual]
        alike = [key for key in labels if _alike(search, winner, sets[key])]
    shares[names(winner)] = sum(shares.get(key, 0.0) for key in (names(winner), *alike))
    return Election(winner, {key: share for key, share in shares.items() if key not in alike}, own, tuple(alike))


def _exchanged(winner: Selected, other: Selected) -> tuple[list[Hypothesis], list[Hypothesis]]:
    """Return what each of two sets has that the other has not."""
    mine, instead = names(winner), names(other)
    return [h for h in winner if h.label not in instead], [h for h in other if h.label not in mine]


def _but_for_one_cause(winner: Selected, other: Selected) -> bool:
    """Return whether an effect of the winner is what another set has in its place, and one cause more."""
    (mine,), (instead,) = _exchanged(winner, other)
    return type(mine.effect).more_than == instead.effect.name


def _alike(search: Search, winner: Selected, other: Selected) -> bool:
    """Return whether a set has another effect in the place of one of the winner's, none of which contains the other,
    and both predict every joint that the two touch as well but for what their formulas may err.
    """
    mine, instead = _exchanged(winner, other)
    if len(mine) != 1 or len(instead) != 1 or not {*mine[0].joints} & {*instead[0].joints}:
        return False
    a, b = mine[0].effect, instead[0].effect
    if a.name in type(b).contains or b.name in type(a).contains:
        return False
    return all(
        search.as_good(one, two, joint)
        for joint in {*mine[0].joints, *instead[0].joints}
        for one, two in ((winner, other), (other, winner))
    )


def _tenable(search: Search, some: Selected) -> bool:
    """Return whether every effect of a set is worthwhile beside the others."""
    return all(search.worthwhile(h, [x for x in some if x is not h]) for h in some)


def _simplest(search: Search, sets: Mapping[tuple[str, ...], Selected], key: tuple[str, ...]) -> tuple[str, ...]:
    """Return the best set with fewer effects on one joint, all others alike, that predicts it as well as a set does."""
    of_set = search.simpler(sets[key])
    if of_set != sets[key] and names(of_set) in sets:
        return names(of_set)
    out = {}
    for other, fewer in sets.items():
        places = {h.joints for h in (*of_set, *fewer) if h.label not in other or h.label not in key}
        if len(fewer) >= len(of_set) or len(places) != 1:
            continue
        joint, *more = places.pop()
        if not more and any(joint in h.at for h in fewer) and search.as_good(fewer, of_set, joint):
            out[other] = search.objective(fewer)
    return min(out, key=lambda other: out[other], default=key)


def _neighbours(search: Search, selected: Selected) -> dict[tuple[str, ...], Selected]:
    """Return the set, and the sets one move away from it that may come near."""
    out: dict[tuple[str, ...], Selected] = {names(selected): selected}

    def put(new: Sequence[Hypothesis]) -> None:
        for one in (tuple(new), search.simpler(new)):
            if search.has_meaning(one):
                out.setdefault(names(one), one)

    for h in selected:
        rest = tuple(x for x in selected if x is not h)
        put(rest)
        for _, other in search.ranked(rest)[:8]:
            put((*rest, other))
    for _, h in search.ranked(selected, refine=0)[:3]:
        if search.predicts(h, selected):
            put((*selected, h))
    for joint in range(search.data.n):
        mine = [h for h in selected if h.joints == (joint,)]
        rest = tuple(h for h in selected if h not in mine)
        if len(mine) >= 2:
            for _, h in search.ranked(rest)[:4]:
                if joint in h.at:
                    put((*rest, h))
    for joint, replaced in search.replaceable(selected):
        rest = tuple(h for h in selected if h not in replaced)
        for _, a, b in search.pairs(rest, joint, 6):
            a, b = search.refined_pair(rest, a, b)
            if len(replaced) == 2 or search.both_worthwhile(rest, a, b):
                put((*rest, a, b))
    return out
