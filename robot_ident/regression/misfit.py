"""Does a model leave more than noise, as it stands (with false alarms under control whatever it was fitted to), or
fitted to these recordings?
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from robot_ident.regression.evidence import Evidence, held, kept_between_parts
from robot_ident.regression.gram import BaseFit, BaseGram
from robot_ident.regression.hidden_path import misfit_beside_hidden_path, residual_beside_hidden_path
from robot_ident.regression.more_than_noise import NoiseTest, Share, noise_tests
from robot_ident.regression.spectrum import white_lines, wholes
from robot_ident.signals.motion import Array

_FITTED = 0.2  # of the parameters' number: less than that between estimate and best fit means that it is the fit


def misfit(evidence: Evidence, covariance: Array) -> tuple[NoiseTest, ...]:
    """Return the lack of fit of every joint; covariance [p or more, p or more]: of the model's parameters.

    Residuals of the recordings that the model was fitted to have lost degrees of freedom to it; those of others carry
    the uncertainty of its parameters on top of their own noise. Which it is shows in the residual: of its own
    recordings nothing of it lies along the columns, whitened where the fit counted the noise's colour, plain otherwise.
    """
    return noise_tests(evidence, evidence.residual, _share(evidence, covariance))


def beside_hidden_path(evidence: Evidence, covariance: Array) -> tuple[NoiseTest, ...]:
    """Return `misfit` of what the part of the path that the noise of the positions hides can't have made.

    As `diagnose` judges whether anything is missing, but with the model's values as they are.
    """
    lines = replace(
        evidence, trajectories=white_lines(evidence.trajectories, evidence), memory=kept_between_parts(evidence)
    )
    white = held(lines, evidence.structure, evidence.values)
    return noise_tests(white, misfit_beside_hidden_path(white), _share(white, covariance))


def _share(evidence: Evidence, covariance: Array) -> Share:
    p = evidence.phi[0].shape[2]
    for whitened in (True, False):
        root, inside = _against_columns(evidence, whitened=whitened)
        if inside < _FITTED * p:
            orthonormal = tuple(phi @ root for phi in evidence.phi)
            return Share(orthonormal, -np.eye(root.shape[1])) if whitened else Share.of_fit(evidence, orthonormal)
    values, vectors = np.linalg.eigh(covariance[:p, :p])
    return Share(tuple(phi @ (vectors * np.sqrt(np.maximum(values, 0.0))) for phi in evidence.phi), np.eye(p))


def _against_columns(evidence: Evidence, *, whitened: bool) -> tuple[Array, float]:
    """Return the root R [p, k] that makes the columns orthonormal, phi R, and the residual's square along them."""
    p = evidence.phi[0].shape[2]
    gram, right = np.zeros((p, p)), np.zeros(p)
    power = -0.5 if whitened else 0.0
    for joint in range(evidence.structure.robot.n):
        for whole in wholes(evidence, joint):
            columns = whole.whitening.lines(whole.joined(evidence.phi, joint), power)
            rest = whole.whitening.lines(whole.residual, power)
            gram += np.real(columns.conj().T @ columns)
            right += np.real(columns.conj().T @ rest)
    scale = np.sqrt(np.maximum(np.diag(gram), 1e-300))
    values, vectors = np.linalg.eigh(gram / np.outer(scale, scale))
    kept = values > 1e-13 * values[-1]
    root = (vectors[:, kept] / np.sqrt(values[kept])) / scale[:, None]
    return root, float(np.sum((root.T @ right) ** 2))


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
