"""A periodic motion in its steady state: one period is simulated and played as often as is wanted, with fresh noise."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from robot_ident.excitation.fourier import FourierSeries
from robot_ident.recording.effort import as_reported
from robot_ident.recording.recording import Recording
from robot_ident.robot.robot import Robot
from robot_ident.signals.motion import Array, Motion
from robot_ident.simulation.physics import Physics
from robot_ident.simulation.plant import Plant
from robot_ident.simulation.readings import FIELDS, Readings, blend, read
from robot_ident.simulation.sensors import Sensors
from robot_ident.simulation.servo import Servo
from robot_ident.simulation.simulate import steps_per_sample, warmed
from robot_ident.simulation.trace import Trace, follow, repeats

WARM_UP = 1.0
"""Time [s] before a period in which drives that start on the path settle."""

MOST_PERIODS = 3
"""Periods after which states of phenomena are taken as settled."""


@dataclass(frozen=True)
class Endless:
    """A Fourier series as a reference without beginning or end."""

    series: FourierSeries

    @property
    def duration(self) -> float:
        """One period [s]."""
        return self.series.period

    @property
    def start_pose(self) -> Array:
        """Position at time 0 [n]."""
        return np.asarray(self.reference(np.zeros(1)).q[0])

    def reference(self, t: Array) -> Motion:
        """Return the motion at instants t [N] s."""
        return self.series.motion(t)


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
        step_rate: float | None = None,
        servo: Servo | None = None,
    ) -> Play:
        """Simulate a period that is a whole number of samples; `physics` are all phenomena of the plant."""
        per_sample = steps_per_sample(sample_rate, step_rate, physics)
        plant = Plant(robot, tuple(physics), servo or Servo.make(robot), 1.0 / (sample_rate * per_sample))
        slow = [p for p in physics if p.slow]
        start = _steady(warmed(plant, None), series, per_sample, sample_rate)
        ends = [(p, _steady(warmed(plant, p), series, per_sample, sample_rate)) for p in slow]
        return cls(robot, sample_rate, start, tuple(ends))

    def readings(self, periods: int) -> Readings:
        """Return the readings of some periods, slow phenomena passing from one state to the other."""
        start = _repeated(self.period, periods)
        t = np.arange(len(start.q)) / self.sample_rate
        return blend(start, [(_repeated(end, periods), p.share(t)) for p, end in self.ends]) if self.ends else start

    def record(self, periods: int = 16, *, noise: float = 1.0, seed: int = 0) -> Recording:
        """Return a recording of some steady periods; `noise` multiplies the variances of the robot's noise."""
        return noisy(self.robot, self.sample_rate, self.readings(periods), noise=noise, seed=seed)


def noisy(robot: Robot, sample_rate: float, made: Readings, *, noise: float = 1.0, seed: int = 0) -> Recording:
    """Return the recording of some readings; `noise` multiplies the variances of the robot's noise."""
    streams = [np.random.default_rng(s) for s in np.random.SeedSequence(seed).spawn(3)]
    sensors = Sensors.of(robot, sample_rate, noise)
    q = sensors.read_position(made.shown_q, streams[1])
    return Recording(
        names=robot.joints,
        t=np.arange(len(made.q)) / sample_rate,
        q=q,
        tau=as_reported(sensors.read_torque(made.recorded, streams[0]), q, robot),
        dq=sensors.read_velocity(made.shown_dq, streams[2]),
        source=f"simulation of {robot.name}",
    )


def _repeated(period: Readings, times: int) -> Readings:
    return Readings(**{name: np.tile(getattr(period, name), (times, 1)) for name in FIELDS})


def _steady(plant: Plant, series: FourierSeries, per_sample: int, sample_rate: float) -> Readings:
    """Return the readings of one steady period.

    The drives start on the path and have a second to settle; where phenomena have states, periods are run until they
    repeat.
    """
    samples = round(series.period * sample_rate)
    steps, before, reference = samples * per_sample, round(WARM_UP / plant.step), Endless(series)
    state = plant.moving(reference.reference(np.array([-before * plant.step])))
    _, state = follow(plant, reference, -before, before, state)
    for _ in range(MOST_PERIODS):
        states, after = follow(plant, reference, 0, steps, state)
        if not plant.layout.own or repeats(plant, state, after, np.ptp(states, axis=0)):
            break
        state = after
    return read(plant, reference, Trace(states, np.arange(steps)), per_sample, samples, periodic=True)
