"""Simulated recordings with what real ones have: servo lag, encoder noise and steps, drivers' rates, scales, offsets.

Apart from the plant and from what identifies: the motion is a servo's answer to its reference, the torque is
Pinocchio's recursive Newton-Euler.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import pinocchio

from robot_ident.recording import Recording
from robot_ident.robot import Robot
from robot_ident.signals.motion import Array

FINE = 1000.0  # Hz, at which the arm moves
RATES = (50.0, 125.0, 250.0, 500.0, 1000.0)
KINDS = ("periodic", "cyclic", "one pass")


@dataclass(frozen=True)
class LikeReal:
    """One arm with its recording to fit, another path to judge by, its exact torque there, and the scales [n] of its
    efforts.
    """

    seed: int
    kind: str
    rate: float
    train: Recording
    test: Recording
    exact: Array
    scale: Array


def like_real(robot: Robot, seed: int) -> LikeReal:
    """Return what one seed makes of an arm."""
    rng = np.random.default_rng(seed)
    n, kind, rate = robot.n, KINDS[seed % 3], float(rng.choice(RATES))
    friction = rng.uniform(0.03, 0.15, (2, n))
    size = _size(robot)
    scaled = bool(rng.integers(2))
    truth = {
        "scale": np.concatenate([[1.0], rng.uniform(0.7, 1.4, n - 1)]) if scaled else np.ones(n),
        "offset": rng.uniform(-0.1, 0.1, n) * size,
        "viscous": friction[0] * size,
        "coulomb": friction[1] * size,
        "noise": rng.uniform(0.005, 0.05) * size,
        "encoder": 10.0 ** rng.uniform(np.log10(5e-5), -3.0),
        "step": float(rng.choice([0.0, 1e-5, 2e-4])),
        "lag": rng.uniform(0.02, 0.08),
    }
    train, _ = _recorded(robot, rng, kind, rate, truth, 24.0)
    test, exact = _recorded(robot, rng, "one pass", rate, truth, 12.0)
    return LikeReal(seed, kind, rate, train, test, exact, truth["scale"])


def _size(robot: Robot) -> Array:
    """Return the rms torque [n] of random states, at least a hundredth of the largest."""
    model, rng = robot.rigid.model, np.random.default_rng(0)
    data = model.createData()
    states = rng.uniform(-1.0, 1.0, (300, 3, robot.n)) * np.array([1.5, 1.0, 3.0])[:, None]
    torque = np.array([pinocchio.rnea(model, data, *state) for state in states])
    rms = np.sqrt(np.mean(torque**2, axis=0))
    return np.asarray(np.maximum(rms, 0.01 * rms.max()))


def _reference(rng: np.random.Generator, kind: str, n: int, seconds: float) -> Array:
    t = np.arange(0.0, seconds, 1.0 / FINE)
    if kind == "periodic":
        base, harmonics = 6.0 / seconds if seconds > 12 else 0.25, np.arange(1, 6)
        rates = np.tile(2.0 * np.pi * base * harmonics, (n, 1))
    else:
        rates = 2.0 * np.pi * rng.uniform(0.05, 0.8, (n, 5))
    amplitude, phase = rng.uniform(0.08, 0.3, (n, 5)), rng.uniform(0.0, 2.0 * np.pi, (n, 5))
    q = np.einsum("jk,tjk->tj", amplitude, np.sin(t[:, None, None] * rates + phase))
    if kind == "cyclic":  # there and back between poses, with rests
        poses = rng.uniform(-0.9, 0.9, (4, n))
        corner = np.arange(0.0, seconds + 1.5, 1.5)
        course = np.array([poses[k % 4] for k in range(len(corner))])
        move = np.clip((t % 1.5) / 1.2, 0.0, 1.0)
        blend = 10.0 * move**3 - 15.0 * move**4 + 6.0 * move**5
        at = (t / 1.5).astype(int)
        q = course[at] + blend[:, None] * (course[at + 1] - course[at])
    return np.asarray(q + rng.uniform(-0.5, 0.5, n))


def _recorded(
    robot: Robot, rng: np.random.Generator, kind: str, rate: float, truth: dict[str, Array], seconds: float
) -> tuple[Recording, Array]:
    """Return a recording and the torque that it would hold without noise, at its samples."""
    reference = _reference(rng, kind, robot.n, seconds + 2.0)
    # a servo without feed-forward: a critically damped second order that lags behind
    w = 1.0 / float(truth["lag"])
    q, dq = reference[0].copy(), np.zeros(robot.n)
    path = np.empty((len(reference), 3, robot.n))
    for k, wanted in enumerate(reference):
        ddq = w**2 * (wanted - q) - 2.0 * w * dq
        path[k] = q, dq, ddq
        dq = dq + ddq / FINE
        q = q + dq / FINE
    path = path[round(2.0 * FINE) :: round(FINE / rate)]
    model, data = robot.rigid.model, robot.rigid.model.createData()
    links = np.array([pinocchio.rnea(model, data, *state) for state in path])
    speed = path[:, 1]
    exact = truth["scale"] * links + truth["viscous"] * speed + truth["coulomb"] * np.sign(speed) + truth["offset"]
    tau = exact + truth["noise"] * rng.standard_normal(exact.shape)
    seen = path[:, 0] + truth["encoder"] * rng.standard_normal(exact.shape)
    step = float(truth["step"])
    seen = step * np.round(seen / step) if step else seen
    t = np.arange(len(path)) / rate
    return Recording(robot.joints, t, seen, tau, source=kind), exact
