"""Is anything missing at all? The squared error beside the noise that was measured without a model."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from robot_ident.diagnosis.evidence import Evidence
from robot_ident.diagnosis.hidden_path import residual_beside_hidden_path
from robot_ident.diagnosis.scan import BaseFit, BaseGram
from robot_ident.motion import Array

ALPHA = 1e-3  # false alarms over all joints and bands together
BANDS = (1.0, 5.0, 15.0)  # Hz: bands up to these, and the rest


@dataclass(frozen=True)
class LackOfFit:
    """Of one joint: squared error over what noise alone would leave, its degrees of freedom and its p-value.

    p_value is the smallest over the whole spectrum and its bands, times their number (Bonferroni). excess: mean
    square of the residual beyond the noise, (Nm)^2, over the rows used.
    """

    statistic: float
    dof: float
    p_value: float
    excess: float
    band: str

    @property
    def fails(self) -> bool:
        """Whether the model doesn't fit."""
        return self.p_value < ALPHA


def lack_of_fit(evidence: Evidence, base: BaseGram) -> tuple[LackOfFit, ...]:
    """Return the lack of fit of every joint, all trajectories together.

    F test: the noise's variance is itself estimated, with its own degrees of freedom. What the hidden part of the path
    may have made is no sign of anything missing; it counts in `excess` alone.
    """
    from scipy.stats import f as fisher

    fit = BaseFit.of(base, range(len(base.power)))
    spent = np.einsum("pq,tjqp->j", fit.inverse, base.own)
    n = evidence.structure.robot.n
    noise_dof = max(1.0, sum(t.measured.variance_dof for t in evidence.trajectories))
    tests = 1 + len(BANDS) + 1
    out = []
    residual = residual_beside_hidden_path(evidence)
    for joint in range(n):
        total = float(sum(np.sum(r[:, joint] ** 2) for r in residual))
        whole = float(sum(np.sum(r[:, joint] ** 2) for r in evidence.residual))
        dof = float(sum(t.dof[joint] for t in evidence.trajectories) - spent[joint])
        p_values = [(float(fisher.sf(total / dof, dof, noise_dof)), "all")]
        for name, power, count in _bands(evidence, residual, joint, spent[joint]):
            if count >= 4:
                p_values.append((float(fisher.sf(power / count, count, noise_dof)), name))
        p, band = min(p_values)
        out.append(LackOfFit(total / dof, dof, min(1.0, p * tests * n), _excess(evidence, joint, whole, dof), band))
    return tuple(out)


def _excess(evidence: Evidence, joint: int, total: float, dof: float) -> float:
    """Return the mean square of the residual beyond the noise [(Nm)^2]."""
    weights = np.concatenate([t.weight[:, joint] ** 2 for t in evidence.trajectories])
    rows = np.concatenate([t.weight[:, joint] > 0 for t in evidence.trajectories])
    return max(0.0, total - dof) / max(1.0, float(rows.sum())) / float(np.mean(weights[rows]))


def _bands(evidence: Evidence, residuals: Sequence[Array], joint: int, spent: float) -> list[tuple[str, float, float]]:
    """Return (name, squared error, degrees of freedom) of frequency bands, periodic trajectories only."""
    edges = (0.0, *BANDS, np.inf)
    power, count = np.zeros(len(edges) - 1), np.zeros(len(edges) - 1)
    for t, residual in zip(evidence.trajectories, residuals, strict=True):
        frequency = t.measured.base_frequency
        if frequency is None or t.measured.decimate != 1:
            return []
        lines = np.fft.rfft(residual[:, joint])
        samples = len(residual)
        line_power = np.abs(lines) ** 2 * (2.0 / samples)
        line_power[0] *= 0.5
        share = t.dof[joint] / samples
        limit = t.measured.low_pass.cutoff if t.measured.low_pass else np.inf
        f = np.arange(len(lines)) * frequency
        for band in range(len(power)):
            inside = (f >= edges[band]) & (f < edges[band + 1]) & (f <= limit)
            power[band] += float(line_power[inside].sum())
            count[band] += 2.0 * inside.sum() * (share if limit == np.inf else 1.0)
    count[0] -= spent
    names = [f"{low:g} to {high:g} Hz" for low, high in zip(edges[:-1], edges[1:], strict=True)]
    return [(name, float(p), float(c)) for name, p, c in zip(names, power, count, strict=True)]


def joint_noise(evidence: Evidence) -> Array:
    """Return the variance [n] of the noise on the averaged torque, (Nm)^2, mean over trajectories."""
    return np.asarray(np.mean([t.measured.averaged_variance for t in evidence.trajectories], axis=0))
