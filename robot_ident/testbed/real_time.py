"""The simulated robot in real time: it keeps its state and is advanced a few steps at a time.

A stream of commanded positions and velocities becomes a smooth reference, and a stop where it ends; trajectories are
followed by splines, and the last point is held, as a joint trajectory controller does.
"""

from __future__ import annotations

from collections import deque
from collections.abc import Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike
from scipy.interpolate import PPoly

from robot_ident.errors import InputError
from robot_ident.robot.robot import Robot
from robot_ident.signals.motion import Array, Motion, frozen_array, joined
from robot_ident.testbed.phenomena import plant_physics
from robot_ident.testbed.phenomena.phenomenon import home_pose
from robot_ident.testbed.plant import Plant, commands
from robot_ident.testbed.sensors import Sensors
from robot_ident.testbed.servo import BANDWIDTH, Servo
from robot_ident.testbed.simulation import steps_per_sample

STOP_TIME = 0.2
"""How long a stop takes [s] for joints whose acceleration isn't limited."""

_ROUNDING = 1e-9  # s by which sums of periods may miss the stamps that they are to meet


_POWERS = np.arange(6.0)[:, None]
_FIRST, _SECOND = _POWERS, _POWERS * (_POWERS - 1.0)  # what a power's first and second derivative are multiplied by


@dataclass(frozen=True)
class Piece:
    """Positions sum_k c_k (t - start)^k [n] from `start` to `end` [s]; c [K, n], K <= 6."""

    start: float
    end: float
    c: Array

    def states(self, t: Array) -> tuple[Array, Array, Array]:
        """Return q, dq, ddq [N, n] at times [N]."""
        size = len(self.c)
        powers = np.ones((len(t), size))
        if size > 1:
            powers[:, 1] = t - self.start
        for k in range(2, size):
            powers[:, k] = powers[:, k - 1] * powers[:, 1]
        return (
            powers @ self.c,
            powers[:, : size - 1] @ (_FIRST[1:size] * self.c[1:]),
            powers[:, : max(size - 2, 0)] @ (_SECOND[2:size] * self.c[2:]),
        )

    def state(self, t: float) -> tuple[Array, Array, Array]:
        """Return q, dq, ddq [n] at a time."""
        q, dq, ddq = self.states(np.array([t]))
        return q[0], dq[0], ddq[0]


def hermite(start: float, end: float, before: tuple[Array, Array], after: tuple[Array, Array]) -> Piece:
    """Return the cubic between two instants with position and velocity at both."""
    span = end - start
    (q0, v0), (q1, v1) = before, after
    slope = (q1 - q0) / span
    return Piece(start, end, np.stack([q0, v0, (3 * slope - 2 * v0 - v1) / span, (v0 + v1 - 2 * slope) / span**2]))


def braking(start: float, q: Array, v: Array, acceleration: Array) -> Piece:
    """Return the smoothest stop within acceleration limits [n]: v(s) = v (1 - 3 s^2 + 2 s^3), s from 0 to 1.

    All joints stop at once, so that the path goes on straight; the deceleration is largest, 1.5 |v| / T, half-way and
    zero at both ends.
    """
    limited = np.isfinite(acceleration) & (acceleration > 0)
    times = np.where(limited, 1.5 * np.abs(v) / np.where(limited, acceleration, 1.0), np.where(v != 0, STOP_TIME, 0.0))
    span = max(float(times.max(initial=0.0)), 1e-6)
    return Piece(start, start + span, np.stack([q, v, 0 * v, -v / span**2, v / (2 * span**3)]))


def quintics(t: Array, points: Motion) -> PPoly:
    """Return the spline of fifth order through position, velocity and acceleration of K points at times t [K] s."""
    h = np.diff(t)[:, None]
    known = np.stack([points.q, points.dq, 0.5 * points.ddq])[:, :-1]
    powers = np.array([[1, 1, 1], [3, 4, 5], [6, 12, 20]], dtype=float)
    q, dq, ddq = known * h ** np.arange(3)[:, None, None]
    wanted = np.stack([points.q[1:], h * points.dq[1:], h**2 * points.ddq[1:]])
    rest = np.tensordot(np.linalg.inv(powers), wanted - [q + dq + ddq, dq + 2 * ddq, 2 * ddq], 1)
    return PPoly(np.concatenate([known, rest / h ** np.array([3, 4, 5])[:, None, None]])[::-1], t)


def settling(start: float, q: Array, v: Array, acceleration: Array) -> Piece:
    """Return the way from offset q and rate v [n] to nothing: the quintic that ends, and begins, unaccelerated.

    Over a time T its parts in q and v accelerate by at most 10 / sqrt(3) |q| / T^2 and 3.95 |v| / T; T is the least
    that keeps their sum within `acceleration` [n].
    """
    limited = np.isfinite(acceleration) & (acceleration > 0)
    a = np.where(limited, acceleration, 1.0)
    slow, far = 3.95 * np.abs(v), 10.0 / np.sqrt(3.0) * np.abs(q)
    times = np.where(limited, (slow + np.sqrt(slow**2 + 4.0 * far * a)) / (2.0 * a), STOP_TIME)
    span = max(float(times[(q != 0) | (v != 0)].max(initial=0.0)), 1e-6)
    still = 0 * q
    way = quintics(np.array([0.0, span]), Motion(np.stack([q, still]), np.stack([v, still]), np.stack([still, still])))
    return Piece(start, start + span, way.c[::-1, 0])


class CommandInterpolator:
    """Plays commands one command period late, as cubics through their positions and velocities.

    Times are those of the commands' own stamps [s], so that jitter of their arrival doesn't reach the reference. When
    the next command is late the reference goes on with its last acceleration for `patience` seconds, then the joints
    brake within `acceleration` [n] rad/s^2 and hold. A stream that begins anew is joined smoothly from wherever the
    reference is.
    """

    def __init__(self, acceleration: ArrayLike, period: float, *, patience: float | None = None) -> None:
        """Expect commands every `period` seconds; `patience` is one period unless it is given."""
        self.acceleration = frozen_array(acceleration, None)
        self.period = float(period)
        self.patience = self.period if patience is None else float(patience)
        self.reset(np.zeros(len(self.acceleration)))

    def reset(self, q: ArrayLike) -> None:
        """Hold position q [n] and forget all commands."""
        self._spacing = self.period
        self._now = 0.0
        self._last: float | None = None  # stamp of the last command
        self._newest = Piece(0.0, np.inf, frozen_array(q, len(self.acceleration))[None])  # which leads to it
        self._goal = self._newest.c[0], 0 * self._newest.c[0]
        self._pieces = deque([self._newest])
        self._offset: Piece | None = None  # from what was left out to the present

    @property
    def holding(self) -> bool:
        """Whether the reference stands still for want of commands."""
        return self._last is None

    @property
    def behind(self) -> float:
        """How far the reference is behind the newest command [s]: one period, where commands come one by one."""
        return 0.0 if self._last is None else max(self._last - self._now, 0.0)

    def push(self, t: float, q: ArrayLike, dq: ArrayLike) -> bool:
        """Take the command of stamp t [s]: positions q [n] and velocities dq [n].

        Returns False where it is left out, being no newer than the last one; ValueError on values that aren't finite.
        """
        goal = frozen_array(q, len(self.acceleration)), frozen_array(dq, len(self.acceleration))
        if not (np.isfinite(t) and np.isfinite(goal[0]).all() and np.isfinite(goal[1]).all()):
            raise ValueError("a command that is not finite")
        last = self._last
        if last is not None and t <= last:
            return False
        if last is not None and t - last < 4 * self.period:
            self._spacing = t - last
        if last is None or self._now > last + _ROUNDING:
            self._join(t, goal)
        else:
            self._newest = hermite(last, t, self._goal, goal)
            self._pieces.append(self._newest)
        self._last, self._goal = t, goal
        return True

    def catch_up(self) -> None:
        """Leave out the commands that wait, but for the newest: what is played is one command late again.

        The reference goes on from where it is: its distance from the present settles within `acceleration`.
        """
        if self._last is None or self._now >= self._last - self._spacing:
            return
        q, v, _ = self._at(np.array([self._now]))
        self._now = self._last - self._spacing
        self._forget()
        there_q, there_v, _ = self._newest.states(np.array([self._now]))
        self._offset = settling(self._now, q[0] - there_q[0], v[0] - there_v[0], self.acceleration)

    def advance(self, instants: int, spacing: float) -> Motion:
        """Return the reference [instants, n] at spacing, 2 spacing, ... [s] from now, and move on to the last."""
        q, dq, ddq = self._at(self._now + spacing * np.arange(1.0, instants + 1.0))
        self._now += instants * spacing
        self._forget()
        return Motion(q, dq, ddq)

    def _at(self, times: Array) -> tuple[Array, Array, Array]:
        """Return the reference [N, n] at times [N] that rise, none before now."""
        if self._last is not None and times[-1] > self._last + _ROUNDING and self._pieces[-1] is self._newest:
            self._pieces.extend(self._onward(self._newest))
        q, dq, ddq = np.empty((3, len(times), len(self.acceleration)))
        row = 0
        for piece in self._pieces:
            until = int(np.searchsorted(times, piece.end + _ROUNDING, side="right"))
            if until > row:
                rows = slice(row, until)
                q[rows], dq[rows], ddq[rows] = piece.states(times[rows])
                row = until
            if row == len(times):
                break
        if self._offset is not None:
            settles = slice(0, int(np.searchsorted(times, self._offset.end)))
            for part, more in zip((q, dq, ddq), self._offset.states(times[settles]), strict=True):
                part[settles] += more
        return q, dq, ddq

    def _join(self, t: float, goal: tuple[Array, Array]) -> None:
        """Begin anew, or catch up with a stream that was late: from where the reference is to the command at t."""
        q, v, _ = self._at(np.array([self._now]))
        if self._last is None or not 0.5 * self._spacing <= t - self._now <= 2 * self._spacing:
            self._now = t - self._spacing
        self._newest = hermite(self._now, t, (q[0], v[0]), goal)
        self._pieces, self._offset = deque([self._newest]), None

    def _onward(self, piece: Piece) -> list[Piece]:
        """Return what is played after a piece when no other command comes: on, braking, hold."""
        t = piece.end
        q, v, a = piece.state(t)
        if not v.any():
            return [Piece(t, np.inf, q[None])]
        on = Piece(t, t + self.patience, np.stack([q, v, np.clip(a, -self.acceleration, self.acceleration) / 2]))
        stop = braking(on.end, *on.state(on.end)[:2], self.acceleration)
        return [on, stop, Piece(stop.end, np.inf, stop.state(stop.end)[0][None])]

    def _forget(self) -> None:
        """Drop what has been played; the last command, too, once the reference holds."""
        while len(self._pieces) > 1 and self._pieces[0].end <= self._now:
            self._pieces.popleft()
        if self._offset is not None and self._offset.end <= self._now:
            self._offset = None
        if self._last is not None and self._now > self._last and self._pieces[0].end == np.inf:
            self._last = None


_AT_REST = 1e-12  # rad/s at the last point


class TrajectoryFollower:
    """Follows trajectories of timed points; each replaces the one before it from the instant at which it is taken in.

    Between points runs a quintic spline. Points of the past are passed over; where the first lies ahead, the way there
    begins at the present reference. The same rules as those of ros2_control's joint_trajectory_controller.
    """

    def __init__(self, joints: int) -> None:
        """Follow for so many joints; `reset` says where they stand."""
        self._joints = joints
        self.reset(np.zeros(joints))

    def reset(self, q: ArrayLike) -> None:
        """Hold position q [n] and forget what was to be followed."""
        self._goal, self._end = frozen_array(q, self._joints), -np.inf

    def take(self, now: float, t: Array, motion: Motion) -> None:
        """Replace what is followed at `now` [s] by points at t [K] s, motion [K, n].

        Raises InputError on what a controller refuses: values that aren't finite, times that don't rise, an end in the
        past, or one that isn't at rest.
        """
        if not all(np.isfinite(x).all() for x in (t, motion.q, motion.dq, motion.ddq)):
            raise InputError("a trajectory with values that are not finite")
        if not len(t) or np.any(np.diff(t) <= 0):
            raise InputError("a trajectory whose points don't follow one another in time")
        if t[-1] < now:
            raise InputError(f"a trajectory that ended {now - t[-1]:.3f} s ago")
        if np.abs(motion.dq[-1]).max() > _AT_REST:
            raise InputError("a trajectory that doesn't end at rest")
        if t[0] > now:
            t, motion = np.insert(t, 0, now), joined([self.at(np.array([now])), motion])
        self.reset(motion.q[-1])
        if len(t) > 1:
            self._spline, self._end = quintics(t, motion), float(t[-1])

    def at(self, t: Array) -> Motion:
        """Return the reference [N, n] at times t [N] s."""
        parts, rows = np.zeros((3, len(t), self._joints)), t < self._end
        parts[0] = self._goal
        for k in range(3 if rows.any() else 0):
            parts[k, rows] = self._spline(t[rows], k)
        return Motion(*parts)


class Reading(NamedTuple):
    """What a robot reports at an instant: q [n] rad, dq [n] rad/s, tau [n] Nm."""

    q: Array
    dq: Array
    tau: Array


class SimulatedRobot:
    """The plant of `simulate`, held in a state: for a node that publishes at `sample_rate` [Hz].

    Time is the caller's: each call of `advance` or `hold` takes whole steps of `step` seconds, `steps_per_sample` a
    sample. reference: that at this instant, one row.
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
        self.reference = Motion(pose[None], np.zeros((1, len(pose))), np.zeros((1, len(pose))))

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
        told = commands(self._servo, joined([self.reference, reference]))
        self._state = self._plant.run(self._state, told)[-1]
        self.reference = reference[-1:]

    def hold(self, steps: int) -> None:
        """Advance some steps with the reference at rest where it was last."""
        still = np.zeros((2 * steps, self.robot.n))
        self.advance(Motion(still + self.reference.q, still, still))

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
    def torque(self) -> Array:
        """The servos' torque [n] Nm at this instant, without noise."""
        seen = self.shown
        return np.asarray(self._servo.torque(self.reference, seen.q, seen.dq)[0])

    def measure(self, rng: np.random.Generator) -> Reading:
        """Return what the robot reports at this instant: noisy and quantised."""
        seen = self.shown
        return Reading(
            self._sensors.read_position(seen.q[0], rng),
            self._sensors.read_velocity(seen.dq[0], rng),
            self._sensors.read_torque(self.torque, rng),
        )
