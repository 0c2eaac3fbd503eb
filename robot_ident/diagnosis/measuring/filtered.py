"""A low pass over the effort alone, as drives have them: the model's torque behind it is held against what was
measured.
"""

from __future__ import annotations

from collections.abc import Callable, Collection, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import partial
from itertools import product

import numpy as np
from numpy.typing import NDArray

from robot_ident.diagnosis.diagnosis import Estimate
from robot_ident.diagnosis.measuring.fitted_fault import (
    FittedFault,
    chosen,
    curvature_std,
    fitted_loss,
    folds,
    raw_columns,
    weighed,
)
from robot_ident.effects import Effect
from robot_ident.effects.catalogue import CATALOGUE
from robot_ident.regression.evidence import Evidence, Trajectory, weighed_once
from robot_ident.regression.gram import BaseFit, BaseGram
from robot_ident.signals.motion import Array

Response = NDArray[np.complex128]

HIGHEST = 0.45  # of the sample rate: the largest -3 dB frequency of a filter that is computed at it

_TWICE = np.sqrt(np.sqrt(2.0) - 1.0)  # of the -3 dB frequency in the corner of two equal lags, one behind the other
_MEAN = 0.442946  # -3 dB frequency of a mean over a second [Hz]: sinc(0.442946) = 1 / sqrt(2)


def _warped(f: Array, f0: float, rate: float) -> Array:
    """Return f / f0 as the bilinear transform bends it for a filter that is computed from sample to sample."""
    return np.asarray(np.tan(np.pi * np.minimum(f / rate, 0.4999)) / np.tan(np.pi * min(f0 / rate, HIGHEST)))


def _first(u: Array) -> Response:
    return np.asarray(1.0 / (1.0 + 1j * u))


def _second(u: Array) -> Response:
    return np.asarray(1.0 / (1.0 + 1j * np.sqrt(2.0) * u - u**2))


def _smoothed(f: Array, f0: float, rate: float) -> Response:
    """Return a / (1 - (1 - a) / z) of y_k = a x_k + (1 - a) y_(k-1)."""
    b = 1.0 - np.cos(2.0 * np.pi * min(f0 / rate, HIGHEST))
    a = np.sqrt(b * b + 2.0 * b) - b
    return np.asarray(a / (1.0 - (1.0 - a) * np.exp(-2j * np.pi * f / rate)))


def _averaged(f: Array, f0: float, rate: float) -> Response:
    u = _MEAN * f / f0
    return np.asarray(np.sinc(u) * np.exp(-1j * np.pi * u))


def _zero_phase(order: int) -> Callable[[Array, float, float], Response]:
    """Return |H|^2 of a Butterworth filter that was run forward and backward, at -3 dB of both together."""
    corner = (np.sqrt(2.0) - 1.0) ** (0.5 / order)
    return lambda f, f0, rate: np.asarray(
        1.0 / (1.0 + (corner * _warped(f, f0, rate)) ** (2 * order)), dtype=np.complex128
    )


LOW_PASSES: Mapping[str, Callable[[Array, float, float], Response]] = {
    "first order": lambda f, f0, rate: _first(f / f0),
    "second-order Butterworth": lambda f, f0, rate: _second(f / f0),
    "two equal lags": lambda f, f0, rate: np.asarray(1.0 / (1.0 + 1j * _TWICE * f / f0) ** 2),
    "moving average": _averaged,
    "exponential smoothing of the samples": _smoothed,
    "first order from sample to sample": lambda f, f0, rate: _first(_warped(f, f0, rate)),
    "second-order Butterworth from sample to sample": lambda f, f0, rate: _second(_warped(f, f0, rate)),
    "second-order Butterworth, forward and backward": _zero_phase(2),
    "fourth-order Butterworth, forward and backward": _zero_phase(4),
    "centred moving average": lambda f, f0, rate: np.asarray(np.sinc(_MEAN * f / f0), dtype=complex),
}
"""Frequency responses H at f [K] Hz for a -3 dB frequency f0 [Hz] and a sample rate [Hz].

Of the drive, which computes far faster than it reports, and of a driver or a script that filters what is reported.
"""

WITHOUT_PHASE = tuple(form for form in LOW_PASSES if form.endswith("backward") or form.startswith("centred"))
"""Those of scripts that filter a whole recording: they shift nothing in time, and no robot YAML can declare them."""

ORDERS = {1: "first order", 2: "second-order Butterworth"}
"""Those that a robot YAML can declare, by their order."""


@dataclass(frozen=True)
class Passage:
    """A low pass: its form and its one parameter, the -3 dB frequency [Hz]."""

    form: str
    at: float

    def response(self, frequency: Array, rate: float) -> Response:
        """Return H at frequencies [K] Hz of what is sampled at a rate [Hz]."""
        return LOW_PASSES[self.form](frequency, self.at, rate)

    def applied(self, lines: Response, t: Trajectory) -> Array:
        """Return periodic columns [N, n, p], whose Fourier lines [K, n, p] are given, behind it."""
        samples, dt = t.motion.samples, t.motion.dt or t.measured.dt
        frequency = np.asarray(np.fft.rfftfreq(samples, dt), dtype=float)
        return np.fft.irfft(lines * self.response(frequency, 1.0 / dt).reshape(-1, 1, 1), samples, axis=0)

    def lag(self, rate: float) -> float:
        """Return how late [s] it passes what is slow: -d arg H / d omega at standstill."""
        slow = 1e-5 * rate
        return float(-np.angle(self.response(np.array([slow]), rate))[0] / (2.0 * np.pi * slow))

    def like(self, form: str, rate: float) -> Passage:
        """Return another low pass that is about as late."""
        if form == self.form or form in WITHOUT_PHASE or self.form in WITHOUT_PHASE:
            return Passage(form, self.at)
        at = self.at * Passage(form, self.at).lag(rate) / self.lag(rate)
        return Passage(form, min(at, HIGHEST * rate))


NAME = "effort_filter"
CUTOFFS = (1.0, 1.4, 2.0, 3.0, 4.5, 6.5, 9.5, 14.0, 20.0, 30.0, 45.0, 65.0, 95.0)
"""-3 dB frequencies [Hz] that are tried at first, with the forms of `ORDERS`."""

_NEIGHBOUR = 0.4  # of the logarithm of a frequency: as far as the next point of the grid lies
_COARSE, _FINE = 0.03, 0.002  # of that logarithm: how near the best is looked for
_STEP = 0.01  # of that logarithm, over which the curvature of the squared error is taken


@dataclass(frozen=True)
class Passages:
    """Models of what is measured behind low passes: Fourier lines [K, n, p] of the columns, and the plain model."""

    evidence: Evidence
    base: BaseGram
    lines: tuple[Response, ...]

    @classmethod
    def of(cls, evidence: Evidence, base: BaseGram) -> Passages:
        """Take the model of some evidence, whose Gram matrices are known."""
        raw = raw_columns(evidence)
        lines = {id(one): np.fft.rfft(one, axis=0) for one in {id(one): one for one in raw}.values()}
        return cls(evidence, base, tuple(lines[id(one)] for one in raw))

    def through(self, passage: Passage, joints: Sequence[int]) -> BaseGram:
        """Return the Gram matrices with the rows of some joints behind a low pass."""
        all_of, some = self.evidence.trajectories, list(joints)

        def passed(place: int) -> Array:
            return passage.applied(self.lines[place][:, some], all_of[place])

        own, torque = self.base.own.copy(), self.base.torque.copy()
        for place, (t, phi) in enumerate(zip(all_of, weighed_once(all_of, passed, some), strict=True)):
            for j, rows in zip(some, phi.swapaxes(0, 1), strict=True):
                own[place, j], torque[place, j] = rows.T @ rows, rows.T @ t.y[:, j]
        return BaseGram(own, torque, self.base.power)

    def loss(self, passage: Passage, joints: Sequence[int]) -> float:
        """Return the squared error of a fit to all trajectories."""
        return fitted_loss(self.through(passage, joints), range(len(self.base.power)))

    def best(
        self, start: Passage, joints: Sequence[int], reach: float = _NEIGHBOUR, near: float = _COARSE
    ) -> tuple[Passage, float]:
        """Return the passage of a form with the least squared error, near one of it, and that error."""
        from scipy.optimize import minimize_scalar

        found = minimize_scalar(
            lambda x: self.loss(Passage(start.form, start.at * float(np.exp(x))), joints),
            bounds=(-reach, reach),
            method="bounded",
            options={"xatol": near, "maxiter": 20},
        )
        return Passage(start.form, start.at * float(np.exp(found.x))), float(found.fun)

    @property
    def rate(self) -> float:
        """Samples per second."""
        t = self.evidence.trajectories[0]
        return 1.0 / (t.motion.dt or t.measured.dt)


def filters(evidence: Evidence, base: BaseGram, places: Collection[int | None] | None = None) -> list[FittedFault]:
    """Return the best low pass of some joints, or all together (None), over the grid alone; places: all of them unless
    told.
    """
    if any(t.measured.base_frequency is None for t in evidence.trajectories):
        return []
    n = base.power.shape[1]
    if places is None:
        places = [*range(n), *([None] if n > 1 else [])]
    joints = range(n) if None in places else sorted(place for place in places if place is not None)
    model = Passages.of(evidence, base)
    tried = [Passage(form, f) for f, form in product(CUTOFFS, (*ORDERS.values(), WITHOUT_PHASE[0]))]
    passes = {passage: model.through(passage, joints) for passage in tried}
    out = [_of_grid(model, passes, place) for place in places]
    return [finding for finding in out if finding.gain > 0.0]


def place_of(effect: Effect) -> int | None:
    """Return the place of an effect among those of `filters`."""
    return None if effect.place is None else effect.joint


def exact(found: FittedFault, evidence: Evidence, base: BaseGram) -> FittedFault:
    """Return a low pass at its exact frequency, of the form among `LOW_PASSES` that leaves least."""
    model = Passages.of(evidence, base)
    joints, start = joints_of(found, base), _passage_of(found)
    losses = dict(model.best(start.like(form, model.rate), joints) for form in _forms(evidence, joints))
    closest = min(losses, key=losses.__getitem__)
    passage, _ = model.best(closest, joints, 2.0 * _COARSE, _FINE)
    declared = min((p for p in losses if p.form in ORDERS.values()), key=losses.__getitem__)
    declared = passage if declared == closest else declared
    std = curvature_std(
        lambda x: model.loss(Passage(passage.form, float(np.exp(x))), joints), np.log(passage.at), _STEP
    )
    better = _fault(model, passage, declared, found.effect.place, passage.at * std)
    return better if better.gain > found.gain else found


def _forms(evidence: Evidence, joints: Sequence[int]) -> list[str]:
    """Return the forms that the efforts of some joints may have passed. A script that filters a recording without phase
    filters its noise as well: where that is white, none did.
    """
    noises = [t.measured.noise for t in evidence.trajectories]
    coloured = all(noise is not None and all(noise.coloured[joint] for joint in joints) for noise in noises)
    return [form for form in LOW_PASSES if coloured or form not in WITHOUT_PHASE]


def joints_of(found: FittedFault, base: BaseGram) -> list[int]:
    """Return the joints whose effort passes."""
    return list(range(base.power.shape[1])) if found.effect.place is None else [found.effect.joint]


def _of_grid(model: Passages, passes: Mapping[Passage, BaseGram], place: int | None) -> FittedFault:
    joints = list(range(model.base.power.shape[1])) if place is None else [place]
    forms = _forms(model.evidence, joints)
    mixed = {passage: chosen(model.base, made, joints) for passage, made in passes.items() if passage.form in forms}
    losses = {passage: fitted_loss(one, range(len(model.base.power))) for passage, one in mixed.items()}
    best = min(losses, key=losses.__getitem__)
    near = sorted(CUTOFFS, key=lambda f: abs(np.log(f / best.at)))[1]
    names = model.evidence.structure.robot.joints
    found = _fault(model, best, best, None if place is None else names[place], abs(near - best.at) / 2.0)
    return replace(found, held_out=_held_fall(model.base, list(mixed.values())))


def _fault(model: Passages, passage: Passage, declared: Passage, place: str | None, std: float) -> FittedFault:
    """Return a low pass as a fault; declared: the best of those that a robot YAML can tell."""
    robot = model.evidence.structure.robot
    effect = CATALOGUE[NAME](robot, None if place is None else robot.joint_index(place))
    joints = list(range(robot.n)) if place is None else [effect.joint]
    after = model.through(passage, joints)
    everything = range(len(model.base.power))
    return FittedFault(
        effect,
        fitted_loss(model.base, everything) - fitted_loss(after, everything),
        _held_fall(model.base, [after]),
        (Estimate(f"cutoff of {effect.label}", passage.at, std, "Hz"),),
        partial(_columns, passage=passage, joints=joints),
        _fix(place, passage, declared),
        2,
    )


def _passage_of(found: FittedFault) -> Passage:
    """Return the passage of a finding of this file."""
    assert isinstance(found.columns, partial)
    passage = found.columns.keywords["passage"]
    assert isinstance(passage, Passage)
    return passage


def _fix(place: str | None, passage: Passage, declared: Passage) -> str:
    if passage.form in WITHOUT_PHASE:
        whose = "of all joints" if place is None else f"of {place}"
        return (
            f"the effort {whose} was filtered without phase ({passage.form}): record it as it comes, or identify with"
            f" --low-pass {0.7 * passage.at:.2g}"
        )
    order = next(order for order, form in ORDERS.items() if form == declared.form)
    kind = f"anti_alias: {{order: {order}, cutoff: {declared.at:.3g}}}"
    near = "" if passage == declared else f": what comes nearest to a filter of another form ({passage.form})"
    return f"{kind if place is None else f'joints: {{{place}: {{{kind}}}}}'}  # in the robot YAML{near}"


def _held_fall(base: BaseGram, made: Sequence[BaseGram]) -> float:
    """Return the fall of the squared error on trajectories left out, the model chosen on the others."""
    total = 0.0
    for left, train in folds(len(base.power)):
        best = made[0] if len(made) == 1 else made[int(np.argmin([fitted_loss(one, train) for one in made]))]
        total += float(BaseFit.of(base, train).loss(base, left).sum() - BaseFit.of(best, train).loss(best, left).sum())
    return total


def _columns(evidence: Evidence, *, passage: Passage, joints: Sequence[int]) -> tuple[Array, ...]:
    parts = []
    for columns, t in zip(raw_columns(evidence), evidence.trajectories, strict=True):
        changed = columns.copy()
        changed[:, joints] = passage.applied(np.fft.rfft(columns[:, joints], axis=0), t)
        parts.append(changed)
    return weighed(evidence, parts)
