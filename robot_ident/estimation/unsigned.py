"""Has an effort lost its sign? Hobby servos report how hard they push, and not which way."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Protocol

import numpy as np

from robot_ident.robot.robot import Robot
from robot_ident.signals.motion import Array

_NEGATIVE = 0.02  # of the largest effort, by which a filtered absolute value may fall below zero
_TURNED = 0.1  # share of the samples whose sign is lost
_FITS = 0.8  # of an effort that must be explained before anything is said about what it is
_BETTER = 0.3  # of the power left over before, that may be left over by a better reading
_TOUCHES = 0.05  # of the largest effort, to which an absolute value falls where its torque turns
_ROUNDS = 20


class Rows(Protocol):
    """The rows of a measurement that count, as `effort_checks` has them."""

    @property
    def robot(self) -> Robot:
        """The robot."""

    @property
    def moving(self) -> Sequence[int]:
        """The joints that move."""

    def of(self, joint: int) -> tuple[Array, Array]:
        """Return the columns of a joint [K, 6] and its effort [K]."""


def unsigned_joints(rows: Rows) -> list[int]:
    """Return the joints whose effort has lost its sign.

    It never changes, and fits the motion far better where the motion's torque says when it turns. Beside one such
    joint, or another of its kind, it is enough that an effort falls to zero and never below it although weight and
    inertia of the URDF turn: a driver treats its joints alike.
    """
    one_sided = [joint for joint in rows.moving if _one_sided(rows.of(joint)[1])]
    sure = [joint for joint in one_sided if _fits_better(*rows.of(joint))]
    alike = [joint for joint in one_sided if joint in sure or _folded(*rows.of(joint))]
    return alike if sure or len(alike) > 1 else []


def in_words(joints: Sequence[str], *, all_moving: bool) -> str:
    """Return in a sentence which joints' efforts have no sign and what to do."""
    listed = ", ".join(joints)
    which = f"all {len(joints)} joints that move ({listed})" if all_moving and len(joints) > 1 else listed
    return (
        f"the effort of {which} never changes its sign although the motion's torque does: the driver reports absolute"
        " values; record effort with its sign (effort: {sign: -1} in the robot YAML can't put that right)"
    )


def left(columns: Array, tau: Array) -> float:
    """Return the power of an effort [K] that columns [K, k] leave."""
    solved, *_ = np.linalg.lstsq(columns, tau, rcond=1e-9)
    return float(np.sum((tau - columns @ solved) ** 2))


def _one_sided(tau: Array) -> bool:
    sign = np.sign(tau.mean()) or 1.0
    return bool((sign * tau).min() >= -_NEGATIVE * np.abs(tau).max())


def _fits_better(columns: Array, tau: Array) -> bool:
    """Return whether the motion explains an effort that turns, and not the one-sided one."""
    turn = np.sign(columns[:, 0] + columns[:, 1])
    for _ in range(_ROUNDS):
        solved, *_ = np.linalg.lstsq(columns, np.abs(tau) * turn, rcond=1e-9)
        turn = np.sign(columns @ solved)
    after, power = left(columns, np.abs(tau) * turn), float(np.sum(tau**2))
    turned = min(np.mean(turn > 0), np.mean(turn < 0))
    return bool(turned > _TURNED and after < _BETTER * left(columns, tau) and after < (1.0 - _FITS) * power)


def _folded(columns: Array, tau: Array) -> bool:
    """Return whether an effort falls to zero and turns back there, although the URDF's torque goes on."""
    urdf = columns[:, 0] + columns[:, 1]
    turns = min(np.mean(urdf > 0), np.mean(urdf < 0)) > _TURNED
    size = np.abs(tau)
    return bool(turns and np.quantile(size, 0.02) < _TOUCHES * size.max() < np.quantile(size, 0.5))
