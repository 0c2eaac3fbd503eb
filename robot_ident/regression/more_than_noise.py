"""Is a residual more than noise? An F test of the whole spectrum and of its bands, every line in units of its noise.

A residual is r = e + L z: the noise e of the torque, and what the model's parameters made of noise when they were
fitted, z of covariance M. In a band b of d lines the squared error r'r then has mean and variance

    m = d + tr(M G),   v = 2 (d + 2 tr(M G) + tr(M G M G)),   G = L_b' L_b,

and is taken as m chi^2_h / h with h = 2 m^2 / v (Satterthwaite, Biometrics Bulletin 2, 1946). The noise's variance is
an estimate itself, so that r'r / m is held against F(h, nu).
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np

from robot_ident.regression.evidence import Evidence
from robot_ident.regression.spectrum import Values, Whitening, Whole, wholes
from robot_ident.signals.motion import Array

ALPHA = 1e-3  # false alarms over all joints and bands together
BANDS = (1.0, 5.0, 15.0)  # Hz: bands up to these, and the rest
_LEAST = 4.0  # degrees of freedom of a band that is worth a test


def chance(p_value: float) -> str:
    """Return a p-value in words of a table; below 1e-99 it is no figure any more."""
    return "<1e-99" if p_value < 1e-99 else f"{p_value:.2g}"


@dataclass(frozen=True)
class NoiseTest:
    """Of one joint: squared error over what noise leaves of it, and its p-value.

    dof: squared error, in units of the noise, that noise leaves. p_value: the smallest over the whole spectrum and its
    bands, times their number and that of the joints (Bonferroni); band: the one it was found in.
    """

    statistic: float
    dof: float
    p_value: float
    band: str

    @property
    def fails(self) -> bool:
        """Whether there is more than noise."""
        return self.p_value < ALPHA


@dataclass(frozen=True)
class Share:
    """What fitted parameters do to a residual: columns L [N, n, k] of each trajectory and the covariance M [k, k].

    whitened: whether L is to be whitened as the residual is; where the fit did not whiten, L holds its columns twice,
    the first half whitened, the second half coloured: whitening and fit don't commute.
    """

    columns: tuple[Array, ...]
    covariance: Array
    twice: bool = False

    @classmethod
    def of_fit(cls, evidence: Evidence, orthonormal: Sequence[Array]) -> Share:
        """Return that of a fit to the evidence by unwhitened least squares, r = (1 - Q Q') e with Q [N, n, k].

        With whitening W, A = W Q and B = W^-1 Q: cov(W r) = 1 - A B' - B A' + A B'B A'.
        """
        k = orthonormal[0].shape[2]
        n = evidence.structure.robot.n
        parts = [(whole, joint) for joint in range(n) for whole in wholes(evidence, joint)]
        if not any(whole.whitening.coloured for whole, _ in parts):
            return cls(tuple(orthonormal), -np.eye(k))
        gram = np.zeros((k, k))
        for whole, joint in parts:
            b = whole.whitening.lines(whole.joined(orthonormal, joint), 0.5)
            gram += np.real(b.conj().T @ b)
        m = np.block([[gram, -np.eye(k)], [-np.eye(k), np.zeros((k, k))]])
        return cls(tuple(orthonormal), m, twice=True)

    def lines(self, whole: Whole, joint: int) -> Values:
        """Return L of one measurement and joint as whitened values [L, k or 2 k]."""
        columns = whole.joined(self.columns, joint)
        plain = whole.whitening.lines(columns)
        return np.hstack([plain, whole.whitening.lines(columns, 0.5)]) if self.twice else plain


def noise_tests(evidence: Evidence, residual: Sequence[Array], share: Share) -> tuple[NoiseTest, ...]:
    """Return the test of every joint's weighed residual [N, n] of each trajectory.

    FloatingPointError where one isn't finite: whatever made it so, it must not pass for fit.
    """
    n = evidence.structure.robot.n
    if not all(np.isfinite(rows).all() for rows in residual):
        raise FloatingPointError("a residual is not finite")
    return tuple(_noise_test(wholes(evidence, joint, residual), share, joint, n) for joint in range(n))


def _noise_test(parts: Sequence[Whole], share: Share, joint: int, joints: int) -> NoiseTest:
    from scipy.special import fdtrc

    values = [part.whitening.lines(part.residual) for part in parts]
    columns = [share.lines(part, joint) for part in parts]
    chosen: list[tuple[str, Callable[[Whitening], np.ndarray]]] = [("all", lambda w: w.count > 0.0)]
    if all(part.spectral for part in parts):
        edges = (0.0, *BANDS, np.inf)
        for a, b in zip(edges[:-1], edges[1:], strict=True):
            name = f"{a:g} to {b:g} Hz" if np.isfinite(b) else f"above {a:g} Hz"
            chosen.append((name, lambda w, a=a, b=b: w.inside(a, b) & (w.count > 0.0)))  # type: ignore[misc]
    whole: tuple[float, float] | None = None
    p_values = []
    for name, choose in chosen:
        inside = [choose(part.whitening) for part in parts]
        count = [float(np.sum(part.whitening.count[rows])) for part, rows in zip(parts, inside, strict=True)]
        if sum(count) < _LEAST:
            continue
        power = sum(float(np.sum(np.abs(v[rows]) ** 2)) for v, rows in zip(values, inside, strict=True))
        level = sum(part.whitening.noise(rows) for part, rows in zip(parts, inside, strict=True)) / sum(count)
        mean, dof = _moments([c[rows] for c, rows in zip(columns, inside, strict=True)], share.covariance, sum(count))
        mean *= level
        known = [part.whitening.noise_dof(rows) for part, rows in zip(parts, inside, strict=True)]
        noise_dof = 1.0 / sum((c / sum(count)) ** 2 / max(1.0, k) for c, k in zip(count, known, strict=True))
        whole = whole or (power / mean, mean)
        p_values.append((float(fdtrc(dof, noise_dof, power / mean)), name))
    if whole is None:
        return NoiseTest(0.0, 0.0, 1.0, "all")
    p, band = min(p_values)
    return NoiseTest(*whole, min(1.0, p * len(p_values) * joints), band)


def _moments(columns: Sequence[Values], covariance: Array, count: float) -> tuple[float, float]:
    """Return the mean m of a squared error and its degrees of freedom h (Satterthwaite)."""
    moved = covariance @ sum(np.real(c.conj().T @ c) for c in columns)
    trace = float(np.trace(moved))
    mean = max(count + trace, 1e-3 * count)
    return mean, mean**2 / max(count + 2.0 * trace + float(np.sum(moved * moved.T)), 1e-3 * count)
