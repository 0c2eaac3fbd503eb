"""Finite Fourier series as joint trajectories, with their extremes in continuous time."""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from robot_ident.signals.motion import Array, Motion, frozen_array

_NEGLIGIBLE = 1e-13  # a harmonic this far below the largest one doesn't move an extreme by more than rounding


class Extremes(NamedTuple):
    """Smallest and largest value of n signals over a time span [n], and when they are reached [n] s."""

    lower: Array
    lower_time: Array
    upper: Array
    upper_time: Array

    @property
    def largest(self) -> Array:
        """Largest absolute value [n]."""
        return np.maximum(np.abs(self.lower), np.abs(self.upper))


class MotionExtremes(NamedTuple):
    """Extremes of position [rad], velocity [rad/s] and acceleration [rad/s^2] of n joints."""

    q: Extremes
    dq: Extremes
    ddq: Extremes


@dataclass(frozen=True)
class FourierSeries:
    """Periodic motion of n joints with L harmonics (Swevers et al. 1997, eq. 11), w = 2 pi base_frequency.

    q_i(t) = q0_i + sum_l a_il / (w l) sin(w l t) - b_il / (w l) cos(w l t),
    dq_i(t) = sum_l a_il cos(w l t) + b_il sin(w l t), ddq_i(t) = sum_l -a_il w l sin(w l t) + b_il w l cos(w l t).
    base_frequency Hz, q0 [n] rad, a and b [n, L] rad/s (m and m/s on a prismatic joint).
    """

    base_frequency: float
    q0: Array
    a: Array
    b: Array

    def __post_init__(self) -> None:
        """Freeze the coefficients and check that they agree; ValueError otherwise."""
        if not (np.isfinite(self.base_frequency) and self.base_frequency > 0):
            raise ValueError(f"a positive base frequency was expected, got {self.base_frequency}")
        q0 = frozen_array(self.q0, None)
        a = frozen_array(self.a, len(q0), None)
        object.__setattr__(self, "q0", q0)
        object.__setattr__(self, "a", a)
        object.__setattr__(self, "b", frozen_array(self.b, *a.shape))

    @property
    def joints(self) -> int:
        """Number of joints n."""
        return int(self.a.shape[0])

    @property
    def harmonics(self) -> int:
        """Number of harmonics L."""
        return int(self.a.shape[1])

    @property
    def period(self) -> float:
        """Period T [s]."""
        return 1.0 / self.base_frequency

    @property
    def frequencies(self) -> Array:
        """Angular frequencies w l [L] rad/s."""
        return np.asarray(2.0 * np.pi * self.base_frequency * np.arange(1.0, self.harmonics + 1.0))

    def motion(self, t: Array) -> Motion:
        """Return position, velocity and acceleration at instants t [N] s."""
        w = self.frequencies
        angle = np.outer(np.asarray(t, dtype=float), w)
        sin, cos = np.sin(angle), np.cos(angle)
        return Motion(
            q=self.q0 + sin @ (self.a / w).T - cos @ (self.b / w).T,
            dq=cos @ self.a.T + sin @ self.b.T,
            ddq=cos @ (self.b * w).T - sin @ (self.a * w).T,
        )

    def jerk_bound(self) -> Array:
        """Return a bound of |d^3 q / dt^3| [n] rad/s^3: the sum of the harmonics' amplitudes."""
        return np.asarray(np.hypot(self.a, self.b) @ self.frequencies**2)

    def extremes(self) -> MotionExtremes:
        """Return the exact extremes over a period, in continuous time."""
        w = self.frequencies
        zero = np.zeros(self.joints)
        return MotionExtremes(
            q=trigonometric_extremes(self.q0, -self.b / w, self.a / w, self.base_frequency),
            dq=trigonometric_extremes(zero, self.a, self.b, self.base_frequency),
            ddq=trigonometric_extremes(zero, self.b * w, -self.a * w, self.base_frequency),
        )


def trigonometric_extremes(mean: Array, cosine: Array, sine: Array, base_frequency: float) -> Extremes:
    """Return the extremes of mean + sum_l cosine_l cos(w l t) + sine_l sin(w l t) over a period, joint by joint.

    With z = exp(i w t) the derivative is a polynomial in z: its roots on the unit circle are the stationary points.
    The angles of all roots are taken, for an error e of a double root that leaves the circle moves the extreme by e^2
    only; a grid stands beside them for the signals that are (nearly) constant. mean [n], cosine and sine [n, L].
    """
    harmonics = cosine.shape[1]
    order = np.arange(1, harmonics + 1)
    grid = np.linspace(0.0, 2.0 * np.pi, 16 * harmonics + 1)[:-1]
    lower, upper = np.empty((2, len(mean))), np.empty((2, len(mean)))
    for joint, (c, s) in enumerate(zip(cosine, sine, strict=True)):
        angle = np.concatenate([_stationary_angles(c, s), grid])
        values = mean[joint] + np.cos(np.outer(angle, order)) @ c + np.sin(np.outer(angle, order)) @ s
        for out, k in ((lower, np.argmin(values)), (upper, np.argmax(values))):
            out[:, joint] = values[k], angle[k] / (2.0 * np.pi * base_frequency)
    return Extremes(lower[0], lower[1], upper[0], upper[1])


def _stationary_angles(cosine: Array, sine: Array) -> Array:
    """Return angles [0, 2 pi) among which are all stationary points of sum_l cosine_l cos(l x) + sine_l sin(l x)."""
    order = np.arange(1, len(cosine) + 1)
    slope = 0.5 * order * (sine + 1j * cosine)  # coefficients of z^l in the derivative; those of z^-l are conjugate
    size = np.abs(slope)
    present = np.flatnonzero(size > _NEGLIGIBLE * size.max()) if size.any() else np.zeros(0, dtype=int)
    if not len(present):
        return np.zeros(1)
    positive = slope[: present[-1] + 1]
    polynomial = np.concatenate([positive[::-1], [0.0], positive.conj()])
    return np.asarray(np.mod(np.angle(np.roots(polynomial)), 2.0 * np.pi))
