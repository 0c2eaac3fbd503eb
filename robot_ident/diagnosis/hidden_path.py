"""What the part of a path that hides in the noise of its positions may do to the torque.

A drive that sticks or gives way as it reverses bends its path within milliseconds. Lines of that kink which don't
stand above the noise are missing from the acceleration: a torque remains at every reversal, of the shape of an effect
around reversals, in rows of every trajectory alike, so that prediction doesn't refute it.
"""

from __future__ import annotations

from collections.abc import Hashable
from dataclasses import replace

import numpy as np

from robot_ident.diagnosis.candidates import Score
from robot_ident.diagnosis.evidence import Evidence, Trajectory
from robot_ident.diagnosis.scan import BaseFit, BaseGram, add, base_gram, gram
from robot_ident.motion import Array
from robot_ident.recording.lines import Lines, evaluate, least_above_noise, lines_of_grid

_MATTERS = 1.0  # chi-square units that a hidden kink must make, at its usual size, to be reckoned with
_KEY = "hidden path"


def gain_beside_hidden_path(found: Score, evidence: Evidence) -> float:
    """Return the gain of an effect beside what hidden kinks of the path may make, in units of chi-square.

    Kinks are columns of the base whose coefficients are known beforehand to be 0 +- 1, in units of their usual size;
    such knowledge counts as an observation of each.
    """
    beside = _beside(evidence)
    if beside is None:
        return found.gain
    with_kinks, fit = beside
    return add(gram(found.columns, with_kinks), fit, found.effect.signs).gain


def _beside(evidence: Evidence) -> tuple[Evidence, BaseFit] | None:
    """Return the evidence with hidden kinks among its base columns, and the base fitted; None where none matters."""
    key: Hashable = (_KEY, evidence.structure.labels, tuple(evidence.values.tolist()))
    if key not in evidence.memory:
        evidence.memory[key] = _with_kinks(evidence)
    found = evidence.memory[key]
    assert found is None or isinstance(found, tuple)
    return found


def _with_kinks(evidence: Evidence) -> tuple[Evidence, BaseFit] | None:
    parts = [_kinks(t, evidence) for t in evidence.trajectories]
    energy = np.sum([np.sum(part**2, axis=(0, 1)) for part in parts], axis=0)
    matter = energy > _MATTERS
    if not matter.any():
        return None
    phi = tuple(np.concatenate([p, k[:, :, matter]], axis=2) for p, k in zip(evidence.phi, parts, strict=True))
    beside = replace(evidence, phi=phi)
    base = base_gram(beside)
    own = base.own.copy()
    first = evidence.phi[0].shape[2]
    own[0, 0, range(first, phi[0].shape[2]), range(first, phi[0].shape[2])] += 1.0
    return beside, BaseFit.of(BaseGram(own, base.torque, base.power), range(len(parts)))


def _kinks(t: Trajectory, evidence: Evidence) -> Array:
    """Return the weighed torque [N, n, 2 n] of every joint's hidden kinks of usual size, in phase with the reversals
    and in quadrature: the lag of the servo turns them.
    """
    samples, n = t.motion.q.shape
    out = np.zeros((samples, n, 2 * n))
    measured = t.measured
    if measured.base_frequency is None or measured.decimate != 1 or measured.position_lines is None:
        return out
    structure, values = evidence.structure, evidence.values
    plain = structure.torques(t.motion, values).total
    lines = _hidden_lines(t)
    for joint in range(n):
        for turn, factor in enumerate((1.0, 1.0j)):
            ddq = t.motion.ddq.copy()
            ddq[:, joint] += evaluate(factor * lines[:, [joint]], samples, measured.base_frequency, 2)[:, 0]
            out[:, :, 2 * joint + turn] = structure.torques(replace(t.motion, ddq=ddq), values).total - plain
    return t.weighed(out)


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
