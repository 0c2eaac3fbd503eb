"""Up to which frequency a recorded torque is the arm's: where a first model is coherent with it."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from robot_ident.effects.torque_ripple import TorqueRipple
from robot_ident.estimation.held_out import Grams, fit, total
from robot_ident.estimation.thin_rows import ThinRows, thin_rows
from robot_ident.model.structure import Structure
from robot_ident.recording.measurement import Processing
from robot_ident.recording.recording import Recording
from robot_ident.robot.robot import Robot
from robot_ident.signals.motion import Array, Motion, joined

_PILOT = 8.0  # Hz, of the first model
_WIDER = 4.0  # times its low pass: the bandwidth of its positions' derivatives
_COHERENT = 0.5  # of the torque's power, above which more of it is the model's than not
_RIPPLE = 1.0 / 3.0  # of what the pilot leaves of a joint that its ripple must make to widen the band
_ROWS = 5000  # by which it is looked for
_LEAST = 2.0  # Hz
_WIDEST = 0.2  # of the sample rate, so that twice the band can be differentiated
_WINDOW = 4.0  # s of a spectrum, at most a third of the shortest recording
_HALVES = 0.6  # independent spectra in each of those that overlap by half


@dataclass(frozen=True)
class _Spectra:
    """Power of prediction and torque and their cross power [K] by joint, at frequencies [K] Hz, from a number of
    stretches.
    """

    frequency: Array
    predicted: Array
    measured: Array
    cross: Array
    stretches: float


def coherent_band(recordings: Sequence[Recording], structure: Structure, processing: Processing, most: float) -> float:
    """Return the frequency [Hz], `most` at most, up to which torque and model have half of their power in common: the
    geometric mean of the two joints where that reaches furthest, since one alone may resonate. What ripples with a
    joint's angle counts as the model's.

    Coherence |S_xy|^2 / (S_xx S_yy) by Welch's method, less its bias of one over the number of independent stretches.
    """
    band, orders = _once(recordings, structure, processing, min(_PILOT, most), most)
    return _once(recordings, structure, processing, min(band, most), most, orders)[0]


def _once(
    recordings: Sequence[Recording],
    structure: Structure,
    processing: Processing,
    band: float,
    most: float,
    orders: Sequence[Sequence[float]] | None = None,
) -> tuple[float, list[Sequence[float]]]:
    """Return the band by a model low-passed at another, and the orders of ripple by joint, where they aren't told."""
    first = [thin_rows(recording, structure.robot, processing, band, wider=_WIDER) for recording in recordings]
    top = min(most, *(_WIDEST / one.sample_dt for one in first))
    cutoff = min(band, top)
    columns = [one.columns(structure) for one in first]
    grams = total(
        Grams.of(one.passed(x, cutoff), one.torque(cutoff), np.zeros(len(x), dtype=int), one.used, 1)
        for one, x in zip(first, columns, strict=True)
    )
    rigid = np.arange(len(structure.names)) < len(structure.base.columns)
    theta = fit(grams, np.ones(1), 1.0, rigid, np.zeros(structure.robot.n, dtype=bool)).theta
    longest = min(_WINDOW, min(one.dt * len(x) for one, x in zip(first, columns, strict=True)) / 3.0)
    predicted, orders = _with_ripple(first, [x @ theta for x in columns], structure.robot, orders)
    reached = [
        _reach([_spectra(one, tau[:, joint], joint, longest) for one, tau in zip(first, predicted, strict=True)])
        for joint in range(structure.robot.n)
    ]
    furthest = np.sort(reached)[-2:]
    return float(np.clip(np.exp(np.mean(np.log(furthest))), min(_LEAST, top), top)), orders


def _with_ripple(
    parts: Sequence[ThinRows], predicted: Sequence[Array], robot: Robot, known: Sequence[Sequence[float]] | None
) -> tuple[list[Array], list[Sequence[float]]]:
    """Return predicted torques [N, n] with what ripples of each joint's torque over its angle, for it is the arm's,
    too; and the orders by joint, read off what is left where they are not known.
    """
    torque = np.concatenate([part.torque(None) for part in parts])
    motion, used = joined([part.motion for part in parts]), np.concatenate([part.used for part in parts])
    out, orders = np.concatenate(predicted), []
    for joint in range(robot.n):
        ripple, rows = TorqueRipple(robot, joint), used[:, joint]
        left = torque[:, joint] - out[:, joint]
        fastest = 0.45 / max(part.dt for part in parts)
        orders.append(_orders(ripple, motion[rows], left[rows], fastest) if known is None else known[joint])
        angle = np.outer(ripple.ratio * motion.q[:, joint], orders[joint])
        lines = np.hstack([np.cos(angle), np.sin(angle)])
        out[:, joint] += lines @ np.linalg.lstsq(lines[rows], left[rows], rcond=None)[0]
    return np.split(out, np.cumsum([len(part) for part in predicted])[:-1]), orders


def _orders(ripple: TorqueRipple, motion: Motion, left: Array, fastest: float) -> Sequence[float]:
    """Return the orders of a joint's ripple; none where it makes little of what is left [N]."""
    if ripple.unseen or not len(left):
        return []
    return list(ripple.certain_lines(motion[:_ROWS], left[:_ROWS], fastest, _RIPPLE))


def _spectra(rows: ThinRows, predicted: Array, joint: int, window: float) -> _Spectra:
    from scipy.signal import csd

    size = max(8, int(window / rows.dt))
    size = min(size, len(predicted))
    options = {"fs": 1.0 / rows.dt, "nperseg": size}
    torque = rows.torque(None)[:, joint]
    frequency, cross = csd(predicted, torque, **options)
    own, other = (csd(signal, signal, **options)[1].real for signal in (predicted, torque))
    stretches = max(1, (len(predicted) - size // 2) // (size - size // 2))
    return _Spectra(frequency, own, other, cross, float(stretches))


def _reach(spectra: Sequence[_Spectra]) -> float:
    """Return the first frequency [Hz] above zero at which less than half of the power is shared."""
    finest = max(spectra, key=lambda one: len(one.frequency))
    total = sum(one.stretches for one in spectra)

    def mean(name: str) -> Array:
        return np.sum(
            [one.stretches * np.interp(finest.frequency, one.frequency, getattr(one, name)) for one in spectra], axis=0
        )

    power = np.maximum(mean("predicted") * mean("measured"), 1e-300)
    coherence = np.abs(mean("cross")) ** 2 / power
    bias = min(0.9, 1.0 / max(total * _HALVES, 1.0))
    coherence = (coherence - bias) / (1.0 - bias)
    lost = np.flatnonzero((coherence < _COHERENT) & (finest.frequency > 0.0))
    return float(finest.frequency[lost[0]] if len(lost) else finest.frequency[-1])
