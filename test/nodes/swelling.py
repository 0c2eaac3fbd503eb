"""A short motion from rest into a periodic one."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from robot_ident.signals.motion import Array, Motion
from robot_ident.trajectories.fourier_series import FourierSeries


@dataclass(frozen=True)
class Swelling:
    """A series that swells from rest to its full size within two seconds."""

    series: FourierSeries
    duration: float = 7.0

    @property
    def start_pose(self) -> Array:
        return self.series.q0

    def reference(self, t: Array) -> Motion:
        m = self.series.motion(t)
        s = np.clip(np.asarray(t) / 2.0, 0.0, 1.0)[:, None]
        f, df, ddf = s**3 * (10 - 15 * s + 6 * s * s), 15 * (s - s * s) ** 2, 15 * (s - 3 * s * s + 2 * s**3)
        away = m.q - self.series.q0
        return Motion(self.series.q0 + f * away, f * m.dq + df * away, f * m.ddq + 2 * df * m.dq + ddf * away)
