"""Are efforts and positions of one time, and do recordings agree on how fast it runs? Held against the arm's motion.

A recording's efforts belong to its positions where no other shift of time explains them better, all joints together.
Weight knows no time and inertia goes with the square of its scale, so that two recordings of one arm whose weights are
alike and whose inertias differ by one factor on every joint were stamped by clocks of different pace.
"""

from __future__ import annotations

from collections.abc import Sequence
from itertools import combinations
from typing import Protocol

import numpy as np

from robot_ident.estimation.declaration import Declared, by_clock
from robot_ident.signals.motion import Array

_NEAR = 0.25  # s; a delay or a drive's lag up to that is an effect of the robot, not another time
_CLEARLY = 0.9  # of what is left over as stamped, that another shift leaves at most: a motion that repeats ties


class Rows(Protocol):
    """The rows of a measurement that count, as `effort_checks` has them."""

    @property
    def moving(self) -> Sequence[int]:
        """The joints that move."""

    @property
    def spacing(self) -> float:
        """Time from row to row [s]."""

    @property
    def efforts(self) -> Sequence[Array]:
        """The efforts [K, n] of every period, or of the whole recording."""

    def columns(self, joint: int) -> Array:
        """Return what the motion can make of a joint's effort [K, 6], the last one an offset."""


def out_of_step(rows: Rows) -> list[str]:
    """Say that efforts are of another time than positions: shifted by one time, all of them fit the motion better.

    A shift by s leaves 1 - |Q_j' tau_j(t + s)|^2 / |tau_j|^2 of joint j, Q_j an orthonormal basis of what its motion
    can make of an effort; the least of the mean over the joints within a quarter of a second is held against the least
    beyond it, round a period or the recording.
    """
    bases = [_basis(rows.columns(joint)) for joint in rows.moving]
    near = max(1, round(_NEAR / rows.spacing))
    found = []
    for number, efforts in enumerate(rows.efforts if bases else (), start=1):
        left = [_left(basis, efforts[:, joint]) for basis, joint in zip(bases, rows.moving, strict=True)]
        total = np.mean(left, axis=0)
        if len(total) < 3 * near:
            return []
        best = near + int(np.argmin(total[near : len(total) - near + 1]))
        here = min(total[:near].min(), total[len(total) - near + 1 :].min())
        shift = (best if best <= len(total) // 2 else best - len(total)) * rows.spacing
        found.append((float(total[best] / here), number, here, total[best], -shift))
    ratio, number, here, there, shift = min(found, default=(1.0, 0, 0.0, 0.0, 0.0))
    if ratio > _CLEARLY:
        return []
    which = f" in period {number}" if len(found) > 1 else ""
    return [
        f"the efforts{which} are not of the same time as the positions: the motion leaves {100 * here:.2g} % of their"
        f" power, {100 * there:.2g} % where they are shifted by {shift:+.3g} s (efforts of another run, samples lost,"
        " or clocks apart); record motion and effort together"
    ]


def _basis(columns: Array) -> Array:
    """Return the spectrum of an orthonormal basis of columns [K, k]."""
    size = np.linalg.norm(columns, axis=0)
    seen = size > 1e-9 * size.max()
    basis, _ = np.linalg.qr(columns[:, seen] / size[seen])
    return np.asarray(np.fft.rfft(basis, axis=0))


def _left(basis: Array, tau: Array) -> Array:
    """Return by circular shift [K] of an effort [K] the part of its power that a basis of a given spectrum leaves."""
    about = tau - tau.mean()
    products = np.fft.irfft(np.conj(basis) * np.fft.rfft(about)[:, None], len(tau), axis=0)
    return np.asarray(1.0 - np.sum(products**2, axis=1) / max(float(about @ about), 1e-300))


def clocks_apart(sources: Sequence[str], judged: Sequence[Sequence[Declared]]) -> str:
    """Return which two recordings' clocks run at different paces, in a sentence; or nothing.

    judged: by recording and joint the shares of the URDF's weight and inertia that the efforts hold. Their ratios don't
    know the URDF's masses.
    """
    for (first, before), (second, after) in combinations(zip(sources, judged, strict=True), 2):
        ratios = [
            Declared(
                a.joint, a.share, a.std, "consistent", "", b.gravity / a.gravity, b.inertia / a.inertia, 0.0, least
            )
            for a, b in zip(before, after, strict=True)
            if (least := min(a.explained, b.explained)) and a.gravity and a.inertia
        ]
        told = [one for one in by_clock(ratios) if one.verdict == "clock"]
        if told:
            factor = float(np.median([one.inertia for one in told]))
            pace = factor**0.5 if factor > 1.0 else factor**-0.5
            fast, slow = (second, first) if factor > 1.0 else (first, second)
            return (
                f"{fast} and {slow} contradict each other: weight is alike and inertia"
                f" {max(factor, 1 / factor):.3g} times as large on every joint, so that the stamps of {fast} run"
                f" {pace:.3g} times as fast as those of {slow}; record anew, or put the times right"
            )
    return ""
