"""The simulated robot in real time: it keeps its state and is advanced a few steps at a time."""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from robot_ident.errors import InputError
from robot_ident.robot.robot import Robot
from robot_ident.signals.motion import Array, Motion
from robot_ident.simulation.commands import Commands
from robot_ident.simulation.physics import home_pose, plant_physics
from robot_ident.simulation.plant import Plant
from robot_ident.simulation.sensors import Sensors
from robot_ident.simulation.servo import BANDWIDTH, Servo
from robot_ident.simulation.simulate import steps_per_sample


class Reading(NamedTuple):
    """What a robot reports at an instant: q [n] rad, dq [n] rad/s, tau [n] Nm."""

    q: Array
    dq: Array
    tau: Array


class SimulatedRobot:
    """The plant of `simulate`, held in a state: for a node that publishes at `sample_rate` [Hz].

    Time is the caller's: each call of `advance` or `hold` takes whole steps of `step` seconds, `steps_per_sample` a
    sample.
    """

    def __init__(
        self,
        robot: Robot,
        *,
        sample_rate: float = 150.0,
        step_rate: float | None = None,
        servo: str = "feedforward",
        bandwidth: float = BANDWIDTH,
        effects: Sequence[str] = (),
        noise: float = 1.0,
    ) -> None:
        """Build the plant, at rest in the middle of its position limits; the arguments are those of `simulate`."""
        self.robot = robot
        physics = plant_physics(robot, effects)
        self.steps_per_sample = steps_per_sample(sample_rate, step_rate, physics)
        self.step = 1.0 / (sample_rate * self.steps_per_sample)
        self._servo = Servo.make(robot, servo, bandwidth)
        self._plant = Plant(robot, physics, self._servo, self.step)
        self._sensors = Sensors.of(robot, sample_rate, noise)
        self.reset(home_pose(robot))
        self.hold(self.steps_per_sample)  # the functions are made now, not in the first cycle
        self.reset(home_pose(robot))

    @property
    def effects(self) -> tuple[str, ...]:
        """The plant's phenomena as `name@joint`."""
        return tuple(physics.label for physics in self._plant.physics)

    def reset(self, q: ArrayLike) -> None:
        """Stand still at q [n], and hold it; InputError when q is not a pose of this robot."""
        pose = np.asarray(q, dtype=float)
        if pose.shape != (self.robot.n,) or not np.isfinite(pose).all():
            raise InputError(
                f"robot {self.robot.name}: a pose of {self.robot.n} finite positions is needed, got {pose.tolist()}"
            )
        self._state = self._plant.rest(pose)
        self._reference = Motion(pose[None], np.zeros((1, len(pose))), np.zeros((1, len(pose))))

    def advance(self, reference: Motion) -> None:
        """Advance k steps along a reference given at h/2, h, 3 h/2, ... k h from now (2 k instants, h = `step`).

        ValueError when their number is odd.
        """
        if reference.samples % 2:
            raise ValueError(
                f"a reference at the middle and the end of each step was expected, got {reference.samples} instants"
            )
        if not reference.samples:
            return
        last = self._reference
        joined = Motion(
            np.concatenate([last.q, reference.q]),
            np.concatenate([last.dq, reference.dq]),
            np.concatenate([last.ddq, reference.ddq]),
        )
        self._state = self._plant.run(self._state, Commands.of(self._servo, joined))[-1]
        self._reference = reference[-1:]

    def hold(self, steps: int) -> None:
        """Advance some steps with the reference at rest where it was last."""
        still = np.zeros((2 * steps, self.robot.n))
        self.advance(Motion(still + self._reference.q, still, still))

    @property
    def motion(self) -> Motion:
        """The exact motion at this instant, one row."""
        parts = self._plant.layout.joints(self._state[None])
        return Motion(parts.q, parts.v, self._plant.accelerations(self._state[None], self.torque[None]))

    @property
    def shown(self) -> Motion:
        """The motion that the encoders show at this instant, one row, without noise (its acceleration is zero)."""
        return self._plant.shown(self._state[None], np.zeros((1, self.robot.n)))

    @property
    def reference(self) -> Motion:
        """The reference at this instant, one row."""
        return self._reference

    @property
    def torque(self) -> Array:
        """The servos' torque [n] Nm at this instant, without noise."""
        seen = self.shown
        return np.asarray(self._servo.torque(self._reference, seen.q, seen.dq)[0])

    def measure(self, rng: np.random.Generator) -> Reading:
        """Return what the robot reports at this instant: noisy and quantised."""
        seen = self.shown
        return Reading(
            self._sensors.read_position(seen.q[0], rng),
            self._sensors.read_velocity(seen.dq[0], rng),
            self._sensors.read_torque(self.torque, rng),
        )
