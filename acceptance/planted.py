"""Truths planted on real recordings: the arm's own motion, the torque of its model, its residual's colour, and effects
in formulas that the product's catalogue does not use.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np
from foreign.memory import dahl, lugre, slipping
from scipy.signal import butter, sosfiltfilt

from robot_ident.estimation.prediction import predict
from robot_ident.model.model import Model
from robot_ident.recording import Recording
from robot_ident.signals.motion import Array, Motion

SMALLEST, LARGEST = 0.5, 3.0  # rms of a planted effect beyond the base model, of the residual's
NONE = 0.2  # of the cases: nothing is planted
Law = Callable[[np.random.Generator, Motion, Array, int], Array]


@dataclass(frozen=True)
class Planted:
    """A recording with planted effects; truth: the share [0, 1] of each in its joint's squared error, by label."""

    recording: Recording
    truth: dict[str, float]


def plant(model: Model, recording: Recording, seed: int) -> Planted:
    """Replace what a model leaves of a recording by noise of its spectrum, and plant up to three effects."""
    rng = np.random.default_rng([seed, 90210])
    predicted = predict(model, recording)
    inside = (recording.t >= predicted.t[0]) & (recording.t <= predicted.t[-1])
    recording = recording[np.flatnonzero(inside)[0] : np.flatnonzero(inside)[-1] + 1]
    torque = np.column_stack([np.interp(recording.t, predicted.t, tau) for tau in predicted.torque.T])
    rest = _surrogate(rng, recording.tau - torque)
    motion = _differentiated(model, recording)
    base = model.structure.columns(motion, model.values)
    load = model.structure.torques(motion, model.values).load
    size, truth, planted = np.std(rest, axis=0), {}, np.zeros_like(torque)
    for _ in range(0 if rng.uniform() < NONE else rng.integers(1, 4)):
        name, joint = str(rng.choice(list(LAWS))), int(rng.integers(len(recording.names)))
        label = f"{name}@{recording.names[joint]}"
        if label in truth or any(one.endswith(f"@{recording.names[joint]}") and rng.uniform() < 0.7 for one in truth):
            continue
        law = _banded(model, LAWS[name](rng, motion, load, joint), recording)
        seen = law - base[:, joint] @ np.linalg.lstsq(base[:, joint], law, rcond=1e-9)[0]
        if np.std(seen) < 0.2 * np.std(law):  # the base model holds nearly all of it
            continue
        factor = np.exp(rng.uniform(np.log(SMALLEST), np.log(LARGEST)))
        planted[:, joint] += factor * size[joint] / np.std(seen) * law
        truth[label] = factor**2
    of_joint = {joint: 1.0 for joint in recording.names}
    for label, square in truth.items():
        of_joint[label.partition("@")[2]] += square
    shares = {label: square / of_joint[label.partition("@")[2]] for label, square in truth.items()}
    return Planted(replace(recording, tau=torque + rest + planted), shares)


def _surrogate(rng: np.random.Generator, rest: Array) -> Array:
    """Return noise of the same spectra and cross spectra (Prichard and Theiler 1994)."""
    lines = np.fft.rfft(rest - rest.mean(axis=0), axis=0)
    turned = lines * np.exp(1j * rng.uniform(0.0, 2.0 * np.pi, len(lines)))[:, None]
    return np.asarray(np.fft.irfft(turned, len(rest), axis=0))


def _differentiated(model: Model, recording: Recording) -> Motion:
    dt = float(np.mean(np.diff(recording.t)))
    wide = model.processing.get("derivative_bandwidth") or model.processing.get("band_derivative") or 20.0
    q = sosfiltfilt(butter(4, min(1.5 * wide, 0.4 / dt), fs=1.0 / dt, output="sos"), recording.q, axis=0)
    dq = np.gradient(q, dt, axis=0)
    return Motion(q, dq, np.gradient(dq, dt, axis=0), dt)


def _banded(model: Model, law: Array, recording: Recording) -> Array:
    """Return a torque as far as the recording's own torque reaches: a driver may have filtered it."""
    dt, band = float(np.mean(np.diff(recording.t))), model.processing.get("band")
    if not band or band >= 0.4 / dt:
        return law
    return np.asarray(sosfiltfilt(butter(2, band, fs=1.0 / dt, output="sos"), law))


def _stribeck(rng: np.random.Generator, motion: Motion, load: Array, j: int) -> Array:
    v = motion.dq[:, j]
    x = np.abs(v) / (rng.uniform(0.03, 0.15) * np.abs(v).max())
    return np.asarray(np.sign(v) * (1 / (1 + x**2) if rng.uniform() < 0.5 else np.exp(-x)))


def _viscous_nonlinear(rng: np.random.Generator, motion: Motion, load: Array, j: int) -> Array:
    v = motion.dq[:, j]
    x = np.abs(v) / np.abs(v).max()
    bend = [x**3, 1 - np.exp(-x / rng.uniform(0.1, 0.3)), np.log1p(x / rng.uniform(0.1, 0.3))][rng.integers(3)]
    return np.asarray(np.sign(v) * bend)


def _presliding(rng: np.random.Generator, motion: Motion, load: Array, j: int) -> Array:
    q, v = motion.q[:, j], motion.dq[:, j]
    reach, dt = np.exp(rng.uniform(np.log(0.003), np.log(0.02))) * np.ptp(q), float(motion.dt or 0.0)
    z = [lambda: lugre(v, reach, dt), lambda: dahl(v, reach, dt), lambda: slipping(q, reach)][rng.integers(3)]()
    return np.asarray(z - np.sign(v))


def _load_friction(rng: np.random.Generator, motion: Motion, load: Array, j: int) -> Array:
    v, ratio = motion.dq[:, j], rng.uniform(0.8, 1.25)
    return np.asarray(np.where(load[:, j] * v > 0, 1.0, ratio) * np.abs(load[:, j]) * np.sign(v))


def _position_friction(rng: np.random.Generator, motion: Motion, load: Array, j: int) -> Array:
    q = motion.q[:, j]
    triangle = 2 / np.pi * np.arcsin(np.cos(q - rng.uniform(-np.pi, np.pi)))
    return np.asarray(np.sign(motion.dq[:, j]) * triangle)


def _torque_ripple(rng: np.random.Generator, motion: Motion, load: Array, j: int) -> Array:
    q = motion.q[:, j]
    order = 2 * np.pi * rng.integers(3, 12) / np.ptp(q)
    angle = order * q + rng.uniform(-np.pi, np.pi)
    return np.asarray(np.sin(angle) + rng.uniform(0.0, 0.2) * np.sin(2 * angle + 1))


def _cable(rng: np.random.Generator, motion: Motion, load: Array, j: int) -> Array:
    bent = (motion.q[:, j] - motion.q[:, j].mean()) / np.ptp(motion.q[:, j]) - rng.uniform(-0.3, 0.3)
    return np.asarray(np.sinh(1.2 * bent))


def _joint_coupling(rng: np.random.Generator, motion: Motion, load: Array, j: int) -> Array:
    others = [k for k in range(motion.joints) if abs(k - j) == 1]
    v = motion.dq[:, int(rng.choice(others))] if others else motion.dq[:, j]
    share = rng.uniform(0.2, 0.9)
    return np.asarray(share * np.tanh(v / (0.02 * np.abs(v).max())) + (1 - share) * v / np.abs(v).max())


def _viscous_asymmetric(rng: np.random.Generator, motion: Motion, load: Array, j: int) -> Array:
    return np.asarray(np.abs(motion.dq[:, j]))


def _torque_saturation(rng: np.random.Generator, motion: Motion, load: Array, j: int) -> Array:
    x = load[:, j] / np.abs(load[:, j]).max()
    return np.asarray(x**3 if rng.uniform() < 0.5 else x * np.tanh(1.5 * np.abs(x)))


LAWS: dict[str, Law] = {
    law.__name__.lstrip("_"): law
    for law in (
        _stribeck,
        _viscous_nonlinear,
        _presliding,
        _load_friction,
        _position_friction,
        _torque_ripple,
        _cable,
        _joint_coupling,
        _viscous_asymmetric,
        _torque_saturation,
    )
}
