"""The base model and the processing of its recordings, chosen by what predicts motion that was left out.

Every candidate is fitted to all but one piece of the path and judged on that piece, in turn, by its squared error
against the same target: the measured torque of all rows up to the band that torque and model share. The score is the
sum over joints of the logarithm of the squared error.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from itertools import product

import numpy as np

from robot_ident.errors import InputError
from robot_ident.estimation.base_choice import OFFSET, PIECES, ROTOR, SCALE, Candidate, Choice, best_of, note_of
from robot_ident.estimation.coherent_band import coherent_band
from robot_ident.estimation.differentiation import prediction_bandwidth
from robot_ident.estimation.held_out import Grams, held_out, total
from robot_ident.estimation.thin_rows import ThinRows, thin_rows
from robot_ident.model.structure import Structure
from robot_ident.recording.measurement import Measurement, Processing
from robot_ident.recording.process import process
from robot_ident.recording.recording import Recording
from robot_ident.recording.torque_channel import chain_of
from robot_ident.robot.robot import Robot
from robot_ident.signals.filters import PeriodicLowPass
from robot_ident.signals.motion import Array, Mask

DIFFERENTIATION = (0.5, 0.7, 1.0, 2.0)  # times the band
ROWS = (0.5, 1.0)  # times the band: the low pass of the rows that are fitted
_LONGEST = 200_000  # samples of a recording that are looked at: columns of seven joints take a gigabyte
_SHOWN = (1.0, 2.0, 4.0, 8.0)  # times the band: the low pass of predictions
_KEPT = 4.0  # rows in a period of their low pass
_OWN = 1e-6  # of a column's square that no other column makes, below which the data can't tell it


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
    plain, _ = Structure.build(robot, effects).with_only(lambda e: not (e.uses_torque or e.inner or e.needs_time))
    known = [one for one in recordings if one.conditions.payload is not None or not one.conditions.estimated]
    looked_at = [_looked_at(recording, robot, asked) for recording in known or recordings]
    parts, default = [part for part, _ in looked_at], [measured for _, measured in looked_at]
    most = min(
        chain_of(robot, asked.anti_alias, part.source, 1.0 / one.dt, 0.0).bandwidth
        for part, one in zip(parts, default, strict=True)
    )
    full = _with_candidates(plain)
    band = coherent_band(parts, full, asked, most)
    ways = _ways(parts, default, full, asked, band)
    labels = [effect.label for effect in full.effects[len(plain.effects) :]]
    told, open_ = _identifiable(ways[0].judged[0], full, labels)
    # a stated payload's torque is taken off in Nm, before any scale
    loaded = any(part.conditions.payload is not None for part in parts)
    scaled = () if robot.ampere_joints or loaded else robot.joints[1:]
    candidates = [made for way in ways for made in _judged(way, full, labels, told, scaled)]
    taken = best_of(candidates)
    used = taken.processing
    if asked.low_pass is None:
        shown = [
            _shown([thin_rows(part, robot, asked, band, wider=wider) for part in parts], full, taken, band)
            for wider in _differentiation(asked, band)
        ]
        own = [one for one in shown if one.wide == used.derivative_bandwidth]
        # another differentiation than that of the fit, where no joint pays for it
        free = [one for one in shown if not own or np.all(one.error <= own[0].error)]
        widest = min(free, key=lambda one: one.score).wide
        if asked.derivative_bandwidth is None:
            used = replace(used, band_derivative=widest)
        values = np.zeros(len(full.names))
        values[taken.kept] = taken.fitted.theta
        wide = [prediction_bandwidth(part, full, values, used) or widest for part in parts]
        predicted = [thin_rows(part, robot, asked, band, wider=x / band) for part, x in zip(parts, wide, strict=True)]
        used = replace(used, band=_shown(predicted, full, taken, band).low_pass)
    notes = [note_of(taken, candidates, band)]
    if open_:
        notes.append(f"left out of the base model, since these data can't tell them: {', '.join(open_)}")
    return Choice(used, taken, band, tuple(candidates), tuple(notes))


def _looked_at(recording: Recording, robot: Robot, asked: Processing) -> tuple[Recording, Measurement]:
    """Return as much of a recording as a choice needs, and what is made of it as asked; all of it where its beginning
    can't be used: too short for two periods, at rest.
    """
    part = recording[:_LONGEST] if recording.samples > _LONGEST else recording
    try:
        return part, process(part, robot, asked)
    except InputError:
        if part is recording:
            raise
        return recording, process(recording, robot, asked)


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
    parts: Sequence[Recording], default: Sequence[Measurement], structure: Structure, asked: Processing, band: float
) -> list[_Way]:
    """Return the ways to process that are compared: one pass of several bandwidths, and averages where all repeats."""
    robot = structure.robot
    passes = [
        [thin_rows(part, robot, asked, band, wider=wider) for part in parts] for wider in _differentiation(asked, band)
    ]
    # the same rows for every candidate
    used = [np.logical_and.reduce([way[k].used for way in passes]) for k in range(len(parts))]
    places = [_Places.of(one, rows, here) for one, rows, here in zip(default, passes[0], used, strict=True)]
    asks_periods = asked.periodic is True
    out: list[_Way] = []
    judges: list[Grams] = []
    for way in passes:
        columns = [rows.columns(structure) for rows in way]

        def sums(cutoff: float, way: list[ThinRows] = way, columns: list[Array] = columns) -> Grams:
            return total(
                Grams.of(rows.passed(x, cutoff), rows.torque(cutoff), place.piece, here, PIECES)
                for rows, x, place, here in zip(way, columns, places, used, strict=True)
            )

        judged = sums(band)
        judges.append(judged)
        wide = way[0].wide
        for cutoff in _row_bands(asked, band):
            processing = replace(
                asked,
                periodic=False,
                low_pass=cutoff,
                derivative_bandwidth=wide,
                decimate=_every(asked, way, cutoff),
            )
            fitted = judged if cutoff == band else sums(cutoff)
            share = min(1.0, 2.0 * cutoff * way[0].dt)
            out.append(_Way(asked if asks_periods else processing, False, fitted, (judged,), share))
    if all(place.repeats for place in places):
        averaged = _averaged(default, tuple(judges), structure, asked, band)
        # what is longer than a choice looks at is averaged: as one pass, its rows would be more than they tell
        only = asks_periods or any(part.samples >= _LONGEST for part in parts)
        return averaged[:1] if only else [*out, *averaged]
    return out[:1] if asks_periods else out


def _differentiation(asked: Processing, band: float) -> list[float]:
    """Return the bandwidths, times the band, to which positions may be differentiated."""
    if asked.derivative_bandwidth is not None:
        return [asked.derivative_bandwidth / band]
    if asked.low_pass is not None:
        return [4.0 * asked.low_pass / band]
    return list(DIFFERENTIATION)


def _row_bands(asked: Processing, band: float) -> list[float]:
    """Return the low passes [Hz] that fitted rows may take."""
    return [asked.low_pass] if asked.low_pass is not None else [share * band for share in reversed(ROWS)]


def _every(asked: Processing, rows: Sequence[ThinRows], cutoff: float) -> int:
    """Return every how many samples a row is kept: four in a period of their low pass [Hz] say all that it leaves."""
    rate = min(1.0 / one.sample_dt for one in rows)
    return asked.decimate if asked.decimate != 1 else max(1, int(rate / (_KEPT * cutoff)))


@dataclass(frozen=True)
class _Places:
    """The piece of the path that each row [N] belongs to, -1: none, and whether the path repeats."""

    piece: np.ndarray
    repeats: bool

    @classmethod
    def of(cls, default: Measurement, rows: ThinRows, used: Mask) -> _Places:
        """Divide what is used of a recording: by the place in the period or cycle that is averaged, else by time."""
        t = np.arange(len(used)) * rows.dt
        inside = np.full(len(t), -1)
        if default.cycles is not None:
            first = next(k for k in range(default.cycles.count) if k + 1 not in default.left_out)
            start = default.cycles.begins[first, 0] - default.motion.began[0]
            phase = default.cycles.phase(t + start) / default.cycles.length
            found = np.isfinite(phase)
            inside[found] = np.minimum(phase[found] * PIECES, PIECES - 1)
            return cls(inside, True)
        if default.base_frequency is not None:
            for began in default.motion.began:
                here = (t >= began) & (t < began + 1.0 / default.base_frequency)
                inside[here] = np.minimum((t[here] - began) * default.base_frequency * PIECES, PIECES - 1)
            return cls(inside, True)
        counted = np.flatnonzero(used.any(axis=1))
        if len(counted):
            first, last = counted[0], counted[-1] + 1
            inside[first:last] = np.arange(last - first) * PIECES // (last - first)
        return cls(inside, False)


def _averaged(
    default: Sequence[Measurement], judges: tuple[Grams, ...], structure: Structure, asked: Processing, band: float
) -> list[_Way]:
    """Return averages of periods: fitted to the mean period, judged on all rows of one pass, in its differentiations.

    Judged on their own columns, averages would predict well for having less noise in them, which another path's lack.
    Fitted as they are, and through a low pass at the band: above it, what the model lacks would count against averages
    alone, and encoder noise would make inertias too small.
    """
    whole, passed = [], []
    for one in default:
        columns = structure.columns(one.motion)
        count = len(columns)
        piece = (np.arange(count) * PIECES // count)[one.rows]
        assert one.base_frequency is not None
        counted = one.used[one.rows]
        whole.append(Grams.of(one.passed(columns), one.passed(one.torque), piece, counted, PIECES))
        if one.low_pass is None:
            lines = replace(one, low_pass=PeriodicLowPass(band, one.base_frequency, count))
            passed.append(Grams.of(lines.passed(columns), lines.passed(one.torque), piece, counted, PIECES))
    ways = [(asked, whole)]
    if len(passed) == len(whole):
        ways.append((replace(asked, low_pass=band), passed))
    return [_Way(processing, True, total(fitted), judges) for processing, fitted in ways]


@dataclass(frozen=True)
class _Shown:
    """How predictions are processed, low pass and differentiation [Hz], and what squared error [n] of the record they
    leave.
    """

    low_pass: float
    wide: float
    error: Array

    @property
    def score(self) -> float:
        """Sum over joints of ln of the squared error."""
        return float(np.sum(np.log(np.maximum(self.error, 1e-300))))


def _shown(rows: Sequence[ThinRows], structure: Structure, taken: Candidate, band: float) -> _Shown:
    """Return the low pass that brings the model's torque nearest to the record, whatever that passed itself."""
    whole = taken.fitted.by_joint(taken.kept < len(structure.base.columns))
    torques = [np.einsum("kjp,jp->kj", one.columns(structure)[:, :, taken.kept], whole) for one in rows]
    most = min(0.4 / one.sample_dt for one in rows)
    found = []
    for cutoff in (min(share * band, most) for share in _SHOWN):
        left = np.zeros(structure.robot.n)
        for one, torque in zip(rows, torques, strict=True):
            left += np.sum(((one.torque(None) - one.passed(torque, cutoff)) * one.used) ** 2, axis=0)
        found.append(_Shown(float(cutoff), rows[0].wide, left))
    return min(found, key=lambda one: one.score)


def _identifiable(sums: Grams, structure: Structure, labels: Sequence[str]) -> tuple[np.ndarray, list[str]]:
    """Return which columns [P] the data can tell, all but candidates that the others span, and the labels of those."""
    weight = 1.0 / np.maximum(sums.yy.sum(axis=0), 1e-300)
    square = np.tensordot(weight, sums.xx.sum(axis=0), 1)
    size = np.sqrt(np.maximum(np.diag(square), 1e-300))
    square = square / size / size[:, None]
    kept = np.ones(len(structure.names), dtype=bool)
    open_ = []
    for label in reversed(labels):
        place = structure.names.index(label)
        others = np.flatnonzero(kept & (np.arange(len(kept)) != place))
        among = square[np.ix_(others, others)] + _OWN**2 * np.eye(len(others))
        own = square[place, place] - square[place, others] @ np.linalg.solve(among, square[others, place])
        if own < _OWN:
            kept[place] = False
            open_.append(label)
    return kept, open_[::-1]


def _judged(
    way: _Way, structure: Structure, labels: Sequence[str], told: np.ndarray, joints: Sequence[str]
) -> list[Candidate]:
    """Return a candidate for every set: offsets, rotor inertias and torque scales (of some joints) in or out."""
    names = structure.names
    out = []
    sets: list[tuple[str, ...]] = []
    for *kinds, scaled in product((True, False), repeat=3):
        if scaled and not joints:
            continue
        wanted = [name for name, taken in zip((OFFSET, ROTOR), kinds, strict=True) if taken]
        chosen = tuple(x for x in labels if x.partition("@")[0] in wanted and told[names.index(x)])
        both = (*chosen, *(f"{SCALE}@{joint}" for joint in joints)) if scaled else chosen
        if both in sets:
            continue
        sets.append(both)
        kept = np.array([k for k, name in enumerate(names) if told[k] and (name not in labels or name in chosen)])
        rigid = kept < len(structure.base.columns)
        free = scaled * (np.arange(structure.robot.n) > 0)
        judged = [sums.kept(kept) for sums in way.judged]
        errors, fitted = held_out(way.fitted.kept(kept), judged, way.independent, rigid, free > 0)
        torque = way.judged[0].yy.sum(axis=0)  # the same in every differentiation
        made = [Candidate(way.processing, both, way.averaged, error, torque, kept, fitted) for error in errors]
        out.append(min(made, key=lambda one: one.score))
    return out
