"""Faults of measuring, hidden in recordings of a simulated robot: not the arm is otherwise, what is written down is.

Each is put into the readings or into the finished recording by a formula of its own, apart from those by which
diagnosis looks for it.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import ClassVar

import numpy as np

from robot_ident.recording.recording import Recording
from robot_ident.robot.rigid_body import RigidBody
from robot_ident.robot.robot import Robot
from robot_ident.testbed.phenomena import plant_physics
from robot_ident.testbed.phenomena.mechanics import Payload
from robot_ident.testbed.phenomena.phenomenon import arm_mass, between, either_sign
from robot_ident.testbed.sensors import Readings
from robot_ident.testbed.servo import Servo
from robot_ident.testbed.simulation import Play, noisy
from robot_ident.trajectories.fourier_series import FourierSeries

FLIPPED = 0.25
"""Share of wrong gains that are a wrong sign."""


@dataclass(frozen=True)
class MeasuringFault(ABC):
    """A fault at one joint, or (joint None) of the whole chain; `values` as `k=v` of its text."""

    joint: int | None
    values: Mapping[str, float]
    name: ClassVar[str]

    @classmethod
    @abstractmethod
    def draw(cls, robot: Robot, rng: np.random.Generator, recordings: int) -> MeasuringFault:
        """Return one as it occurs, for a number of recordings."""

    def label(self, robot: Robot) -> str:
        """Return `name@joint`, or `name`."""
        return self.name if self.joint is None else f"{self.name}@{robot.joints[self.joint]}"

    def text(self, robot: Robot) -> str:
        """Return it in full: `name@joint:k=v,...`."""
        return f"{self.label(robot)}:" + ",".join(f"{key}={value!r}" for key, value in self.values.items())

    def plant(self, robot: Robot) -> Robot:
        """Return the robot as it really is."""
        return robot

    def effects(self, robot: Robot, number: int) -> Sequence[str]:
        """Return what else the plant has in a recording, as `NAME@JOINT:k=v,...`."""
        return ()

    def read(self, readings: Readings, rate: float, rng: np.random.Generator) -> Readings:
        """Return what is sampled."""
        return readings

    def written(self, recording: Recording, rng: np.random.Generator) -> Recording:
        """Return what is written down."""
        return recording


class EffortGain(MeasuringFault):
    """An effort that is reported in too large or too small a unit, or with the wrong sign: tau_j becomes g tau_j."""

    name = "effort_gain"

    @classmethod
    def draw(cls, robot: Robot, rng: np.random.Generator, recordings: int) -> EffortGain:
        """Return a gain 5 to 60 % off, or a sign."""
        size = float(np.exp(either_sign(rng) * between(rng, 0.05, 0.6)))
        flipped = float(rng.random()) < FLIPPED
        return cls(int(rng.integers(robot.n)), {"gain": -1.0 if flipped else size})

    def written(self, recording: Recording, rng: np.random.Generator) -> Recording:
        """Return it with one effort multiplied."""
        factor = np.ones(recording.tau.shape[1])
        factor[self.joint] = self.values["gain"]
        return replace(recording, tau=recording.tau * factor)


class UnmodelledPayload(MeasuringFault):
    """A tool or a load that the arm carries in some of the recordings, and nobody wrote down."""

    name = "payload"

    @classmethod
    def draw(cls, robot: Robot, rng: np.random.Generator, recordings: int) -> UnmodelledPayload:
        """Return 2 to 8 % of the arm's mass off the flange, in one of the recordings."""
        place = {axis: float(rng.uniform(-0.1, 0.1)) for axis in ("x", "y", "z")}
        loaded = float(rng.integers(recordings))
        return cls(None, {"payload": arm_mass(robot) * between(rng, 0.02, 0.08), **place, "recording": loaded})

    def effects(self, robot: Robot, number: int) -> Sequence[str]:
        """Return the load where it is carried."""
        if number != int(self.values["recording"]):
            return ()
        return (Payload(robot, None, {key: v for key, v in self.values.items() if key != "recording"}).text,)


class EffortFilter(MeasuringFault):
    """A low pass that the driver puts over the effort alone: a causal filter, as steps of 1 ms would compute it."""

    name = "effort_filter"

    @classmethod
    def draw(cls, robot: Robot, rng: np.random.Generator, recordings: int) -> EffortFilter:
        """Return one of first or second order at 3 to 30 Hz, of one joint or of all."""
        joint = None if rng.random() < 0.5 else int(rng.integers(robot.n))
        return cls(joint, {"cutoff": between(rng, 3.0, 30.0), "order": float(rng.integers(1, 3))})

    def written(self, recording: Recording, rng: np.random.Generator) -> Recording:
        """Return it filtered; it has settled on the first sample."""
        from scipy import signal

        joints = slice(None) if self.joint is None else [self.joint]
        rate = 1.0 / float(np.median(np.diff(recording.t)))
        sections = signal.butter(int(self.values["order"]), self.values["cutoff"], fs=rate, output="sos")
        tau = recording.tau.copy()
        settled = signal.sosfilt_zi(sections)[:, :, None] * tau[0, joints]
        tau[:, joints], _ = signal.sosfilt(sections, tau[:, joints], axis=0, zi=settled)
        return replace(recording, tau=tau)


class StampJitter(MeasuringFault):
    """Samples that are not from the instants of their stamps: taken unevenly and stamped as if they weren't, or taken
    evenly and stamped late.
    """

    name = "stamp_jitter"

    @classmethod
    def draw(cls, robot: Robot, rng: np.random.Generator, recordings: int) -> StampJitter:
        """Return 0.2 to 2 ms rms, half of them late stamps."""
        return cls(None, {"jitter": between(rng, 2e-4, 2e-3), "late": float(rng.integers(2))})

    def read(self, readings: Readings, rate: float, rng: np.random.Generator) -> Readings:
        """Return the readings of instants off the clock, by cubic splines through those on it."""
        from scipy.interpolate import CubicSpline

        if self.values["late"]:
            return readings
        samples = len(readings.q)
        at = np.arange(samples) + self.values["jitter"] * rate * rng.standard_normal(samples)
        at = np.clip(at, 0.0, samples - 1.0)
        return Readings(*(CubicSpline(np.arange(samples), values, axis=0)(at) for values in readings[:-1]))

    def written(self, recording: Recording, rng: np.random.Generator) -> Recording:
        """Return it with stamps that come late, by a gamma distribution's time; none overtakes another."""
        if not self.values["late"]:
            return recording
        late = rng.gamma(2.0, self.values["jitter"] / np.sqrt(2.0), recording.samples)
        least = 1e-6 * np.arange(recording.samples)
        return replace(recording, t=np.maximum.accumulate(recording.t + late - least) + least)


class LinkLength(MeasuringFault):
    """A joint that is mounted elsewhere than the URDF says: its origin in the frame before is off by (x, y, z).

    Base parameters absorb most of it, and all of it along the joint's own axis or that of the joint before: 50 mm leave
    at most 0.15 Nm rms of the KUKA's torque.
    """

    name = "link_length"

    @classmethod
    def draw(cls, robot: Robot, rng: np.random.Generator, recordings: int) -> LinkLength:
        """Return 5 to 50 mm along a random direction, at any joint that another one moves."""
        direction = rng.standard_normal(3)
        moved = between(rng, 0.005, 0.05) * direction / np.linalg.norm(direction)
        joint = int(rng.integers(1, robot.n)) if robot.n > 1 else 0
        return cls(joint, dict(zip(("x", "y", "z"), moved.tolist(), strict=True)))

    def plant(self, robot: Robot) -> Robot:
        """Return the robot with the joint where it really is."""
        model = robot.rigid.model.copy()
        placement = model.jointPlacements[1 + (self.joint or 0)]
        placement.translation = placement.translation + np.array([self.values[axis] for axis in "xyz"])
        return replace(robot, rigid=RigidBody(model))


FAULTS: dict[str, type[MeasuringFault]] = {
    fault.name: fault for fault in (EffortGain, UnmodelledPayload, EffortFilter, StampJitter, LinkLength)
}
"""What `trial --family measurement` hides, all alike often."""


def draw_fault(seed: int, robot: Robot, recordings: int) -> MeasuringFault:
    """Draw a fault of a number of recordings; the same seed and arguments give the same."""
    rng = np.random.default_rng([seed, 1964])
    return FAULTS[str(rng.choice(list(FAULTS)))].draw(robot, rng, recordings)


def fault_of(text: str, robot: Robot) -> MeasuringFault:
    """Return the fault of a text as `MeasuringFault.text` gives it."""
    head, _, tail = text.partition(":")
    name, at, joint = head.partition("@")
    values = {key: float(value) for key, _, value in (item.partition("=") for item in tail.split(","))}
    return FAULTS[name](robot.joint_index(joint) if at else None, values)


def recordings_with(
    fault: MeasuringFault,
    robot: Robot,
    motions: Sequence[FourierSeries],
    *,
    periods: int = 16,
    noise: float = 1.0,
    seed: int = 0,
) -> list[Recording]:
    """Return recordings of steady periods with the fault in them, one for each motion."""
    true, out = fault.plant(robot), []
    servo = Servo.make(true)
    for number, motion in enumerate(motions):
        physics = plant_physics(true, fault.effects(true, number))
        play = Play.of(true, physics, motion, servo=servo)
        out.append(spoilt(fault, play, number, periods=periods, noise=noise, seed=seed))
    return out


def spoilt(
    fault: MeasuringFault, play: Play, number: int, *, periods: int = 16, noise: float = 1.0, seed: int = 0
) -> Recording:
    """Return recording `number` of a steady motion as it is read and written with a fault.

    A period before it lets what filters settle.
    """
    rng = np.random.default_rng([seed, number])
    read = fault.read(play.readings(periods + 1), play.sample_rate, rng)
    stream = int(np.random.SeedSequence([seed, number]).generate_state(1)[0])
    made = fault.written(noisy(play.robot, play.sample_rate, read, noise=noise, seed=stream), rng)
    rows = len(play.period.q)
    dq = None if made.dq is None else made.dq[rows:]
    return replace(made, t=made.t[rows:] - made.t[rows], q=made.q[rows:], tau=made.tau[rows:], dq=dq)
