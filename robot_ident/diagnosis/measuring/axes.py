"""A joint that counts the other way round, or two whose readings stand under each other's name.

What is measured is q' = P q and tau' = P' tau, P and P' permutations with signs: the model's columns follow from the
motion P^-1 q', and their rows from P'. Every turned joint and every exchange of two is fitted anew to some of the
rows, and those that leave least of them to all; such a mistake is gross, and what undoes it brings the misfit down to
about the noise at a stroke.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace
from functools import partial
from itertools import combinations

import numpy as np

from robot_ident.diagnosis.diagnosis import Estimate
from robot_ident.diagnosis.measuring.fitted_fault import FittedFault, fitted_loss, folds, weighed
from robot_ident.effects import Effect
from robot_ident.effects.catalogue import CATALOGUE
from robot_ident.regression.evidence import Evidence
from robot_ident.regression.gram import BaseFit, BaseGram, base_gram
from robot_ident.regression.normal_equations import pseudo_inverse
from robot_ident.robot.robot import Robot
from robot_ident.signals.motion import Array, Motion

GROSS = 1.5
"""Chi-square per degree of freedom from which on a mistake of this kind is looked for."""

NEARLY = 0.8
"""Part of the excess that must go, of all data and of trajectories left out: the arm may lack something besides."""


_ROWS = 200  # of each trajectory, by which the likeliest are chosen
_LIKELIEST = 6  # of dozens, that are fitted to all rows


@dataclass(frozen=True)
class Wiring:
    """Which readings are whose: joint j's position is sign[j] times the reading number order[j], its effort likewise.

    Both by joint [n]; wrong: the joints concerned, and what of them is (`position`, `effort` or both).
    """

    position: tuple[int, ...]
    position_sign: tuple[int, ...]
    effort: tuple[int, ...]
    effort_sign: tuple[int, ...]
    joints: tuple[int, ...]
    wrong: tuple[str, ...]

    def motion(self, measured: Motion) -> Motion:
        """Return the joints' own motion."""
        sign, order = np.array(self.position_sign, dtype=float), list(self.position)
        q, dq, ddq = (x[:, order] * sign for x in (measured.q, measured.dq, measured.ddq))
        return replace(measured, q=q, dq=dq, ddq=ddq)

    def rows(self, columns: Array) -> Array:
        """Return the columns [N, n, p] of the joints' torque as those of what is read as effort."""
        out = np.empty_like(columns)
        out[:, list(self.effort)] = columns * np.array(self.effort_sign, dtype=float)[:, None]
        return out


def wirings(robot: Robot) -> Iterator[Wiring]:
    """Yield every joint turned round and every exchange of two joints of one kind.

    A wrong sign of an effort alone is a gain of -1, and tried as such.
    """
    n = robot.n
    plain, ones = tuple(range(n)), (1,) * n
    for j in range(n):
        turned = tuple(-1 if k == j else 1 for k in range(n))
        yield Wiring(plain, turned, plain, turned, (j,), ("position", "effort"))
        yield Wiring(plain, turned, plain, ones, (j,), ("position",))
    for a, b in combinations(range(n), 2):
        if robot.prismatic[a] != robot.prismatic[b]:
            continue
        other = tuple(b if k == a else a if k == b else k for k in range(n))
        yield Wiring(other, ones, other, ones, (a, b), ("position", "effort"))
        yield Wiring(other, ones, plain, ones, (a, b), ("position",))
        yield Wiring(plain, ones, other, ones, (a, b), ("effort",))


def wrong_axes(evidence: Evidence, base: BaseGram) -> list[FittedFault]:
    """Return the turned or exchanged joints with which nearly all of a gross misfit goes; mostly none."""
    everything = range(len(base.power))
    dof = sum(float(t.dof.sum()) for t in evidence.trajectories)
    before = fitted_loss(base, everything)
    if before < GROSS * dof:
        return []
    held_before, robot, out = _held_out(base), evidence.structure.robot, []
    for wiring in _likeliest(evidence):
        after = _gram(evidence, wiring)
        gain = before - fitted_loss(after, everything)
        held = held_before - _held_out(after) if gain > NEARLY * (before - dof) else 0.0
        if held <= NEARLY * (held_before - dof) or _is_sign_of_effort(wiring, evidence, held_before - held):
            continue
        columns = partial(_columns, wiring=wiring)
        out.append(FittedFault(_effect(wiring, robot), gain, held, _told(wiring, robot), columns, _fix(wiring, robot)))
    return out


def _likeliest(evidence: Evidence) -> list[Wiring]:
    """Return the wirings that leave least of some rows, by the part of the model that depends on no other rows."""
    structure, _ = evidence.structure.with_only(lambda effect: not effect.needs_time and not effect.uses_torque)
    some = []
    for t in evidence.trajectories:
        used = np.flatnonzero((t.weight > 0).any(axis=1))
        rows = used[:: max(1, len(used) // _ROWS)]
        some.append((t.motion[np.arange(t.motion.samples)[t.measured.rows][rows]], t.weight[rows], t.plain(t.y)[rows]))

    def left(wiring: Wiring) -> float:
        phi = [wiring.rows(structure.columns(wiring.motion(motion))) * weight[:, :, None] for motion, weight, _ in some]
        stacked = np.concatenate([part.reshape(-1, part.shape[2]) for part in phi])
        y = np.concatenate([torque.ravel() for _, _, torque in some])
        return float(y @ y - (stacked.T @ y) @ pseudo_inverse(stacked.T @ stacked) @ (stacked.T @ y))

    return sorted(wirings(evidence.structure.robot), key=left)[:_LIKELIEST]


def _gram(evidence: Evidence, wiring: Wiring) -> BaseGram:
    return base_gram(replace(evidence, phi=_columns(evidence, wiring=wiring)))


def _is_sign_of_effort(wiring: Wiring, evidence: Evidence, left: float) -> bool:
    """Return whether a turned position leaves no less than a turned effort does, whose sign the robot YAML can tell."""
    if len(wiring.joints) > 1 or "effort" in wiring.wrong:
        return False
    ones = (1,) * len(wiring.position)
    effort = replace(wiring, position_sign=ones, effort_sign=wiring.position_sign)
    return _held_out(_gram(evidence, effort)) <= left / NEARLY


def _effect(wiring: Wiring, robot: Robot) -> Effect:
    name = "mirrored_joint" if len(wiring.joints) == 1 else "exchanged_joints"
    return CATALOGUE[name](robot, wiring.joints[0])


def _told(wiring: Wiring, robot: Robot) -> tuple[Estimate, ...]:
    if len(wiring.joints) == 1:
        name = robot.joints[wiring.joints[0]]
        return tuple(Estimate(f"factor of the {word} of {name}", -1.0, 0.0, "") for word in wiring.wrong)
    name, other = (robot.joints[j] for j in wiring.joints)
    return tuple(
        Estimate(f"number of the joint whose {word} {name} has ({other})", wiring.joints[1] + 1.0, 0.0, "")
        for word in wiring.wrong
    )


def _fix(wiring: Wiring, robot: Robot) -> str:
    """Return what to change: no field of the robot YAML turns a position or exchanges two joints."""
    if len(wiring.joints) == 1:
        name = robot.joints[wiring.joints[0]]
        axis = f"the URDF, joint {name}: its axis the other way round (xyz times -1, and limits -upper to -lower)"
        if "effort" in wiring.wrong:
            return f"{axis}, or in the driver the sign of its position and of its effort"
        sign = -robot.effort.of(name).sign
        return f"{axis} and joints: {{{name}: {{effort: {{sign: {sign}}}}}}}; or in the driver the sign of its position"
    pair, words = " and ".join(robot.joints[j] for j in wiring.joints), " and ".join(f"{w}s" for w in wiring.wrong)
    sources = [robot.effort.sources.get(robot.joints[j]) for j in wiring.joints]
    if wiring.wrong == ("effort",) and all(source is not None and source.index is not None for source in sources):
        fields = [source.field for source in sources if source is not None]
        change = ", ".join(
            f"{robot.joints[j]}: {{effort: {{field: {field}}}}}"
            for j, field in zip(wiring.joints, reversed(fields), strict=True)
        )
        return f"joints: {{{change}}}  # in the robot YAML"
    return f"the driver or whatever wrote the recording: the {words} of {pair} stand under each other's name"


def _held_out(base: BaseGram) -> float:
    return float(sum(BaseFit.of(base, train).loss(base, left).sum() for left, train in folds(len(base.power))))


def _columns(evidence: Evidence, *, wiring: Wiring) -> tuple[Array, ...]:
    known: dict[int, Array] = {}
    for t in evidence.trajectories:
        if id(t.measured) not in known:
            own = evidence.structure.columns(wiring.motion(t.motion), evidence.values)
            known[id(t.measured)] = wiring.rows(own)
    return weighed(evidence, [known[id(t.measured)] for t in evidence.trajectories])
