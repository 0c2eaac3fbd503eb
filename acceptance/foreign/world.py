"""The simulated robot: a servo that follows imperfectly, exact inverse dynamics along what it does, noisy sensors."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from foreign.arm import (
    ARMATURE,
    COULOMB,
    POSITION_VARIANCE,
    TORQUE_VARIANCE,
    VISCOUS,
    Array,
    Path,
    differentiated,
    links_torque,
    regressor,
)

SAMPLE_RATE = 150.0
FINE = 10  # steps of the simulation a sample


@dataclass(frozen=True)
class Scene:
    """One period of the robot's motion without anything hidden.

    links, load, torque [N, 3] Nm: what moves the links, what their gears carry, what the drives give, friction and
    rotors included. number: which motion it is.
    """

    path: Path
    links: Array
    torque: Array
    number: int

    @property
    def load(self) -> Array:
        return self.links


@dataclass(frozen=True)
class Seen:
    """What sensors would read without noise: position and torque [N, 3] on the fine grid.

    later: torque once all has warmed up, where that differs; slow: time constant of that [s].
    """

    q: Array
    torque: Array
    later: Array | None = None
    slow: float = 1.0


Hidden = Callable[[Scene, float], Seen]
"""What a hidden effect of a size shows along a scene."""


def series(content: Mapping[str, Any], steps: int) -> tuple[Array, float]:
    """Return positions [steps, 3] of an excitation file's Fourier series, and its period [s] (eq. (11))."""
    w, period = 2 * np.pi * content["base_frequency"], 1.0 / content["base_frequency"]
    t = np.arange(steps) * period / steps
    q = np.tile(np.array(content["q0"], dtype=float), (steps, 1))
    for number, (a, b) in enumerate(zip(np.array(content["a"]).T, np.array(content["b"]).T, strict=True), 1):
        q += np.outer(np.sin(w * number * t), a / (w * number)) - np.outer(np.cos(w * number * t), b / (w * number))
    return q, period


@dataclass(frozen=True)
class Servo:
    """How the drives fall short of their reference: a lag of two poles at `bandwidth` [Hz], made up for by the
    feedforward but for a share `lag`, and `yielding` [rad/Nm] to friction.
    """

    bandwidth: float
    lag: float
    yielding: float

    @classmethod
    def draw(cls, rng: np.random.Generator) -> Servo:
        return cls(rng.uniform(4.0, 12.0), rng.uniform(0.0, 0.5), 10 ** rng.uniform(-6.5, -5.3))

    def follow(self, q: Array, period: float) -> Path:
        """Return the motion that the robot makes of positions [N, 3]."""
        wished = differentiated(q, period)
        f = np.arange(len(q) // 2 + 1)[:, None] / period
        pole = 1.0 / (1.0 + 1j * f / self.bandwidth)
        friction = COULOMB * np.sign(wished.dq) + VISCOUS * wished.dq
        lines = np.fft.rfft(q, axis=0) * (1 - self.lag + self.lag * pole**2)
        lines -= self.yielding * np.fft.rfft(friction, axis=0) * pole**4
        return differentiated(np.fft.irfft(lines, len(q), axis=0), period)


def scenes(motions: Sequence[Mapping[str, Any]], servo: Servo) -> list[Scene]:
    """Return the robot's motions along several excitations."""
    out = []
    for number, content in enumerate(motions):
        steps = round(SAMPLE_RATE / content["base_frequency"]) * FINE
        path = servo.follow(*series(content, steps))
        links = links_torque(path)
        torque = links + ARMATURE * path.ddq + VISCOUS * path.dq + COULOMB * np.sign(path.dq)
        out.append(Scene(path, links, torque, number))
    return out


def left_over(made: Sequence[Scene], hidden: Hidden, size: float) -> Array:
    """Return what the best model without the hidden effect leaves, rms [3] Nm, torque weighed with its noise."""
    weight = 1 / np.sqrt(TORQUE_VARIANCE)
    phi, tau = [], []
    for scene in made:
        seen = hidden(scene, size)
        path = differentiated(seen.q[::FINE], scene.path.period).every(3)
        torque = seen.torque[:: 3 * FINE]
        if seen.later is not None:  # warm by the middle of the recording
            torque = (torque + seen.later[:: 3 * FINE]) / 2
        phi.append(regressor(path))
        tau.append(torque)
    columns, torque = np.concatenate(phi), np.concatenate(tau)
    solved = np.linalg.lstsq(
        (columns * weight[:, None]).reshape(-1, columns.shape[2]), (torque * weight).ravel(), rcond=1e-9
    )[0]
    return np.sqrt(np.mean((torque - columns @ solved) ** 2, axis=0))


def sized(made: Sequence[Scene], hidden: Hidden, target: float, start: float) -> tuple[float, Array]:
    """Return the size at which an effect leaves `target` Nm rms on one joint, within a tenth, and what is left."""
    size = start
    left = left_over(made, hidden, size)
    for _ in range(6):
        ratio = target / max(float(left.max()), 1e-9)
        if abs(np.log(ratio)) < 0.1:
            break
        size *= float(np.clip(ratio, 0.2, 5.0))
        left = left_over(made, hidden, size)
    return size, left


def recorded(
    scene: Scene, hidden: Hidden, size: float, *, periods: int, noise: float, rng: np.random.Generator
) -> tuple[Array, Array, Array]:
    """Return t [N], q, tau [N, 3] of several periods; `noise` multiplies the variances of the paper."""
    seen = hidden(scene, size)
    q, torque = np.tile(seen.q[::FINE], (periods, 1)), np.tile(seen.torque[::FINE], (periods, 1))
    t = np.arange(len(q)) / SAMPLE_RATE
    if seen.later is not None:
        torque += (np.tile(seen.later[::FINE], (periods, 1)) - torque) * (1 - np.exp(-t / seen.slow))[:, None]
    q = q + rng.standard_normal(q.shape) * np.sqrt(noise * POSITION_VARIANCE)
    torque += rng.standard_normal(q.shape) * np.sqrt(noise * TORQUE_VARIANCE)
    return t, q, torque
