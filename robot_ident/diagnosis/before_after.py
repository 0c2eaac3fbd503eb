"""What an effect does to a model's error, in torque, and how large it is."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from robot_ident.diagnosis.diagnosis import Estimate
from robot_ident.effects import Effect
from robot_ident.recording.measurement import Measurement
from robot_ident.regression.block_jackknife import block_jackknife, half_seconds
from robot_ident.regression.evidence import Evidence
from robot_ident.signals.motion import Array

_STEP = 1e-3  # of the range of an inner parameter, for derivatives


def mean_squares(evidence: Evidence) -> dict[str, float]:
    """Return the mean square of the residual of every joint, (Nm)^2."""
    out = {}
    newton = evidence.newton
    for joint, name in enumerate(evidence.structure.robot.joints):
        total, rows = 0.0, 0
        for t, residual in zip(evidence.trajectories, newton, strict=True):
            total += float(np.sum(residual[:, joint] ** 2))
            rows += int(np.sum(t.weight[:, joint] > 0))
        out[name] = total / max(rows, 1)
    return out


def errors(evidence: Evidence, validation: Sequence[Measurement]) -> dict[str, float]:
    """Return the mean square error of every joint on measurements that were not fitted, (Nm)^2."""
    structure = evidence.structure
    total, rows = np.zeros(structure.robot.n), np.zeros(structure.robot.n)
    for measured in validation:
        predicted = structure.columns(measured.motion, evidence.values) @ evidence.values
        error = measured.passed(measured.torque - predicted)
        used = measured.used[measured.rows]
        total += np.sum(np.where(used, error**2, 0.0), axis=0)
        rows += used.sum(axis=0)
    return {name: float(total[j] / max(rows[j], 1)) for j, name in enumerate(structure.robot.joints)}


def estimates(evidence: Evidence, effect: Effect) -> tuple[Estimate, ...]:
    """Return the parameters of an effect that the evidence's model holds, inner ones included, with their spread.

    std: the larger of what noise makes of them and of what leaving out half a second at a time does, as that of a
    model; inner parameters linearised. Those that only take values of a grid have no std (0).
    """
    # in the model it lacks the coefficients whose columns another effect holds
    effect = next((one for one in evidence.structure.effects if one.label == effect.label), effect)
    jacobians, free = _jacobians(evidence, effect)
    std = spread(evidence, jacobians)
    place = {name: k for k, name in enumerate(evidence.structure.names)}
    linear = [
        Estimate(name, float(evidence.values[place[name]]), float(std[place[name]]), unit)
        for name, unit in zip(effect.parameter_names(), effect.parameter_units(), strict=True)
    ]
    inner_std = dict(zip(free, std[len(place) :], strict=True))
    inner = [
        Estimate(name, float(effect.setting[i.name]), float(inner_std.get(i.name, 0.0)), unit)
        for name, unit, i in zip(effect.inner_names(), effect.inner_units(), effect.inner, strict=True)
    ]
    return (*linear, *inner)


def spread(evidence: Evidence, jacobians: Sequence[Array]) -> Array:
    """Return the standard deviation [p] of parameters of weighed derivatives [N, n, p] of every trajectory, as
    `estimates` tells.
    """
    along = evidence.trajectories
    rows = np.concatenate([t.stacked(j) for t, j in zip(along, jacobians, strict=True)])
    residual = np.concatenate([t.stacked(r) for t, r in zip(along, evidence.residual, strict=True)])
    scale = np.maximum(np.linalg.norm(rows, axis=0), 1e-150)
    noise = np.diag(np.linalg.pinv((rows / scale).T @ (rows / scale), rcond=1e-11, hermitian=True)) / scale**2
    samples = [np.arange(len(t.y))[t.rows].repeat(t.y.shape[1]) for t in along]
    number = np.repeat(np.arange(len(along)), [len(own) for own in samples])
    blocks = half_seconds([t.measured for t in along], number, np.concatenate(samples))
    left_out = np.diag(block_jackknife(rows, rows, residual, blocks))
    return np.asarray(np.sqrt(np.maximum(noise, left_out)))


def _jacobians(evidence: Evidence, effect: Effect) -> tuple[list[Array], list[str]]:
    """Return each trajectory's weighed derivatives [N, n, p + free] by the model's parameters and the effect's free
    inner ones, and the names of these.
    """
    structure = evidence.structure
    held = next(e for e in structure.effects if e.label == effect.label)
    names = effect.parameter_names()
    place = {name: k for k, name in enumerate(structure.names)}
    coefficients = np.array([evidence.values[place[name]] for name in names])
    free = [i for i in held.inner if i.continuous]
    out = []
    for number, (t, phi) in enumerate(zip(evidence.trajectories, evidence.phi, strict=True)):
        columns = [phi]
        torque = evidence.torques[number] if held.uses_torque and free else None
        for inner in free:
            value = held.setting[inner.name]
            step = _STEP * (inner.upper - inner.lower)
            ends = np.clip([value - step, value + step], inner.lower, inner.upper)
            low, high = (held.at({inner.name: float(x)}).columns(t.motion, torque) @ coefficients for x in ends)
            columns.append(t.weighed(((high - low) / (ends[1] - ends[0]))[:, :, None]))
        out.append(np.concatenate(columns, axis=2))
    return out, [i.name for i in free]
