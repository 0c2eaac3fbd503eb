"""The base model and the processing of its recordings, chosen by what predicts motion that was left out.

Every candidate is fitted to all but one piece of the path and judged on that piece, in turn, by its squared error
against the same target: the measured torque of all rows up to the band that torque and model share. The score is the
sum over joints of the logarithm of the squared error. What is taken is told beside what is not, and by how much.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import reduce
from itertools import product
from operator import add
from typing import Any, NamedTuple

import numpy as np

from robot_ident.errors import InputError
from robot_ident.estimation.coherent_band import ThinRows, coherent_band, thin_rows
from robot_ident.estimation.held_out import Fitted, Grams, held_out
from robot_ident.estimation.prediction import prediction_bandwidth
from robot_ident.model.structure import Structure
from robot_ident.recording.measurement import Measurement, Processing
from robot_ident.recording.process import Opened
from robot_ident.recording.recording import Recording
from robot_ident.recording.torque_channel import chain_of
from robot_ident.robot.robot import Robot
from robot_ident.signals.motion import Array, Mask

DIFFERENTIATION = (0.5, 0.7, 1.0, 2.0)  # times the band
_LONGEST = 200_000  # samples of a recording that are looked at: columns of seven joints take a gigabyte
_SHOWN = (0.125, 0.25, 0.5, 1.0, 2.0, 4.0, 8.0)  # times the band: low passes of predictions, by quarters near the best
_KEPT = 4.0  # rows in a period of their low pass
_OWN = 1e-6  # of a column's square that no other column makes, below which the data can't tell it
_SPANS = 0.1  # of a column's size, that another column must make of it to be named
OFFSET, ROTOR, SCALE = "torque_offset", "rotor_inertia", "torque_scale"
PIECES = 8  # of the path, each left out in turn
_BETTER = 2.0  # standard errors by which torque scales have to predict better than none, one pass than averages
_MORE = 1.1  # times the error: averages beyond it are not taken, filters that were asked for are said to be worse
_SCALES_TOLD = 3.0  # from which on they count as measured: true motor torques got .87 to 1.37 below it
_USUAL = 0.7, 1.4  # what a scale lies between, unless a unit or a gear ratio is wrong


def _score_of(error: Array) -> float:
    """Return the sum over joints of ln of the squared error [n]."""
    return float(np.sum(np.log(np.maximum(error, 1e-300))))


@dataclass(frozen=True)
class Candidate:
    """One way to process and one set of columns, with its squared error [PIECES, n] on pieces left out and the torque's
    square there [n]; kept: which columns those are, fitted: to everything.
    """

    processing: Processing
    effects: tuple[str, ...]
    averaged: bool
    error: Array
    torque: Array
    kept: np.ndarray
    fitted: Fitted

    @property
    def score(self) -> float:
        """What candidates are compared by."""
        return _score_of(self.error.sum(axis=0))

    @property
    def scaled(self) -> bool:
        """Whether joints have torque scales that nobody asked for."""
        return any(label.startswith(SCALE) for label in self.effects)

    @property
    def relative(self) -> float:
        """Root of the squared error of all joints over that of the torque."""
        return float(np.sqrt(self.error.sum() / max(float(self.torque.sum()), 1e-300)))

    def to_dict(self) -> dict[str, Any]:
        """Return what it is, and the error that it leaves."""
        return {
            "averaged": self.averaged,
            "low_pass": self.processing.low_pass,
            "derivative_bandwidth": self.processing.derivative_bandwidth,
            "effects": list(self.effects),
            "error": self.relative,
        }

    def worse(self, best: Candidate) -> float:
        """Return by how many standard errors it predicts worse than another, over the pieces: of squared errors or of
        their logarithms, whichever says more. Where one piece is far worse than the others, it alone makes the spread.
        """
        mine, other = (np.maximum(one.error, 1e-300) for one in (self, best))
        difference = np.sum((mine - other) / other.sum(axis=0), axis=1)
        return max(_standard_errors(difference), _standard_errors(np.sum(np.log(mine / other), axis=1)))


@dataclass(frozen=True)
class Choice:
    """The candidate that was taken; band: Hz up to which it was judged, None where there was nothing to choose. free:
    the one that would have been taken, had no filter been asked for, where it predicts better.
    """

    processing: Processing
    taken: Candidate | None = None
    band: float | None = None
    candidates: tuple[Candidate, ...] = ()
    notes: tuple[str, ...] = ()
    free: Candidate | None = None

    @property
    def effects(self) -> tuple[str, ...]:
        """Offsets, rotor inertias and torque scales that belong to the base model."""
        return () if self.taken is None else self.taken.effects

    @property
    def scale_evidence(self) -> float:
        """Standard errors by which the same without torque scales predicts worse, 0 where there are none."""
        if self.taken is None or not self.taken.scaled:
            return 0.0
        free = [one for one in self.candidates if not one.scaled]
        return min(free, key=lambda one: one.score).worse(self.taken)

    @property
    def scale_spread(self) -> Array | None:
        """Standard errors [n] of torque scales over the pieces, None where there are none."""
        spread = None if self.taken is None else self.taken.fitted.scale_spread
        return spread if spread is not None and np.any(spread > 0.0) else None

    def to_dict(self) -> dict[str, Any] | None:
        """Return what `identify --json` prints of it: what was taken, what was compared, how much worse it was."""
        taken = self.taken
        if taken is None or self.band is None:
            return None
        best = min(self.candidates, key=lambda one: one.score)
        return {
            "band_hz": self.band,
            "pieces": PIECES,
            "effects": list(self.effects),
            "error": taken.relative,
            "standard_errors_worse_than_best": taken.worse(best),
            "scale_evidence": self.scale_evidence,
            "scale_spread": None if self.scale_spread is None else self.scale_spread.tolist(),
            "compared": [
                {**one.to_dict(), "score": one.score - best.score}
                for one in sorted(self.candidates, key=lambda one: one.score)
            ],
            "without_asked_filters": None if self.free is None else self.free.to_dict(),
        }


def choose_base(
    recordings: Sequence[Recording], robot: Robot, effects: Sequence[str] = (), processing: Processing | None = None
) -> Choice:
    """Return how recordings are best processed and which offsets, rotor inertias and torque scales belong to the
    base model.

    What `processing` states is kept, and so is all where the robot's base is declared. Raises InputError on recordings
    that can't be used.
    """
    asked = processing or Processing()
    if robot.base == "declared":
        return Choice(asked)
    given = Structure.build(robot, effects)
    plain, _ = given.with_only(lambda e: not (e.uses_torque or e.inner or e.needs_time))
    known = [one for one in recordings if one.conditions.payload is not None or not one.conditions.estimated]
    looked_at = [_looked_at(recording, robot, asked) for recording in known or recordings]
    parts, default = [part for part, _ in looked_at], [measured for _, measured in looked_at]
    most = min(
        chain_of(robot, asked.anti_alias, part.given.source, 1.0 / one.dt, 0.0).bandwidth
        for part, one in zip(parts, default, strict=True)
    )
    full = _with_candidates(plain)
    band = coherent_band(parts, full, asked, most)
    ways = _ways(parts, default, full, asked, band)
    labels = [effect.label for effect in full.effects[len(plain.effects) :]]
    told, open_ = _identifiable(ways[0].judged[0], full, labels)
    # a stated payload's torque is taken off in Nm, before any scale
    loaded = any(part.given.conditions.payload is not None for part in parts)
    kept = given.joints_scaled
    first = next(joint for joint in robot.joints if joint not in kept)
    every = kept if robot.ampere_joints or loaded else tuple(joint for joint in robot.joints if joint != first)
    candidates = [made for way in ways for made in _judged(way, full, labels, told, (every, kept))]
    taken = _best_of(candidates)
    used = taken.processing
    if asked.low_pass is None:
        shown = [
            _shown([thin_rows(part, asked, band, wider=wider, shown=True) for part in parts], full, taken, band)
            for wider in _differentiation(asked, band)
        ]
        widest = min(shown, key=lambda one: one.score).wide
        if asked.derivative_bandwidth is None:
            used = replace(used, band_derivative=widest)
        values = np.zeros(len(full.names))
        values[taken.kept] = taken.fitted.theta
        wide = [prediction_bandwidth(part.given, full, values, used) or widest for part in parts]
        predicted = [
            thin_rows(part, asked, band, wider=x / band, shown=True) for part, x in zip(parts, wide, strict=True)
        ]
        used = replace(used, band=_shown(predicted, full, taken, band).low_pass)
    notes = [_note_of(taken, candidates, band)]
    if len(parts) < len(recordings):
        by = ", ".join(part.given.source for part in parts)
        notes.append(f"that error is of {by} alone: the payload of the others is open; see their residuals")
    if open_:
        alike = "; ".join(f"{', '.join(labels)} from {of}" for of, labels in open_.items())
        notes.append(f"left out of the base model, since these data can't tell them apart: {alike}")
    free = None
    if asked.low_pass is not None or asked.derivative_bandwidth is not None:
        own = replace(asked, low_pass=None, derivative_bandwidth=None)
        free = choose_base(recordings, robot, effects, own).taken
    free = free if free and taken.worse(free) >= _BETTER and taken.relative > _MORE * free.relative else None
    return Choice(used, taken, band, tuple(candidates), tuple(notes), free)


def _looked_at(recording: Recording, robot: Robot, asked: Processing) -> tuple[Opened, Measurement]:
    """Return as much of a recording as a choice needs, all of it where its beginning can't be used, and its rows."""
    part = recording[:_LONGEST] if recording.samples > _LONGEST else recording
    try:
        opened = Opened.of(part, robot)
        return opened, opened.processed(asked)
    except InputError:
        if part is recording:
            raise
        opened = Opened.of(recording, robot)
        return opened, opened.processed(asked)


@dataclass(frozen=True)
class _Way:
    """One way to process: sums over the rows that are fitted, of which a share is independent, and over those that
    judge, in one or several differentiations.
    """

    processing: Processing
    averaged: bool
    fitted: Grams
    judged: tuple[Grams, ...]
    independent: float = 1.0


def _with_candidates(structure: Structure) -> Structure:
    """Return a structure with an offset and a rotor inertia on every joint where neither is in it."""
    for label in (f"{name}@{joint}" for name in (OFFSET, ROTOR) for joint in structure.robot.joints):
        try:
            structure = structure.with_further([label])
        except InputError:  # it is in the model, merges with a link's inertia, or no sensor of this joint sees it
            continue
    return structure


def _ways(
    parts: Sequence[Opened], default: Sequence[Measurement], structure: Structure, asked: Processing, band: float
) -> list[_Way]:
    """Return the ways to process that are compared: one pass of several bandwidths, and averages where all repeats."""
    passes = [[thin_rows(part, asked, band, wider=wider) for part in parts] for wider in _differentiation(asked, band)]
    # the same rows for every candidate
    used = [np.logical_and.reduce([way[k].used for way in passes]) for k in range(len(parts))]
    places = [_pieces(one, rows, here) for one, rows, here in zip(default, passes[0], used, strict=True)]
    asks_periods = asked.periodic is True
    out: list[_Way] = []
    judges: list[Grams] = []
    for way in passes:
        columns = [structure.columns(rows.motion) for rows in way]

        def sums(cutoff: float, way: list[ThinRows] = way, columns: list[Array] = columns) -> Grams:
            parts = (
                Grams.of(rows.passed(x, cutoff), rows.torque(cutoff), piece, here, PIECES)
                for rows, x, piece, here in zip(way, columns, places, used, strict=True)
            )
            return reduce(add, parts)

        judged = sums(band)
        judges.append(judged)
        # four rows in a period of their low pass say all that it leaves
        rate = min(1.0 / rows.measured.dt for rows in way)
        cutoff = band if asked.low_pass is None else asked.low_pass
        every = asked.decimate if asked.decimate != 1 else max(1, int(rate / (_KEPT * cutoff)))
        one_pass = replace(asked, periodic=False, low_pass=cutoff, decimate=every)
        processing = replace(one_pass, derivative_bandwidth=way[0].wide)
        fitted = judged if cutoff == band else sums(cutoff)
        share = min(1.0, 2.0 * cutoff * way[0].dt)
        out.append(_Way(asked if asks_periods else processing, False, fitted, (judged,), share))
    if all(one.base_frequency is not None for one in default):
        averaged = _averaged(default, tuple(judges), structure, asked)
        # what is longer than a choice looks at is averaged: as one pass, its rows would be more than they tell
        only = asks_periods or any(part.given.samples >= _LONGEST for part in parts)
        return [averaged] if only else [*out, averaged]
    return out[:1] if asks_periods else out


def _differentiation(asked: Processing, band: float) -> list[float]:
    """Return the bandwidths, times the band, to which positions may be differentiated."""
    if asked.derivative_bandwidth is not None:
        return [asked.derivative_bandwidth / band]
    if asked.low_pass is not None:
        return [4.0 * asked.low_pass / band]
    return list(DIFFERENTIATION)


def _pieces(default: Measurement, rows: ThinRows, used: Mask) -> np.ndarray:
    """Return the piece of the path of each row [N], -1: none; by place in the averaged period or cycle, or by time."""
    t = np.arange(len(used)) * rows.dt
    inside, counted = np.full(len(t), -1), np.flatnonzero(used.any(axis=1))
    if default.cycles is not None:
        first = next(k for k in range(default.cycles.count) if k + 1 not in default.left_out)
        start = default.cycles.begins[first, 0] - default.motion.began[0]
        phase = default.cycles.phase(t + start) / default.cycles.length
        found = np.isfinite(phase)
        inside[found] = np.minimum(phase[found] * PIECES, PIECES - 1)
    elif default.base_frequency is not None:
        for began in default.motion.began:
            here = (t >= began) & (t < began + 1.0 / default.base_frequency)
            inside[here] = np.minimum((t[here] - began) * default.base_frequency * PIECES, PIECES - 1)
    elif len(counted):
        first, last = counted[0], counted[-1] + 1
        inside[first:last] = np.arange(last - first) * PIECES // (last - first)
    return inside


def _averaged(
    default: Sequence[Measurement], judges: tuple[Grams, ...], structure: Structure, asked: Processing
) -> _Way:
    """Return averages of periods: fitted to the mean period, judged on all rows of one pass, in its differentiations.

    Judged on their own columns, averages would predict well for having less noise in them, which another path's lack.
    """
    whole = []
    for one in default:
        columns = structure.columns(one.motion)
        count = len(columns)
        piece = (np.arange(count) * PIECES // count)[one.rows]
        assert one.base_frequency is not None
        counted = one.used[one.rows]
        whole.append(Grams.of(one.passed(columns), one.passed(one.torque), piece, counted, PIECES))
    return _Way(asked, True, reduce(add, whole), judges)


class _Shown(NamedTuple):
    """How predictions are processed, low pass and differentiation [Hz]; score: sum over joints of ln of the squared
    error that they leave of the record.
    """

    low_pass: float
    wide: float
    score: float


def _shown(rows: Sequence[ThinRows], structure: Structure, taken: Candidate, band: float) -> _Shown:
    """Return the low pass that brings the model's torque nearest to the record, whatever that passed itself."""
    whole = taken.fitted.by_joint(taken.kept < len(structure.base.columns))
    torques = [np.einsum("kjp,jp->kj", structure.columns(one.motion)[:, :, taken.kept], whole) for one in rows]
    records = [one.torque(None) for one in rows]

    def score(cutoff: float) -> float:
        left = sum(
            np.sum(((record - one.passed(torque, cutoff)) * one.used) ** 2, axis=0)
            for one, torque, record in zip(rows, torques, records, strict=True)
        )
        return _score_of(left)

    most = min(0.4 / one.measured.dt for one in rows)

    def best(shares: Iterable[float]) -> _Shown:
        grid = sorted({min(share * band, most) for share in shares})
        return min((_Shown(cutoff, rows[0].wide, score(cutoff)) for cutoff in grid), key=lambda one: one.score)

    near = best(_SHOWN).low_pass / band
    return best(near * 2.0 ** (k / 4.0) for k in range(-3, 4))


def _identifiable(sums: Grams, structure: Structure, labels: Sequence[str]) -> tuple[np.ndarray, dict[str, list[str]]]:
    """Return which columns [P] the data can tell, all but candidates that the others span, and the labels of those by
    what spans them, in words.
    """
    weight = 1.0 / np.maximum(sums.yy.sum(axis=0), 1e-300)
    square = np.tensordot(weight, sums.xx.sum(axis=0), 1)
    size = np.sqrt(np.maximum(np.diag(square), 1e-300))
    square = square / size / size[:, None]
    kept = np.ones(len(structure.names), dtype=bool)
    open_: dict[str, list[str]] = {}
    for label in reversed(labels):
        place = structure.names.index(label)
        others = np.flatnonzero(kept & (np.arange(len(kept)) != place))
        among = square[np.ix_(others, others)] + _OWN**2 * np.eye(len(others))
        made = np.linalg.solve(among, square[others, place])
        own = square[place, place] - square[place, others] @ made
        if own < _OWN:
            kept[place] = False
            open_.setdefault(_spanning(label, structure, others[np.abs(made) > _SPANS]), []).insert(0, label)
    return kept, dict(reversed(open_.items()))


def _spanning(label: str, structure: Structure, columns: np.ndarray) -> str:
    """Return what makes the column of a candidate, in words: an offset is alike to weight, a rotor to a link."""
    rigid = len(structure.base.columns)
    others = [structure.names[column] for column in columns if column >= rigid]
    if others and all(column >= rigid for column in columns):
        return " and ".join(others)
    return "gravity" if label.startswith(OFFSET) else "the links' inertia"


def _judged(
    way: _Way,
    structure: Structure,
    labels: Sequence[str],
    told: np.ndarray,
    scales: tuple[Sequence[str], Sequence[str]],
) -> list[Candidate]:
    """Return a candidate for every set: offsets and rotor inertias in or out, torque scales on one set of joints or
    another, of which the last one is in the model in any case.
    """
    names = structure.names
    out = []
    sets: list[tuple[str, ...]] = []
    for offset, rotor, scaled in product((True, False), (True, False), scales):
        wanted = [name for name, taken in ((OFFSET, offset), (ROTOR, rotor)) if taken]
        chosen = tuple(x for x in labels if x.partition("@")[0] in wanted and told[names.index(x)])
        both = (*chosen, *(f"{SCALE}@{joint}" for joint in scaled if joint not in scales[-1]))
        if both in sets:
            continue
        sets.append(both)
        kept = np.array([k for k, name in enumerate(names) if told[k] and (name not in labels or name in chosen)])
        rigid = kept < len(structure.base.columns)
        free = np.array([joint in scaled for joint in structure.robot.joints])
        judged = [sums.kept(kept) for sums in way.judged]
        errors, fitted = held_out(way.fitted.kept(kept), judged, way.independent, rigid, free)
        torque = way.judged[0].yy.sum(axis=0)  # the same in every differentiation
        made = [Candidate(way.processing, both, way.averaged, error, torque, kept, fitted) for error in errors]
        out.append(min(made, key=lambda one: one.score))
    return out


def _best_of(candidates: Sequence[Candidate]) -> Candidate:
    """Return that of the least score; torque scales only where they surely serve, averages, which measure their noise,
    where they predict as well or nearly so.
    """
    free = [one for one in candidates if not one.scaled]
    best, first = min(free, key=lambda one: one.score), min(candidates, key=lambda one: one.score)
    if first.scaled and best.worse(first) >= _BETTER:
        best, free = first, [one for one in candidates if one.scaled]
    nearly = best.score + 2.0 * np.log(_MORE) * len(best.torque)
    alike = [one for one in free if one.averaged and (one.score <= nearly or one.worse(best) <= _BETTER)]
    return min(alike or [best], key=lambda one: one.score)


def _note_of(taken: Candidate, candidates: Sequence[Candidate], band: float) -> str:
    """Return what was taken and by how much others are worse, in a line."""
    kinds = {OFFSET: "offsets", ROTOR: "rotor inertias", SCALE: "torque scales"}
    has = [word for name, word in kinds.items() if any(x.startswith(name) for x in taken.effects)]
    way = _in_words(taken)
    rivals = {
        "periods averaged" if not taken.averaged else "as one pass": [
            one for one in candidates if one.averaged is not taken.averaged
        ],
        "without torque scales": [one for one in candidates if not one.scaled and taken.scaled],
        "links and friction alone": [one for one in candidates if not one.effects and taken.effects],
    }
    beside = [
        f"{word} {100 * best.relative:.3g} % ({best.worse(taken):+.1f} standard errors)"
        for word, others in rivals.items()
        if others
        for best in [min(others, key=lambda one: one.score)]
    ]
    told = f" ({'; '.join(beside)})" if beside else ""
    return (
        f"base model by prediction of pieces of the path left out, up to {band:.3g} Hz: {way},"
        f" {' and '.join(has) if has else 'no offsets, no rotor inertias'}; error {100 * taken.relative:.3g} %{told}"
    )


def torque_scale_notes(choice: Choice, scales: Mapping[str, tuple[float, float]]) -> list[str]:
    """Return what torque scales by joint, each with its sigma, mean: measured, or no more than a help to prediction."""
    if not scales:
        return []
    told = ", ".join(f"{joint} {value:.3g} ± {std:.1g}" for joint, (value, std) in scales.items())
    known = choice.scale_evidence >= _SCALES_TOLD
    word = "torque scales beside the first joint's" if known else "torque scales that serve prediction and may be none"
    judged = f"{choice.scale_evidence:.1f} standard errors over the pieces, {_SCALES_TOLD:g} count as measured"
    if choice.taken is None or not choice.taken.scaled:
        word, judged = "torque scales", "asked for: not judged by prediction"
    lines = [
        f"{word}: {told} ({judged}); what an effort is reported in, or what the links' model lacks; no drive's gain as"
        " long as no known payload says the same"
    ]
    far = [joint for joint, (value, _) in scales.items() if not _USUAL[0] <= value <= _USUAL[1]]
    if far:
        lines.append(
            f"the torque scale of {', '.join(far)} lies beyond {_USUAL[0]:g} to {_USUAL[1]:g}: check the unit of the"
            " effort, the gear ratio and the URDF there before anything else"
        )
    return lines


def _standard_errors(differences: Array) -> float:
    spread = float(np.std(differences, ddof=1) * np.sqrt(len(differences)))
    return float(differences.sum() / spread) if spread > 0.0 else 0.0


def _in_words(taken: Candidate) -> str:
    low_pass = taken.processing.low_pass
    if low_pass is None:
        return "periods averaged" if taken.averaged else "processed as asked"
    if taken.averaged:
        return f"periods averaged and low-passed at {low_pass:.3g} Hz"
    wide = taken.processing.derivative_bandwidth or 4.0 * low_pass
    return f"one pass, rows low-passed at {low_pass:.3g} Hz, positions differentiated to {wide:.3g} Hz"
