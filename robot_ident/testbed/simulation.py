"""The simulated robot, faster than real time: from a reference motion to a recording.

Of a periodic motion in its steady state one period is simulated and played as often as is wanted, with fresh noise.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from robot_ident.errors import InputError
from robot_ident.recording.effort import as_reported
from robot_ident.recording.recording import Recording
from robot_ident.robot.robot import Robot
from robot_ident.signals.motion import Array, Motion
from robot_ident.testbed.phenomena import plant_physics
from robot_ident.testbed.phenomena.phenomenon import Physics, felt_inertia
from robot_ident.testbed.plant import Plant, Steady, Trace, follow, repeats, trace
from robot_ident.testbed.sensors import Readings, Sensors, blend, filtered, read
from robot_ident.testbed.servo import BANDWIDTH, Servo
from robot_ident.trajectories.excitation import Reference
from robot_ident.trajectories.fourier_series import FourierSeries

_MOST_SAMPLES = 10_000_000  # of a recording: 2 GB with the trace beneath it
STEP_RATE = 1500.0
"""Steps a second, at least: a tenth of a sample at 150 Hz."""


@dataclass(frozen=True)
class SimulationResult:
    """A recording and what was true beneath it.

    exact: motion at the samples [N, n]. torque [N, n] Nm: the servos' torque at the samples, before noise and filter.
    effects: the plant's phenomena as `name@joint`. notes: what a user should know.
    """

    recording: Recording
    exact: Motion
    torque: Array
    effects: tuple[str, ...]
    notes: tuple[str, ...]


def simulate(
    robot: Robot,
    reference: Reference,
    *,
    sample_rate: float = 150.0,
    servo: str = "feedforward",
    bandwidth: float = BANDWIDTH,
    step_rate: float | None = None,
    seed: int = 0,
    effects: Sequence[str] = (),
    anti_alias: bool = False,
    steady: tuple[float, float, int] | None = None,
    noise: float = 1.0,
) -> SimulationResult:
    """Return what a robot reports that follows `reference`: t on an even grid, noisy and quantised q, noisy dq and tau.

    sample_rate, step_rate [Hz], the latter a multiple of the former (default: 1500 or just above). `servo` is one of
    `SERVOS`, `bandwidth` [Hz] that of its position controllers. `effects` (`NAME@JOINT[:k=v,...]`) are added to those
    of the robot's description; the servos don't know of them. With `anti_alias` torque and its noise pass the robot's
    filter. With `steady` (transient, period, periods) the recording ends after the last period, the steady state is
    simulated once and repeated with fresh noise. `noise` multiplies the noise variances. The same seed gives the same
    recording. InputError on values that can't be used.
    """
    physics = plant_physics(robot, effects)
    per_sample = steps_per_sample(sample_rate, step_rate, physics)
    _check(robot, reference)
    repeated = None if steady is None else Steady(*steady)
    samples = _samples(reference, sample_rate, repeated)
    drives, step = Servo.make(robot, servo, bandwidth), 1.0 / (sample_rate * per_sample)
    plant, t = Plant(robot, physics, drives, step), np.arange(samples) / sample_rate

    early = max([0.0, *(-p.lateness() for p in physics)])  # torque that is recorded early is that of later steps

    def readings_of(plant: Plant) -> Readings:
        course = trace(plant, reference, samples * per_sample, repeated, int(np.ceil(early / step)) + 1)
        return read(plant, reference.reference, course, per_sample, samples, fine=anti_alias)

    slow = [] if steady is None else [p for p in physics if p.slow]
    readings = readings_of(warmed(plant, None) if slow else plant)
    readings = blend(readings, [(readings_of(warmed(plant, p)), p.share(t)) for p in slow])
    recording = noisy(robot, sample_rate, readings, noise=noise, seed=seed)
    exact = Motion(readings.q, readings.dq, readings.ddq)
    labels = tuple(p.label for p in physics)
    return SimulationResult(recording, exact, readings.torque, labels, _notes(robot, readings.torque))


def steps_per_sample(sample_rate: float, step_rate: float | None = None, physics: Sequence[Physics] = ()) -> int:
    """Return how many steps a sample takes, enough for the phenomena unless a step rate is given.

    InputError where the step rate isn't a multiple of the sample rate.
    """
    if not 0 < sample_rate < np.inf:
        raise InputError(f"sample rate {sample_rate} Hz: a positive number is needed")
    if step_rate is None:
        needed = max([STEP_RATE, *(p.step_rate for p in physics)])
        return int(np.ceil(needed / sample_rate - 1e-9))
    ratio = step_rate / sample_rate
    if not np.isfinite(ratio) or ratio < 0.5 or abs(ratio - round(ratio)) > 1e-9 * ratio:
        raise InputError(f"step rate {step_rate:g} Hz is not a multiple of the sample rate {sample_rate:g} Hz")
    return round(ratio)


def warmed(plant: Plant, done: Physics | None) -> Plant:
    """Return a plant whose slow phenomena are held at their beginning, one of them at its end.

    Friction that changes over many periods passes through states that are steady each for itself; between its first and
    last the torque follows in proportion.
    """
    return replace(plant, physics=tuple(p.held(float(p is done)) if p.slow else p for p in plant.physics))


def _check(robot: Robot, reference: Reference) -> None:
    pose = np.asarray(reference.start_pose)
    if pose.shape != (robot.n,):
        raise InputError(f"the motion moves {pose.size} joints, robot {robot.name} has {robot.n}")
    for name, inertia in zip(robot.joints, felt_inertia(robot, pose), strict=True):
        if not inertia > 1e-12:
            raise InputError(f"robot {robot.name}: nothing that {name!r} moves has inertia; the URDF lacks it")


def _samples(reference: Reference, sample_rate: float, steady: Steady | None) -> int:
    end = reference.duration if steady is None else steady.end
    if not end * sample_rate <= _MOST_SAMPLES:
        raise InputError(
            f"a motion of {end:.4g} s at {sample_rate:g} Hz is too long to simulate: at most"
            f" {_MOST_SAMPLES / sample_rate:.4g} s at this sample rate"
        )
    if steady is None:
        return int(np.floor(end * sample_rate + 1e-6)) + 1
    if steady.periods < 1 or steady.period <= 0 or steady.transient < 0:
        raise InputError(
            f"{steady.periods} periods of {steady.period:g} s after {steady.transient:g} s: nothing to simulate"
        )
    return round(steady.end * sample_rate)


def _notes(robot: Robot, torque: Array) -> tuple[str, ...]:
    share = np.mean(np.abs(torque) >= robot.limits.torque, axis=0)
    return tuple(
        f"{name} is at its torque limit {limit:g} {robot.torque_unit(j)} in {100 * part:.1f} % of the samples"
        for j, (name, limit, part) in enumerate(zip(robot.joints, robot.limits.torque, share, strict=True))
        if part > 0
    )


WARM_UP = 1.0
"""Time [s] before a period in which drives that start on the path settle."""

MOST_PERIODS = 3
"""Periods after which states of phenomena are taken as settled."""


@dataclass(frozen=True)
class Play:
    """A robot's steady answer to a periodic motion, without noise.

    period: readings of one period, slow phenomena at their beginning. ends: those with one of them at its end.
    """

    robot: Robot
    sample_rate: float
    period: Readings
    ends: tuple[tuple[Physics, Readings], ...] = ()

    @classmethod
    def of(
        cls,
        robot: Robot,
        physics: Sequence[Physics],
        series: FourierSeries,
        *,
        sample_rate: float = 150.0,
        servo: Servo | None = None,
    ) -> Play:
        """Simulate a period that is a whole number of samples; `physics` are all phenomena of the plant."""
        per_sample = steps_per_sample(sample_rate, None, physics)
        plant = Plant(robot, tuple(physics), servo or Servo.make(robot), 1.0 / (sample_rate * per_sample))
        slow = [p for p in physics if p.slow]
        start = _steady(warmed(plant, None), series, per_sample, sample_rate)
        ends = [(p, _steady(warmed(plant, p), series, per_sample, sample_rate)) for p in slow]
        return cls(robot, sample_rate, start, tuple(ends))

    def readings(self, periods: int) -> Readings:
        """Return the readings of some periods, slow phenomena passing from one state to the other."""
        start = _repeated(self.period, periods)
        t = np.arange(len(start.q)) / self.sample_rate
        return blend(start, [(_repeated(end, periods), p.share(t)) for p, end in self.ends])

    def record(self, periods: int = 16, *, noise: float = 1.0, seed: int = 0) -> Recording:
        """Return a recording of some steady periods; `noise` multiplies the variances of the robot's noise."""
        return noisy(self.robot, self.sample_rate, self.readings(periods), noise=noise, seed=seed)


def noisy(robot: Robot, sample_rate: float, made: Readings, *, noise: float = 1.0, seed: int = 0) -> Recording:
    """Return the recording of some readings, its torque behind the robot's filter where that of every step is known.

    `noise` multiplies the variances of the robot's noise.
    """
    streams = [np.random.default_rng(s) for s in np.random.SeedSequence(seed).spawn(3)]
    sensors = Sensors.of(robot, sample_rate, noise)
    if made.fine is None:
        tau = sensors.read_torque(made.recorded, streams[0])
    else:
        step = 1.0 / (sample_rate * (len(made.fine) // len(made.q)))
        tau = filtered(robot, made.fine, step, len(made.q), sensors, streams[0])
    q = sensors.read_position(made.shown_q, streams[1])
    return Recording(
        names=robot.joints,
        t=np.arange(len(made.q)) / sample_rate,
        q=q,
        tau=as_reported(tau, q, robot),
        dq=sensors.read_velocity(made.shown_dq, streams[2]),
        source=f"simulation of {robot.name}",
    )


def _repeated(period: Readings, times: int) -> Readings:
    return Readings(*(np.tile(values, (times, 1)) for values in period[:-1]))


def _steady(plant: Plant, series: FourierSeries, per_sample: int, sample_rate: float) -> Readings:
    """Return the readings of one steady period.

    The drives start on the path and have a second to settle; where phenomena have states, periods are run until they
    repeat.
    """
    samples = round(series.period * sample_rate)
    steps, before = samples * per_sample, round(WARM_UP / plant.step)
    state = plant.moving(series.motion(np.array([-before * plant.step])))
    _, state = follow(plant, series.motion, -before, before, state)
    for _ in range(MOST_PERIODS):
        states, after = follow(plant, series.motion, 0, steps, state)
        if not plant.layout.own or repeats(plant, state, after, np.ptp(states, axis=0)):
            break
        state = after
    return read(plant, series.motion, Trace(states, np.arange(steps)), per_sample, samples, periodic=True)
