"""Why a model may miss most of a joint's torque: the data's sign, unit, names, time or gravity before any physics."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np

from robot_ident.estimation.effort_checks import EffortChecks
from robot_ident.estimation.validation import residual_on
from robot_ident.model.model import Model
from robot_ident.recording.measurement import Measurement
from robot_ident.robot.robot import Robot
from robot_ident.signals.motion import Array

_POOR = 0.5  # of a joint's torque: a model that misses more is asked why
_BEYOND_NOISE = 4.0  # times the noise's variance
_FITS = 0.1  # of the effort's power about its mean, that a reading may leave over to be named
_BETTER = 0.25  # of what the model leaves over, that it may leave
_SAME = 0.1  # by which a gain may differ from 1 and be none
_LATEST = 0.2  # s by which effort may come late or early


def likely_reason(model: Model, measurements: Sequence[Measurement]) -> str | None:
    """Return in a sentence why a model misses more than half of the torque of some joint of some recording.

    First what the URDF's masses say against the robot YAML: absolute values, names, coupling, gravity, sign, unit. Then
    what the model itself says of the effort: a sign, a gain, an offset, names exchanged, a delay. None where the model
    follows all joints, or nothing of this tells why.
    """
    for measured in measurements:
        poor = _poor_joints(model, measured)
        if not poor:
            continue
        told = _against_declaration(measured, model.robot) or _against_model(model, measured, poor)
        if told:
            return f"{measured.source}: {told}"
    return None


def _poor_joints(model: Model, measured: Measurement) -> list[int]:
    found = residual_on(model, measured)
    return [
        model.robot.joint_index(name)
        for name, one in found.items()
        if (one.relative or 0.0) > _POOR and one.mse > _BEYOND_NOISE * (one.noise_variance or 0.0)
    ]


def _against_declaration(measured: Measurement, robot: Robot) -> str:
    """Return what the effort says against the robot YAML, by the URDF's masses; nothing under an unknown payload."""
    if measured.conditions.estimated:
        return ""
    checks = EffortChecks([measured], robot)
    foreign = checks.foreign() or checks.exchanged()
    if foreign:
        return foreign.removeprefix(f"{measured.source}: ")
    found = checks.declaration()
    return found.told(robot) if found else ""


def _against_model(model: Model, measured: Measurement, poor: Sequence[int]) -> str:
    """Return what the effort says beside the model's own torque."""
    torque, predicted = measured.passed(measured.torque), measured.passed(model.predict(measured.motion))
    used = measured.used[measured.rows]
    names, robot = model.robot.joints, model.robot
    pairs = _exchanged(torque, predicted, used, poor)
    told = [f"the efforts of {names[j]} and {names[k]} are exchanged" for j, k in pairs.items() if j < k]
    for joint in (j for j in poor if j not in pairs):
        rows = used[:, joint]
        tau, own = torque[rows, joint], predicted[rows, joint]
        before = _share(tau, own)
        gain, offset, left = _line(own, tau)
        if left < min(_FITS, _BETTER * before):
            told.append(_in_words(names[joint], gain, offset, robot.torque_unit(joint)))
            continue
        late, left = _late(torque[:, joint], predicted[:, joint], rows, measured.dt * measured.decimate)
        if late and left < min(_FITS, _BETTER * before):
            told.append(
                f"the effort of {names[joint]} comes {abs(late) * 1e3:.0f} ms {'late' if late > 0 else 'early'}"
            )
    return "; ".join(told)


def _in_words(joint: str, gain: float, offset: float, unit: str) -> str:
    if abs(gain - 1.0) < _SAME:
        return f"the effort of {joint} stands {offset:.3g} {unit} beside the model's (an offset, or an unstated load)"
    if abs(gain + 1.0) < _SAME:
        return f"the effort of {joint} has the opposite sign of the model's"
    turned = " and the opposite sign" if gain < 0 else ""
    return f"the effort of {joint} is {abs(gain):.3g} times the model's{turned} (another unit or gain)"


def _share(tau: Array, predicted: Array) -> float:
    """Return the share of an effort's power about its mean that a prediction leaves."""
    power = float(np.sum((tau - tau.mean()) ** 2))
    return float(np.sum((tau - predicted) ** 2)) / power if power > 0 else 0.0


def _line(predicted: Array, tau: Array) -> tuple[float, float, float]:
    """Return gain and offset that make an effort of a prediction, and the share of its power that they leave."""
    columns = np.column_stack([predicted, np.ones_like(predicted)])
    (gain, offset), *_ = np.linalg.lstsq(columns, tau, rcond=1e-9)
    return float(gain), float(offset), _share(tau, columns @ np.array([gain, offset]))


def _exchanged(torque: Array, predicted: Array, used: np.ndarray, poor: Sequence[int]) -> Mapping[int, int]:
    """Return pairs of joints each of whose efforts is what the model says of the other."""
    out = {}
    for j in poor:
        for k in poor:
            rows = used[:, j] & used[:, k]
            both = ((torque[rows, j], predicted[rows, k]), (torque[rows, k], predicted[rows, j]))
            if j != k and rows.sum() > 2 and all(_share(tau, other) < _FITS for tau, other in both):
                out[j] = k
    return out


def _late(tau: Array, predicted: Array, rows: np.ndarray, step: float) -> tuple[float, float]:
    """Return by how much an effort comes later than its prediction [s] where that fits best, and what it leaves."""
    most = min(round(_LATEST / step), len(tau) // 10)
    inside = rows & (np.arange(len(tau)) >= most) & (np.arange(len(tau)) < len(tau) - most)
    if most < 1 or inside.sum() < 10:
        return 0.0, 1.0
    left = {lag: _share(tau[inside], np.roll(predicted, lag)[inside]) for lag in range(-most, most + 1)}
    best = min(left, key=lambda lag: left[lag])
    return best * step, left[best]
