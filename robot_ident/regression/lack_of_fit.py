"""Is anything missing at all? A fitted model's squared error beside the noise, which was measured without a model."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from robot_ident.regression.evidence import Evidence
from robot_ident.regression.gram import BaseFit, BaseGram
from robot_ident.regression.hidden_path import residual_beside_hidden_path
from robot_ident.regression.more_than_noise import NoiseTest, Share, noise_tests
from robot_ident.signals.motion import Array


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
    orthonormal = [t.times(phi, root) for t, phi in zip(evidence.trajectories, evidence.phi, strict=True)]
    tests = noise_tests(evidence, residual_beside_hidden_path(evidence), Share.of_fit(evidence, orthonormal))
    return tuple(
        LackOfFit(**vars(test), excess=_excess(evidence, joint, orthonormal)) for joint, test in enumerate(tests)
    )


def _excess(evidence: Evidence, joint: int, orthonormal: list[Array]) -> float:
    """Return the mean square of the residual beyond the noise [(Nm)^2]."""
    beyond = rows = 0.0
    for t, rest, q in zip(evidence.trajectories, evidence.newton, orthonormal, strict=True):
        used = float(np.sum(t.weight[:, joint] > 0))
        spent = float(np.sum(q[:, joint] ** 2)) / t.measured.independent
        beyond += float(np.sum(rest[:, joint] ** 2)) - float(t.measured.averaged_variance[joint]) * (used - spent)
        rows += used
    return max(0.0, beyond) / max(1.0, rows)
