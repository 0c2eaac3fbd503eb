"""What has changed between two models of one robot, identified from different recordings?

The estimates differ by d = theta_new - theta_old with covariance C = C_old + C_new, since their noise is independent. A
parameter is called changed where z = d_k / sqrt(C_kk) is more than chance leaves in all parameters together (Holm,
Scandinavian Journal of Statistics 6, 1979); a joint where d' C^-1 d of its parameters is, of all joints together
(chi-square): a change that spreads over correlated parameters shows there alone.
"""

from __future__ import annotations

from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from robot_ident.errors import InputError
from robot_ident.model.model import Model
from robot_ident.recording.measurement import Measurement
from robot_ident.signals.motion import Array

CHANCE = 0.01  # that anything is called changed where nothing has, all parameters, or all joints, together
_SAME = 1e-6  # of a row of the regrouping: two sets of base parameters that differ by less describe the same
_MISFIT = 1.1  # squared error over that of the noise from which on a model's own error counts beside its sigma


@dataclass(frozen=True)
class ParameterChange:
    """One parameter in the old and in the new model, with its standard deviation in each.

    std: of the difference. p_value: of such a difference where nothing has changed, times the number of parameters that
    it competes with (Holm); None where neither model says how well it knows the parameter.
    """

    name: str
    unit: str
    joint: str | None
    effect: str
    old: float
    old_std: float
    new: float
    new_std: float
    std: float
    p_value: float | None

    @property
    def change(self) -> float:
        """New less old."""
        return self.new - self.old

    @property
    def relative(self) -> float | None:
        """Change over the old value's size; None from zero on."""
        return self.change / abs(self.old) if self.old else None

    @property
    def changed(self) -> bool | None:
        """Whether the difference is beyond chance; None where it can't be told."""
        return None if self.p_value is None else self.p_value < CHANCE

    def to_dict(self) -> dict[str, Any]:
        """Return it as `compare --json` prints it."""
        plain = {name: value for name, value in vars(self).items() if name != "effect"}
        return plain | {"change": self.change, "relative": self.relative, "changed": self.changed}


@dataclass(frozen=True)
class JointChange:
    """The parameters of one joint together (joint None: those of the whole robot): d' C^-1 d over their number, and its
    p-value times the number of joints.
    """

    joint: str | None
    parameters: int
    statistic: float
    p_value: float

    @property
    def changed(self) -> bool:
        """Whether the difference is beyond chance."""
        return self.p_value < CHANCE

    def to_dict(self) -> dict[str, Any]:
        """Return it as `compare --json` prints it."""
        return {**vars(self), "changed": self.changed}


@dataclass(frozen=True)
class ModelChange:
    """An old model beside a new one: what both hold, effects that only one of them has, and what limits the judgement.

    unmatched: base parameters of the new model that those of the old one don't give.
    """

    parameters: tuple[ParameterChange, ...]
    joints: tuple[JointChange, ...]
    only_old: tuple[str, ...]
    only_new: tuple[str, ...]
    unmatched: tuple[str, ...]
    notes: tuple[str, ...]

    @property
    def changed(self) -> tuple[ParameterChange, ...]:
        """The parameters that changed, the surest first."""
        found = [p for p in self.parameters if p.changed]
        return tuple(sorted(found, key=lambda p: -abs(p.change) / p.std))

    @property
    def anything(self) -> bool:
        """Whether anything has changed."""
        return bool(self.changed) or any(joint.changed for joint in self.joints)

    def to_dict(self) -> dict[str, Any]:
        """Return it as `compare --json` prints it."""
        return {
            "false_alarms": CHANCE,
            "parameters": [p.to_dict() for p in self.parameters],
            "joints": [joint.to_dict() for joint in self.joints],
            "only_old": list(self.only_old),
            "only_new": list(self.only_new),
            "unmatched": list(self.unmatched),
            "notes": list(self.notes),
        }


def torque_change(old: Model, new: Model, measurements: Sequence[Measurement]) -> dict[str, float]:
    """Return by joint the rms torque [Nm] by which the new model differs from the old one along recordings."""
    total, rows = np.zeros(new.robot.n), np.zeros(new.robot.n)
    for measured in measurements:
        moved = measured.passed(new.predict(measured.motion) - old.predict(measured.motion))
        used = measured.used[measured.rows]
        total += np.sum(np.where(used, moved**2, 0.0), axis=0)
        rows += used.sum(axis=0)
    rms = np.sqrt(total / np.maximum(rows, 1.0))
    return dict(zip(new.robot.joints, (float(value) for value in rms), strict=True))


def shared_recordings(old: Model, new: Model) -> tuple[str, ...]:
    """Return the recordings that both models were identified from: what differs between them is then no chance."""
    seen = {one["sha256"] for one in old.provenance.get("recordings", ()) if one.get("sha256")}
    return tuple(one["path"] for one in new.provenance.get("recordings", ()) if one.get("sha256") in seen)


def changed(old: Model, new: Model, names: tuple[str, str] = ("the old model", "the new model")) -> ModelChange:
    """Return what has changed from one model to another of the same robot.

    Parameters of effects are matched by name, base parameters by what they are made of: another choice of them is
    converted. Sigmas count what a model lacks, but for models of release 0.1.0, of which a note tells that. Raises
    InputError for models of other joints, of torque in other units, or from the same recordings.
    """
    _refuse(old, new, names)
    there, unmatched = _converted(old, new)
    shared = [p for p in new.parameters if p.name in there]
    place = {p.name: k for k, p in enumerate(new.parameters)}
    rows = np.array([there[p.name] for p in shared])
    before, covariance = rows @ old.values, rows @ old.covariance @ rows.T
    chosen = np.array([place[p.name] for p in shared], dtype=int)
    after, own = new.values[chosen], new.covariance[np.ix_(chosen, chosen)]
    both = covariance + own
    std = np.sqrt(np.maximum(np.diag(both), 0.0))
    p_values = _holm(after - before, std)
    parameters = tuple(
        ParameterChange(
            p.name, p.unit, p.joint, p.effect, float(a), float(c**0.5), float(b), float(d**0.5), float(s), p_value
        )
        for p, a, b, c, d, s, p_value in zip(
            shared, before, after, np.diag(covariance), np.diag(own), std, p_values, strict=True
        )
    )
    labels = (old.structure.labels, new.structure.labels)
    only_old, only_new = (_only(*pair) for pair in (labels, labels[::-1]))
    return ModelChange(
        parameters,
        _by_joint(parameters, after - before, both),
        only_old,
        only_new,
        unmatched,
        _notes(old, new, names, only_old, only_new),
    )


def _refuse(old: Model, new: Model, names: tuple[str, str]) -> None:
    robots = old.robot, new.robot
    if robots[0].joints != robots[1].joints:
        raise InputError(
            f"{names[1]}: model of another robot: joints {', '.join(robots[1].joints)};"
            f" {names[0]} has {', '.join(robots[0].joints)}"
        )
    for number, joint in enumerate(robots[0].joints):
        units = [robot.torque_unit(number) for robot in robots]
        if units[0] != units[1]:
            raise InputError(f"{names[1]}: {joint} is in {units[1]}, in {names[0]} in {units[0]}")
    common = shared_recordings(old, new)
    if common:
        raise InputError(
            f"{names[0]} and {names[1]} were both identified from {', '.join(common)}: nothing can have changed between"
            " them; give a model of a later recording, or a recording to compare them on"
        )


def _converted(old: Model, new: Model) -> tuple[dict[str, Array], tuple[str, ...]]:
    """Return what each of the new model's parameters is of the old model's [p], by name, and the base parameters that
    are none.
    """
    count = len(old.parameters)
    place = {p.name: k for k, p in enumerate(old.parameters) if p.effect != "rigid_body"}
    out = {p.name: np.eye(count)[place[p.name]] for p in new.parameters if p.name in place}
    mine, theirs = new.structure.base, old.structure.base
    unmatched = []
    for name, row in zip(mine.names, mine.regrouping, strict=True):
        weights = np.linalg.lstsq(theirs.regrouping.T, row, rcond=None)[0]
        weights = np.where(np.abs(weights) > _SAME, weights, 0.0)
        if np.max(np.abs(weights @ theirs.regrouping - row)) > _SAME * max(1.0, float(np.max(np.abs(row)))):
            unmatched.append(name)
            continue
        out[name] = np.concatenate([weights, np.zeros(count - len(weights))])
    return out, tuple(unmatched)


def _holm(change: Array, std: Array) -> list[float | None]:
    """Return p-values of differences, those with no standard deviation left out, made fit for all of them together."""
    from scipy.special import ndtr

    told = np.flatnonzero(std > 0.0)
    p = 2.0 * ndtr(-np.abs(change[told] / std[told]))
    order = np.argsort(p)
    out: list[float | None] = [None] * len(change)
    worst = 0.0
    for rank, k in enumerate(order):
        worst = max(worst, min(1.0, float(p[k]) * (len(told) - rank)))
        out[int(told[k])] = worst
    return out


def _by_joint(parameters: Sequence[ParameterChange], change: Array, covariance: Array) -> tuple[JointChange, ...]:
    from scipy.special import chdtrc

    joints = list(dict.fromkeys(p.joint for p in parameters))
    out = []
    for joint in joints:
        mine = [k for k, p in enumerate(parameters) if p.joint == joint and p.std > 0.0]
        if not mine:
            continue
        scale = np.sqrt(np.diag(covariance)[mine])
        values, vectors = np.linalg.eigh(covariance[np.ix_(mine, mine)] / np.outer(scale, scale))
        kept = values > 1e-9 * values[-1]
        score = vectors[:, kept].T @ (change[mine] / scale)
        squared, dof = float(np.sum(score**2 / values[kept])), int(kept.sum())
        p_value = min(1.0, float(chdtrc(dof, squared)) * len(joints))
        out.append(JointChange(joint, len(mine), squared / dof, p_value))
    return tuple(out)


def _only(mine: Collection[str], others: Collection[str]) -> tuple[str, ...]:
    return tuple(label for label in mine if label not in others)


def _notes(
    old: Model, new: Model, names: tuple[str, str], only_old: Collection[str], only_new: Collection[str]
) -> tuple[str, ...]:
    notes = []
    for labels, name in ((only_old, names[0]), (only_new, names[1])):
        if labels:
            notes.append(
                f"only {name} holds {', '.join(labels)}: what it stands for is in other parameters of the other model,"
                " which seem to change; identify both with the same effects"
            )
    for model, name in zip((old, new), names, strict=True):
        misfits = _misfits(model.residual)
        if misfits:
            notes.append(
                f"{name} does not fit at {', '.join(misfits)}: on another motion what it lacks moves its parameters as"
                " well; repeat the same motion, or add what is missing first"
            )
        if misfits and model.noise_covariance is None:
            notes.append(
                f"the standard deviations of {name} count noise alone, as those of release 0.1.0 do: identify such a"
                " model anew"
            )
    return tuple(notes)


def _misfits(residual: Mapping[str, Any]) -> list[str]:
    return [
        joint
        for joint, fit in residual.items()
        if fit.noise_variance is not None and fit.mse > _MISFIT * fit.noise_variance
    ]
