"""How sure a set is: the final set and its neighbours, elected anew on resamples of the blocks (RELL, Kishino 1990)
that were not fitted, by fits that move with the noise of those that were.
"""

from __future__ import annotations

from collections.abc import Callable, Collection, Mapping, Sequence
from dataclasses import dataclass, field
from itertools import combinations

import numpy as np

from robot_ident.diagnosis.selection.constants import ALTERNATIVE, RESAMPLES
from robot_ident.diagnosis.selection.data_set import DataSet
from robot_ident.diagnosis.selection.hypotheses import Hypothesis
from robot_ident.diagnosis.selection.search import Search, Selected, names
from robot_ident.signals.motion import Array


@dataclass(frozen=True)
class Election:
    """The set that wins most resamples, of those whose effects are worthwhile, and the share [0, 1] of the resamples
    that each set wins, by its labels.

    shares: what a set of several effects on a joint wins counts for one of fewer that predicts as well but for what its
    formulas may err; alternatives: every set's own share. alike: sets with other effects in the place of some of the
    winner's, which predict as well as these but for what their formulas may err, since real causes are no nearer to a
    formula; by the winner's labels, those in their place. joints: whose torque an effect makes, by its label.
    """

    winner: Selected
    shares: Mapping[tuple[str, ...], float]
    alternatives: Mapping[tuple[str, ...], float]
    alike: Mapping[tuple[str, ...], Mapping[str, str]] = field(default_factory=dict)
    joints: Mapping[str, frozenset[int]] = field(default_factory=dict)

    @property
    def tied(self) -> tuple[tuple[str, ...], ...]:
        """Sets that these recordings don't tell from the winner: those that win often enough, and those alike."""
        often = tuple(key for key, share in self.alternatives.items() if share >= ALTERNATIVE)
        return (*often, *(key for key in self.alike if key not in often))

    def instead_of(self, label: str) -> set[str]:
        """Return the labels of what other sets hold in the place of an effect of the winner, on its joints."""
        mine = names(self.winner)
        out: set[str] = set()
        for key in self.tied:
            if key in self.alike:
                out |= {other for own, other in self.alike[key].items() if own == label}
            elif label not in key:
                out |= {other for other in key if other not in mine and self.joints[other] & self.joints[label]}
        return out

    def probability(self, label: str) -> float:
        """Return the share of the resamples won by sets that hold a label, or one that is alike in its place."""
        any_of = {label, *(pairs[label] for pairs in self.alike.values() if label in pairs)}
        return sum(share for labels, share in self.shares.items() if any_of & {*labels})


def elect(search: Search, selected: Selected, seed: int = 0) -> Election:
    """Resample the held-out blocks of every fold, and draw noise for the fits; each resample elects the set of the
    least objective.
    """
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
    given = [search.given(sets[key]) for key in labels]
    noise = _Noise(data, {h for one in given for h in one.selected}, rng)
    objectives += np.array([one.noise_losses(noise.beside(one.selected)) for one in given]).T
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
    winner = _with_usual_causes(search, winner, sets)
    alike = _all_alike(search, winner, sets)
    joints = {h.label: frozenset(h.joints) for one in sets.values() for h in one}
    return Election(winner, shares, own, alike, joints)


class _Noise:
    """Noise e of the fitted rows, of variance 1, drawn for every resample: its products E'e with base and effects."""

    def __init__(self, data: DataSet, some: Collection[Hypothesis], rng: np.random.Generator) -> None:
        """Draw it, a joint's rows of a fold at a time."""
        self.base: dict[tuple[int, int], Array] = {}
        self.own: dict[tuple[Hypothesis, int, int], Array] = {}
        for joint, fold in np.ndindex(data.n, data.training):
            drawn = rng.standard_normal((RESAMPLES, len(data.y[joint][fold])), dtype=np.float32)
            self.base[joint, fold] = drawn @ data.base[joint][fold]
            for h in some:
                nothing = np.zeros((RESAMPLES, len(h.ranges)))
                here = data.pools[joint].rows(fold, h.at[joint]) if joint in h.at else None
                self.own[h, joint, fold] = nothing if here is None else drawn @ here

    def beside(self, some: Selected) -> Callable[[int, int], Array]:
        """Return E'e [R, q] of base and some effects, as a function of joint and fold."""
        return lambda joint, fold: np.concatenate(
            [self.base[joint, fold], *(self.own[h, joint, fold] for h in some)], axis=1
        )


def _all_alike(
    search: Search, winner: Selected, sets: Mapping[tuple[str, ...], Selected]
) -> dict[tuple[str, ...], dict[str, str]]:
    """Return the sets that are alike with the winner, and what they hold in the place of its effects."""
    alike = {key: other for key, other in sets.items() if _alike(search, winner, other)}
    return {key: {a.label: b.label for a, b in _exchanged(winner, other)} for key, other in alike.items()}


def _exchanged(winner: Selected, other: Selected) -> list[tuple[Hypothesis, Hypothesis]]:
    """Return what another set has in the place of some of the winner's effects, joint by joint; nothing where it is not
    so.
    """
    mine, instead = names(winner), names(other)
    here = sorted((h for h in winner if h.label not in instead), key=lambda h: h.joints)
    there = sorted((h for h in other if h.label not in mine), key=lambda h: h.joints)
    if len(here) != len(there) or not all({*a.joints} & {*b.joints} for a, b in zip(here, there, strict=True)):
        return []
    return list(zip(here, there, strict=True))


def _alike(search: Search, winner: Selected, other: Selected) -> bool:
    """Return whether a set has other effects in the place of some of the winner's, none of which contains the other,
    and both predict every joint that these touch as well but for what their formulas may err; or for chance, where
    one is the other but for one more cause.
    """
    pairs = _exchanged(winner, other)
    if not pairs or any(b.effect.name in type(a.effect).contains for pair in pairs for a, b in (pair, pair[::-1])):
        return False
    one_more = all(
        b.effect.name == type(a.effect).more_than or a.effect.name == type(b.effect).more_than for a, b in pairs
    )
    if one_more and not search.tells_apart(winner, other) and not search.tells_apart(other, winner):
        return True
    mine, instead = zip(*pairs, strict=True)
    return all(
        search.as_good(one, two, joint, own)
        for joint in {joint for pair in pairs for h in pair for joint in h.joints}
        for one, two, own in ((winner, other, mine), (other, winner, instead))
    )


def _with_usual_causes(search: Search, winner: Selected, sets: Mapping[tuple[str, ...], Selected]) -> Selected:
    """Return the winner with every effect that is another one but for one more cause (`more_than`) replaced by that
    one, where both predict alike and it is worthwhile beside the others.
    """
    known = {h.label: h for one in sets.values() for h in one}
    for a in winner:
        b = known.get(f"{type(a.effect).more_than}@{a.effect.place}")
        if b is None:
            continue
        rest = tuple(h for h in winner if h is not a)
        b = search.refinement.of(search.given(rest), b)
        other = (*rest, b)
        if _alike(search, winner, other) and search.worthwhile(b, rest):
            winner = other
    return winner


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
    for a, b in combinations(selected, 2):
        rest = tuple(h for h in selected if h not in (a, b))
        for _, h in search.ranked(rest)[:4] if {*a.joints} & {*b.joints} else ():
            put((*rest, h))
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
