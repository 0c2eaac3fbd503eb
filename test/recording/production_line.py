"""A robot at work: the same moves again and again, each begun when it may, with a torque that is known exactly."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from robot_ident.model.structure import Structure
from robot_ident.planning.validation_motion import moves
from robot_ident.recording import Recording
from robot_ident.robot import Robot
from robot_ident.signals.motion import Array, Motion
from robot_ident.trajectories.point_to_point import PointToPoint

POSES = np.array([[0.0, 0.2, -0.3], [1.0, 0.6, -0.8], [-0.9, -0.4, 0.7], [0.4, -0.6, -0.6]])
ORDER = (0, 1, 2, 1, 3, 0)
HOLD = 5.0  # Nm rms that stiction holds at rest, another each time


@dataclass(frozen=True)
class Line:
    """A recording of production with what truly happened."""

    recording: Recording
    motion: Motion
    cycles: int


class Shift:
    """Work as a reference that the simulated robot follows: each move begins when it may."""

    def __init__(self, robot: Robot, cycles: int, seed: int, poses: Array, order: tuple[int, ...]) -> None:
        """Draw the pauses."""
        rng, self._moves, end = np.random.default_rng(seed), list[tuple[float, PointToPoint]](), 1.0
        for _ in range(cycles):
            for start, goal in zip(order[:-1], order[1:], strict=True):
                move = moves(robot, poses[[start, goal]], law="smooth", share=0.9)
                self._moves.append((end, move))
                end += move.duration + rng.uniform(0.3, 1.2)
        self.duration, self.start_pose = end, poses[order[0]]

    def reference(self, t: Array) -> Motion:
        """Return the motion at instants t [N] s."""
        t = np.atleast_1d(np.asarray(t, dtype=float))
        of = np.maximum(np.searchsorted([begin for begin, _ in self._moves], t, side="right") - 1, 0)
        state = np.empty((3, len(t), len(self.start_pose)))
        for number in np.unique(of):
            begin, move = self._moves[number]
            one = move.reference(t[of == number] - begin)
            state[:, of == number] = one.q, one.dq, one.ddq
        return Motion(*state)


def production(
    robot: Robot,
    cycles: int = 40,
    seed: int = 0,
    *,
    rate: float = 125.0,
    law: str = "smooth",
    noise: float = 1.0,
    pause: tuple[float, float] = (0.3, 1.5),
    order: tuple[int, ...] | None = ORDER,
    extra: Callable[[Motion], Array] | None = None,
    late: float = 0.0,
    skip: float = 3.0,
) -> Line:
    """Return `cycles` cycles of five moves whose pauses are drawn from `pause` [s], the first `skip` s not recorded.

    order: of the poses in a cycle; None draws one anew each time, so that nothing repeats. extra: torque [N, n] that
    the model doesn't know. late: s by which stamps lag at random.
    """
    rng = np.random.default_rng(seed)
    parts, end = [], 0.0
    place = 0 if order is None else order[0]
    poses = POSES if order is not None else rng.uniform(-1.0, 1.0, (5 * cycles + 1, robot.n))
    for _ in range(cycles):
        for goal in order[1:] if order is not None else range(place + 1, place + 6):
            move = moves(robot, poses[[place, goal]], law=law, share=0.9)
            parts.append((end, move))
            end, place = end + move.duration + rng.uniform(*pause), goal
    t = np.arange(rng.uniform(0.0, 1.0 / rate), end, 1.0 / rate)
    of = np.searchsorted([begin for begin, _ in parts], t, side="right") - 1
    of = np.maximum(of, 0)
    state = np.empty((3, len(t), robot.n))
    for number, (begin, move) in enumerate(parts):
        rows = of == number
        one = move.reference(t[rows] - begin)
        state[:, rows] = one.q, one.dq, one.ddq
    motion = Motion(*state)
    structure = Structure.build(robot)
    tau = structure.columns(motion) @ structure.true_values()
    rest = np.all(motion.dq == 0.0, axis=1)[:, None]
    tau = tau + np.where(rest, HOLD * rng.normal(size=(len(parts), robot.n))[of], 0.0)
    tau = tau + (0.0 if extra is None else extra(motion))
    tau = tau + noise * rng.normal(size=tau.shape) * np.sqrt(robot.noise.torque_variance)
    q = motion.q + noise * rng.normal(size=tau.shape) * np.sqrt(robot.noise.position_variance)
    stamps = t + late * np.abs(rng.normal(size=len(t)))
    kept = t > skip
    return Line(Recording(robot.joints, stamps[kept], q[kept], tau[kept], source="line"), motion[kept], cycles)
