"""Up to which frequency a recorded torque is the arm's: where a first model is coherent with it; and recordings as one
pass on a grid no finer than their band needs, on which candidates of processing are compared.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import reduce
from operator import add

import numpy as np

from robot_ident.effects.torque_ripple import TorqueRipple
from robot_ident.estimation.held_out import Grams, fit
from robot_ident.model.structure import Structure
from robot_ident.recording.averaging import FINE
from robot_ident.recording.measurement import Measurement, Processing
from robot_ident.recording.process import Opened
from robot_ident.robot.robot import Robot
from robot_ident.signals.filters import ZeroPhaseLowPass
from robot_ident.signals.motion import Array, Mask, Motion, joined

_SLOWEST = 100.0  # Hz, of rows that are thinned
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
class ThinRows:
    """Every `step`-th sample of a recording that was taken as one pass, its positions differentiated to `wide` [Hz]."""

    measured: Measurement
    step: int
    wide: float

    @property
    def dt(self) -> float:
        """Time between rows [s]."""
        return self.measured.dt * self.step

    @property
    def used(self) -> Mask:
        """Rows [N, n] that count."""
        return self.measured.used[:: self.step]

    @property
    def motion(self) -> Motion:
        """The motion [N, n] of the rows."""
        return replace(self.measured.motion[:: self.step], dt=self.dt)

    def torque(self, cutoff: float | None) -> Array:
        """Return the torque [N, n], low-passed at `cutoff` [Hz]; None: at what the rows can hold."""
        if cutoff is None and self.step == 1:
            return self.measured.torque
        low_pass = ZeroPhaseLowPass(cutoff or 0.45 / self.dt, self.measured.dt, len(self.measured.torque))
        return low_pass.apply(self.measured.torque)[:: self.step]

    def passed(self, x: Array, cutoff: float) -> Array:
        """Return x [N, ...] low-passed at `cutoff` [Hz]."""
        columns = x.reshape(len(x), -1)
        some, out = columns.any(axis=0), np.zeros(columns.shape)  # most parameters act on a few joints only
        out[:, some] = ZeroPhaseLowPass(cutoff, self.dt, len(x)).apply(columns[:, some])
        return out.reshape(x.shape)


def thin_rows(opened: Opened, processing: Processing, band: float, *, wider: float, shown: bool = False) -> ThinRows:
    """Return a recording as one pass, low-passed at `band` [Hz], its positions differentiated to `wider` times that;
    shown: velocities no further, as for predictions.
    """
    nyquist = 0.5 / opened.clock.dt
    low_pass, wide = min(band, 0.8 * nyquist), min(wider * band, 0.8 * nyquist)
    asked = replace(processing, periodic=False, base_frequency=None, decimate=1, low_pass=low_pass)
    asked = replace(asked, derivative_bandwidth=wide, velocity_bandwidth=wide if shown else None)
    measured = opened.processed(asked)
    return ThinRows(measured, max(1, int(1.0 / (measured.dt * max(_SLOWEST, FINE * low_pass)))), wide)


def coherent_band(recordings: Sequence[Opened], structure: Structure, processing: Processing, most: float) -> float:
    """Return the frequency [Hz], `most` at most, up to which torque and model have half of their power in common: the
    geometric mean of the two joints where that reaches furthest, since one alone may resonate. What ripples with a
    joint's angle counts as the model's.

    Coherence |S_xy|^2 / (S_xx S_yy) by Welch's method, less its bias of one over the number of independent stretches.
    """
    band, orders = _once(recordings, structure, processing, min(_PILOT, most), most)
    return _once(recordings, structure, processing, min(band, most), most, orders)[0]


def _once(
    recordings: Sequence[Opened],
    structure: Structure,
    processing: Processing,
    band: float,
    most: float,
    orders: Sequence[Sequence[float]] | None = None,
) -> tuple[float, list[Sequence[float]]]:
    """Return the band by a model low-passed at another, and the orders of ripple by joint, where they aren't told."""
    first = [thin_rows(recording, processing, band, wider=_WIDER) for recording in recordings]
    top = min(most, *(_WIDEST / one.measured.dt for one in first))
    cutoff = min(band, top)
    columns = [structure.columns(one.motion) for one in first]
    whole = (
        Grams.of(one.passed(x, cutoff), one.torque(cutoff), np.zeros(len(x), dtype=int), one.used, 1)
        for one, x in zip(first, columns, strict=True)
    )
    rigid = np.arange(len(structure.names)) < len(structure.base.columns)
    theta = fit(reduce(add, whole), np.ones(1), 1.0, rigid, np.zeros(structure.robot.n, dtype=bool)).theta
    longest = min(_WINDOW, min(one.dt * len(x) for one, x in zip(first, columns, strict=True)) / 3.0)
    torques = [one.torque(None) for one in first]
    predicted, orders = _with_ripple(first, torques, [x @ theta for x in columns], structure.robot, orders)
    reached = [
        _reach(
            [
                _spectra(one.dt, record[:, joint], tau[:, joint], longest)
                for one, record, tau in zip(first, torques, predicted, strict=True)
            ]
        )
        for joint in range(structure.robot.n)
    ]
    furthest = np.sort(reached)[-2:]
    return float(np.clip(np.exp(np.mean(np.log(furthest))), min(_LEAST, top), top)), orders


def _with_ripple(
    parts: Sequence[ThinRows],
    torques: Sequence[Array],
    predicted: Sequence[Array],
    robot: Robot,
    known: Sequence[Sequence[float]] | None,
) -> tuple[list[Array], list[Sequence[float]]]:
    """Return predicted torques [N, n] with what ripples of each joint's torque over its angle, for it is the arm's,
    too; and the orders by joint, read off what is left of the measured ones where they are not known.
    """
    torque = np.concatenate(torques)
    motion, used = joined([part.motion for part in parts]), np.concatenate([part.used for part in parts])
    out, orders = np.concatenate(predicted), []
    for joint in range(robot.n):
        ripple, rows = TorqueRipple(robot, joint), used[:, joint]
        left = torque[:, joint] - out[:, joint]
        fastest = 0.45 / max(part.dt for part in parts)
        if known is not None:
            orders.append(known[joint])
        elif ripple.unseen or not rows.any():
            orders.append([])
        else:
            orders.append(list(ripple.certain_lines(motion[rows][:_ROWS], left[rows][:_ROWS], fastest, _RIPPLE)))
        angle = np.outer(ripple.ratio * motion.q[:, joint], orders[joint])
        lines = np.hstack([np.cos(angle), np.sin(angle)])
        out[:, joint] += lines @ np.linalg.lstsq(lines[rows], left[rows], rcond=None)[0]
    return np.split(out, np.cumsum([len(part) for part in predicted])[:-1]), orders


def _spectra(dt: float, torque: Array, predicted: Array, window: float) -> tuple[Array, np.ndarray, int]:
    """Return frequencies [K] Hz, power of prediction, torque and both [3, K], and from how many stretches."""
    from scipy.signal import csd

    size = min(max(8, int(window / dt)), len(predicted))
    pairs = np.array([(predicted, predicted), (torque, torque), (predicted, torque)])
    frequency, power = csd(pairs[:, 0], pairs[:, 1], fs=1.0 / dt, nperseg=size)
    return frequency, power, max(1, (len(predicted) - size // 2) // (size - size // 2))


def _reach(spectra: Sequence[tuple[Array, np.ndarray, int]]) -> float:
    """Return the first frequency [Hz] above zero at which less than half of the power is shared."""
    finest = max((frequency for frequency, _, _ in spectra), key=len)
    weighed = [
        stretches * np.array([np.interp(finest, frequency, one) for one in power])
        for frequency, power, stretches in spectra
    ]
    own, other, cross = np.sum(weighed, axis=0)
    coherence = np.abs(cross) ** 2 / np.maximum(own.real * other.real, 1e-300)
    bias = min(0.9, 1.0 / max(sum(stretches for _, _, stretches in spectra) * _HALVES, 1.0))
    lost = np.flatnonzero(((coherence - bias) / (1.0 - bias) < _COHERENT) & (finest > 0.0))
    return float(finest[lost[0]] if len(lost) else finest[-1])
