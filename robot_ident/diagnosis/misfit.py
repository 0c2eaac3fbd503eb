"""Does a model, as it stands, leave more than noise? With false alarms under control whatever it was fitted to."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from robot_ident.diagnosis.evidence import Evidence
from robot_ident.diagnosis.lack_of_fit import ALPHA, BANDS
from robot_ident.diagnosis.spectrum import bands, effective_share
from robot_ident.motion import Array

_FITTED = 0.2  # of the parameters' number: less than that between estimate and best fit means that it is the fit


@dataclass(frozen=True)
class Misfit:
    """Of one joint: mean squared residual over what noise leaves (and the model's own uncertainty), and its p-value.

    p_value is the smallest over the whole spectrum and its bands, times their number and that of the joints.
    """

    statistic: float
    dof: float
    p_value: float
    band: str

    @property
    def fails(self) -> bool:
        """Whether the model doesn't fit."""
        return self.p_value < ALPHA


def misfit(evidence: Evidence, covariance: Array) -> tuple[Misfit, ...]:
    """Return the lack of fit of every joint by an F test: the variance of the noise is itself an estimate.

    Residuals of the recordings that the model was fitted to have lost degrees of freedom to it; those of others carry
    the uncertainty of its parameters, covariance [p or more, p or more], on top of their own noise. Which it is shows
    in the residual: of its own recordings nothing of it lies along the columns.
    """
    from scipy.stats import f as fisher

    robot = evidence.structure.robot
    noise_dof = max(1.0, sum(t.measured.variance_dof for t in evidence.trajectories))
    spent = _spent(evidence, covariance)
    edges = (0.0, *BANDS, np.inf)
    out = []
    for joint in range(robot.n):
        power = sum(float(np.sum(r[:, joint] ** 2)) for r in evidence.residual)
        dof = sum(float(t.dof[joint]) for t in evidence.trajectories)
        effective = sum(float(t.dof[joint]) * effective_share(t, joint) for t in evidence.trajectories)
        tests = [("all", power, dof - spent[joint], effective)]
        for place, band in enumerate(bands(evidence, joint, edges)):
            name = f"{band.lower:g} to {band.upper:g} Hz"
            tests.append((name, band.power, band.dof - (spent[joint] if place == 0 else 0.0), band.dof))
        p_values = [
            (float(fisher.sf(found / expected, count, noise_dof)), name)
            for name, found, expected, count in tests
            if expected >= 4.0
        ]
        p, band_name = min(p_values)
        statistic = power / (dof - spent[joint])
        out.append(Misfit(statistic, dof - spent[joint], min(1.0, p * len(p_values) * robot.n), band_name))
    return tuple(out)


def _spent(evidence: Evidence, covariance: Array) -> Array:
    """Return what each joint's squared error lacks by the fit [n], negative where parameters add their uncertainty."""
    n, p = evidence.structure.robot.n, evidence.phi[0].shape[2]
    stacked = np.concatenate([phi.reshape(-1, p) for phi in evidence.phi])
    rest = np.concatenate([r.ravel() for r in evidence.residual])
    scale = np.maximum(np.linalg.norm(stacked, axis=0), 1e-300)
    u, s, _ = np.linalg.svd(stacked / scale, full_matrices=False)
    u = u[:, s > 1e-10 * s[0]]
    # rows that a low pass has smeared stand for fewer independent ones
    independent = float(np.mean([t.measured.independent for t in evidence.trajectories]))
    if float(np.sum((u.T @ rest) ** 2)) < _FITTED * p * max(independent, 1e-3):
        rows = np.sum(u**2, axis=1)
        return np.asarray(rows.reshape(-1, n).sum(axis=0))
    uncertain = np.sum((stacked @ covariance[:p, :p]) * stacked, axis=1)
    return -np.asarray(uncertain.reshape(-1, n).sum(axis=0))
