"""Whether noise explains as much: the best of all effects of a joint on noise of the spectrum of what the others leave.

What the set without an effect leaves of the recordings is turned into noise of the same spectra and cross spectra: each
line times a complex normal number (the wild bootstrap of Kirch and Politis 2011). It holds the lines of the effect, for
what is asked is whether something else of these lines could look like it. The fit has taken a part of it: that is put
back in the ratio in which the fit takes of such noise. Base and the other effects are fitted to every noise, and the
best of all hypotheses that touch no other joints is found beside them, by g n / L: the fall g of the squared error over
what is left L of the joints that it touches, n independent rows. The share of noises whose best explains as much as the
effect does of the recordings (the largest of all statistics, Westfall and Young 1993), times the number of places where
such joints are (Bonferroni), is the chance that it is noise.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence

import numpy as np

from robot_ident.diagnosis.selection.constants import CHANCE, RESAMPLES
from robot_ident.diagnosis.selection.fitted_set import FittedSet
from robot_ident.diagnosis.selection.hypotheses import Hypothesis
from robot_ident.diagnosis.selection.search import Search, Selected
from robot_ident.regression.gram import HELD
from robot_ident.regression.normal_equations import pseudo_inverse
from robot_ident.signals.motion import Array

_NOTHING = 1e-300  # left of a joint that stands still
_Series = list[Array]
"""Of each recording, by joint [..., N, n]."""


class Chance:
    """The chance that noise explains as much as an effect of a set does, by the search that found it."""

    def __init__(self, search: Search, selected: Selected) -> None:
        """Take a set and the rows of the training folds."""
        self.search, self.data, self.selected = search, search.data, selected
        folds = search.data.folds
        self.counted = [rows > 0.0 for rows in self._whole(lambda j, f: folds[f].weight[folds[f].rows, j])]

    def of(self, h: Hypothesis) -> float:
        """Return the chance that noise explains as much as an effect of the set beside the others, by any effect of the
        joints that it touches, at one place of the robot or another; beyond 1 the number of places where it does.
        """
        others = tuple(x for x in self.selected if x is not h)
        given, data = self.search.given(others), self.data
        every = (x for settings in data.hypotheses.values() for x in settings if set(x.joints) <= set(h.joints))
        rivals = [x for x in every if self.search.is_open(x, others)]
        found = [rows[None] for rows in self._whole(lambda j, f: data.y[j][f])]
        own = self._explained(given, found, [h])[0, 0]
        places = data.n / len(h.joints)
        rounds, as_much, drawn = int(np.ceil(places)), 0, 0
        for noises in self._noises_of(given, rounds):
            best = self._explained(given, noises, rivals).max(axis=1)
            as_much += int(np.sum(best >= own))
            drawn += len(best)
            if places * as_much > CHANCE * rounds * RESAMPLES:
                break
        return places * (1 + as_much) / (1 + drawn)

    def _noises_of(self, given: FittedSet, rounds: int) -> Iterator[_Series]:
        """Yield noises [K, N, n] of the spectra of what a set leaves, with what its fit took of them put back."""
        left, rng = self._whole(given.residual), np.random.default_rng(0)
        lines = int(np.ceil(given.parameters_of().max()))  # twice as many as the fit can take wholly
        refitted = self._left(given, self._noises(left, [1.0] * len(left), rng), range(self.data.n))
        power = zip(map(_power, left), map(_power, refitted), strict=True)
        taken = [
            np.sqrt(_smooth(own, lines) / np.maximum(_smooth(of.mean(axis=0), lines), _NOTHING)) for own, of in power
        ]
        for _ in range(rounds):
            yield self._noises(left, taken, rng)

    def _whole(self, rows: Callable[[int, int], Array]) -> _Series:
        """Return the rows of every recording, of which a fold holds its part; rows: of a joint in a fold [N]."""
        joints, parts = range(self.data.n), self.data.of_measurement
        return [np.stack([np.concatenate([rows(j, f) for f in folds]) for j in joints], axis=-1) for folds in parts]

    def _noises(self, left: _Series, factors: Sequence[Array | float], rng: np.random.Generator) -> _Series:
        """Return noises [K, N, n] of the spectra of what is left, times a factor by line, where rows count."""
        triples = zip(left, factors, self.counted, strict=True)
        return [_of_spectrum(one, factor, rng) * counted for one, factor, counted in triples]

    def _left(self, given: FittedSet, rows: _Series, joints: Sequence[int]) -> _Series:
        """Return what a set, fitted to rows [K, N, n], leaves of some joints of them."""
        right, columns = np.zeros((len(rows[0]), given.q)), []
        for folds, one in zip(self.data.of_measurement, rows, strict=True):
            columns.append([np.concatenate([given.columns(j, f) for f in folds]) for j in range(self.data.n)])
            for j, own in enumerate(columns[-1]):
                right += one[:, :, j] @ own / given.dispersion[0, j]
        values = right @ given.whole.inverse
        taken = [np.stack([values @ of[j].T for j in joints], axis=-1) for of in columns]
        return [one[:, :, joints] - part for one, part in zip(rows, taken, strict=True)]

    def _explained(self, given: FittedSet, rows: _Series, hypotheses: Sequence[Hypothesis]) -> Array:
        """Return g n / L [K, H] of hypotheses beside a set in rows [K, N, n]."""
        data, count = self.data, len(rows[0])
        left, touched = np.zeros((count, data.n)), sorted({j for h in hypotheses for j in h.joints})
        right = {j: np.zeros((count, data.pools[j].count)) for j in touched}
        for folds, rest in zip(data.of_measurement, self._left(given, rows, touched), strict=True):
            left[:, touched] += np.sum(rest**2, axis=1) / given.dispersion[0, touched]
            for place, j in enumerate(touched):
                own = np.concatenate([data.pools[j].rows(f, slice(None)) for f in folds])
                right[j] += rest[:, :, place] @ own / given.dispersion[0, j]
        independent = data.dof[: data.training].sum(axis=0)
        out = np.zeros((count, len(hypotheses)))
        for k, h in enumerate(hypotheses):
            made, joints = given.addition(-1, h), list(h.joints)
            along = np.sum([right[j][:, at] for j, at in h.at.items()], axis=0)
            free = np.diag(made.square) > HELD * made.size  # others are rounding: the set makes them already
            if len(h.ranges) > 1:
                inverse = pseudo_inverse(made.square[np.ix_(free, free)]) if free.any() else np.zeros((0, 0))
                gain = np.einsum("kp,pq,kq->k", along[:, free], inverse, along[:, free])
            elif free[0]:
                c = np.clip(along[:, 0] / made.square[0, 0], *h.ranges[0])
                gain = c * (2.0 * along[:, 0] - c * made.square[0, 0])
            else:
                continue
            out[:, k] = gain * independent[joints].sum() / np.maximum(left[:, joints].sum(axis=1), _NOTHING)
        return out


def _of_spectrum(rows: Array, factor: Array | float, rng: np.random.Generator) -> Array:
    """Return normal noises [K, N, n] with the spectra and cross spectra of rows [N, n], a factor by line and joint."""
    lines = np.fft.rfft(rows - rows.mean(axis=0), axis=0) * factor
    size, turn = rng.normal(size=(2, RESAMPLES, len(lines), 1))
    return np.asarray(np.fft.irfft((size + 1j * turn) * lines, len(rows), axis=1))


def _power(rows: Array) -> Array:
    return np.asarray(np.abs(np.fft.rfft(rows, axis=-2)) ** 2)


def _smooth(power: Array, lines: int) -> Array:
    """Return power [L, n] averaged over so many neighbouring lines."""
    from scipy.ndimage import uniform_filter1d

    return np.asarray(uniform_filter1d(power, lines, axis=0, mode="reflect"))
