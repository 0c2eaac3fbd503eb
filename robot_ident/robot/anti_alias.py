"""The analogue low pass in front of the torque converter, by its poles."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from robot_ident.signals.motion import Array

Response = NDArray[np.complex128]
Section = tuple[float, ...]  # (frequency [Hz], quality) of a pair of poles, or (frequency [Hz],) of a real one


@dataclass(frozen=True)
class AntiAlias:
    """Analogue low pass with gain 1 at rest: H(s) = prod_k 1 / (1 + s / (w_k Q_k) + (s / w_k)^2).

    Without `sections` the Butterworth filter of `order` with its -3 dB at `cutoff` Hz; with them the filter of these
    natural frequencies w_k / 2 pi [Hz] and qualities Q_k (a section of a frequency alone: 1 / (1 + s / w_k)), as
    `robot_ident filter` identifies it; order and cutoff are then what follows from them.
    """

    order: int
    cutoff: float
    sections: tuple[Section, ...] = ()

    @classmethod
    def of_sections(cls, sections: Sequence[Sequence[float]]) -> AntiAlias:
        """Return the filter of sections; its cutoff is where the gain first falls below 1 / sqrt 2."""
        kept = tuple(tuple(float(value) for value in section) for section in sections)
        whole = cls(sum(len(section) for section in kept), 1.0, kept)
        return cls(whole.order, whole.passes(np.sqrt(0.5)), kept)

    @property
    def poles(self) -> Response:
        """Poles [order] rad/s."""
        if not self.sections:
            angles = np.pi * (2.0 * np.arange(1, self.order + 1) + self.order - 1) / (2.0 * self.order)
            return np.asarray(2.0 * np.pi * self.cutoff * np.exp(1j * angles))
        found: list[complex] = []
        for frequency, *quality in self.sections:
            w = 2.0 * np.pi * frequency
            found += np.roots([1.0 / w**2, 1.0 / (w * quality[0]), 1.0]).tolist() if quality else [complex(-w)]
        return np.array(found)

    def response(self, frequency: Array) -> Response:
        """Return H [K] at frequencies [K] Hz."""
        s = 2j * np.pi * np.asarray(frequency)
        gain = np.ones(s.shape, dtype=complex)
        for pole in self.poles:
            gain = gain * (-pole) / (s - pole)
        return gain

    def passes(self, gain: float) -> float:
        """Return the lowest frequency [Hz] at which |H| falls below a gain."""
        if not self.sections:
            return float(self.cutoff * (1.0 / gain**2 - 1.0) ** (0.5 / self.order))
        from scipy.optimize import brentq

        grid = np.geomspace(1e-3, 1e3, 4000) * max(section[0] for section in self.sections)
        first = int(np.argmax(np.abs(self.response(grid)) < gain))

        def above(frequency: float) -> float:
            return float(np.abs(self.response(np.array([frequency])))[0]) - gain

        return float(brentq(above, grid[first - 1], grid[first], xtol=1e-12 * grid[first]))

    @property
    def delay(self) -> float:
        """Delay [s] of slow signals, the sum of -1 / Re(pole) parts: -d phase / d w at 0."""
        return float(np.sum(np.real(-1.0 / self.poles)))

    @property
    def words(self) -> str:
        """The filter in words."""
        kind = "identified filter" if self.sections else "Butterworth filter"
        return f"{kind} of order {self.order} at {self.cutoff:.4g} Hz"
