"""What the part of a path that hides in the noise of its positions may do to the torque.

A drive that sticks or gives way as it reverses bends its path within milliseconds. Lines of that kink which don't
stand above the noise are missing from the acceleration: a torque remains at every reversal, of the shape of an effect
around reversals, in rows of every trajectory alike, so that prediction doesn't refute it. A fast effect shakes its
drive as well, faster than the servo follows: what it gives way is missing from the acceleration too, and makes the
effect seem to lag and to fade.
"""

from __future__ import annotations

from collections.abc import Hashable
from dataclasses import replace

import numpy as np

from robot_ident.diagnosis.candidates import Score
from robot_ident.diagnosis.evidence import Evidence, Trajectory, added
from robot_ident.diagnosis.scan import BaseFit, BaseGram, add, base_gram, gram
from robot_ident.motion import Array
from robot_ident.recording.lines import Lines, evaluate, least_above_noise, lines_of_grid

_MATTERS = 1.0  # chi-square units that a hidden part must make, at its usual size, to be reckoned with
_KEY = "hidden path"


def gain_beside_hidden_path(found: Score, evidence: Evidence) -> float:
    """Return the gain of an effect beside what the hidden path may make, in units of chi-square.

    The latter are columns of the base whose coefficients are known beforehand to be 0 +- 1, in units of their usual
    size; such knowledge counts as an observation of each.
    """
    beside = _beside(evidence)
    if beside is None:
        return found.gain
    with_hidden, fit = beside
    return add(gram(found.columns, with_hidden), fit, found.effect.signs).gain


def residual_beside_hidden_path(evidence: Evidence) -> tuple[Array, ...]:
    """Return the weighed residual [N, n] of each trajectory without what the hidden path may have made of it."""
    beside = _beside(evidence)
    if beside is None:
        return evidence.residual
    with_hidden, fit = beside
    return tuple(t.y - phi @ fit.values for t, phi in zip(evidence.trajectories, with_hidden.phi, strict=True))


def _beside(evidence: Evidence) -> tuple[Evidence, BaseFit] | None:
    """Return the evidence with the hidden path among its base columns, and the base fitted; None where none matters."""
    key: Hashable = (_KEY, evidence.structure.labels, evidence.values.tobytes())
    if key not in evidence.memory:
        evidence.memory[key] = _with_hidden_path(evidence)
    found = evidence.memory[key]
    assert found is None or isinstance(found, tuple)
    return found


def _with_hidden_path(evidence: Evidence) -> tuple[Evidence, BaseFit] | None:
    if any(t.measured.position_lines is None or t.measured.decimate != 1 for t in evidence.trajectories):
        return None
    parts = [
        t.weighed(np.concatenate([_kinks_once(t, evidence), _given_way(t, rigid, evidence)], axis=2))
        for t, rigid in zip(evidence.trajectories, evidence.rigid, strict=True)
    ]
    matter = np.sum([np.sum(part**2, axis=(0, 1)) for part in parts], axis=0) > _MATTERS
    if not matter.any():
        return None
    phi = tuple(np.concatenate([p, k[:, :, matter]], axis=2) for p, k in zip(evidence.phi, parts, strict=True))
    beside = replace(evidence, phi=phi)
    base = base_gram(beside)
    own = base.own.copy()
    further = np.arange(evidence.phi[0].shape[2], phi[0].shape[2])
    own[0, 0, further, further] += 1.0
    return beside, BaseFit.of(BaseGram(own, base.torque, base.power), range(len(parts)))


def _kinks_once(t: Trajectory, evidence: Evidence) -> Array:
    """Return `_kinks`, computed once for all models on a measurement: further effects hardly change an inertia."""
    key: Hashable = (_KEY, id(t.measured))
    if key not in evidence.memory:
        evidence.memory[key] = _kinks(t, evidence)
    found = evidence.memory[key]
    assert isinstance(found, np.ndarray)
    return found


def _kinks(t: Trajectory, evidence: Evidence) -> Array:
    """Return the torque [N, n, 2 n] Nm of every joint's hidden kinks of usual size, in phase with its reversals and in
    quadrature: the lag of the servo turns them.
    """
    samples, n = t.motion.q.shape
    out = np.zeros((samples, n, 2 * n))
    structure, values = evidence.structure, evidence.values
    plain = structure.torques(t.motion, values).total
    lines = _hidden_lines(t)
    for joint in range(n):
        for turn, factor in enumerate((1.0, 1.0j)):
            ddq = t.motion.ddq.copy()
            ddq[:, joint] += evaluate(factor * lines[:, [joint]], samples, t.measured.base_frequency or 0.0, 2)[:, 0]
            out[:, :, 2 * joint + turn] = structure.torques(replace(t.motion, ddq=ddq), values).total - plain
    return out


def _given_way(t: Trajectory, rigid: Array, evidence: Evidence) -> Array:
    """Return the torque [N, n, 4 k] Nm by which the drives may give way to k added effects, unseen in their positions.

    Lines of the effect's own torque where the position shows none, in phase and in quadrature, as they are and falling
    with frequency.
    """
    structure, kept = evidence.structure, t.measured.position_lines
    assert kept is not None
    columns = structure.columns(t.motion, evidence.values, rigid)
    mine = {effect.label for effect in added(structure)}
    start, out = rigid.shape[2], [np.zeros((*t.motion.q.shape, 0))]
    for effect in structure.effects:
        place = slice(start, start + len(effect.coefficients))
        start = place.stop
        if effect.label not in mine:
            continue
        lines = lines_of_grid(columns[:, :, place] @ evidence.values[place])
        lines[: len(kept)][kept[: len(lines)]] = 0.0
        falling = kept.sum(axis=0) / np.maximum(np.arange(len(lines)), 1)[:, None]
        turned = [lines, 1j * lines, falling * lines, 1j * falling * lines]
        out.append(np.stack([evaluate(part, t.motion.samples, 1.0) for part in turned], axis=2))
    return np.concatenate(out, axis=2)


def _hidden_lines(t: Trajectory) -> Lines:
    """Return the lines [K + 1, n] of each joint's kinks at its reversals that noise may hide.

    A kink of the velocity by the same amount at every reversal has the lines of sign(dq) over k^2; where the lines end
    that stand above the noise, it is as large as the least that would.
    """
    measured, motion = t.measured, t.motion
    variance, kept = measured.averaged_position_variance, measured.position_lines
    lines = lines_of_grid(np.sign(motion.dq))
    if variance is None or kept is None:
        return np.zeros_like(lines)
    least = least_above_noise(len(kept), variance, motion.samples)
    count = np.arange(len(lines))
    for joint in range(motion.joints):
        edge = max(1, int(kept[:, joint].sum()) - 1)
        near = np.sqrt(np.mean(np.abs(lines[edge : 2 * edge + 1, joint]) ** 2))
        lines[:, joint] *= least[joint] / max(float(near), 1e-300) * np.minimum(1.0, (edge / np.maximum(count, 1)) ** 2)
        lines[: len(kept), joint][kept[: len(lines), joint]] = 0.0
    return lines
