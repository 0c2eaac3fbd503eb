"""How large a phenomenon is to the eye of identification: what a refitted model without it leaves."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import NamedTuple

import numpy as np

from robot_ident.model.structure import Structure
from robot_ident.recording.measurement import Processing
from robot_ident.recording.periodic import direction_known, trusted, velocity_noise
from robot_ident.robot.robot import Robot
from robot_ident.signals.fourier import above_noise, evaluate, lines_of_grid
from robot_ident.signals.motion import Array, Mask, Motion, joined
from robot_ident.testbed.phenomena.phenomenon import Physics, home_pose, strength
from robot_ident.testbed.sensors import Readings, Sensors
from robot_ident.testbed.simulation import Play
from robot_ident.trajectories.fourier_series import FourierSeries

PERIODS = 16
"""Periods whose mean a phenomenon has to be seen in."""

TRIES = 6
TOLERANCE = 0.12
"""How near the visible residual comes to what was wanted."""

FASTEST = 1.5
"""Power of size with which the residual is taken to rise at most, where it is judged whether a size can be reached."""

STEEPEST = 3.0
"""Bound on how fast the residual is taken to rise with size, as a power."""


class Calibrated(NamedTuple):
    """A phenomenon of the size that was wanted, or as near to it as it may be; visible [n] Nm rms by joint."""

    physics: Physics
    visible: Array


def standard_motions(robot: Robot, count: int = 2) -> list[FourierSeries]:
    """Return random periodic motions (five harmonics of 0.1 Hz) that fill 85 % of a robot's limits, workspace aside.

    They are the same whenever they are asked for: what is drawn for them doesn't depend on a user's own motion.
    """
    rng, base, out = np.random.default_rng(361), 0.1, []
    limits, middle = robot.limits, home_pose(robot)
    room = np.minimum(limits.upper - middle, middle - limits.lower)
    room = np.where(np.isfinite(room), np.minimum(room, 2.0), 1.5)
    speed = np.where(np.isfinite(limits.velocity), np.minimum(limits.velocity, 2.0), 1.0)
    push = np.where(np.isfinite(limits.acceleration), limits.acceleration, 4.0)
    for _ in range(count):
        a, b = rng.standard_normal((2, robot.n, 5))
        motion = FourierSeries(base, np.zeros(robot.n), a, b).motion(np.linspace(0, 1 / base, 400, endpoint=False))
        largest = [np.abs(part).max(axis=0) for part in (motion.q, motion.dq, motion.ddq)]
        factor = 0.85 * np.min([limit / peak for limit, peak in zip((room, speed, push), largest, strict=True)], axis=0)
        out.append(FourierSeries(base, middle, a * factor[:, None], b * factor[:, None]))
    return out


def pooled(motions: Sequence[FourierSeries]) -> Motion:
    """Return periods of several motions one after the other."""
    return joined([m.motion(np.linspace(0, m.period, 500, endpoint=False)) for m in motions])


def torque_scale(robot: Robot) -> Array:
    """Return in what unit [n] Nm the torques of a robot's joints are alike: their noise, where unknown their limit."""
    noise = np.sqrt(robot.noise.torque_variance)
    limit = [strength(robot, j) for j in range(robot.n)]
    return np.asarray(np.where(np.isfinite(noise) & (noise > 0), noise, limit))


def visible(structure: Structure, plays: Sequence[Play]) -> Array:
    """Return the rms [n] Nm of what the model leaves of all plays' exact torque after one weighted fit.

    Rows and motion are those that a recording of `PERIODS` periods gives: of each Fourier line of the positions the
    share that their noise leaves, without the rows where the direction is not certain. Slow phenomena count with their
    beginning and their end.
    """
    made = [(play, readings) for play in plays for readings in (play.period, *(end for _, end in play.ends))]
    measured = [_measured(readings, play) for play, readings in made]
    counts = np.concatenate([known for _, known in measured])
    torque = np.concatenate([readings.recorded for _, readings in made])
    weight = counts / torque_scale(structure.robot)
    columns = structure.columns(joined([motion for motion, _ in measured]))
    phi = (columns * weight[:, :, None]).reshape(-1, columns.shape[2])
    theta, *_ = np.linalg.lstsq(phi, (torque * weight).ravel(), rcond=None)
    left = np.where(counts, torque - columns @ theta, 0.0)
    return np.asarray(np.sqrt(np.sum(left**2, axis=0) / np.maximum(np.sum(counts, axis=0), 1)))


def _measured(made: Readings, play: Play) -> tuple[Motion, Mask]:
    """Return the motion of one steady period as its Fourier lines tell beside noise, and the rows [N, n] that count."""
    samples, frequency = len(made.shown_q), play.sample_rate / len(made.shown_q)
    sensors = Sensors.of(play.robot, play.sample_rate)
    variance = sensors.position**2 / PERIODS
    lines = lines_of_grid(made.shown_q)
    strong = above_noise(lines, variance, samples)
    power = np.abs(lines) ** 2 * samples / (4.0 * np.maximum(variance, 1e-300))
    share = np.where(strong, 1.0, power / (1.0 + power))
    q, dq, ddq = (evaluate(share * lines, samples, frequency, derivative) for derivative in (0, 1, 2))
    motion = Motion(q, dq, ddq)
    counts = trusted(motion, play.robot, Processing(), velocity_noise(share, variance, frequency, samples))
    return motion, counts & direction_known(motion, strong, variance, frequency, 1.0 / play.sample_rate)


def calibrate(
    physics: Physics,
    target: float,
    play: Callable[[Physics], Sequence[Play]],
    structure: Structure,
    *,
    tolerance: float = TOLERANCE,
    least: float = 0.0,
) -> Calibrated:
    """Return a phenomenon scaled so that the joint that shows it best has `target` Nm rms left, within a tolerance.

    `play` simulates the robot with it. The size is found by secants of the logarithms, and stays between `smallest`
    and `largest` times that of `physics`: what is visible then may be another than wanted. The search ends early
    where `least` [Nm rms] is out of reach.
    """
    size, past = 1.0, (0.0, 0.0)
    for attempt in range(TRIES):
        scaled = physics.scaled(size)
        left = visible(structure, play(scaled))
        ratio = float(left.max()) / target
        edge = physics.largest if ratio < 1 else physics.smallest
        if abs(ratio - 1) < tolerance or size == edge or ratio == 0.0:
            break
        if attempt == 0 and ratio * target * physics.largest**FASTEST < least:
            break
        now = (float(np.log(size)), float(np.log(ratio)))
        power = 1.0
        if attempt and now[0] != past[0]:
            power = float(np.clip((now[1] - past[1]) / (now[0] - past[0]), 1 / STEEPEST, STEEPEST))
        # Four digits: the same size on machines whose last digits differ.
        past, size = now, float(f"{np.exp(now[0] - now[1] / power):.4g}")
        size = min(max(size, physics.smallest), physics.largest)
    return Calibrated(scaled, left)
