"""An effort beside what its motion can make of it: has it lost its sign, is it of the same time, do clocks agree?

Hobby servos report how hard they push, and not which way. A recording's efforts belong to its positions where no other
shift of time explains them better, all joints together. Weight knows no time and inertia goes with the square of its
scale, so that two recordings of one arm whose weights are alike and whose inertias differ by one factor on every joint
were stamped by clocks of different pace.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from itertools import combinations

import numpy as np

from robot_ident.estimation.declaration import Declared, at_all_rows, by_clock
from robot_ident.recording.measurement import Measurement
from robot_ident.recording.payload_torque import beyond_base
from robot_ident.recording.unsigned import EXPLAINED, folded_back, one_sided
from robot_ident.robot.robot import Robot
from robot_ident.signals.motion import Array

_ROWS = 4000  # that are looked at, at most
_MOVES = 0.02  # rad or m
_BLOCK = 0.5  # s within which residuals depend on each other
_TURNED = 0.1  # share of the samples whose sign is lost
_BETTER = 0.3  # of the power left over before, that may be left over by a better reading
_TOUCHES = 0.05  # of the largest effort, to which an absolute value falls where its torque turns
_NEAR = 0.25  # s; a delay or a drive's lag up to that is an effect of the robot, not another time
_OF_CLOCK = 0.1  # of what inertia in common leaves beyond own ones, that the pace of a clock must explain
_TIMELESS, _TIMED = [0, 3, 5], [1, 2, 4]  # columns of a joint
_CLEARLY = 0.9  # of what is left over as stamped, that another shift leaves at most: a motion that repeats ties


class EffortRows:
    """The rows of a measurement that count: effort and what the motion can make of it, after the low pass."""

    def __init__(self, measured: Measurement, robot: Robot) -> None:
        """Compute the URDF's torques at `_ROWS` rows at most, linear between."""
        self.measured, motion = measured, measured.motion
        every = max(1, motion.samples // _ROWS)
        thin = motion[slice(None, None, every)]
        still = np.zeros_like(thin.q)
        nothing = robot.rigid.inverse_dynamics(replace(thin, dq=still, ddq=still, gravity=(0.0, 0.0, 0.0)))
        axes: list[tuple[float, float, float]] = [(1.0, 0.0, 0.0), (0.0, 1.0, 0.0), (0.0, 0.0, 1.0)]
        at_rest = [replace(thin, dq=still, ddq=still, gravity=axis) for axis in axes]
        weight = [robot.rigid.inverse_dynamics(one) - nothing for one in at_rest]
        self.robot = robot
        self.gravity = np.array(motion.gravity or robot.rigid.model.gravity.linear, dtype=float)
        inertial = robot.rigid.inverse_dynamics(thin) - sum(g * w for g, w in zip(self.gravity, weight, strict=True))
        *weight, inertial = (at_all_rows(one, motion.samples, every) for one in (*weight, inertial))
        self.weight = measured.passed(np.stack(weight, axis=2))  # [N, n, 3] Nm per m/s^2
        self.tau = measured.passed(measured.torque + beyond_base(motion, robot))
        parts = (inertial, motion.dq, np.sign(motion.dq), motion.ddq, np.ones_like(motion.q))
        self.drive = measured.passed(np.stack(parts, axis=2))  # [N, n, 5]
        self.used = measured.used[measured.rows]
        self.spacing = measured.dt * measured.decimate
        self.block = max(1, round(_BLOCK / self.spacing))
        enough = self.used.sum(axis=0) > 5 * self.drive.shape[2]
        self.moving = np.flatnonzero((np.ptp(motion.q, axis=0) > _MOVES) & enough).tolist()

    def of(self, joint: int, effort: int | None = None) -> tuple[Array, Array]:
        """Return the columns of a joint [K, 6], its weight first and its offset last, and an effort [K]: its own, or
        that of another joint.
        """
        effort = joint if effort is None else effort
        used = self.used[:, effort]
        return self.columns(joint)[used], self.tau[used, effort]

    def columns(self, joint: int) -> Array:
        """Return the columns of a joint [K, 6] at all rows, those that don't count included."""
        return np.column_stack([self.weight[:, joint] @ self.gravity, self.drive[:, joint]])

    @property
    def efforts(self) -> list[Array]:
        """The efforts [K, n] of all rows: of every period by itself where there are some, else of the recording."""
        periods = self.measured.period_torque
        if periods is None:
            return [self.tau]
        mean = self.measured.torque
        whole = (np.where(np.isfinite(one), one, mean) for one in periods)
        return [self.tau + self.measured.passed(one - mean) for one in whole]


def unsigned_joints(rows: EffortRows) -> list[int]:
    """Return the joints whose effort has lost its sign.

    It never changes, and fits the motion far better where the motion's torque says when it turns. Beside one such
    joint, or another of its kind, it is enough that an effort falls to zero and never below it although weight and
    inertia of the URDF turn: a driver treats its joints alike.
    """
    never_turns = [joint for joint in rows.moving if one_sided(rows.of(joint)[1])]
    sure = [joint for joint in never_turns if _fits_better(*rows.of(joint))]
    alike = [joint for joint in never_turns if joint in sure or _folded(*rows.of(joint))]
    return alike if sure or len(alike) > 1 else []


def in_words(joints: Sequence[str], *, all_moving: bool) -> str:
    """Return in a sentence which joints' efforts have no sign and what to do."""
    listed = ", ".join(joints)
    which = f"all {len(joints)} joints that move ({listed})" if all_moving and len(joints) > 1 else listed
    return (
        f"the effort of {which} never changes its sign although the motion's torque does: the driver reports absolute"
        " values; record effort with its sign, or write effort: {unsigned: true} in the robot YAML: its sign is then"
        " taken from the motion"
    )


def _left(columns: Array, tau: Array) -> float:
    """Return the power of an effort [K] that columns [K, k] leave."""
    return float(np.sum((tau - columns @ np.linalg.lstsq(columns, tau, rcond=1e-9)[0]) ** 2))


def _fits_better(columns: Array, tau: Array) -> bool:
    """Return whether the motion explains an effort that turns, and not the one-sided one."""
    made, left = folded_back(columns, np.abs(tau))
    after, power = float(left @ left), float(np.sum(tau**2))
    turned = min(np.mean(made > 0), np.mean(made < 0))
    return bool(turned > _TURNED and after < _BETTER * _left(columns, tau) and after < (1.0 - EXPLAINED) * power)


def _folded(columns: Array, tau: Array) -> bool:
    """Return whether an effort falls to zero and turns back there, although the URDF's torque goes on."""
    urdf = columns[:, 0] + columns[:, 1]
    turns = min(np.mean(urdf > 0), np.mean(urdf < 0)) > _TURNED
    size = np.abs(tau)
    return bool(turns and np.quantile(size, 0.02) < _TOUCHES * size.max() < np.quantile(size, 0.5))


def out_of_step(rows: EffortRows) -> list[str]:
    """Say that efforts are of another time than positions: shifted by one time, all of them fit the motion better.

    A shift by s leaves 1 - |Q_j' tau_j(t + s)|^2 / |tau_j|^2 of joint j, Q_j an orthonormal basis of what its motion
    can make of an effort; the least of the mean over the joints within a quarter of a second is held against the least
    beyond it, round a period or the recording.
    """
    bases = []  # their spectra
    for joint in rows.moving:
        columns = rows.columns(joint)
        size = np.linalg.norm(columns, axis=0)
        seen = size > 1e-9 * size.max()
        bases.append(np.fft.rfft(np.linalg.qr(columns[:, seen] / size[seen])[0], axis=0))
    near = max(1, round(_NEAR / rows.spacing))
    found = []
    for number, efforts in enumerate(rows.efforts if bases else (), start=1):
        pairs = zip(bases, rows.moving, strict=True)
        total = np.mean([_left_by_shift(basis, efforts[:, joint]) for basis, joint in pairs], axis=0)
        if len(total) < 3 * near:
            return []
        steps = np.arange(len(total))
        close = np.minimum(steps, len(total) - steps) < near
        best, here = int(np.argmin(np.where(close, np.inf, total))), float(total[close].min())
        shift = (best if best <= len(total) // 2 else best - len(total)) * rows.spacing
        found.append((float(total[best] / here), number, here, total[best], -shift))
    ratio, number, here, there, shift = min(found, default=(1.0, 0, 0.0, 0.0, 0.0))
    if ratio > _CLEARLY:
        return []
    which = f" in period {number}" if len(found) > 1 else ""
    return [
        f"the efforts{which} are not of the same time as the positions: the motion leaves {100 * here:.2g} % of their"
        f" power, {100 * there:.2g} % where they are shifted by {shift:+.3g} s (efforts of another run, samples lost,"
        " or clocks apart); record motion and effort together"
    ]


def _left_by_shift(basis: np.ndarray, tau: Array) -> Array:
    """Return by circular shift [K] of an effort [K] the part of its power that a basis of a given spectrum leaves."""
    about = tau - tau.mean()
    products = np.fft.irfft(np.conj(basis) * np.fft.rfft(about)[:, None], len(tau), axis=0)
    return np.asarray(1.0 - np.sum(products**2, axis=1) / max(float(about @ about), 1e-300))


def clocks_apart(rows: Sequence[EffortRows], judged: Sequence[Sequence[Declared]]) -> str:
    """Return which two recordings' clocks run at different paces, in a sentence; or nothing.

    rows, judged: by recording what its efforts are, and by joint the shares of the URDF's weight and inertia that they
    hold. Their ratios don't know the URDF's masses. What changes inertia otherwise, a mass that sloshes, no pace of the
    clock explains.
    """
    for (first, before), (second, after) in combinations(zip(rows, judged, strict=True), 2):
        ratios = [
            Declared(
                a.joint, a.share, a.std, "consistent", "", b.gravity / a.gravity, b.inertia / a.inertia, 0.0, least
            )
            for a, b in zip(before, after, strict=True)
            if (least := min(a.explained, b.explained)) and a.gravity and a.inertia
        ]
        told = [one for one in by_clock(ratios) if one.verdict == "clock"]
        factor = float(np.median([one.inertia for one in told])) if told else 1.0
        if told and _by_pace(first, second, factor**0.5) > _OF_CLOCK:
            pace = factor**0.5 if factor > 1.0 else factor**-0.5
            ordered = (second, first) if factor > 1.0 else (first, second)
            fast, slow = (one.measured.source for one in ordered)
            return (
                f"{fast} and {slow} contradict each other: weight is alike and inertia"
                f" {max(factor, 1 / factor):.3g} times as large on every joint, so that the stamps of {fast} run"
                f" {pace:.3g} times as fast as those of {slow}; record anew, or put the times right"
            )
    return ""


def _by_pace(first: EffortRows, second: EffortRows, pace: float) -> float:
    """Return the share that a clock's pace explains of what one inertia, damping and rotor leave of two recordings'
    efforts beyond own ones for each, every joint's power counted alike: the second's speed goes with the pace, its
    acceleration and inertial torque with the square. Weight, dry friction and offset know no time.
    """
    apart = together = paced = 0.0
    for joint in set(first.moving) & set(second.moving):
        (one, tau), (other, efforts) = first.of(joint), second.of(joint)
        both = np.concatenate([tau, efforts])
        power = max(float(np.sum((both - both.mean()) ** 2)), 1e-300)
        own = np.block([[one[:, _TIMELESS], 0.0 * one[:, _TIMELESS]], [0.0 * other[:, _TIMELESS], other[:, _TIMELESS]]])
        apart += (_left(one, tau) + _left(other, efforts)) / power
        timed = (np.vstack([one[:, _TIMED], other[:, _TIMED] * scale]) for scale in (1.0, pace ** np.array([2, 1, 2])))
        same, scaled = (_left(np.hstack([own, columns]), both) / power for columns in timed)
        together, paced = together + same, paced + scaled
    return (together - paced) / max(together - apart, 1e-300)
