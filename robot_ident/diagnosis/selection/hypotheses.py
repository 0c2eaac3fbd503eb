"""All that a model may lack, as hypotheses of one kind: physical effects, and faults of what is measured."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

from robot_ident.diagnosis.diagnosis import FRICTION
from robot_ident.diagnosis.selection.constants import FIRST_ORDER_ERROR, FORMULA_ERROR
from robot_ident.effects import Effect
from robot_ident.effects.catalogue import candidates_of
from robot_ident.effects.effort_filter import EffortFilter
from robot_ident.effects.effort_gain import EffortGain
from robot_ident.effects.torque_ripple import TorqueRipple
from robot_ident.effects.wrist_coupling import WristCoupling
from robot_ident.model.structure import Structure
from robot_ident.signals.motion import Array

TIMING = frozenset({"time_delay", "effort_filter"})
"""Forms of one cause: how late an effort is."""

OWN_FRICTION = FRICTION - {"joint_coupling", "temperature_drift"}
"""Friction of a joint's own drive: every robot has some of it, and what acts from elsewhere hardly looks like it."""


def formula_error(effect: Effect) -> float:
    """Return the relative rms error of an effect's formula."""
    return FIRST_ORDER_ERROR.get(effect.name, FORMULA_ERROR)


@dataclass(frozen=True, eq=False)
class Hypothesis:
    """An effect at one value of its nonlinear parameters; at: places of its columns in each joint's pool.

    ranges: the least and the largest of each linear parameter.
    """

    effect: Effect
    at: dict[int, Array]
    ranges: tuple[tuple[float, float], ...]

    @property
    def label(self) -> str:
        """`name@joint`."""
        return self.effect.label

    @property
    def joints(self) -> tuple[int, ...]:
        """Joints whose torque it changes."""
        return tuple(self.at)

    @property
    def causes(self) -> int:
        """Number of causes that it stands for: a cable that has its own offset is two."""
        return 1 + len(type(self.effect).contains)

    @property
    def formula_error(self) -> float:
        """Relative rms error of its formula."""
        return formula_error(self.effect)

    @property
    def own_friction(self) -> bool:
        """Whether it is friction of a joint's own drive."""
        return self.effect.name in OWN_FRICTION

    def excludes(self, other: Hypothesis) -> bool:
        """Return whether both are forms of one cause at one place, of which at most one can be."""
        if self.label == other.label:
            return True
        if isinstance(self.effect, TorqueRipple) and isinstance(other.effect, TorqueRipple):
            return self.effect.joint == other.effect.joint and self.effect.setting == other.effect.setting
        both_late = self.effect.name in TIMING and other.effect.name in TIMING
        same_effect = self.effect.name == other.effect.name and (self.effect.whole or other.effect.whole)
        return (both_late or same_effect) and bool(set(self.at) & set(other.at))


def hypotheses_of(structure: Structure, *, averaged: bool) -> Sequence[Effect]:
    """Return the effects that a model may lack, at every place where the robot's sensors can see them.

    averaged: the recordings are mean periods, in which what drifts from period to period can't be seen.
    """
    robot = structure.robot
    out = [effect for effect in candidates_of(structure) if not (effect.trends and averaged)]
    joints = range(robot.n)
    further: list[Effect] = [WristCoupling(robot, j) for j in joints[1:]]
    further += [EffortFilter(robot, j) for j in (None, *joints)]
    further += [EffortGain(robot, j) for j in joints if not structure.scaled]  # else they are parameters already
    return [*out, *(effect for effect in further if not effect.unseen and effect.label not in structure.labels)]
