"""Certified torque along a motion: its range over intervals of time, halved until it is narrow enough.

Over an interval of half width h about t position, speed and acceleration lie in boxes (their values at t, and bounds
of the next derivative), and interval arithmetic on the model's equation encloses the torque; friction that jumps with
the direction takes both its values where the speed may change its sign.

The torque that a motion takes, as far as a robot's files tell: URDF, armature and `simulation`.
"""

from __future__ import annotations

from functools import cached_property
from itertools import pairwise
from typing import Any, NamedTuple

import casadi as ca
import numpy as np

from robot_ident.limits.interval import Range, RangeFunction, Unbounded
from robot_ident.model.expressions import columns_function
from robot_ident.model.structure import Structure
from robot_ident.robot.robot import Robot
from robot_ident.signals.motion import Array, Motion
from robot_ident.trajectories.excitation import Piece
from robot_ident.trajectories.extremes import halved, intervals


class TorqueModel:
    """tau = Phi(q, dq, ddq) theta with the values that the robot's files give.

    What they don't give counts as zero, and so do effects with memory and those that depend on the torque themselves.
    """

    def __init__(self, robot: Robot) -> None:
        """Read the values of a robot."""
        structure = Structure.build(robot)
        self._robot = robot
        self._structure, kept = structure.with_only(lambda effect: effect.symbolic and not effect.uses_torque)
        self._theta = structure.true_values()[kept]
        labels = {joint: f"rotor_inertia@{robot.joints[joint]}" for joint in structure.base.free_rotors}
        free = [joint for joint, label in labels.items() if label not in structure.labels]
        self._rotors = np.zeros(robot.n)
        self._rotors[free] = robot.drives.armature[free]

    @property
    def known(self) -> bool:
        """Whether there is anything to limit: inertias in the URDF and at least one torque limit."""
        return bool(np.any(self._robot.rigid.parameters) and np.isfinite(self._robot.limits.torque).any())

    def function(self, sign: Any = None) -> Any:
        """Return the CasADi function (q, dq, ddq) -> tau [n]; `sign` may be a smooth stand-in for the sign function."""
        q, dq, ddq = (ca.SX.sym(name, self._robot.n) for name in ("q", "dq", "ddq"))
        phi = columns_function(self._structure, sign)(q, dq, ddq)
        tau = ca.mtimes(phi, ca.DM(self._theta)) + ca.DM(self._rotors) * ddq
        return ca.Function("torque", [q, dq, ddq], [ca.densify(tau)])

    @cached_property
    def _numeric(self) -> Any:
        return self.function()

    def torque(self, motion: Motion) -> Array:
        """Return the torque [N, n] Nm along a motion."""
        return np.array(self._numeric(motion.q.T, motion.dq.T, motion.ddq.T)).T

    def limited_joints(self, samples: int = 4000) -> tuple[int, ...]:
        """Return the joints whose torque comes near its limit in states within the other limits, by random states."""
        if not self.known:
            return ()
        limits, rng = self._robot.limits, np.random.default_rng(0)
        draw = rng.uniform(-1.0, 1.0, (3, samples, self._robot.n))
        draw[1:] = np.where(rng.uniform(size=draw[1:].shape) < 0.5, np.sign(draw[1:]), draw[1:])
        middle, half = 0.5 * (limits.upper + limits.lower), 0.5 * (limits.upper - limits.lower)
        motion = Motion(middle + half * draw[0], limits.velocity * draw[1], limits.acceleration * draw[2])
        near = np.any(np.abs(self.torque(motion)) > 0.9 * limits.torque, axis=0)
        return tuple(int(joint) for joint in np.flatnonzero(near))


TOLERANCE = 2e-3  # of the certified torque, as a share of the limit
_FIRST = 64  # intervals
_BUDGET = 60_000  # intervals
_SAMPLES = 400  # where there is no proof


class TorqueExtreme(NamedTuple):
    """A proven bound [n] of |torque|, the largest torque found, signed [n], and its time [n] s."""

    bound: Array
    value: Array
    time: Array
    proven: bool


class TorqueRange:
    """The range of a robot's torque along pieces of a motion."""

    def __init__(self, model: TorqueModel, limits: Array) -> None:
        """Take a model of the torque and its limits [n] (inf: none)."""
        self._model, self._limits = model, limits
        try:
            self._range: RangeFunction | None = RangeFunction(model.function())
        except Unbounded:
            self._range = None

    def extreme(self, piece: Piece) -> TorqueExtreme:
        """Return the largest torque along a piece, proven to within a share of the limits; from samples (and said to
        be) where the model's equation or a jump of the motion doesn't allow more.
        """
        found = self._sampled(piece)
        if self._range is None or piece.jerk is None:
            return found
        try:
            proven = self._proven(piece, found)
            unclear = (proven.bound >= self._limits) & (np.abs(proven.value) < self._limits)
            below = self._below(piece) if unclear.any() else None
        except Unbounded:
            return found
        return proven if below is None else proven._replace(bound=np.minimum(proven.bound, below))

    def keeps(self, piece: Piece) -> bool:
        """Return whether the torque limits are kept along a piece: proven where that is possible."""
        found = self._sampled(piece)
        if np.any(np.abs(found.value) >= self._limits):
            return False
        if self._range is None or piece.jerk is None:
            return True
        try:
            return self._below(piece) is not None
        except Unbounded:
            return True

    def _sampled(self, piece: Piece) -> TorqueExtreme:
        times = np.linspace(piece.start, piece.end, _SAMPLES)
        torque = self._model.torque(piece.motion(times))
        rows = np.argmax(np.abs(torque), axis=0)
        value = torque[rows, np.arange(torque.shape[1])]
        return TorqueExtreme(np.abs(value), value, times[rows], proven=False)

    def _proven(self, piece: Piece, found: TorqueExtreme) -> TorqueExtreme:
        finite = np.isfinite(self._limits)
        slack = np.where(finite, TOLERANCE * self._limits, 0.0)
        value, time, wide = found.value.copy(), found.time.copy(), np.zeros(len(found.value))
        centres, halves, spent = *_first(piece), 0
        while len(centres):
            bound = self._bound(piece, centres, halves)
            torque = self._model.torque(piece.motion(centres))
            rows = np.argmax(np.abs(torque), axis=0)
            for joint, row in enumerate(rows):
                if abs(torque[row, joint]) > abs(value[joint]):
                    value[joint], time[joint] = torque[row, joint], centres[row]
            spent += len(centres)
            open_ = np.any((bound > np.abs(value) + slack) & finite, axis=1)
            if spent > _BUDGET and open_.any():
                wide = bound[open_].max(axis=0)
                break
            centres, halves = halved(centres, halves, open_)
        return TorqueExtreme(np.maximum(np.abs(value) + slack, wide), value, time, proven=True)

    def _below(self, piece: Piece) -> Array | None:
        """Return proven bounds [n] of |torque| that lie below the limits, None where there is no such proof."""
        centres, halves, spent = *_first(piece), 0
        proven = np.zeros(len(self._limits))
        while len(centres) and spent < _BUDGET:
            bound = self._bound(piece, centres, halves)
            open_ = np.any(bound >= self._limits, axis=1)
            if open_.any() and np.any(np.abs(self._model.torque(piece.motion(centres[open_]))) >= self._limits):
                return None
            proven = np.maximum(proven, bound[~open_].max(axis=0, initial=0.0))
            spent += len(centres)
            centres, halves = halved(centres, halves, open_)
        return None if len(centres) else proven

    def _bound(self, piece: Piece, centres: Array, halves: Array) -> Array:
        """Return bounds [N, n] of |torque| over intervals."""
        assert self._range is not None
        ((low, high),) = self._range(_boxes(piece, centres, halves))
        return np.maximum(np.abs(low), np.abs(high))


def _boxes(piece: Piece, centres: Array, halves: Array) -> list[Range]:
    """Return the boxes of q, dq and ddq over intervals, as pairs of [N, n]."""
    assert piece.jerk is not None
    motion, h, extremes = piece.motion(centres), halves[:, None], piece.extremes
    bend = np.minimum(np.abs(motion.ddq) + h * piece.jerk, extremes.ddq.largest)
    speed = np.minimum(np.abs(motion.dq) + h * bend, extremes.dq.largest)
    widths = (h * speed, h * bend, h * piece.jerk)
    return [
        (np.maximum(value - width, known.lower), np.minimum(value + width, known.upper))
        for value, width, known in zip((motion.q, motion.dq, motion.ddq), widths, extremes, strict=True)
    ]


def _first(piece: Piece) -> tuple[Array, Array]:
    """Return the first intervals, none of which holds a jump of the acceleration."""
    count = max(4, _FIRST // (1 + len(piece.jumps)))
    ends = [piece.start, *sorted(t for t in piece.jumps if piece.start < t < piece.end), piece.end]
    parts = [intervals(a, b, count) for a, b in pairwise(ends)]
    return np.concatenate([centres for centres, _ in parts]), np.concatenate([halves for _, halves in parts])
