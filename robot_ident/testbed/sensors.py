"""What is read of the simulated arm: noise and quantisation, the causal low pass in front of the torque converter, and
what a torque sensor behind the gear feels, which is what the links need without the losses and rotors before it.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any, NamedTuple

import casadi as ca
import numpy as np

from robot_ident.errors import InputError
from robot_ident.robot.anti_alias import AntiAlias
from robot_ident.robot.robot import Robot
from robot_ident.signals.motion import Array, Motion
from robot_ident.testbed.phenomena.phenomenon import Instant, Physics
from robot_ident.testbed.plant import Plant, Trace
from robot_ident.testbed.vectorised import vectorised


@dataclass(frozen=True)
class Sensors:
    """Independent Gaussian noise of each sample (Swevers et al. 1997, eq. 2), then the encoder's steps.

    torque [n] Nm, position [n] rad and velocity [n] rad/s: standard deviations; encoder_step [n] rad, 0 where there is
    none. Velocity is the drive's own: noise as of a difference of two position readings one sample apart, without its
    delay.
    """

    torque: Array
    position: Array
    velocity: Array
    encoder_step: Array

    @classmethod
    def of(cls, robot: Robot, sample_rate: float, noise: float = 1.0) -> Sensors:
        """Return a robot's sensors at a sample rate [Hz]; `noise` multiplies its variances, unknown ones are none."""
        if not 0 <= noise < np.inf:
            raise InputError(f"noise {noise}: a factor of the robot's noise variance, not negative, is needed")
        torque = noise * np.nan_to_num(robot.noise.torque_variance)
        position = noise * np.nan_to_num(robot.noise.position_variance)
        step = robot.drives.encoder_step
        velocity = 2 * (position + step**2 / 12) * sample_rate**2
        return cls(np.sqrt(torque), np.sqrt(position), np.sqrt(velocity), step)

    def read_position(self, q: Array, rng: np.random.Generator) -> Array:
        """Return noisy and quantised positions of q [..., n] rad."""
        noisy = q + self.position * rng.standard_normal(q.shape)
        step = np.where(self.encoder_step > 0, self.encoder_step, 1.0)
        return np.where(self.encoder_step > 0, np.round(noisy / step) * step, noisy)

    def read_velocity(self, dq: Array, rng: np.random.Generator) -> Array:
        """Return noisy velocities of dq [..., n] rad/s."""
        return dq + self.velocity * rng.standard_normal(dq.shape)

    def read_torque(self, tau: Array, rng: np.random.Generator) -> Array:
        """Return noisy torques of tau [..., n] Nm."""
        return tau + self.torque * rng.standard_normal(tau.shape)


PAPER = AntiAlias(order=8, cutoff=40.0)
"""The filter of the paper's section V: a delay of 20 ms at low frequency."""


def low_pass(kind: AntiAlias, values: Array, rate: float) -> Array:
    """Return values [N, n], sampled at `rate` [Hz], behind the filter, which has settled on the first value.

    Discretised by the bilinear rule with its -3 dB kept in place; `rate` far above the cutoff.
    """
    from scipy import signal

    warp = rate / (np.pi * kind.cutoff) * np.tan(np.pi * kind.cutoff / rate)
    poles = warp * kind.poles
    sections = signal.zpk2sos(*signal.bilinear_zpk([], poles, np.real(np.prod(-poles)), rate))
    settled = signal.sosfilt_zi(sections)[:, :, None] * values[0]
    filtered, _ = signal.sosfilt(sections, values, axis=0, zi=settled)
    return np.asarray(filtered)


def filtered(
    robot: Robot, torque: Array, step: float, samples: int, sensors: Sensors, rng: np.random.Generator
) -> Array:
    """Return the noisy torque [samples, n] behind each joint's filter, of the torque [N, n] at steps of `step` seconds.

    The paper's filter on all joints where the robot declares none. The noise is that of the samples without a filter,
    from the same generator, as the smooth signal through them that holds nothing above half of the sample rate
    (Shannon): inverting the filter gives the very same noise back. InputError when a cutoff isn't below half of the
    step rate.
    """
    rate, kinds = 1.0 / step, robot.anti_alias if any(robot.anti_alias) else (PAPER,) * robot.n
    for kind in kinds:
        if kind and kind.cutoff >= rate / 2:
            raise InputError(
                f"anti-alias filter: cutoff {kind.cutoff:g} Hz is not below half of the step rate, {rate:g} Hz"
            )
    noise = sensors.read_torque(np.zeros((samples, torque.shape[1])), rng)
    fine = torque + _through(noise, len(torque))
    settled = np.concatenate([torque[:1], fine])  # the filter has settled on the first torque, not on its noise
    columns = [low_pass(k, x[:, None], rate) if k else x[:, None] for k, x in zip(kinds, settled.T, strict=True)]
    return np.hstack(columns)[1 :: len(torque) // samples]


def _through(x: Array, steps: int) -> Array:
    """Return the band-limited signal through samples x [N, n] at `steps` even instants, a multiple of N."""
    lines = np.fft.rfft(x, axis=0)
    if len(x) % 2 == 0:
        lines[-1] *= 0.5
    return np.fft.irfft(lines, steps, axis=0) * (steps / len(x))


def link_torque(robot: Robot, physics: Sequence[Physics], motion: Motion) -> Array:
    """Return the torque [N, n] Nm that the links need along their true motion: rigid bodies without rotors, and the
    phenomena that act on links.

    Raises InputError where one of these has a memory or shifts the links against the motors: it isn't simulated here.
    """
    q, v, a = (ca.SX.sym(name, robot.n) for name in ("q", "v", "a"))
    parts, nothing = [ca.vertsplit(x) for x in (q, v, a)], [ca.SX(0)] * robot.n
    added, level = ca.SX.zeros(robot.n), ca.SX.zeros(robot.n)
    for one in physics:
        if one.shaft or (one.side == "link" and one.states):
            raise InputError(f"{one.label} can't be simulated where effort is measured on the link side")
        if one.side == "link":
            one.contribution(Instant(parts[0], parts[1], parts[2], nothing, moved=nothing)).add_to(added, level, v, a)
    function = vectorised(ca.Function("added", [q, v, a], [added + level * ca.sign(v)]))
    (torque,) = function(motion.q, motion.dq, motion.ddq)
    return torque + robot.rigid.inverse_dynamics(motion) - robot.drives.armature * motion.ddq


Steps = np.ndarray[Any, np.dtype[np.int64]]


class Readings(NamedTuple):
    """Arrays [N, n] at the samples, without noise.

    q, dq, ddq: true motion of the joints. shown_q, shown_dq, shown_ddq: that of the encoders. torque: of the drives.
    recorded: what is measured of it where the robot measures, late or early. fine: that at every step, None unless it
    was asked for.
    """

    q: Array
    dq: Array
    ddq: Array
    shown_q: Array
    shown_dq: Array
    shown_ddq: Array
    torque: Array
    recorded: Array
    fine: Array | None = None


def blend(start: Readings, ends: Sequence[tuple[Readings, Array]]) -> Readings:
    """Return readings that go from a start toward ends, each by a share [N] at each sample of its own."""
    values, fine = [x.copy() for x in start[:-1]], None if start.fine is None else start.fine.copy()
    for end, share in ends:
        for value, first, last in zip(values, start[:-1], end[:-1], strict=True):
            value += share[:, None] * (last - first)
        if fine is not None and start.fine is not None and end.fine is not None:
            at = np.arange(len(fine)) * (len(share) / len(fine))
            fine += np.interp(at, np.arange(len(share)), share)[:, None] * (end.fine - start.fine)
    return Readings._make([*values, fine])


def read(
    plant: Plant,
    reference: Callable[[Array], Motion],
    course: Trace,
    per_sample: int,
    samples: int,
    *,
    fine: bool = False,
    periodic: bool = False,
) -> Readings:
    """Return the readings at `samples` samples of a course; those of repeated periods are computed once.

    periodic: the course is a whole period, before and after which it repeats.
    """
    steps, which = np.unique(course.rows[: samples * per_sample : per_sample], return_inverse=True)
    states = course.states[steps]
    torque = _drives(plant, reference, states, steps)
    ddq = plant.accelerations(states, torque)
    shown = plant.shown(states, ddq)
    parts = plant.layout.joints(states)
    recorded = torque[which]
    late, every = np.zeros(plant.robot.n), None  # s, by joint
    for one in plant.physics:
        late[slice(None) if one.place is None else one.joint] += one.lateness()
    if fine or late.any():
        whole = _drives(plant, reference, course.states, np.arange(len(course.states)))
        every = _shifted(whole, course.rows, late / plant.step, periodic)[: samples * per_sample]
        recorded = every[::per_sample]
    sensed = [joint for joint in range(plant.robot.n) if plant.robot.side(joint) == "link"]
    if sensed:
        if fine or late[sensed].any():
            raise InputError("a filter or a delay can't be simulated where effort is measured on the link side")
        recorded = np.array(recorded)
        links = link_torque(plant.robot, plant.physics, Motion(parts.q, parts.v, ddq))
        recorded[:, sensed] = links[which][:, sensed]
    values = (parts.q, parts.v, ddq, shown.q, shown.dq, shown.ddq, torque)
    return Readings._make([*(value[which] for value in values), recorded, every if fine else None])


def _drives(plant: Plant, reference: Callable[[Array], Motion], states: Array, steps: Steps) -> Array:
    """Return the drives' torque [U, n] at states of given steps."""
    wanted = reference(np.asarray(steps * plant.step, dtype=float))
    shown = plant.shown(states, np.zeros(wanted.q.shape))
    return plant.servo.torque(wanted, shown.q, shown.dq)


def _shifted(torque: Array, rows: Steps, late: Array, periodic: bool) -> Array:
    """Return the torque [N, n] of steps `rows`, each joint's late by a number of steps, linear between steps."""
    out = np.empty((len(rows), torque.shape[1]))
    at = np.arange(len(rows), dtype=float)
    for j, delay in enumerate(late):
        out[:, j] = np.interp(at - delay, at, torque[rows, j], period=len(rows) if periodic else None)
    return out
