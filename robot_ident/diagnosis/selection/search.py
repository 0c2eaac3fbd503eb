"""The search over sets of effects: add, pair, drop, swap, merge, until nothing improves.

The objective of a set S is J(S) = sum_fj L_fj / phi_fj + sum_h [2 u_h ln H + k_h ln B]: the squared error L of every
fold f and joint j by the fit that has not seen it, over the joint's dispersion phi; H hypotheses, u causes that h
stands for, k parameters, B blocks (risk inflation, Foster and George 1994; BIC, Schwarz 1978).
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from itertools import combinations

import numpy as np

from robot_ident.diagnosis.selection.constants import (
    FORMULA_ERROR,
    LARGEST_SET,
    PAIRS,
    PARTIAL_SHARE,
    REFINED,
    SHARE,
    SIZE_ERROR,
    SIZE_ERROR_OF_FRICTION,
)
from robot_ident.diagnosis.selection.data_set import DataSet
from robot_ident.diagnosis.selection.fitted_set import FittedSet
from robot_ident.diagnosis.selection.hypotheses import Hypothesis
from robot_ident.diagnosis.selection.pair_scores import PairScores
from robot_ident.diagnosis.selection.refinement import Refinement
from robot_ident.regression.gram import HELD
from robot_ident.signals.motion import Array

Selected = tuple[Hypothesis, ...]
Ranked = list[tuple[float, Hypothesis]]
"""Hypotheses and what they predict beyond their cost, best first."""

_FIRST = 6  # hypotheses that are looked at in a step, the best by what they predict
_TOGETHER = 3  # effects of a joint at most of which some are replaced by a pair
_KEPT = 24  # fitted sets that are remembered
_CLEARLY = 2.0  # of J, by which another set must be better to take the place of one
_LEAST_DISPERSION = 1e-9  # of what the model without any effect leaves, where noise is not known
_ROUNDING = 1e-6  # of a gain, to which a bound of it is computed
_WITHOUT_WEIGHT = 1e6  # dispersion of a joint whose rows count for nothing


def names(selected: Sequence[Hypothesis]) -> tuple[str, ...]:
    """Return the labels of a set, in order."""
    return tuple(sorted(h.label for h in selected))


class Search:
    """Searches sets on a data set; `unknown`: joints whose rows count for nothing, since what acts there is unknown.

    barred: labels that are not tried. size_error: to which the size of an effect must be known, for a formula of the
    usual error.
    """

    def __init__(self, data: DataSet, size_error: float = SIZE_ERROR) -> None:
        """Begin with the empty set, every joint counting."""
        self.data = data
        self.size_error = size_error
        self.refinement = Refinement(data)
        self.dispersion = np.ones_like(data.power)
        self.unknown: set[int] = set()
        self.barred: set[str] = set()
        self._fitted: dict[object, FittedSet] = {}
        self._looked: dict[object, list[tuple[float, Hypothesis, Hypothesis]]] = {}
        self._choices = 2.0 * np.log(max(2, len(data.hypotheses)))
        self._per_parameter = np.log(max(2, data.block_count))
        self.least = data.weights.sum(axis=0) * data.least

    def with_size_error(self, size_error: float) -> Search:
        """Return another search on the data set that asks for another size error, and knows what this one computed."""
        other = Search(self.data, size_error)
        other.refinement, other._fitted, other._looked = self.refinement, self._fitted, self._looked
        return other

    def given(self, selected: Sequence[Hypothesis], dispersion: Array | None = None) -> FittedSet:
        """Return a set, fitted with a dispersion (None: the present one)."""
        dispersion = self.dispersion if dispersion is None else dispersion
        key = (tuple(sorted(id(h) for h in selected)), dispersion.tobytes())
        found = self._fitted.pop(key, None) or FittedSet(self.data, selected, dispersion)
        while len(self._fitted) >= _KEPT:
            self._fitted.pop(next(iter(self._fitted)))
        self._fitted[key] = found
        return found

    def weigh_by(self, selected: Sequence[Hypothesis]) -> None:
        """Take the dispersion phi = max(1, L / dof) that a set leaves, training folds pooled by joint."""
        self.dispersion = self._dispersion_of(self.given(selected).loss)

    def _dispersion_of(self, loss: Array) -> Array:
        data, phi = self.data, np.ones_like(loss)
        some = slice(0, data.training)
        phi[some] = loss[some].sum(axis=0) / np.maximum(data.dof[some].sum(axis=0), 1.0)
        phi[data.training :] = loss[data.training :] / np.maximum(data.dof[data.training :], 1.0)
        phi = np.maximum(phi, 1.0 if data.floor else _LEAST_DISPERSION)
        phi[:, sorted(self.unknown)] = _WITHOUT_WEIGHT
        return phi

    def cost(self, h: Hypothesis) -> float:
        """Return what a hypothesis must gain to be worth its choice and its parameters."""
        return float(self._choices * h.causes + self._per_parameter * h.effect.size)

    def objective(self, selected: Sequence[Hypothesis]) -> float:
        """Return J of a set."""
        return float((self.given(selected).loss / self.dispersion).sum()) + sum(self.cost(h) for h in selected)

    def formula_error(self, selected: Sequence[Hypothesis]) -> Array:
        """Return the squared error [n] of all folds that the formulas of a set and of what the model has already, and
        unseen reactions, may make.
        """
        data = self.data
        known = len(data.folds) / data.training * sum(data.known_errors.values())
        return np.asarray(data.unseen.sum(axis=0) + known + self._error_of(selected, selected))

    def _error_of(self, some: Sequence[Hypothesis], selected: Sequence[Hypothesis]) -> Array:
        """Return the squared error [n] of all folds that the formulas of some effects of a set may make."""
        given, out = self.given(selected), np.zeros(self.data.n)
        for h in given.selected:
            if h in some:
                out += len(self.data.folds) / self.data.training * h.formula_error**2 * given.contribution(h)
        return out

    def as_good(
        self, one: Sequence[Hypothesis], other: Sequence[Hypothesis], joint: int, some: Sequence[Hypothesis] = ()
    ) -> bool:
        """Return whether a set predicts a joint as well as another does, but for what its formulas (some: those of some
        of its effects) may err.
        """
        falls = self.given(one).loss[:, joint].sum() - self.given(other).loss[:, joint].sum()
        allowed = self._error_of(some, one) if some else self.formula_error(one)
        return float(falls) <= float(allowed[joint])

    def worthwhile(self, h: Hypothesis, beside: Sequence[Hypothesis]) -> bool:
        """Return whether a hypothesis predicts more than it costs, its size is known and makes sense."""
        return self.size_known(h, beside) and self.predicts(h, beside)

    def size_known(self, h: Hypothesis, beside: Sequence[Hypothesis]) -> bool:
        """Return whether the size of a hypothesis is known as well as is asked of its formula, and of one that contains
        another the size of what it has more.
        """
        least = self.largest_size_error(h)
        parts = [self.part_of(h, name) for name in type(h.effect).contains]
        sets = [beside, *([*beside, part] for part in parts if part is not None)]
        return all(self.size_error_of(h, one) < least for one in sets)

    def size_error_of(self, h: Hypothesis, beside: Sequence[Hypothesis]) -> float:
        """Return the relative standard error of a hypothesis's size. Where noise is not known, joints weigh as much as
        what is left of them with it makes them, of friction of the own drive: while it is missing it must not hide its
        size. What acts from elsewhere must be seen beside all that is missing.
        """
        given = self.given(beside)
        if h.own_friction and not self.data.floor:
            given = self.given(beside, self._dispersion_of(given.loss - given.held_out_gain(h)))
        return given.size_error(h)

    def largest_size_error(self, h: Hypothesis) -> float:
        """Return the relative standard error to which the size of a hypothesis must be known."""
        asked = max(self.size_error, SIZE_ERROR_OF_FRICTION) if h.own_friction else self.size_error
        return asked * h.formula_error / FORMULA_ERROR

    def part_of(self, h: Hypothesis, name: str) -> Hypothesis | None:
        """Return the effect of a name that a hypothesis contains, at its place; None where it is no hypothesis."""
        settings = self.data.hypotheses.get(f"{name}@{h.effect.place}")
        return settings[0] if settings else None

    def simpler(self, selected: Sequence[Hypothesis]) -> Selected:
        """Return a set with effects replaced by the one that they contain where what they have more is not known."""
        out = list(selected)
        for h in selected:
            rest = [x for x in out if x is not h]
            for part in (self.part_of(h, name) for name in type(h.effect).contains):
                if part is not None and not any(part.excludes(x) for x in rest) and not self.size_known(h, rest):
                    out = [*rest, part]
        return tuple(out)

    def predicts(self, h: Hypothesis, beside: Sequence[Hypothesis], *, beyond_chance: bool = True) -> bool:
        """Return whether a hypothesis predicts more than it costs and makes sense; beyond_chance: and stands out.

        On each joint no more counts than the excess over noise, and only what exceeds the error of the others' formulas
        and the least torque worth a name; where it matters most it must explain a share of what they leave.
        """
        given = self.given(beside)
        gain = given.held_out_gain(h)
        cost = self.cost(h)
        if (gain / self.dispersion).sum() <= cost or beyond_chance and not self.stands_out(h, given):
            return False
        counts = self.dispersion[0] < 0.1 * _WITHOUT_WEIGHT
        by_joint = np.minimum(gain.sum(axis=0), given.largest_excess()) * counts
        beyond = by_joint - np.clip(by_joint, 0.0, self.formula_error(beside))
        beyond -= np.clip(beyond, 0.0, self.least)
        if not self.data.floor:  # squared errors are in no unit of noise
            beyond = beyond / self.dispersion[0]
        least = PARTIAL_SHARE if h.own_friction or not self.data.floor else SHARE
        if beyond.sum() <= cost or self._most_share(h, beside) < least:
            return False
        return self._makes_sense(h, given) and self._acts_everywhere(h, beside)

    def stands_out(self, h: Hypothesis, given: FittedSet) -> bool:
        """Return whether a hypothesis explains more of what others leave than it would of noise of the same spectrum:
        sum_j n_j ln(L_j / L_j') / r > 2 u ln H + k ln(sum_j n_j / r), r as `FittedSet.colours` tells, n_j independent
        rows; L without what noise makes of it, where that is known. Asked twice: of rows left out, by the colour of
        what others leave; and of fitted rows, less the parameters of the others, by the colour of what it leaves. Of
        few rows left out any fit leaves far more than noise; a true effect colours what is left without it. Without a
        noise floor the choice, 2 u ln H, is not asked: `Chance` holds the best of all hypotheses against noise.
        """
        choices = h.causes if self.data.floor else 0
        return self._beyond_chance(given, given.loss - given.held_out_gain(h), given.colours(h), choices, h.effect.size)

    def tells_apart(self, one: Sequence[Hypothesis], other: Sequence[Hypothesis]) -> bool:
        """Return whether a set explains more than another one does beyond chance, as `stands_out` asks of a cause."""
        given, with_it = self.given(other), self.given(one)
        return self._beyond_chance(given, with_it.loss, given.colours_beside(with_it), 1, 0)

    def _beyond_chance(
        self, given: FittedSet, with_it: Array, colours: tuple[Array, Array], causes: int, size: int
    ) -> bool:
        """Return whether squared errors [folds, n] tell further causes of so many parameters from chance, predicted and
        fitted.
        """
        (before, after), fitted = colours
        training = slice(0, self.data.training)
        loss, left_out, rows = (x[training].sum(axis=0) for x in (given.loss, with_it, self.data.dof))
        known = [j for j in range(self.data.n) if j not in self.unknown]
        free = np.maximum(rows - given.parameters_of(), 0.0)
        for without, left, count in ((loss, left_out, rows / before), (*fitted, free / after)):
            gain = float(count[known] @ np.log(self._excess(without) / self._excess(left))[known])
            if gain <= self._choices * causes + size * np.log(max(2.0, float(count[known].sum()))):
                return False
        return True

    def _excess(self, loss: Array) -> Array:
        """Return what a squared error [n] of the training folds holds beside noise where that is known, at least what
        noise may hide: one standard deviation of its own.
        """
        noise = self.data.noise * self.data.floor
        return np.asarray(np.maximum(loss - noise, 1e-12 * loss) + np.sqrt(2.0 * noise))

    def _makes_sense(self, h: Hypothesis, given: FittedSet) -> bool:
        """Return whether the parameters of a hypothesis beside a set can be those of one cause."""
        training = range(self.data.training)
        along = [(self.data.folds[f].motion, self.data.torques[f]) for f in training]
        c, made = given.coefficients(-1, h)
        model = given.whole.values - made.projected @ c
        beside = dict(zip(self.data.structure.names, map(float, model), strict=False))  # the set's own come after them
        return not h.effect.contradicts_itself(c, along, beside)

    def share(self, h: Hypothesis, beside: Sequence[Hypothesis]) -> float:
        """Return the share that a hypothesis explains of what others leave in excess of noise, on the joint where it
        predicts most of motion that was not fitted.
        """
        fall, left = self._fall_and_left(h, beside, resolved=False)
        formulas = float(self.formula_error(beside)[self._main(h, beside)])
        return fall / max(fall + left + formulas, 1.0)

    def _most_share(self, h: Hypothesis, beside: Sequence[Hypothesis]) -> float:
        """Return the same as large as it may be: less the standard deviation of noise, of all rows or of those that no
        unresolved motion at reversals spoils.
        """
        out = []
        for resolved in (False, True) if self.data.floor else (False,):
            fall, left = self._fall_and_left(h, beside, resolved)
            spread = np.sqrt(2.0 * self.data.noise[self._main(h, beside)])
            out.append(fall / max(fall + left - float(np.clip(left, 0.0, spread)), 1.0))
        return max(out)

    def _acts_everywhere(self, h: Hypothesis, beside: Sequence[Hypothesis]) -> bool:
        """Return whether a hypothesis explains half as much a row as of all rows in those that no unresolved motion at
        reversals spoils: what has no memory acts wherever a joint moves, while the torque of one that sticks turns
        round. Not asked of what has a memory, nor where noise is known, by which such rows are few.
        """
        if self.data.floor or h.effect.needs_time:
            return True
        joint, training = self._main(h, beside), range(self.data.training)
        fall, _ = self.given(beside).fall_where_resolved(h, joint)
        whole = float(self.given(beside).held_out_gain(h)[: len(training), joint].sum())
        kept = sum(int(self.data.kept(f, joint).sum()) for f in training)
        rows = sum(int(np.sum(self.data.folds[f].weight[:, joint] > 0.0)) for f in training)
        return fall >= SHARE * kept / max(rows, 1) * whole

    def _main(self, h: Hypothesis, beside: Sequence[Hypothesis]) -> int:
        """Return the joint where a hypothesis predicts most of motion that was not fitted, in units of its error."""
        gain = self.given(beside).held_out_gain(h)[: self.data.training].sum(axis=0)
        return max(h.joints, key=lambda j: float(gain[j] / self.dispersion[0, j]))

    def _fall_and_left(self, h: Hypothesis, beside: Sequence[Hypothesis], resolved: bool) -> tuple[float, float]:
        """Return the fall of the squared error there, and what is left in excess of noise and the others' formulas."""
        given, joint = self.given(beside), self._main(h, beside)
        if resolved:
            fall, before = given.fall_where_resolved(h, joint)
        else:
            training = slice(0, self.data.training)
            fall = float(given.held_out_gain(h)[training, joint].sum())
            before = float(given.loss[training, joint].sum() - self.data.noise[joint])
        return fall, before - fall - float(self.formula_error(beside)[joint])

    def is_open(self, h: Hypothesis, beside: Sequence[Hypothesis]) -> bool:
        """Return whether a hypothesis may stand beside a set; none may whose joint has an unknown cause."""
        where = {*(h.joints if len(h.joints) == 1 else ()), *(() if h.effect.whole else (h.effect.joint,))}
        if where & self.unknown or h.label in self.barred:
            return False
        return self.has_meaning((h, *beside), [h]) and not any(h.excludes(other) for other in beside)

    def has_meaning(self, selected: Sequence[Hypothesis], some: Sequence[Hypothesis] | None = None) -> bool:
        """Return whether a set, or the model, holds all effects after which some of it (None: all) come."""
        needed = {f"{h.effect.after}@{h.effect.place}" for h in (selected if some is None else some) if h.effect.after}
        return needed <= {*self.data.structure.labels, *(h.label for h in selected)} if needed else True

    def first_looks(self) -> Iterator[tuple[FittedSet, Sequence[int]]]:
        """Yield what the model leaves of all joints, then what the effect that explains most of each joint leaves of
        it: where effects that are dear to compute may show.
        """
        given = self.given(())
        yield given, range(self.data.n)
        best = self.best_values(given)
        for joint in range(self.data.n):
            mine = max((h for h in best if joint in h.at), key=given.gain, default=None)
            if mine is not None:
                yield self.given((mine,)), [joint]

    def best_values(self, given: FittedSet) -> list[Hypothesis]:
        """Return every hypothesis at the values of its grid that gain most by the score test, less 2 a parameter."""
        known = {label: settings for label, settings in self.data.hypotheses.items() if label not in self.barred}
        bounds = self._most_gains(given, [settings for settings in known.values() if len(settings) > 1])
        out = []
        for settings in known.values():
            if len(settings) == 1:
                out.append(settings[0])
                continue
            best, most = 0, -np.inf
            for k in sorted(range(len(settings)), key=lambda k: -bounds[id(settings[k])][0]):
                bound, exact = bounds[id(settings[k])]
                if bound < most - _ROUNDING * abs(most):
                    break
                gain = bound if exact else given.gain(settings[k]) - 2.0 * settings[k].effect.size
                if gain > most or (gain == most and k < best):
                    best, most = k, gain
            out.append(settings[best])
        return out

    def _most_gains(self, given: FittedSet, some: Sequence[Sequence[Hypothesis]]) -> dict[int, tuple[float, bool]]:
        """Return by id the most that hypotheses may gain, less 2 a parameter, and whether that is what they do gain.

        One column tells; of several on one joint the ranges are not looked at.
        """
        out, alike = {}, dict[tuple[int, int], list[Hypothesis]]()
        for h in (h for settings in some for h in settings):
            if len(h.at) == 1:
                alike.setdefault((h.joints[0], len(h.ranges)), []).append(h)
            else:
                out[id(h)] = given.gain(h) - 2.0 * h.effect.size, True
        for (joint, columns), mine in alike.items():
            at = np.array([h.at[joint] for h in mine])
            if columns == 1:
                c, right = (x[at[:, 0]] for x in given.single_gains(joint))
                low, high = np.array([h.ranges[0] for h in mine]).T
                gains = np.where((low <= c) & (c <= high), c * right, 0.0)
            else:
                gains = given.most_gains(joint, at)
            out |= {id(h): (float(g) - 2.0 * h.effect.size, columns == 1) for h, g in zip(mine, gains, strict=True)}
        return out

    def ranked(self, beside: Sequence[Hypothesis], refine: int = REFINED) -> Ranked:
        """Return what every hypothesis predicts beside a set beyond its cost, best first, the best ones refined.

        What gains less than its cost on the fitted data themselves gets no held-out look (score test).
        """
        given = self.given(beside)
        out = []
        for h in self.best_values(given):
            if self.is_open(h, beside) and self._score(given, h) >= self.cost(h):
                out.append((self._held_out(given, h) - self.cost(h), h))
        out.sort(key=lambda pair: -pair[0])
        if refine and out and out[0][0] > 0.0:
            near = [h for g, h in out[:refine] if g > 0.5 * out[0][0]]
            sharp = {h.label: self.refinement.of(given, h) for h in near}
            out = [
                (g, h)
                if sharp.get(h.label, h) is h
                else (self._held_out(given, sharp[h.label]) - self.cost(h), sharp[h.label])
                for g, h in out
            ]
            out.sort(key=lambda pair: -pair[0])
        return [(g, h) for g, h in out if g <= 0.0 or self._makes_sense(h, given)]

    def _score(self, given: FittedSet, h: Hypothesis) -> float:
        """Return what a hypothesis gains on the fitted data themselves. Where noise is not known, in units of what the
        fit leaves of these, the most of its joints: with few rows, motion that was not fitted is left several times it.
        """
        gain = given.gain(h)
        if not self.data.floor:
            gain *= max(1.0, float(np.max((self.dispersion[0] / given.fitted_dispersion)[list(h.joints)])))
        return gain

    def _held_out(self, given: FittedSet, *new: Hypothesis) -> float:
        return float((given.held_out_gain(*new) / self.dispersion).sum())

    def pairs(self, beside: Sequence[Hypothesis], joint: int, keep: int) -> list[tuple[float, Hypothesis, Hypothesis]]:
        """Return the pairs of hypotheses on one joint that predict most beyond their costs, best first.

        By the score test of two columns on the joint's projected inner products; the best get a held-out look.
        """
        given = self.given(beside)
        key = (tuple(sorted(id(h) for h in beside)), joint, self.dispersion.tobytes(), *sorted(self.barred))
        if key not in self._looked:
            self._looked[key] = self._pairs(given, joint)
        return self._looked[key][:keep]

    def _pairs(self, given: FittedSet, joint: int) -> list[tuple[float, Hypothesis, Hypothesis]]:
        square, right, size = given.pair_matrix(joint)
        live = [
            h
            for settings in self.data.hypotheses.values()
            for h in settings
            if h.joints == (joint,)
            and self.is_open(h, given.selected)
            and all(square[k, k] > HELD * size[k] for k in h.at[joint])
        ]
        scores = PairScores(square, right, size, joint, live)
        looked = []
        for a, b in scores.best(PAIRS):
            gain = self._held_out(given, a, b) - self.cost(a) - self.cost(b)
            looked.append((gain, a, b))
        return sorted(looked, key=lambda found: -found[0])

    def refined_pair(self, beside: Sequence[Hypothesis], a: Hypothesis, b: Hypothesis) -> tuple[Hypothesis, Hypothesis]:
        """Return a pair refined in each other's light."""
        for _ in range(2):
            a = self.refinement.of(self.given([*beside, b]), a)
            b = self.refinement.of(self.given([*beside, a]), b)
        return a, b

    def both_worthwhile(self, beside: Sequence[Hypothesis], a: Hypothesis, b: Hypothesis) -> bool:
        """Return whether each of two hypotheses is worthwhile beside the other."""
        return self.worthwhile(a, [*beside, b]) and self.worthwhile(b, [*beside, a])

    def run(self) -> Selected:
        """Return the set from which no move leads to a better one."""
        selected: Selected = ()
        while len(selected) < LARGEST_SET:
            self.weigh_by(selected)
            best = self.ranked(selected)[:_FIRST]
            options = [found for found in (self._single(selected, best), self._pair(selected, best)) if found]
            if not options and (across := self._pair_across(selected, best)):
                options = [across]
            if not options:
                break
            grown = self.settled(min(options, key=self.objective))
            if self.objective(grown) >= self.objective(selected) - 1.0 or names(grown) == names(selected):
                break
            selected = grown
        self.weigh_by(selected)
        return selected

    def _single(self, selected: Selected, best: Ranked) -> Selected | None:
        for gain, h in best:
            if gain > 0.0 and self.worthwhile(h, selected):
                return (*selected, h)
        return None

    def _pair(self, selected: Selected, best: Ranked) -> Selected | None:
        """Return the set with the best two further effects, each worthwhile beside the other."""
        out = []
        for a, b in self._promising_pairs(selected, best):
            a, b = self.refined_pair(selected, a, b)
            if self.both_worthwhile(selected, a, b):
                out.append((*selected, a, b))
        return min(out, key=self.objective, default=None)

    def _pair_across(self, selected: Selected, best: Ranked) -> Selected | None:
        """Return the set with the best two further effects of two joints, each worthwhile beside the other: gravity
        couples joints, so that an offset that is missing on one makes that of another differ from motion to motion.
        """
        out = []
        for gain, a in best:
            if gain > 0.0 and len(a.joints) == 1:
                for more, b in self.ranked([*selected, a])[:2]:
                    if more > 0.0 and a.joints[0] not in b.joints and self.both_worthwhile(selected, a, b):
                        out.append((*selected, a, b))
        return min(out, key=self.objective, default=None)

    def _promising_pairs(self, selected: Selected, best: Ranked) -> Iterator[tuple[Hypothesis, Hypothesis]]:
        """Yield pairs on one joint, and effects of several joints that are not worthwhile alone with what predicts best
        beside them.
        """
        given, total = self.given(selected), self.data.dof.sum(axis=0)
        for joint in range(self.data.n):
            if joint not in self.unknown and given.loss[:, joint].sum() >= total[joint] + self.least[joint]:
                for _, a, b in self.pairs(selected, joint, 2):
                    yield a, b
        for gain, a in best:
            if gain > 0.0 and len(a.joints) > 1 and not self.worthwhile(a, selected):
                for more, b in self.ranked([*selected, a])[:2]:
                    if more > 0.0:
                        yield a, b

    def settled(self, selected: Selected) -> Selected:
        """Return the set after drops, swaps, merges and other pairs, as long as one of them improves it."""
        for _ in range(6):
            changed = (
                self._dropped_or_swapped(selected) or self._merged(selected) or self._of_all(selected)
                or self._other_pair(selected)
            )  # fmt: skip
            if changed is None:
                break
            selected = changed
        return selected

    def _dropped_or_swapped(self, selected: Selected) -> Selected | None:
        for h in selected:
            rest = tuple(x for x in selected if x is not h)
            if not self.has_meaning(rest):
                continue
            if not self.worthwhile(h, rest):
                return rest
            again = self._better_values(rest, h)
            ranked = self.ranked(rest, refine=3)
            best = ranked[0][1] if ranked else h
            better = self.objective([*rest, best]) < self.objective([*rest, again]) - _CLEARLY
            if best.label != h.label and better and self.worthwhile(best, rest):
                return (*rest, best)
            if again is not h and self.objective([*rest, again]) < self.objective(selected) - 0.5:
                return (*rest, again)
        return None

    def _better_values(self, beside: Selected, h: Hypothesis) -> Hypothesis:
        """Return an effect at better values of its nonlinear parameters: near its own, or near the best of its grid."""
        given = self.given(beside)
        grid = self.data.hypotheses[h.label][: self.data.grid.get(h.label, 0)]
        near = [self.refinement.of(given, one) for one in (h, max(grid, key=given.gain, default=h))]
        return max(near, key=given.gain)

    def _merged(self, selected: Selected) -> Selected | None:
        """Return the set with a joint's several effects replaced by one that predicts as well (`as_good`)."""
        for joint in range(self.data.n):
            rest = tuple(h for h in selected if h.joints != (joint,))
            if len(selected) - len(rest) < 2:
                continue
            for _, h in self.ranked(rest)[:3]:
                if joint in h.at and self.as_good([*rest, h], selected, joint) and self.worthwhile(h, rest):
                    return (*rest, h)
        return None

    def _of_all(self, selected: Selected) -> Selected | None:
        """Return the set with effects of single joints replaced by that of the whole robot which excludes them."""
        for settings in self.data.hypotheses.values():
            first = settings[0]
            if not first.effect.whole or first.label in self.barred or any(h.label == first.label for h in selected):
                continue
            excluded = [h for h in selected if first.excludes(h)]
            if not excluded:
                continue
            rest = tuple(h for h in selected if h not in excluded)
            given = self.given(rest)
            best = max(settings, key=given.gain)
            whole = self.refinement.of(given, best)
            if self.objective([*rest, whole]) < self.objective(selected) - _CLEARLY and self.worthwhile(whole, rest):
                return (*rest, whole)
        return None

    def _other_pair(self, selected: Selected) -> Selected | None:
        """Return the set with one or two effects of a joint replaced by another pair."""
        for joint, replaced in self.replaceable(selected):
            rest = tuple(h for h in selected if h not in replaced)
            for _, a, b in self.pairs(rest, joint, 3):
                if {a.label, b.label} == {h.label for h in replaced}:
                    continue
                a, b = self.refined_pair(rest, a, b)
                better = self.objective([*rest, a, b]) < self.objective(selected) - _CLEARLY
                better = better and not (len(replaced) == 1 and self.as_good(selected, [*rest, a, b], joint))
                if better and self.both_worthwhile(rest, a, b):
                    return (*rest, a, b)
        return None

    def replaceable(self, selected: Selected) -> Iterator[tuple[int, Selected]]:
        """Yield the effects of a joint that a pair may replace: any one or two of at most three."""
        for joint in range(self.data.n):
            mine = [h for h in selected if h.joints == (joint,)]
            for count in (1, 2) if len(mine) <= _TOGETHER else ():
                for replaced in combinations(mine, count):
                    yield joint, replaced
