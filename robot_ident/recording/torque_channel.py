"""The measuring chain of the torque: from what the drive reports back to the torque at the instant of the position; its
anti-alias filter identified from a frequency response (Swevers et al. 1997, section V-A).
"""

from __future__ import annotations

import csv
import io
from collections.abc import Sequence
from dataclasses import dataclass
from itertools import zip_longest
from pathlib import Path
from typing import Any

import numpy as np

from robot_ident.errors import InputError
from robot_ident.files import read_text
from robot_ident.recording.measurement import Measurement
from robot_ident.robot.anti_alias import AntiAlias, Response, Section
from robot_ident.robot.robot import Robot
from robot_ident.signals.motion import Array, Mask

LEAST_GAIN = 0.5  # of a filter that is inverted: beyond, noise would be more than doubled


@dataclass(frozen=True)
class Chain:
    """What lies between the torque and its record, by joint: an analogue low pass [n] or None, a delay [n] s."""

    anti_alias: tuple[AntiAlias | None, ...]
    delay: Array

    @property
    def trivial(self) -> bool:
        """Whether the torque is recorded as it is."""
        return not self.filtered and not self.delay.any()

    @property
    def filtered(self) -> bool:
        """Whether any joint's torque passes a filter."""
        return any(self.anti_alias)

    @property
    def bandwidth(self) -> float:
        """Frequency [Hz] up to which all filters pass at least half; inf without."""
        return min((kind.passes(LEAST_GAIN) for kind in self.anti_alias if kind), default=float("inf"))

    def response(self, frequency: Array) -> Response:
        """Return H [K, n] at frequencies [K] Hz: the filters' poles, and exp(-i w delay)."""
        lag = np.exp(-2j * np.pi * frequency[:, None] * self.delay)
        gains = {kind: kind.response(frequency) for kind in set(self.anti_alias) if kind}
        for joint, kind in enumerate(self.anti_alias):
            if kind:
                lag[:, joint] *= gains[kind]
        return np.asarray(lag)

    def undone(self, x: Array, rate: float) -> Array:
        """Return torque x [N, n] sampled at `rate` [Hz] without the chain, a low pass below its bandwidth to follow.

        Works on the signal continued at both ends by its odd reflection; the first and last moments stay disturbed.
        """
        pad = min(len(x) - 1, int(2.0 * rate))
        long = np.concatenate([2.0 * x[0] - x[pad:0:-1], x, 2.0 * x[-1] - x[-2 : -pad - 2 : -1]])
        frequency = np.asarray(np.fft.rfftfreq(len(long), 1.0 / rate), dtype=float)
        h = self.response(frequency)
        bounded = h / np.minimum(1.0, np.abs(h) / LEAST_GAIN)  # beyond the bandwidth as large as at its edge
        return np.fft.irfft(np.fft.rfft(long, axis=0) / bounded, len(long), axis=0)[pad : pad + len(x)]

    def check_low_pass(self, cutoff: float, source: str) -> None:
        """Raise InputError where a low pass [Hz] keeps more than can be undone."""
        if cutoff > self.bandwidth:
            raise InputError(
                f"{source}: low pass of {cutoff:g} Hz lies above {self.bandwidth:.3g} Hz, up to which the anti-alias"
                " filter can be undone"
            )

    @property
    def note(self) -> str:
        """A line for the user, empty where there is nothing to say."""
        parts = []
        kinds = [kind for kind in dict.fromkeys(self.anti_alias) if kind]
        if kinds:
            parts.append(f"{', '.join(kind.words for kind in kinds)} undone to {self.bandwidth:.3g} Hz")
        if self.delay.any():
            parts.append("delay of " + ", ".join(f"{1e3 * d:g}" for d in self.delay) + " ms undone")
        return "torque channel: " + ", ".join(parts) if parts else ""


def chain_of(robot: Robot, anti_alias: tuple[float, float] | None, source: str, rate: float, lowest: float) -> Chain:
    """Return the chain that a robot declares; `anti_alias` (order, Hz) replaces its filters, order 0 takes them away.

    Raises InputError where a cutoff is not below half of the sample rate, and where a filter passes less than half of
    the `lowest` frequency [Hz] that the recording holds.
    """
    kinds = robot.anti_alias or (None,) * robot.n
    if anti_alias is not None:
        kinds = (AntiAlias(int(anti_alias[0]), float(anti_alias[1])) if anti_alias[0] else None,) * robot.n
    kind = max((kind for kind in kinds if kind), key=lambda k: k.cutoff, default=None)
    if kind is not None and kind.cutoff > 0.4999 * rate:
        raise InputError(
            f"{source}: the anti-alias filter's cutoff of {kind.cutoff:g} Hz is not below half the sample rate,"
            f" {0.5 * rate:g} Hz; give the filter that was in the chain (--anti-alias ORDER:HZ, or none)"
        )
    chain = Chain(kinds, np.broadcast_to(np.asarray(robot.torque_delay, dtype=float), (robot.n,)))
    if chain.bandwidth < lowest:
        raise InputError(
            f"{source}: the anti-alias filter passes less than half above {chain.bandwidth:.3g} Hz, and the motion"
            f" begins at {lowest:.3g} Hz; give the filter that was in the chain (--anti-alias ORDER:HZ, or none)"
        )
    return chain


COLUMNS = ("frequency", "gain", "phase")
LARGEST_ORDER = 12
_STRONG = 25.0  # (|c| / its noise)^2 of a line of the torque from which the ratio of two lines is told
_LEAST_POINTS = 6
_FREQUENCIES, _QUALITIES = np.log(30.0), np.log(50.0)  # how far poles may go from where a search begins
_ROUGHLY = 1e-5  # relative change of the squared error at which one of several searches ends; the best goes on
_LEAST_NOISE_GAIN = 0.1  # below, what leaks from other lines into the noise's spectrum counts
_LEAST_GAIN = 1e-4  # below, an analyser reads its own noise


@dataclass(frozen=True)
class FrequencyResponse:
    """H [K] at frequencies [K] Hz, and the standard deviation [K] of its real and imaginary part relative to |H|.

    with_phase [K]: where the phase is known; elsewhere |H| alone counts. deviation None: unknown, the same at all.
    """

    frequency: Array
    value: Response
    with_phase: Mask
    deviation: Array | None
    source: str

    @classmethod
    def read(cls, path: str | Path) -> FrequencyResponse:
        """Read a CSV with the columns frequency [Hz], gain [-] and phase [deg], which may be empty, and (optionally)
        deviation, the standard deviation of the gain [-]. InputError on anything else.
        """
        rows = list(csv.reader(io.StringIO(read_text(path))))
        header = [word.strip().lower() for word in rows[0]] if rows else []
        missing = [name for name in COLUMNS if name not in header]
        if missing:
            raise InputError(
                f"{path}: no column {', '.join(missing)}; a CSV with a header frequency,gain,phase (Hz, ratio, degrees)"
                " was expected, and deviation (of the gain) where it is known"
            )
        wanted = [*COLUMNS, *(["deviation"] if "deviation" in header else [])]
        values = []
        for number, row in enumerate(rows[1:], 2):
            if not any(word.strip() for word in row):
                continue
            try:
                words = {name: row[header.index(name)].strip() for name in wanted}
                words["phase"] = words["phase"] or "nan"
                values.append([float(word) for word in words.values()])
            except (ValueError, IndexError):
                raise InputError(f"{path}, line {number}: {','.join(row)}: numbers were expected") from None
        table = np.array(values, dtype=float).reshape(len(values), len(wanted))
        frequency, gain, phase = table[:, 0], table[:, 1], table[:, 2]
        if len(table) < _LEAST_POINTS:
            raise InputError(f"{path}: {len(table)} points; at least {_LEAST_POINTS} are needed")
        if not (np.all(frequency > 0) and np.all(gain > 0) and np.all(np.isfinite(table[:, :2]))):
            raise InputError(f"{path}: frequency and gain must be positive (gain as a ratio, not in dB)")
        told = np.isfinite(phase)
        deviation = table[:, 3] / gain if len(wanted) > 3 else None
        if deviation is not None and not np.all(deviation > 0):
            raise InputError(f"{path}: deviation must be positive")
        value = gain * np.exp(1j * np.deg2rad(np.where(told, phase, 0.0)))
        kept = gain > _LEAST_GAIN * gain.max()
        return cls(frequency[kept], value[kept], told[kept], None if deviation is None else deviation[kept], str(path))


def between(with_filter: Measurement, without: Measurement, joint: int | None = None) -> FrequencyResponse:
    """Return the response between two periodic recordings of one motion, one with the filter and one without.

    joint: of this one alone; else all joints together, as if they had one filter.
    H at each line of the torque that stands out of both noises: sum_j conj(a_kj) b_kj / sum_j
    |a_kj|^2, weighted by the noise; between the lines |H|^2 = S_b / S_a of the noise that passes the filter too.
    Raises InputError where the periods or sample rates differ, or a recording holds no noise (one period).
    """
    a, b = without, with_filter
    if a.base_frequency is None or b.base_frequency is None or a.noise is None or b.noise is None:
        raise InputError("two periodic recordings of two periods at least are needed, with the filter and without it")
    if a.motion.samples != b.motion.samples or abs(a.base_frequency / b.base_frequency - 1.0) > 1e-6:
        raise InputError(f"{b.source} and {a.source} are of different motions or sample rates")
    of = slice(None) if joint is None else slice(joint, joint + 1)
    lines_a, lines_b = (np.fft.rfft(one.torque[:, of], axis=0) / one.motion.samples for one in (a, b))
    # E |n_k|^2 of the averaged torque's lines c_k = (1 / N) sum x exp(-i w k t)
    noise_a = a.noise.power[:, of] / a.periods / a.noise.samples
    noise_b = b.noise.power[:, of] / b.periods / b.noise.samples
    strong = (np.abs(lines_a) ** 2 > _STRONG * noise_a) & (np.abs(lines_b) ** 2 > _STRONG * noise_b)
    strong[0] = False
    weight = np.where(strong, 1.0 / noise_b, 0.0)
    power = np.sum(weight * np.abs(lines_a) ** 2, axis=1)
    used = np.flatnonzero(strong.any(axis=1))
    h = np.sum(weight * np.conj(lines_a) * lines_b, axis=1)[used] / power[used]
    both = noise_b[used] + np.abs(h)[:, None] ** 2 * noise_a[used]
    spread = np.sum(weight[used] ** 2 * np.abs(lines_a[used]) ** 2 * both, axis=1)
    relative = np.sqrt(0.5 * spread) / power[used] / np.abs(h)
    frequency = used * a.base_frequency
    gains, at, deviation = _noise_gain(b, a, of)
    order = np.argsort(np.concatenate([frequency, at]), kind="stable")
    return FrequencyResponse(
        np.concatenate([frequency, at])[order],
        np.concatenate([h, gains.astype(complex)])[order],
        np.concatenate([np.ones(len(used), dtype=bool), np.zeros(len(at), dtype=bool)])[order],
        np.concatenate([relative, deviation])[order],
        f"{b.source} over {a.source}",
    )


def _noise_gain(b: Measurement, a: Measurement, of: slice) -> tuple[Array, Array, Array]:
    """Return |H| [M] by the noise of both at frequencies [M] Hz, and its relative deviation [M].

    Smoothed lines are taken one smoothing width apart, so that they are independent.
    """
    assert a.noise is not None and b.noise is not None and a.base_frequency is not None
    power_a, power_b = a.noise.power[:, of], b.noise.power[:, of]
    dof = min(a.noise.dof, b.noise.dof)
    apart = max(1, round(dof / (2.0 * max(1, min(a.periods, b.periods) - 1))))
    at = np.arange(apart, len(power_a) - apart, apart)
    if not len(at):
        return np.zeros(0), np.zeros(0), np.zeros(0)
    ratio = np.exp(np.mean(np.log(power_b[at] / power_a[at]), axis=1))
    # A mean over so many lines is off by a twenty-fourth of the second difference, half of it in the gain.
    bend = np.abs(np.diff(ratio, 2, prepend=ratio[:1], append=ratio[-1:])) / ratio / 48.0
    deviation = np.hypot(np.sqrt(1.0 / (dof * power_a.shape[1])), bend)
    gain = np.sqrt(ratio)
    kept = gain > _LEAST_NOISE_GAIN
    return gain[kept], np.asarray(at * a.base_frequency, dtype=float)[kept], deviation[kept]


@dataclass(frozen=True)
class IdentifiedFilter:
    """A filter with its uncertainty: standard deviations of its sections (frequency [Hz], quality), the gain at rest.

    misfit: root mean square of the relative residual. chi_square, dof: where the response states its deviation.
    bic: Bayesian information criterion by order, of those that were tried.
    """

    filter: AntiAlias
    deviations: tuple[Section, ...]
    gain: float
    gain_deviation: float
    misfit: float
    chi_square: float | None
    dof: int
    bic: dict[int, float]

    @property
    def yaml(self) -> str:
        """The entry of a robot YAML."""
        sections = ", ".join("[" + ", ".join(f"{value:.5g}" for value in one) + "]" for one in self.filter.sections)
        return f"anti_alias: {{sections: [{sections}]}}"

    def to_dict(self) -> dict[str, Any]:
        """Return it as plain data."""
        keys = ("frequency", "frequency_std", "quality", "quality_std")
        pairs = zip(self.filter.sections, self.deviations, strict=True)
        flat = ([word for pair in zip(section, spread, strict=True) for word in pair] for section, spread in pairs)
        return {
            "order": self.filter.order,
            "cutoff": self.filter.cutoff,
            "delay": self.filter.delay,
            "undone_to": self.filter.passes(0.5),
            "sections": [dict(zip_longest(keys, words)) for words in flat],
            "gain": self.gain,
            "gain_std": self.gain_deviation,
            "misfit": self.misfit,
            "chi_square": self.chi_square,
            "dof": self.dof,
            "tried": [{"order": order, "bic": float(value)} for order, value in self.bic.items()],
            "yaml": self.yaml,
        }


def identify_filter(response: FrequencyResponse, order: int | None = None) -> IdentifiedFilter:
    """Return the all-pole low pass that maximum likelihood finds: the least sum of squared relative errors of H, each
    over its deviation; without stated deviations one is estimated. The order is that of the least BIC, or as given.

    Each search begins at the Butterworth, Bessel and Chebyshev filters whose gain falls where the measured one does.
    Raises InputError where the response never falls below 1 / sqrt 2 of its first value.
    """
    size = np.abs(response.value)
    low = float(np.median(size[: max(1, len(size) // 10)]))
    below = np.flatnonzero(size < np.sqrt(0.5) * low)
    if not len(below):
        raise InputError(
            f"{response.source}: the gain stays above {np.sqrt(0.5):.2f} of its value at low frequency up to"
            f" {response.frequency[-1]:.4g} Hz: measure beyond the filter's cutoff"
        )
    cutoff = float(response.frequency[below[0]])
    rows = int(2 * response.with_phase.sum() + (~response.with_phase).sum())
    orders = range(1, min(LARGEST_ORDER, rows - 3) + 1) if order is None else (order,)
    best: tuple[float, Any, tuple[int, ...]] | None = None
    scores: dict[int, float] = {}
    for number in orders:
        shape = (2,) * (number // 2) + (1,) * (number % 2)
        starts = _starts(number, cutoff, low)
        found = min((_fitted(response, start, shape, _ROUGHLY) for start in starts), key=lambda f: f.cost)
        square = 2.0 * found.cost
        known = response.deviation is not None
        scores[number] = (square if known else rows * np.log(square / rows)) + len(found.x) * np.log(rows)
        if best is None or scores[number] < best[0]:
            best = (scores[number], found, shape)
    assert best is not None
    return _described(response, _fitted(response, best[1].x, best[2]), best[2], rows, scores)


def _starts(order: int, cutoff: float, gain: float) -> list[Array]:
    """Return variables (log gain, log frequency and log quality of each section) of filters of an order."""
    from scipy import signal

    out = []
    for prototype in (signal.buttap(order), signal.besselap(order, norm="mag"), signal.cheb1ap(order, 0.5)):
        poles = np.asarray(prototype[1])
        pairs = poles[poles.imag > 1e-9]
        real = poles[np.abs(poles.imag) <= 1e-9]
        w = np.concatenate([np.abs(pairs), np.abs(real)]) * cutoff
        quality = np.abs(pairs) / (-2.0 * pairs.real)
        out.append(np.concatenate([[np.log(gain)], np.log(w), np.log(quality)]))
    return out


def _sections(x: Array, shape: Sequence[int]) -> tuple[Section, ...]:
    count = len(shape)
    w, quality = np.exp(x[1 : 1 + count]), np.exp(x[1 + count :])
    return tuple((float(w[k]), float(quality[k])) if k < len(quality) else (float(w[k]),) for k in range(count))


def _fitted(response: FrequencyResponse, start: Array, shape: Sequence[int], tolerance: float = 1e-8) -> Any:
    from scipy.optimize import least_squares

    s = 1j * response.frequency
    scale = 1.0 if response.deviation is None else 1.0 / response.deviation
    phase = response.with_phase

    def parts(of: Array) -> Array:
        return np.concatenate([of.real * scale, (of.imag * scale)[phase]])

    def residual(x: Array) -> Array:
        h = np.full(len(s), np.exp(x[0]), dtype=complex)
        for section in _sections(x, shape):
            u = s / section[0]
            h = h / (1.0 + u / section[1] + u * u if len(section) == 2 else 1.0 + u)
        return parts(np.log(response.value / h))

    def slopes(x: Array) -> Array:
        """Return the derivatives of the residual: of -ln h by the logarithms of gain, frequencies and qualities."""
        out = np.empty((len(x), len(s)), dtype=complex)
        out[0] = -1.0
        for k, section in enumerate(_sections(x, shape)):
            u = s / section[0]
            if len(section) == 2:
                below = 1.0 + u / section[1] + u * u
                out[1 + k] = -(u / section[1] + 2.0 * u * u) / below
                out[1 + len(shape) + k] = -u / section[1] / below
            else:
                out[1 + k] = -u / (1.0 + u)
        return np.array([parts(one) for one in out]).T

    span = np.full(len(start), _QUALITIES)
    span[0], span[1 : 1 + len(shape)] = np.inf, _FREQUENCIES
    bounds = (start - span, start + span)
    return least_squares(residual, start, jac=slopes, bounds=bounds, ftol=tolerance, x_scale="jac", max_nfev=200)


def _described(
    response: FrequencyResponse, found: Any, shape: Sequence[int], rows: int, scores: dict[int, float]
) -> IdentifiedFilter:
    square, dof = 2.0 * float(found.cost), rows - len(found.x)
    known = response.deviation is not None
    variance = max(1.0, square / dof) if known else square / dof
    deviation = np.sqrt(variance * np.diag(np.linalg.pinv(found.jac.T @ found.jac)))
    sections = _sections(found.x, shape)
    count = len(shape)
    spread = tuple(
        tuple(float(value * deviation[1 + k + count * part]) for part, value in enumerate(section))
        for k, section in enumerate(sections)
    )
    order = sorted(range(count), key=lambda k: sections[k][-1] if len(sections[k]) == 2 else 0.0)
    gain = float(np.exp(found.x[0]))
    residual = found.fun
    if response.deviation is not None:
        residual = residual * np.concatenate([response.deviation, response.deviation[response.with_phase]])
    return IdentifiedFilter(
        AntiAlias.of_sections([sections[k] for k in order]),
        tuple(spread[k] for k in order),
        gain,
        gain * float(deviation[0]),
        float(np.sqrt(np.mean(residual**2))),
        square if known else None,
        dof,
        scores,
    )
