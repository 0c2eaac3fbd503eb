"""Is anything missing at all? A fitted model's squared error beside the noise, which was measured without a model."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from robot_ident.diagnosis.evidence import Evidence
from robot_ident.diagnosis.hidden_path import residual_beside_hidden_path
from robot_ident.diagnosis.noise_test import NoiseTest, Share, noise_tests
from robot_ident.diagnosis.scan import BaseFit, BaseGram
from robot_ident.motion import Array


@dataclass(frozen=True)
class LackOfFit(NoiseTest):
    """Of one joint, and excess: mean square of the residual beyond the noise, (Nm)^2, over the rows used."""

    excess: float


def lack_of_fit(evidence: Evidence, base: BaseGram) -> tuple[LackOfFit, ...]:
    """Return the lack of fit of every joint, all trajectories together.

    What the hidden part of the path may have made is no sign of anything missing; it counts in `excess` alone.
    """
    inverse = BaseFit.of(base, range(len(base.power))).inverse
    values, vectors = np.linalg.eigh(0.5 * (inverse + inverse.T))
    root = vectors * np.sqrt(np.maximum(values, 0.0))
    orthonormal = [phi @ root for phi in evidence.phi]
    tests = noise_tests(evidence, residual_beside_hidden_path(evidence), Share.of_fit(evidence, orthonormal))
    return tuple(
        LackOfFit(**vars(test), excess=_excess(evidence, joint, orthonormal)) for joint, test in enumerate(tests)
    )


def _excess(evidence: Evidence, joint: int, orthonormal: list[Array]) -> float:
    """Return the mean square of the residual beyond the noise [(Nm)^2]."""
    total = float(sum(np.sum(r[:, joint] ** 2) for r in evidence.residual))
    spent = float(sum(np.sum(q[:, joint] ** 2) for q in orthonormal))
    dof = float(sum(t.dof[joint] for t in evidence.trajectories)) - spent
    weights = np.concatenate([t.weight[:, joint] ** 2 for t in evidence.trajectories])
    rows = np.concatenate([t.weight[:, joint] > 0 for t in evidence.trajectories])
    return max(0.0, total - dof) / max(1.0, float(rows.sum())) / float(np.mean(weights[rows]))


def joint_noise(evidence: Evidence) -> Array:
    """Return the variance [n] of the noise on the averaged torque, (Nm)^2, mean over trajectories."""
    return np.asarray(np.mean([t.measured.averaged_variance for t in evidence.trajectories], axis=0))
