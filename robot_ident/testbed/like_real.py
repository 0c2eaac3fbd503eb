"""Simulated recordings with what real ones have: servo lag, encoder noise and steps, drivers' rates, scales, offsets.

Apart from the plant and from what identifies: the motion is a servo's answer to its reference, the torque is
Pinocchio's recursive Newton-Euler.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from robot_ident.estimation.prediction import predict
from robot_ident.model.model import Model
from robot_ident.recording import Recording
from robot_ident.robot import Robot
from robot_ident.signals.motion import Array, Motion
from robot_ident.testbed.joint_causes import Cause, Course, draw_causes

FINE = 1000.0  # Hz, at which the arm moves
RATES = (50.0, 125.0, 250.0, 500.0, 1000.0)
KINDS = ("periodic", "cyclic", "one pass")

_SETTLING = 2.0  # s, before a recording begins
_SHORT, _LONG = 24.0, 48.0  # s of a recording to fit: enough for a base model, and for causes besides
_ENDS = 0.5  # s at either end of a path, which filters spoil
_A_POSE = 6.0  # s of a recording, for each pose that it passes
_CAUSES = 43  # stream of the random numbers that draw them, apart from all others


@dataclass(frozen=True)
class LikeReal:
    """One arm with its recording to fit, another path to judge by, its exact torque there, and the scales [n] of its
    efforts.

    causes: what acts besides links, plain friction and offsets; hidden [N, causes]: the torque of each along the
    recording to fit.
    """

    seed: int
    kind: str
    rate: float
    train: Recording
    test: Recording
    exact: Array
    scale: Array
    causes: tuple[Cause, ...]
    hidden: Array

    def errors(self, model: Model) -> Array:
        """Return a model's errors [rows, n] along the other path, over the exact torque's standard deviations."""
        predicted = predict(model, self.test)
        exact = np.column_stack([np.interp(predicted.t, self.test.t, x) for x in self.exact.T])
        ends = round(_ENDS / float(np.mean(np.diff(predicted.t))))
        return np.asarray(((predicted.torque - exact) / exact.std(axis=0))[ends:-ends])


def like_real(robot: Robot, seed: int, *, causes: bool = False) -> LikeReal:
    """Return what one seed makes of an arm; causes: with several at every joint but one, and a rest without a name."""
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
    drawn: list[Cause] = []
    path = _path(robot, rng, kind, float(truth["lag"]), _LONG if causes else _SHORT)
    if causes:
        drawn = draw_causes(_course(robot, path), size, np.random.default_rng([seed, _CAUSES]))
    train, _, hidden = _recorded(robot, rng, path, rate, truth, drawn, kind)
    path = _path(robot, rng, "one pass", float(truth["lag"]), 12.0)
    test, exact, _ = _recorded(robot, rng, path, rate, truth, drawn, "one pass")
    return LikeReal(seed, kind, rate, train, test, exact, truth["scale"], tuple(drawn), hidden)


def _size(robot: Robot) -> Array:
    """Return the rms torque [n] of random states, at least a hundredth of the largest."""
    states = np.random.default_rng(0).uniform(-1.0, 1.0, (300, 3, robot.n)) * np.array([1.5, 1.0, 3.0])[:, None]
    rms = np.sqrt(np.mean(_links(robot, states) ** 2, axis=0))
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
        poses = rng.uniform(-0.9, 0.9, (max(4, int(seconds / _A_POSE)), n))
        corner = np.arange(0.0, seconds + 1.5, 1.5)
        course = np.array([poses[k % len(poses)] for k in range(len(corner))])
        move = np.clip((t % 1.5) / 1.2, 0.0, 1.0)
        blend = 10.0 * move**3 - 15.0 * move**4 + 6.0 * move**5
        at = (t / 1.5).astype(int)
        q = course[at] + blend[:, None] * (course[at + 1] - course[at])
    return np.asarray(q + rng.uniform(-0.5, 0.5, n))


def _path(robot: Robot, rng: np.random.Generator, kind: str, lag: float, seconds: float) -> Array:
    """Return q, dq, ddq [N, 3, n] of a servo without feed-forward: critically damped, of second order, late."""
    reference = _reference(rng, kind, robot.n, seconds + _SETTLING)
    w = 1.0 / lag
    q, dq = reference[0].copy(), np.zeros(robot.n)
    path = np.empty((len(reference), 3, robot.n))
    for k, wanted in enumerate(reference):
        ddq = w**2 * (wanted - q) - 2.0 * w * dq
        path[k] = q, dq, ddq
        dq = dq + ddq / FINE
        q = q + dq / FINE
    return path


def _links(robot: Robot, path: Array) -> Array:
    return robot.rigid.inverse_dynamics(Motion(path[:, 0], path[:, 1], path[:, 2]))


def _course(robot: Robot, path: Array) -> Course:
    return Course(path[:, 0], path[:, 1], _links(robot, path), robot.drives.gear_ratio)


def _recorded(
    robot: Robot,
    rng: np.random.Generator,
    whole: Array,
    rate: float,
    truth: dict[str, Array],
    causes: Sequence[Cause],
    source: str,
) -> tuple[Recording, Array, Array]:
    """Return a recording, the torque that it would hold without noise, and that of each cause, at its samples."""
    sampled = slice(round(_SETTLING * FINE), None, round(FINE / rate))  # by the driver, once the servo has settled
    path = whole[sampled]
    speed = path[:, 1]
    hidden, together = np.zeros((len(path), len(causes))), np.zeros(speed.shape)
    if causes:
        course = _course(robot, whole)
        for k, cause in enumerate(causes):
            hidden[:, k] = cause.torque(course)[sampled]
            together[:, cause.joint] += hidden[:, k]
    exact = truth["scale"] * _links(robot, path)
    exact = exact + truth["viscous"] * speed + truth["coulomb"] * np.sign(speed) + truth["offset"]
    exact = exact + together
    tau = exact + truth["noise"] * rng.standard_normal(exact.shape)
    seen = path[:, 0] + truth["encoder"] * rng.standard_normal(exact.shape)
    step = float(truth["step"])
    seen = step * np.round(seen / step) if step else seen
    t = np.arange(len(path)) / rate
    return Recording(robot.joints, t, seen, tau, source=source), exact, hidden
